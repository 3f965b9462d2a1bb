"""One bone found in another: how it lies, where each of its points is, and what is wrong with the
match.

Lives here: rigid and non-rigid registration of surfaces, landmarks found by rule, clusters of
markers on bones, and the checks of all of these. Ends with a `BoneMap`. Never here: muscles,
joints, or any other part of a model.
"""
