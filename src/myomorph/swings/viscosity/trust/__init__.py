"""How far to trust a viscosity: other laws and cutoffs, moment arms in error, faults.

It changes no result.
"""
