"""How large a body is beside a human one, so that what is small for a human is small for a mouse too."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.series import Motion
from myomorph.motion.lengths import joint_centers
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree

HUMAN_SEGMENT = 0.24
"""A body whose longest segment is that long, as an adult's forearm, or longer is of human size [m]."""


def length_unit(tree: Tree) -> float:
    """What stands for one metre in tolerances and usual distances: 1 for a body of human size, else less in proportion.

    unit = min(1, longest segment / 0.24 m), a segment being the distance of a joint's center to that of its
    body's parent or to a marker of its body.
    """
    poses = forward_kinematics(tree, tree.coordinates_of(Motion(np.zeros(1), (), np.zeros((1, 0)))))
    centers = joint_centers(tree, poses.axis_points[0], poses.origins[0])
    joined = np.flatnonzero(tree.arrays.parent > 0)
    spans = np.linalg.norm(centers[joined] - centers[tree.arrays.parent[joined]], axis=1)
    bodies = np.array([tree.body_index[one.body] for one in tree.model.markers], np.int64)
    places = poses.points(bodies, np.array([one.location for one in tree.model.markers]).reshape(-1, 3))[0]
    marked = bodies > 0
    spans = np.concatenate([spans, np.linalg.norm(places - centers[bodies], axis=1)[marked]])
    longest = float(spans.max(initial=0.0))
    return min(1.0, longest / HUMAN_SEGMENT) if longest > 0.0 else 1.0


def coordinate_units(tree: Tree) -> Array:
    """(coordinates,) by what a change of each is measured: 1 rad, or `length_unit` where it slides."""
    slides = np.array([one.motion == "translational" for one in tree.model.coordinates])
    return np.where(slides, length_unit(tree), 1.0)
