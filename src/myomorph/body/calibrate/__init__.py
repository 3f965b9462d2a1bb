"""The problem that all frames of a body share: its unknowns, priors, fit, and what fixes the zero
of every angle.
"""
