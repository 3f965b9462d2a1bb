"""Figures of the documentation that are drawn from measurements."""
