"""Rotations and rigid transforms as small NumPy values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array, frozen_array, read_only


def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) by `angle` [rad] about the unit vector `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def rotation_from_euler_xyz(angles: ArrayLike) -> Array:
    """Rotation matrix of body-fixed X, Y, Z rotations [rad], as OpenSim writes orientations."""
    a, b, c = np.asarray(angles, dtype=np.float64)
    return axis_rotation((1, 0, 0), a) @ axis_rotation((0, 1, 0), b) @ axis_rotation((0, 0, 1), c)


def euler_xyz_from_rotation(rotation: ArrayLike) -> Array:
    """Body-fixed X, Y, Z angles [rad] of a rotation matrix; Z is 0 where X and Z cannot be told apart."""
    r = np.asarray(rotation, dtype=np.float64)
    b = np.arcsin(np.clip(r[0, 2], -1.0, 1.0))
    if abs(r[0, 2]) < 1.0 - 1e-14:
        return np.array([np.arctan2(-r[1, 2], r[2, 2]), b, np.arctan2(-r[0, 1], r[0, 0])])
    return np.array([np.arctan2(r[2, 1], r[1, 1]), b, 0.0])


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z), normalised here."""
    q = np.asarray(quaternion, dtype=np.float64)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@read_only
@dataclass(frozen=True, eq=False)
class Transform:
    """Pose of a frame B in a frame A: x_A = rotation @ x_B + translation.

    Attributes
    ----------
    rotation : (3, 3) axes of B in A as columns
    translation : (3,) origin of B in A [m]
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_array(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", frozen_array(self.translation, (3,)))

    @staticmethod
    def identity() -> Transform:
        """The transform that changes nothing."""
        return Transform(np.eye(3), np.zeros(3))

    @staticmethod
    def from_euler_xyz(angles: ArrayLike, translation: ArrayLike) -> Transform:
        """Transform of body-fixed X, Y, Z angles [rad] and a translation [m]."""
        return Transform(rotation_from_euler_xyz(angles), np.asarray(translation, dtype=np.float64))

    def __matmul__(self, other: Transform) -> Transform:
        """Composition: `(A @ B).apply(x) == A.apply(B.apply(x))`."""
        return Transform(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Transform:
        """The transform back."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of B expressed in A."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
