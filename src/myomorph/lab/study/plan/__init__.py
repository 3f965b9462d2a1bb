"""A study file read into a plan: subjects, trials, measures, conditions and groups.

Every mistake is found at once. It runs nothing.
"""
