"""Derivatives of a joint's motion; of a ball by its rotation, whose three angles jump where the limb twists far."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.model.arrays import Array
from myomorph.model.series import Motion
from myomorph.motion.filters import differentiate
from myomorph.viscosity.specimen import Specimen


def differentiate_joint(specimen: Specimen, motion: Motion, cutoff: float | None = None) -> Motion:
    """The motion of a specimen's joint with velocities and accelerations, low-pass filtered first.

    As `motion.filters.differentiate`, but a ball is filtered as a quaternion, which no pose makes singular:
    omega = 2 vec(conj(q) dq/dt) / |q|^2. Angles near a quarter turn of the middle rotation have large rates, which
    together still are that omega.

    Parameters
    ----------
    motion : of the joint's coordinates [rad], NaN where it is not known
    cutoff : [Hz]; None for none

    Raises
    ------
    BadData
        where no run of six frames is free of gaps
    """
    if len(specimen.joint_coordinates) == 1:
        return differentiate(motion, cutoff)
    joint = next(one for one in specimen.model.joints if one.child == specimen.first)
    axes = np.array([axis.vector for axis in joint.axes])
    order = "".join("XYZ"[int(np.argmax(axis))] for axis in axes)
    columns = [motion.names.index(name) for name in joint.coordinates]
    angles = motion.values[:, columns]
    seen = np.isfinite(angles).all(axis=1)
    quaternions = np.full((len(motion), 4), np.nan)
    quaternions[seen] = continuous(Rotation.from_euler(order, angles[seen]).as_quat(scalar_first=True))
    found = differentiate(Motion(motion.time, ("w", "x", "y", "z"), quaternions), cutoff)
    assert found.velocities is not None
    assert found.accelerations is not None
    known = np.isfinite(found.values).all(axis=1)
    values, velocities, accelerations = (np.full((len(motion), 3), np.nan) for _ in range(3))
    turns, rates, gains = angular_motion(found.values[known], found.velocities[known], found.accelerations[known])
    values[known] = turns.as_euler(order)
    velocities[known], accelerations[known] = _angle_rates(axes, values[known], rates, gains)
    return Motion(motion.time, tuple(joint.coordinates), values, velocities, accelerations)


def continuous(quaternions: Array) -> Array:
    """Quaternions (frames, 4) with the signs that make each the nearest to the one before."""
    turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    signed: Array = quaternions * np.concatenate([[1.0], np.cumprod(turned)])[: len(quaternions), None]
    return signed


def angular_motion(values: Array, velocities: Array, accelerations: Array) -> tuple[Rotation, Array, Array]:
    """Rotations, angular rates and accelerations (frames, 3) along the body's axes.

    Of quaternions (frames, 4), w first and of any length, and their derivatives: with s = |q|,
    omega = 2 vec(conj(q) q') / s^2 and alpha = 2 vec(conj(q) q'') / s^2 - 2 omega s' / s.
    """
    square = np.sum(values**2, axis=1, keepdims=True)
    growth = np.sum(values * velocities, axis=1, keepdims=True) / square
    rates = 2.0 * _vector_part(values, velocities) / square
    gains = 2.0 * _vector_part(values, accelerations) / square - 2.0 * growth * rates
    return Rotation.from_quat(values, scalar_first=True), rates, gains


def _vector_part(first: Array, second: Array) -> Array:
    """Of conj(first) second, quaternions (frames, 4)."""
    a, u, b, v = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    part: Array = a * v - b * u - np.cross(u, v)
    return part


def _angle_rates(axes: Array, angles: Array, rates: Array, gains: Array) -> tuple[Array, Array]:
    """Rates and accelerations (frames, 3) of body-fixed rotations about `axes` (3, 3), of those along the body's axes.

    omega = S(q) q', alpha = S q'' + S' q'; the columns of S are the axes as the body sees them.
    """
    last, middle = (Rotation.from_rotvec(angles[:, k, None] * axes[k]) for k in (2, 1))
    second = last.apply(np.tile(axes[1], (len(angles), 1)), inverse=True)
    third = np.tile(axes[2], (len(angles), 1))
    first = (middle * last).apply(np.tile(axes[0], (len(angles), 1)), inverse=True)
    slopes = np.stack([first, second, third], axis=2)
    speeds = np.linalg.solve(slopes, rates[..., None])[..., 0]
    beyond = third * speeds[:, 2:]
    changes = (
        -np.cross(beyond + second * speeds[:, 1:2], first) * speeds[:, :1] - np.cross(beyond, second) * speeds[:, 1:2]
    )
    return speeds, np.linalg.solve(slopes, (gains - changes)[..., None])[..., 0]
