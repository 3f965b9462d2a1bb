"""Maps from the space around one bone to the space around another: points in, points out.

Lives here: kinds of maps, their Jacobians, their fits to pairs of points, and `BoneMap`, a map with
what it was derived from. Never here: how pairs of points are found, or what a model's parts make of
a map.
"""
