"""Foot strikes and foot offs of a run: when the lowest point of a sole is near the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.analysis.phases import contacts
from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

NEAR = 0.025
"""A sole is on the ground where its lowest point is within this share of the leg's length of where it gets lowest."""
FLIGHT = 0.05
"""A run has both feet off the ground for more than this share of the time; of walks only noise has."""
SHORTEST = 0.05
"""Contacts and flights shorter than this are noise [s]."""


def sole_heights(model: Model, motion: Motion, feet: Sequence[str]) -> tuple[Array, float]:
    """Height of the lowest point of each sole (frames, feet) and the length of a leg, hip to sole [m].

    Points are heel and ball: the foot's origin, and twice the way from there to its center of mass.
    """
    tree = compile_tree(model)
    known = np.isfinite(motion.values).all(axis=1)
    values = tree.coordinates_of(motion)
    values[~known] = tree.defaults
    poses = forward_kinematics(tree, values)
    up = np.asarray(model.up)
    heights = np.empty((len(motion), len(feet)))
    for k, name in enumerate(feet):
        b = tree.body_index[name]
        heel = poses.origins[:, b]
        ball = heel + 2.0 * poses.rotations[:, b] @ model.body(name).mass_center
        heights[:, k] = np.minimum(heel @ up, ball @ up)
    heights[~known] = np.nan
    root = poses.origins[:, tree.body_index[model.body_names[0]]] @ up
    leg = float(np.nanpercentile(root[:, None] - heights, 95.0)) if known.any() else 0.0
    return heights, leg


def running_contacts(
    model: Model, motion: Motion, feet: Sequence[str]
) -> Mapping[str, tuple[tuple[float, float], ...]]:
    """Contact intervals of each foot in a run [s]; none for a walk, in which a foot is always on the ground.

    The events that tell a walk's contacts, a foot farthest ahead of and behind the trunk, are far from a runner's:
    a foot goes on backward after it has left the ground.

    Parameters
    ----------
    motion : coordinates (frames, coordinates) [rad or m]
    feet : bodies
    """
    heights, leg = sole_heights(model, motion, feet)
    if not leg > 0.0 or len(motion) < 2:
        return {}
    lowest = np.nanpercentile(heights, 5.0, axis=0)
    near = heights < lowest + NEAR * leg
    seen = np.isfinite(heights).all(axis=1)
    if not seen.any() or float((~near[seen]).all(axis=1).mean()) < FLIGHT:
        return {}
    shortest = min(SHORTEST, 0.05 * float(np.ptp(motion.time)))
    found = {}
    for k, name in enumerate(feet):
        rows = contacts(motion.time, near[:, k].astype(np.float64), 0.5, shortest)
        found[name] = tuple(
            (float(motion.time[start]), float(motion.time[min(stop, len(motion) - 1)]))
            for start, stop in rows
            if start > 0 and stop < len(motion) - 1
        )
    return found
