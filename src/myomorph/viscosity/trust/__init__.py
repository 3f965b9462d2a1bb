"""How far to trust an identified viscosity: other passive laws, other cutoffs, moment arms in error, faults.

Nothing here changes the result itself.
"""
