"""Simulated performers with known truth, and the demonstrations."""
