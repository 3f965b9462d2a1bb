"""Masses, inertias and bodies."""
