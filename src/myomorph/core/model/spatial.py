"""Rotations and rigid transforms as small NumPy values."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, read_only


def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) by `angle` [rad] about the unit vector `axis` (Rodrigues)."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    c = np.cos(angle)
    s = np.sin(angle)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def least_rotation(source: Array, target: Array) -> Array:
    """The least rotation (3, 3) that brings one unit vector (3,) onto another."""
    axis = np.cross(source, target)
    cosine = float(source @ target)
    sine = float(np.linalg.norm(axis))
    if sine >= 1e-12:
        return axis_rotation(axis / sine, float(np.arctan2(sine, cosine)))
    if cosine > 0.0:
        return np.eye(3)
    aside = np.cross(source, np.eye(3)[int(np.argmin(np.abs(source)))])
    return axis_rotation(aside / np.linalg.norm(aside), np.pi)


def rotation_from_euler_xyz(angles: ArrayLike) -> Array:
    """Rotation matrix of body-fixed X, Y, Z rotations [rad], as OpenSim writes orientations."""
    a, b, c = np.asarray(angles, dtype=np.float64)
    return axis_rotation((1, 0, 0), a) @ axis_rotation((0, 1, 0), b) @ axis_rotation((0, 0, 1), c)


def euler_xyz_from_rotation(rotation: ArrayLike) -> Array:
    """Body-fixed X, Y, Z angles (..., 3) [rad] of rotation matrices; Z is 0 where X and Z cannot be
    separated.
    """
    r = np.asarray(rotation, dtype=np.float64)
    apart = np.abs(r[..., 0, 2]) < 1.0 - 1e-14
    first = np.where(
        apart, np.arctan2(-r[..., 1, 2], r[..., 2, 2]), np.arctan2(r[..., 2, 1], r[..., 1, 1])
    )
    last = np.where(apart, np.arctan2(-r[..., 0, 1], r[..., 0, 0]), 0.0)
    return np.stack([first, np.arcsin(np.clip(r[..., 0, 2], -1.0, 1.0)), last], axis=-1)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in the order w, x, y, z, normalised
    here.
    """
    q = np.asarray(quaternion, dtype=np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_from_vector(vector: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    v = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    half = 0.5 * np.sinc(0.5 * angle / np.pi) * v
    return rotation_from_quaternion(np.concatenate([np.cos(0.5 * angle), half], axis=-1))


def vector_from_rotation(rotation: ArrayLike) -> Array:
    """Rotation vectors (..., 3) [rad] of rotation matrices (..., 3, 3)."""
    q = quaternion_from_rotation(rotation)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    stretch = np.where(
        sine > 1e-12, 2.0 * np.arctan2(sine, q[..., :1]) / np.where(sine > 1e-12, sine, 1.0), 2.0
    )
    return np.asarray(stretch * q[..., 1:])


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Quaternions (..., 4) in the order w, x, y, z, w not negative, of rotation matrices (..., 3,
    3). Of the four ways to compute one, that with the largest divisor.
    """
    r = np.asarray(rotation, dtype=np.float64)
    trace = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    # Four times the outer product of the quaternion with itself.
    outer = np.empty((*r.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1.0 + trace
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        outer[..., i + 1, i + 1] = 1.0 + 2.0 * r[..., i, i] - trace
        outer[..., 0, i + 1] = outer[..., i + 1, 0] = r[..., k, j] - r[..., j, k]
        outer[..., j + 1, k + 1] = outer[..., k + 1, j + 1] = r[..., j, k] + r[..., k, j]
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.asarray(np.where(row[..., :1] < 0.0, -row, row))


def spread_directions(count: int) -> Array:
    """Unit vectors (count, 3) evenly over the sphere, along a spiral."""
    step = np.arange(count) + 0.5
    height = 1.0 - 2.0 * step / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * step
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


@read_only
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
        freeze(self, rotation=(3, 3), translation=(3,))

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
        return Transform(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Transform:
        """The transform back."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of B expressed in A."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
