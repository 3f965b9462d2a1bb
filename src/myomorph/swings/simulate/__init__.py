"""Swinging limbs and their laboratory, simulated with known truth."""
