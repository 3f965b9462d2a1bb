"""Recordings with known truth: virtual subjects, limbs and fighters that demos, benchmarks and
tests measure against.

Nothing that estimates lives here.
"""
