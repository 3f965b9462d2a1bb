"""One bone found in another: its pose, the position of each of its points, and faults of the match.

Lives here: rigid and non-rigid registration of surfaces, landmarks found by rule, clusters of
markers on bones, and the checks of all of these. Ends with a `BoneMap`. Never here: muscles,
joints, or any other part of a model.
"""
