"""Between MuJoCo's `qpos`, with its quaternions, and the coordinates of a model read from MJCF."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.spatial import euler_xyz_from_rotation, rotation_from_euler_xyz, rotation_from_quaternion

WIDTHS = {"free": (7, 6), "ball": (4, 3), "slide": (1, 1), "hinge": (1, 1), "weld": (0, 0)}


def qpos_from_coordinates(model: Model, coordinates: ArrayLike) -> Array:
    """MuJoCo's `qpos` for values of all coordinates of a model that `read_mjcf` made.

    Parameters
    ----------
    coordinates : (..., coordinates) in the model's order [rad or m]

    Returns
    -------
    (..., nq), quaternions as (w, x, y, z) with w >= 0
    """
    c = np.asarray(coordinates, dtype=np.float64)
    if c.shape[-1:] != (len(model.coordinates),):
        raise BadData(f"expected {len(model.coordinates)} coordinates in the last axis, but got shape {c.shape}")
    flat = c.reshape(-1, c.shape[-1])
    rows = []
    for row in flat:
        parts: list[Array] = []
        for kind, _, at, start in _layout(model):
            width = WIDTHS[kind][1]
            values = row[at : at + width]
            if kind in ("free", "ball"):
                turn = rotation_from_euler_xyz(values[-3:]) @ start
                values = np.concatenate([values[:-3], quaternion_from_rotation(turn)])
            parts.append(values)
        rows.append(np.concatenate(parts) if parts else np.zeros(0))
    return np.array(rows).reshape(*c.shape[:-1], -1)


def coordinates_from_qpos(model: Model, qpos: ArrayLike) -> Array:
    """Values of all coordinates for MuJoCo's `qpos` (..., nq); the inverse of `qpos_from_coordinates`.

    Angles of ball and free joints come back in (-pi, pi], the middle one in [-pi/2, pi/2].
    """
    q = np.asarray(qpos, dtype=np.float64)
    layout = list(_layout(model))
    needed = sum(WIDTHS[kind][0] for kind, *_ in layout)
    if q.shape[-1:] != (needed,):
        raise BadData(f"expected qpos of width {needed}, but got shape {q.shape}")
    flat = q.reshape(-1, needed)
    result = np.empty((len(flat), len(model.coordinates)))
    for row, out in zip(flat, result, strict=True):
        for kind, at_q, at_c, start in layout:
            width_q, width_c = WIDTHS[kind]
            values = row[at_q : at_q + width_q]
            if kind in ("free", "ball"):
                turn = rotation_from_quaternion(values[-4:]) @ start.T
                values = np.concatenate([values[:-4], euler_xyz_from_rotation(turn)])
            out[at_c : at_c + width_c] = values
    return result.reshape(*q.shape[:-1], -1)


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Quaternion (w, x, y, z) with w >= 0 of a rotation matrix (3, 3)."""
    r = np.asarray(rotation, dtype=np.float64)
    # q q^T is linear in the rotation, so its largest column is the quaternion at its best scale.
    outer = np.array(
        [
            [1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    q = outer[:, np.argmax(np.diag(outer))]
    q = q / np.linalg.norm(q)
    return -q if q[0] < 0.0 else q


def _layout(model: Model) -> Iterator[tuple[str, int, int, Array]]:
    """Kind, place in qpos, place in coordinates and start orientation of each MuJoCo joint."""
    at_q = at_c = 0
    for joint in model.joints:
        for kind in joint.kind.split("+"):
            if kind not in WIDTHS:
                raise BadData(f"joint '{joint.name}' is a {joint.kind}: only models read from MJCF have a qpos")
            start = joint.child_frame.rotation.T if kind == "free" else np.eye(3)
            yield kind, at_q, at_c, start
            at_q, at_c = at_q + WIDTHS[kind][0], at_c + WIDTHS[kind][1]
