"""The other side of a body: a left leg from a right one, models and bones.

Lives here: planes of symmetry, names of sides, and the reflection of each part of a model. Never
here: the detection of which side a scan is, which `registration/` checks.
"""
