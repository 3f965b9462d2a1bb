"""The equations of a rigid limb on a fixed joint, straight from its markers: a short cut for virtual limbs.

Specimens go through `identify.specimen` and `identify.swing_rows`; here the joint's center and the limb's shape
are known, so a few lines suffice.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.model.arrays import Array
from myomorph.viscosity.swings.motion import continuous
from myomorph.viscosity.swings.recording import PARAMETERS


def poses_of(seen: Array, places: Array, axis: Array | None) -> Array:
    """Quaternions (frames, 4) that turn places (markers, 3) onto what was seen (frames, markers, 3)."""
    if axis is not None:
        angle = np.arctan2(
            np.einsum("fmi,mi->f", seen, np.cross(axis, places)),
            np.einsum("fmi,mi->f", seen, places - np.outer(places @ axis, axis)),
        )
        half = 0.5 * np.unwrap(angle)[:, None]
        return np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
    left, _, right = np.linalg.svd(np.einsum("fmi,mj->fij", seen, places))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return continuous(Rotation.from_matrix(left @ right).as_quat(scalar_first=True))


def moment_rows(rotations: Array, rates: Array, accelerations: Array, gravity: Array) -> tuple[Array, Array]:
    """(frames, 3, 10) moment about a fixed point of the body and force that unit parameters need, in its axes.

    n = I alpha + omega x I omega - m c x g,  f = -m g + alpha x m c + omega x (omega x m c).
    """
    weight = np.einsum("fji,j->fi", rotations, gravity)
    moment, force = np.zeros((2, len(rates), 3, PARAMETERS))
    turning = _skew(rates)
    moment[:, :, 1:4] = _skew(weight)
    moment[:, :, 4:] = _inertia_columns(accelerations) + turning @ _inertia_columns(rates)
    force[:, :, 0] = -weight
    force[:, :, 1:4] = _skew(accelerations) + turning @ turning
    return moment, force


def _skew(vectors: Array) -> Array:
    """Matrices (frames, 3, 3) that cross these vectors (frames, 3) with others."""
    table = np.zeros((len(vectors), 3, 3))
    table[:, 2, 1], table[:, 0, 2], table[:, 1, 0] = vectors.T
    return table - np.swapaxes(table, 1, 2)


def _inertia_columns(vectors: Array) -> Array:
    """(frames, 3, 6) with columns I_xx, I_yy, I_zz, I_yz, I_zx, I_xy of I @ vector."""
    x, y, z = vectors.T
    table = np.zeros((len(vectors), 3, 6))
    table[:, 0, 0], table[:, 1, 1], table[:, 2, 2] = x, y, z
    table[:, 1, 3], table[:, 2, 3] = z, y
    table[:, 2, 4], table[:, 0, 4] = x, z
    table[:, 0, 5], table[:, 1, 5] = y, x
    return table
