"""The center of mass of the whole body over time."""

from __future__ import annotations

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.rigid.tree import compile_tree

NAMES = ("center_of_mass_x", "center_of_mass_y", "center_of_mass_z")
_CHUNK = 1024


def centroid(model: Model, motion: Motion) -> Series:
    """Center of mass of all bodies in ground.
    x = sum_b m_b x_b / sum_b m_b, from the poses of the bodies.
    `model`: with masses; `motion`: coordinates over time. Returns Series of (frames, 3) `center_of_mass_x`, `_y`, `_z`
    [m], NaN where the motion is NaN or the model weighs nothing.
    """
    if model.mass <= 0.0:
        return Series(motion.time, NAMES, np.full((len(motion), 3), np.nan))
    tree = compile_tree(model)
    values = np.empty((len(motion), 3))
    coordinates = tree.coordinates_of(motion)
    for start in range(0, len(motion), _CHUNK):
        part = slice(start, start + _CHUNK)
        values[part] = center_of_mass(tree, forward_kinematics(tree, coordinates[part]))
    return Series(motion.time, NAMES, values)
