"""Comparisons of accuracy, one module per subject.

Each returns the rows of the tables in docs/validation.
"""
