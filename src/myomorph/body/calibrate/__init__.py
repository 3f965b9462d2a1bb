"""Kinematic identification: the problem that all frames of a body share.

Its unknowns, priors and fit, and what fixes the zero of every angle.
"""
