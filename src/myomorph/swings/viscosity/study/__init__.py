"""From a study file of specimens to its results: files, steps, tables.

It computes nothing and draws no page.
"""
