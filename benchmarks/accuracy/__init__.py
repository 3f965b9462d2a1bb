"""Comparisons of accuracy, a module a subject; each returns the rows of the tables in
docs/validation.
"""
