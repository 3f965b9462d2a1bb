"""Rotations and rigid transforms as small NumPy values."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, read_only

# Of axis x, y and z
NEXT_AXIS = np.array([1, 2, 0])
LAST_AXIS = np.array([2, 0, 1])


def axis_rotation(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix about an axis (Rodrigues).

        R = 1 + sin(angle) [axis]x + (1 - cos(angle)) [axis]x^2

    Parameters
    ----------
    axis : (3,) unit vector
    angle : [rad]

    Returns
    -------
    (3, 3)
    """
    x, y, z = np.asarray(axis, dtype=np.float64)
    c = np.cos(angle)
    s = np.sin(angle)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def cross_products(first: Array, second: Array) -> Array:
    """Cross products of vectors in the last axis, as `numpy.cross`.

    Of the few vectors of a live frame that function takes ten times as long.

    Parameters
    ----------
    first, second : (..., 3)

    Returns
    -------
    (..., 3)
    """
    ahead = first.take(NEXT_AXIS, -1) * second.take(LAST_AXIS, -1)
    return ahead - first.take(LAST_AXIS, -1) * second.take(NEXT_AXIS, -1)


def least_rotation(source: Array, target: Array) -> Array:
    """Find the least rotation that brings one unit vector onto another.

    Parameters
    ----------
    source, target : (3,) unit vectors

    Returns
    -------
    (3, 3)
    """
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
    """Rotation matrix of body-fixed X, Y, Z rotations, as OpenSim writes orientations.

    Parameters
    ----------
    angles : (3,) [rad]

    Returns
    -------
    (3, 3)
    """
    a, b, c = np.asarray(angles, dtype=np.float64)
    return axis_rotation((1, 0, 0), a) @ axis_rotation((0, 1, 0), b) @ axis_rotation((0, 0, 1), c)


def euler_xyz_from_rotation(rotation: ArrayLike) -> Array:
    """Body-fixed X, Y, Z angles of rotation matrices.

    Parameters
    ----------
    rotation : (..., 3, 3)

    Returns
    -------
    (..., 3) [rad]; Z is 0 where X and Z cannot be separated
    """
    r = np.asarray(rotation, dtype=np.float64)
    separable = np.abs(r[..., 0, 2]) < 1.0 - 1e-14
    x = np.arctan2(-r[..., 1, 2], r[..., 2, 2])
    x_and_z = np.arctan2(r[..., 2, 1], r[..., 1, 1])
    y = np.arcsin(np.clip(r[..., 0, 2], -1.0, 1.0))
    z = np.where(separable, np.arctan2(-r[..., 0, 1], r[..., 0, 0]), 0.0)
    return np.stack([np.where(separable, x, x_and_z), y, z], axis=-1)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrices of quaternions.

    Parameters
    ----------
    quaternion : (..., 4) in the order w, x, y, z, of any norm above 0

    Returns
    -------
    (..., 3, 3)
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
    """Rotation matrices of rotation vectors.

    Parameters
    ----------
    vector : (..., 3) axis times angle [rad]

    Returns
    -------
    (..., 3, 3)
    """
    v = np.asarray(vector, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    half = 0.5 * np.sinc(0.5 * angle / np.pi) * v
    return rotation_from_quaternion(np.concatenate([np.cos(0.5 * angle), half], axis=-1))


def vector_from_rotation(rotation: ArrayLike) -> Array:
    """Rotation vectors of rotation matrices.

    With the quaternion (w, u) and s = |u| = sin(angle / 2), the vector is 2 atan2(s, w) / s u; the
    factor tends to 2 where s does to 0.

    Parameters
    ----------
    rotation : (..., 3, 3)

    Returns
    -------
    (..., 3) axis times angle [rad]
    """
    q = quaternion_from_rotation(rotation)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    turns = sine > 1e-12
    factor = 2.0 * np.arctan2(sine, q[..., :1]) / np.where(turns, sine, 1.0)
    return np.asarray(np.where(turns, factor, 2.0) * q[..., 1:])


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Quaternions of rotation matrices.

    Of the four ways to compute one, that with the largest divisor.

    Parameters
    ----------
    rotation : (..., 3, 3)

    Returns
    -------
    (..., 4) in the order w, x, y, z; w is not negative
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
    """Spread unit vectors evenly over the sphere, along a spiral.

    Parameters
    ----------
    count : of vectors

    Returns
    -------
    (count, 3)
    """
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
        """Make the transform that changes nothing."""
        return Transform(np.eye(3), np.zeros(3))

    @staticmethod
    def from_euler_xyz(angles: ArrayLike, translation: ArrayLike) -> Transform:
        """Make a transform of angles and a translation.

        Parameters
        ----------
        angles : (3,) body-fixed X, Y, Z [rad]
        translation : (3,) [m]
        """
        return Transform(rotation_from_euler_xyz(angles), np.asarray(translation, dtype=np.float64))

    def __matmul__(self, other: Transform) -> Transform:
        """Composition: `(A @ B).apply(x) == A.apply(B.apply(x))`."""
        return Transform(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Transform:
        """Invert: the pose of A in B."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Express points of B in A.

        Parameters
        ----------
        points : (..., 3) in B [m]

        Returns
        -------
        (..., 3) in A [m]
        """
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
