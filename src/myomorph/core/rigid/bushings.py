"""Generalized forces of bushings: springs and dampers between two frames, in OpenSim's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import Bushing
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import Tree


def bushing_forces(
    tree: Tree, bushings: Sequence[Bushing], coordinates: Array, rates: Array
) -> Array:
    """What bushings do at every coordinate, (frames, coordinates) [N m or N].

        tau = -B^T (K q + D B cdot),   B = dq/dc

    with q (6,) the body-fixed x-y-z angles and the origin of the second frame seen from the first.
    Dependent coordinates keep their own share.

    `coordinates`, `rates` (frames, coordinates) consistent.
    """
    tau = np.zeros_like(coordinates)
    poses = forward_kinematics(tree, coordinates)
    for bushing in bushings:
        q, B = deflection(tree, poses, bushing)
        stiffness = np.concatenate([bushing.rotational_stiffness, bushing.translational_stiffness])
        damping = np.concatenate([bushing.rotational_damping, bushing.translational_damping])
        force = stiffness * q + damping * np.einsum("fij,fj->fi", B, rates)
        tau -= np.einsum("fij,fi->fj", B, force)
    return tau


def deflection(tree: Tree, poses: Poses, bushing: Bushing) -> tuple[Array, Array]:
    """A bushing's q (frames, 6) and dq/dc (frames, 6, coordinates); singular where the middle angle
    is 90 degrees.
    """
    ends = []
    for body, pose in ((bushing.body_1, bushing.pose_1), (bushing.body_2, bushing.pose_2)):
        b = tree.body_index[body]
        R = poses.rotations[:, b]
        ends.append((b, R @ pose.rotation, poses.origins[:, b] + R @ pose.translation))
    (b1, R1, x1), (b2, R2, x2) = ends
    towards = np.swapaxes(R1, 1, 2)
    Q = towards @ R2
    x = np.arctan2(-Q[:, 1, 2], Q[:, 2, 2])
    y = np.arcsin(np.clip(Q[:, 0, 2], -1.0, 1.0))
    z = np.arctan2(-Q[:, 0, 1], Q[:, 0, 0])
    apart = np.einsum("fij,fj->fi", towards, x2 - x1)
    # Both bodies' motion at the second frame's origin: what is left turns or moves one frame
    # against the other.
    moved = poses.jacobian(b2, x2) - poses.jacobian(b1, x2)
    B = np.concatenate(
        [np.linalg.solve(angular_velocities(x, y), towards @ moved[:, :3]), towards @ moved[:, 3:]],
        axis=1,
    )
    return np.column_stack([x, y, z, apart]), B


def angular_velocities(x: Array, y: Array) -> Array:
    """E (frames, 3, 3): angular velocity along the first frame = E (xdot, ydot, zdot) of body-fixed
    angles x, y, z.
    """
    E = np.zeros((len(x), 3, 3))
    E[:, 0, 0] = 1.0
    E[:, 1, 1], E[:, 2, 1] = np.cos(x), np.sin(x)
    E[:, 0, 2], E[:, 1, 2], E[:, 2, 2] = np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y)
    return E
