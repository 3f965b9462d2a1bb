"""A study file read into a plan: subjects, trials, measures, conditions, groups, and every mistake
at once.

It runs nothing.
"""
