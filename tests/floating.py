"""States of a floating tree as Pinocchio and MuJoCo hold them, and Pinocchio's parameters."""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

PINOCCHIO_ORDER = np.array([0, 1, 2, 3, 4, 9, 5, 8, 7, 6])
"""Which of our ten parameters each of Pinocchio's is: m, m c, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz.
"""


def root_rates(model, motion):
    """Return the pose and rates of the first body, in ground.

    They are its rotation and origin, angular velocity and acceleration, velocity and acceleration.
    """
    c, cdot, cddot = motion_arrays(compile_tree(model), motion)
    poses = forward_kinematics(compile_tree(model), c)
    axes = poses.axis_directions[:, 3:6]
    omega = np.einsum("fa,fai->fi", cdot[:, 3:6], axes)
    alpha = np.einsum("fa,fai->fi", cddot[:, 3:6], axes)
    # Each axis is carried by the turns before it.
    carried = np.zeros_like(omega)
    for k in range(3):
        alpha += np.cross(carried, axes[:, k]) * cdot[:, 3 + k, None]
        carried += cdot[:, 3 + k, None] * axes[:, k]
    return poses.rotations[:, 1], poses.origins[:, 1], omega, alpha, cdot[:, :3], cddot[:, :3]


def pinocchio_states(model, motion):
    """q, v, a of a model with a free flyer: velocities of the root in its own axes."""
    import pinocchio as pin

    R, p, omega, alpha, speed, acceleration = root_rates(model, motion)
    rest = (
        np.array(motion.values[:, 6:]),
        np.array(motion.velocities[:, 6:]),
        np.array(motion.accelerations[:, 6:]),
    )
    for f in range(len(motion)):
        turn = R[f].T
        q = np.concatenate([p[f], pin.Quaternion(np.ascontiguousarray(R[f])).coeffs(), rest[0][f]])
        v = np.concatenate([turn @ speed[f], turn @ omega[f], rest[1][f]])
        # A spatial acceleration: the rate of the velocity's components in the moving axes.
        linear = turn @ (acceleration[f] - np.cross(omega[f], speed[f]))
        yield q, v, np.concatenate([linear, turn @ alpha[f], rest[2][f]])


def mujoco_states(model, motion):
    """qpos, qvel, qacc with a free joint: linear rates in ground, angular ones in body axes."""
    import mujoco

    R, p, omega, alpha, speed, acceleration = root_rates(model, motion)
    for f in range(len(motion)):
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, R[f].ravel())
        yield (
            np.concatenate([p[f], quaternion]),
            np.concatenate([speed[f], R[f].T @ omega[f]]),
            np.concatenate([acceleration[f], R[f].T @ alpha[f]]),
        )
