"""The motion of a swinging limb: angles without jumps, derivatives, rows of the wrench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.regressor import base_regressor
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.viscosity.specimen.model import Specimen


@read_only
class LimbMotion:
    """A limb in motion about its joint's center, everything distal of the joint one rigid link.

    Attributes
    ----------
    rotations : (frames, 3, 3) to ground
    slopes : (frames, axes, coordinates) d(rate about a free axis)/d(coordinate's velocity)
    rates : (frames, axes) about the free axes [rad/s]
    wrench_rows : (frames, 6, 10) moment about the center and force that unit parameters need, along
        ground axes
    torque_rows : (frames, axes, 10) the moment along the free axes
    """

    rotations: Array
    slopes: Array
    rates: Array
    wrench_rows: Array
    torque_rows: Array


def limb_motion(specimen: Specimen, motion: Motion) -> LimbMotion:
    """Find rotation, rates and rows of a motion of the joint, the base at its stand.

    Parameters
    ----------
    specimen : with the limb
    motion : with derivatives; NaN stays NaN
    """
    pendulum = specimen.pendulum
    tree = compile_tree(pendulum)
    rows = base_regressor(pendulum, motion, specimen.center_in_ground)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    rotations = poses.rotations[:, 1]
    axes = np.einsum("fij,aj->fai", rotations, specimen.axis_vectors)
    slopes = axes @ poses.axis_directions.transpose(0, 2, 1)
    assert motion.velocities is not None
    columns = [motion.names.index(name) for name in specimen.joint_coordinates]
    rates = np.einsum("fac,fc->fa", slopes, motion.velocities[:, columns])
    return LimbMotion(
        rotations=rotations,
        slopes=slopes,
        rates=rates,
        wrench_rows=rows,
        torque_rows=axes @ rows[:, :3],
    )


def on_moving_base(specimen: Specimen, limb: LimbMotion, base: Motion) -> LimbMotion:
    """Put the limb on a base that moves.

    The center's acceleration acts as gravity does; rates are those against the base.

    Parameters
    ----------
    specimen : with the limb
    limb : on a base at rest
    base : displacement of the joint's center and rotation vector, a small one, in ground (frames,
        6), with derivatives
    """
    assert base.velocities is not None
    assert base.accelerations is not None
    acceleration = base.accelerations[:, :3]
    turning = base.velocities[:, 3:]
    rows = np.array(limb.wrench_rows)
    rows[:, 3:, 0] += acceleration
    rows[:, :3, 1:4] += np.cross(
        limb.rotations.transpose(0, 2, 1), acceleration[:, None]
    ).transpose(0, 2, 1)
    axes = np.einsum("fij,aj->fai", limb.rotations, specimen.axis_vectors)
    rates = limb.rates - np.einsum("fai,fi->fa", axes, turning)
    return replace(limb, rates=rates, wrench_rows=rows, torque_rows=axes @ rows[:, :3])


def lengthening(specimen: Specimen, motion: Motion, slopes: Array) -> Array:
    """Find J_M of [S] eq. 3, d(length)/d(angle about a free axis).

    Strands stand muscle after muscle, each divided by the root of their number (see
    `SwingRecording`). Moment arms about the coordinates become arms about the axes by the inverse
    of the slopes.

    Parameters
    ----------
    specimen : with muscles
    motion : of the joint
    slopes : (frames, axes, coordinates) of `LimbMotion`

    Returns
    -------
    (frames, strands, axes) [m/rad], NaN where the motion is
    """
    strands = [(strand, len(muscle)) for muscle in specimen.muscles.values() for strand in muscle]
    result = np.full((len(motion), len(strands), len(specimen.axes)), np.nan)
    seen = np.isfinite(motion.values).all(axis=1)
    if not specimen.muscles or not seen.any():
        return result
    part = Motion(motion.time[seen], motion.names, motion.values[seen])
    arms = muscle_kinematics(specimen.model, part, velocities=False).moment_arm
    columns = [specimen.model.coordinate_names.index(name) for name in specimen.joint_coordinates]
    rows = [specimen.model.muscle_names.index(strand) for strand, _ in strands]
    roots = np.sqrt([count for _, count in strands])
    result[seen] = -arms[:, rows][:, :, columns] @ np.linalg.inv(slopes[seen]) / roots[:, None]
    return result


def differentiate_joint(specimen: Specimen, motion: Motion, cutoff: float | None = None) -> Motion:
    """Find velocities and accelerations of a specimen's joint, low-pass filtered first.

    As `motion.filters.differentiate`, but a ball is filtered as a quaternion, which no pose makes
    singular: omega = 2 vec(conj(q) dq/dt) / |q|^2. Angles near a quarter turn of the middle
    rotation have large rates, which together still are that omega.

    Parameters
    ----------
    specimen : with the joint
    motion : of its coordinates
    cutoff : of the low-pass [Hz], None for none
    """
    if len(specimen.joint_coordinates) == 1:
        return differentiate(motion, cutoff)
    joint = next(joint for joint in specimen.model.joints if joint.child == specimen.first)
    axes = np.array([axis.vector for axis in joint.axes])
    order = "".join("XYZ"[int(np.argmax(axis))] for axis in axes)
    columns = [motion.names.index(name) for name in joint.coordinates]
    quaternions = _quaternions(motion.values[:, columns], order)
    rates = differentiate(Motion(motion.time, ("w", "x", "y", "z"), quaternions), cutoff)
    assert rates.velocities is not None
    assert rates.accelerations is not None

    known = np.isfinite(rates.values).all(axis=1)
    turns, omega, alpha = angular_motion(
        rates.values[known], rates.velocities[known], rates.accelerations[known]
    )
    values = np.full((len(motion), 3), np.nan)
    velocities = np.full((len(motion), 3), np.nan)
    accelerations = np.full((len(motion), 3), np.nan)
    values[known] = turns.as_euler(order)
    velocities[known], accelerations[known] = _angle_rates(axes, values[known], omega, alpha)
    return Motion(
        time=motion.time,
        names=tuple(joint.coordinates),
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )


def _quaternions(angles: Array, order: str) -> Array:
    """Turn angles (frames, 3) into quaternions (frames, 4), w first, without jumps of sign."""
    seen = np.isfinite(angles).all(axis=1)
    quaternions = np.full((len(angles), 4), np.nan)
    rotations = Rotation.from_euler(order, angles[seen])
    quaternions[seen] = continuous(rotations.as_quat(scalar_first=True))
    return quaternions


def continuous(quaternions: Array) -> Array:
    """Give quaternions the signs that make each the nearest to the one before.

    Parameters
    ----------
    quaternions : (frames, 4)

    Returns
    -------
    (frames, 4)
    """
    turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    return quaternions * np.concatenate([[1.0], np.cumprod(turned)])[: len(quaternions), None]


def angular_motion(
    values: Array, velocities: Array, accelerations: Array
) -> tuple[Rotation, Array, Array]:
    """Find rotations, angular rates and accelerations from quaternions of any length.

    With s = |q|, omega = 2 vec(conj(q) q') / s^2 and alpha = 2 vec(conj(q) q'') / s^2 - 2 omega s'
    / s.

    Parameters
    ----------
    values, velocities, accelerations : (frames, 4) w first, and their derivatives

    Returns
    -------
    rotations, and (frames, 3) along the body's axes [rad/s], [rad/s^2]
    """
    square = np.sum(values**2, axis=1, keepdims=True)
    growth = np.sum(values * velocities, axis=1, keepdims=True) / square
    rates = 2.0 * _vector_part(values, velocities) / square
    gains = 2.0 * _vector_part(values, accelerations) / square - 2.0 * growth * rates
    return Rotation.from_quat(values, scalar_first=True), rates, gains


def _vector_part(first: Array, second: Array) -> Array:
    """Find the vector part (frames, 3) of conj(first) second, quaternions (frames, 4)."""
    a = first[:, :1]
    u = first[:, 1:]
    b = second[:, :1]
    v = second[:, 1:]
    return a * v - b * u - np.cross(u, v)


def _angle_rates(axes: Array, angles: Array, rates: Array, gains: Array) -> tuple[Array, Array]:
    """Find rates and accelerations of body-fixed rotations from those along the body's axes.

    With omega = S(q) q', alpha = S q'' + S' q'; the columns of S are the axes as the body sees
    them.

    Parameters
    ----------
    axes : (3, 3) of the rotations
    angles : (frames, 3) [rad]
    rates, gains : (frames, 3) along the body's axes [rad/s], [rad/s^2]

    Returns
    -------
    (frames, 3) each [rad/s], [rad/s^2]
    """
    last = Rotation.from_rotvec(angles[:, 2, None] * axes[2])
    middle = Rotation.from_rotvec(angles[:, 1, None] * axes[1])
    second = last.apply(np.tile(axes[1], (len(angles), 1)), inverse=True)
    third = np.tile(axes[2], (len(angles), 1))
    first = (middle * last).apply(np.tile(axes[0], (len(angles), 1)), inverse=True)
    slopes = np.stack([first, second, third], axis=2)
    speeds = np.linalg.solve(slopes, rates[..., None])[..., 0]
    beyond = third * speeds[:, 2:]
    slow = np.cross(beyond + second * speeds[:, 1:2], first) * speeds[:, :1]
    changes = slow + np.cross(beyond, second) * speeds[:, 1:2]
    return speeds, np.linalg.solve(slopes, (gains + changes)[..., None])[..., 0]


def on_one_branch(specimen: Specimen, motion: Motion) -> Motion:
    """Bring angles to one branch, so that none jumps by a turn.

    The middle one of a ball's three rotations is brought within a quarter turn, the others within
    half a turn; a joint's only angle may go on beyond.
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
            for column in columns:
                if specimen.model.coordinate(motion.names[column]).motion == "rotational":
                    values[:, column] = _continuous(values[:, column])
    return replace(motion, values=values)


def _continuous(angle: Array) -> Array:
    """Take jumps by a turn out of an angle (frames,), which is then around zero."""
    seen = np.isfinite(angle)
    unwound = np.array(angle)
    unwound[seen] = np.unwrap(angle[seen])
    middle = np.median(unwound[seen]) if seen.any() else 0.0
    return unwound - 2.0 * np.pi * np.round(middle / (2.0 * np.pi))
