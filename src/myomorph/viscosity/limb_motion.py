"""A swinging limb as one link: its rotation, its rates, and what wrench each of its inertial parameters needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.series import Motion
from myomorph.muscles.path import muscle_kinematics
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.regressor import base_regressor
from myomorph.rigid.tree import compile_tree
from myomorph.viscosity.specimen import Specimen


@dataclass(frozen=True, eq=False)
class LimbMotion:
    """A limb in motion about its joint's center, everything distal of the joint one rigid link.

    Attributes
    ----------
    rotations : (frames, 3, 3) of the limb's first body in ground
    slopes : (frames, axes, coordinates) d(rate about a free axis)/d(coordinate's velocity)
    rates : (frames, axes) angular velocity about the free axes [rad/s]
    wrench_rows : (frames, 6, 10) moment about the center and force that unit parameters need, ground axes
    torque_rows : (frames, axes, 10) the moment along the free axes
    """

    rotations: Array
    slopes: Array
    rates: Array
    wrench_rows: Array
    torque_rows: Array


def limb_motion(specimen: Specimen, motion: Motion) -> LimbMotion:
    """Rotation, rates and rows of a motion of the specimen's joint; NaN in frames where the motion is NaN.

    Parameters
    ----------
    motion : of the joint's coordinates, with velocities and accelerations; the base at its stand

    Raises
    ------
    BadData : the motion has no derivatives
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
    return LimbMotion(rotations, slopes, rates, rows, axes @ rows[:, :3])


def lengthening(specimen: Specimen, motion: Motion, slopes: Array) -> Array:
    """(frames, strands, axes) d(length)/d(angle about a free axis), J_M of [S] eq. 3 [m/rad].

    Strands stand muscle after muscle, each divided by the root of their number (see `SwingRecording`). Moment
    arms about the coordinates become arms about the axes by the inverse of `slopes` (frames, axes, coordinates).
    NaN where the motion is.
    """
    strands = [(strand, len(own)) for own in specimen.muscles.values() for strand in own]
    found = np.full((len(motion), len(strands), len(specimen.axes)), np.nan)
    seen = np.isfinite(motion.values).all(axis=1)
    if not specimen.muscles or not seen.any():
        return found
    part = Motion(motion.time[seen], motion.names, motion.values[seen])
    arms = muscle_kinematics(specimen.model, part, velocities=False).moment_arms
    columns = [specimen.model.coordinate_names.index(name) for name in specimen.joint_coordinates]
    rows = [specimen.model.muscle_names.index(strand) for strand, _ in strands]
    roots = np.sqrt([count for _, count in strands])
    found[seen] = -arms[:, rows][:, :, columns] @ np.linalg.inv(slopes[seen]) / roots[:, None]
    return found
