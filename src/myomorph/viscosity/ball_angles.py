"""Angles of joints on the branch on which they are continuous."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.model.arrays import Array
from myomorph.model.series import Motion
from myomorph.viscosity.specimen import Specimen


def on_one_branch(specimen: Specimen, motion: Motion) -> Motion:
    """The same motion with angles that neither jump by a turn nor to the other branch of a ball's three rotations.

    The middle one of three rotations is brought within a quarter turn, the others of a ball within half a turn; a
    joint's only angle may go on beyond.
    """
    values = np.array(motion.values)
    for joint in specimen.model.joints:
        columns = [motion.names.index(name) for name in joint.coordinates if name in motion.names]
        if joint.kind == "ball" and len(columns) == 3:
            order = "".join("XYZ"[int(np.argmax(axis.vector))] for axis in joint.axes[-3:])
            angles = values[:, columns]
            seen = np.isfinite(angles).all(axis=1)
            angles[seen] = Rotation.from_euler(order, angles[seen]).as_euler(order)
            values[:, columns] = angles
        else:
            for k in columns:
                if specimen.model.coordinate(motion.names[k]).motion == "rotational":
                    values[:, k] = _continuous(values[:, k])
    return replace(motion, values=values)


def _continuous(angle: Array) -> Array:
    """An angle (frames,) without jumps by a turn, around zero."""
    seen = np.isfinite(angle)
    unwound = np.array(angle)
    unwound[seen] = np.unwrap(angle[seen])
    middle = np.median(unwound[seen]) if seen.any() else 0.0
    around: Array = unwound - 2.0 * np.pi * np.round(middle / (2.0 * np.pi))
    return around
