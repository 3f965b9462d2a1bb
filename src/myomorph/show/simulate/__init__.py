"""Recordings with known truth, which demos, benchmarks and tests measure against.

They are of virtual subjects, limbs and fighters. Nothing that estimates lives here.
"""
