"""Generalized forces of bushings: springs and dampers between two frames, as in OpenSim."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import Bushing
from myomorph.core.model.shapes import (
    Coordinates,
    FrameMatrices,
    FrameValues,
    FrameVectors,
    GeneralizedForces,
)
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.bushing_kernels import BushingArrays, add_bushings
from myomorph.core.rigid.coordinates import State
from myomorph.core.rigid.dynamics import project
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import (
    Poses,
    body_poses,
    body_rates,
    pose_room,
    rate_room,
)
from myomorph.core.rigid.tree import Tree


class FramePose(NamedTuple):
    """Pose in ground of a frame that is fixed to a body.

    Attributes
    ----------
    body : number of the body in the tree
    rotation : (frames, 3, 3) from the frame's axes to ground
    origin : (frames, 3) in ground [m]
    """

    body: int
    rotation: FrameMatrices
    origin: FrameVectors


class Deflection(NamedTuple):
    """Deflection of a bushing and how coordinates change it.

    Attributes
    ----------
    values : (frames, 6) body-fixed x-y-z angles [rad], then translations [m], of the second frame
        seen from the first
    slopes : (frames, 6, coordinates) derivatives in the coordinates
    """

    values: Array
    slopes: Array


def bushing_forces(
    tree: Tree, bushings: Sequence[Bushing], coordinates: Coordinates, rates: Coordinates
) -> GeneralizedForces:
    """Generalized forces of bushings at every coordinate.

        tau = -B^T (K q + D B cdot),   B = dq/dc

    with q (6,) the body-fixed x-y-z angles and the origin of the second frame seen from the first.
    Dependent coordinates keep their own share.

    Source: OpenSim's `BushingForce` (Seth et al. 2018).

    Parameters
    ----------
    tree : the compiled model
    bushings : of the model
    coordinates : (frames, coordinates) in the model's order, dependent ones consistent [rad or m]
    rates : (frames, coordinates) their velocities [per s]

    Returns
    -------
    (frames, coordinates) [N m or N]
    """
    tau = np.empty_like(coordinates)
    arrays = (np.ascontiguousarray(coordinates), np.ascontiguousarray(rates), tau)
    run_frames(_bushing_forces, (tree.arrays, bushing_arrays(tree, bushings)), *arrays)
    return tau


def bushing_arrays(tree: Tree, bushings: Sequence[Bushing]) -> BushingArrays:
    """Compile bushings to flat arrays.

    Parameters
    ----------
    tree : the compiled model
    bushings : of the model
    """

    def stacked(rows: list[Array], shape: tuple[int, ...]) -> Array:
        return np.array(rows, dtype=np.float64).reshape(-1, *shape)

    stiffness = [
        np.concatenate([bushing.rotational_stiffness, bushing.translational_stiffness])
        for bushing in bushings
    ]
    damping = [
        np.concatenate([bushing.rotational_damping, bushing.translational_damping])
        for bushing in bushings
    ]
    return BushingArrays(
        body_1=np.array([tree.body_index[bushing.body_1] for bushing in bushings], np.int64),
        body_2=np.array([tree.body_index[bushing.body_2] for bushing in bushings], np.int64),
        point_1=stacked([bushing.pose_1.translation for bushing in bushings], (3,)),
        point_2=stacked([bushing.pose_2.translation for bushing in bushings], (3,)),
        turn_1=stacked([bushing.pose_1.rotation for bushing in bushings], (3, 3)),
        turn_2=stacked([bushing.pose_2.rotation for bushing in bushings], (3, 3)),
        stiffness=stacked(stiffness, (6,)),
        damping=stacked(damping, (6,)),
    )


@kernel
def _bushing_forces(T, bushings, c, cdot, tau):
    """`bushing_forces` of frames: c, cdot and tau (frames, coordinates), the last filled."""
    pose = pose_room(T)
    rates = rate_room(T)
    still = np.zeros(c.shape[1])
    f = np.empty((T.parent.shape[0], 3))
    m = np.empty((T.parent.shape[0], 3))
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=still), pose, rates)
        f[:, :] = 0.0
        m[:, :] = 0.0
        add_bushings(bushings, pose, rates, f, m)
        project(T, pose, f, m, tau[frame])


def deflection(tree: Tree, poses: Poses, bushing: Bushing) -> Deflection:
    """Deflection of a bushing and its derivatives in the coordinates.

    With E of `angular_velocities` and J_1, J_2 the Jacobians of both bodies at the second frame's
    origin, in the axes of the first frame, rows angular before linear:

        B = [E^-1 (J_2 - J_1)_angular; (J_2 - J_1)_linear]

    Singular where the middle angle is 90 degrees.

    Parameters
    ----------
    tree : the compiled model
    poses : of the tree
    bushing : of the model

    Returns
    -------
    angles [rad] and translations [m] with their derivatives
    """
    first = _frame_in_ground(tree, poses, bushing.body_1, bushing.pose_1)
    second = _frame_in_ground(tree, poses, bushing.body_2, bushing.pose_2)

    to_first = np.swapaxes(first.rotation, 1, 2)
    relative = to_first @ second.rotation
    x = np.arctan2(-relative[:, 1, 2], relative[:, 2, 2])
    y = np.arcsin(np.clip(relative[:, 0, 2], -1.0, 1.0))
    z = np.arctan2(-relative[:, 0, 1], relative[:, 0, 0])
    translation = np.einsum("fij,fj->fi", to_first, second.origin - first.origin)

    # Motion that both bodies share at the second frame's origin deflects nothing.
    relative_motion = poses.jacobian(second.body, second.origin) - poses.jacobian(
        first.body, second.origin
    )
    angular = to_first @ relative_motion[:, :3]
    linear = to_first @ relative_motion[:, 3:]
    of_angles = np.linalg.solve(angular_velocities(x, y), angular)
    return Deflection(
        values=np.column_stack([x, y, z, translation]),
        slopes=np.concatenate([of_angles, linear], axis=1),
    )


def _frame_in_ground(tree: Tree, poses: Poses, body: str, pose: Transform) -> FramePose:
    """Pose in ground of a frame with a constant pose in a body."""
    number = tree.body_index[body]
    rotation = poses.rotations[:, number]
    return FramePose(
        body=number,
        rotation=rotation @ pose.rotation,
        origin=poses.origins[:, number] + rotation @ pose.translation,
    )


def angular_velocities(x: FrameValues, y: FrameValues) -> FrameMatrices:
    """Matrix E that gives the angular velocity of body-fixed angles x, y, z.

        omega = E (xdot, ydot, zdot),   omega along the axes of the first frame

    Parameters
    ----------
    x, y : (frames,) first and second angle [rad]

    Returns
    -------
    (frames, 3, 3)
    """
    E = np.zeros((len(x), 3, 3))
    E[:, 0, 0] = 1.0
    E[:, 1, 1] = np.cos(x)
    E[:, 2, 1] = np.sin(x)
    E[:, 0, 2] = np.sin(y)
    E[:, 1, 2] = -np.sin(x) * np.cos(y)
    E[:, 2, 2] = np.cos(x) * np.cos(y)
    return E
