"""The center of mass of the whole body over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

NAMES = ("center_of_mass_x", "center_of_mass_y", "center_of_mass_z")
_CHUNK = 1024


def centroid(model: Model, motion: Motion, bodies: Sequence[str] = ()) -> Series:
    """Compute the center of mass of all bodies or of those named.

        c = sum_b m_b x_b / sum_b m_b

    The result is a Series of (frames, 3) `center_of_mass_x`, `_y`, `_z` in ground [m]. It is NaN
    where the motion is NaN or where the model weighs nothing.
    """
    if model.mass <= 0.0:
        return Series(motion.time, NAMES, np.full((len(motion), 3), np.nan))
    tree = compile_tree(model)
    chosen = np.array([tree.body_index[body] for body in bodies or model.body_names])
    mass = tree.arrays.mass[chosen]
    centers = tree.arrays.mass_center[chosen]
    values = np.empty((len(motion), 3))
    coordinates = tree.coordinates_of(motion)
    for start in range(0, len(motion), _CHUNK):
        part = slice(start, start + _CHUNK)
        places = forward_kinematics(tree, coordinates[part]).points(chosen, centers)
        values[part] = np.einsum("b,fbi->fi", mass / mass.sum(), places)
    return Series(motion.time, NAMES, values)
