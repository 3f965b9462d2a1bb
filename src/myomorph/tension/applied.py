"""What muscles, actuators, bushings and contacts do to bodies: force and moment on each, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import GROUND, Actuator
from myomorph.model.paths import Bushing
from myomorph.model.series import Wrenches
from myomorph.muscles.path import Paths
from myomorph.rigid.bushings import angular_velocities, deflection
from myomorph.rigid.kinematics import Poses
from myomorph.rigid.tree import Tree


def no_wrenches(tree: Tree, frames: int) -> Array:
    """Nothing on any body: (frames, bodies, 6) of zeros, force and its moment about the ground's origin in ground."""
    return np.zeros((frames, len(tree.arrays.parent), 6))


def about_origin(force: Array, point: Array, torque: Array | float = 0.0) -> Array:
    """Force (..., 3) at a point with a free torque, as force and moment about the ground's origin (..., 6)."""
    return np.concatenate([force, torque + np.cross(point, force)], axis=-1)


def of_muscles(paths: Paths, pulls: Array, tensions: Array) -> Array:
    """What muscles of given tensions do to bodies, (frames, bodies, 6) [N], [N m].
    `pulls` (frames, pairs, 6) as of `Paths.pulls`; `tensions` (frames, muscles) [N].
    """
    result = no_wrenches(paths.tree, len(pulls))
    share = pulls * tensions[:, paths.pull_muscle, None]
    for body in np.unique(paths.pull_body):
        result[:, body] = share[:, paths.pull_body == body].sum(axis=1)
    return result


def of_actuators(tree: Tree, poses: Poses, actuators: Sequence[Actuator], forces: Array) -> Array:
    """What actuators that push or turn bodies do to them, (frames, bodies, 6); those of coordinates do nothing to one.
    `forces` (frames, actuators) [N or N m].
    """
    result = no_wrenches(tree, len(forces))
    for actuator, force in zip(actuators, forces.T, strict=True):
        if actuator.kind == "coordinate":
            continue
        body = tree.body_number(actuator.body or GROUND, f"for '{actuator.name}' the model")
        other = tree.body_number(actuator.other_body, f"for '{actuator.name}' the model") if actuator.other_body else -1
        R, p = poses.rotations, poses.origins
        direction = np.broadcast_to(actuator.direction / (np.linalg.norm(actuator.direction) or 1.0), (len(forces), 3))
        if not actuator.direction_is_global:
            direction = np.einsum("fij,fj->fi", R[:, body], direction)
        at = actuator.point if actuator.point_is_global else R[:, body] @ actuator.point + p[:, body]
        if actuator.kind == "torque":
            wrench = np.concatenate([np.zeros_like(direction), force[:, None] * direction], axis=1)
            opposite = -wrench
        elif actuator.kind == "point":
            wrench, opposite = about_origin(force[:, None] * direction, at), None
        else:
            far = max(other, 0)
            end = actuator.other_point if actuator.point_is_global else R[:, far] @ actuator.other_point + p[:, far]
            apart = at - end
            push = force[:, None] * apart / np.linalg.norm(apart, axis=1, keepdims=True)
            wrench, opposite = about_origin(push, at), about_origin(-push, end)
        result[:, body] += wrench
        if other >= 0 and opposite is not None:
            result[:, other] += opposite
    return result


def of_bushings(tree: Tree, poses: Poses, bushings: Sequence[Bushing], rates: Array) -> Array:
    """What bushings do to the bodies they hold together, (frames, bodies, 6) [N], [N m].
    `rates` (frames, coordinates) velocities, consistent.
    """
    result = no_wrenches(tree, len(rates))
    for bushing in bushings:
        q, B = deflection(tree, poses, bushing)
        stiffness = np.concatenate([bushing.rotational_stiffness, bushing.translational_stiffness])
        damping = np.concatenate([bushing.rotational_damping, bushing.translational_damping])
        load = -(stiffness * q + damping * np.einsum("fij,fj->fi", B, rates))
        first, second = tree.body_index[bushing.body_1], tree.body_index[bushing.body_2]
        axes = poses.rotations[:, first] @ bushing.pose_1.rotation
        point = poses.origins[:, second] + poses.rotations[:, second] @ bushing.pose_2.translation
        # The generalized forces of the angles are E^T times the moment along the first frame's axes.
        slopes = np.swapaxes(angular_velocities(q[:, 0], q[:, 1]), 1, 2)
        moment = np.linalg.solve(slopes, load[:, :3, None])[..., 0]
        wrench = about_origin(np.einsum("fij,fj->fi", axes, load[:, 3:]), point, np.einsum("fij,fj->fi", axes, moment))
        result[:, second] += wrench
        result[:, first] -= wrench
    return result


def of_wrenches(tree: Tree, wrenches: Wrenches) -> Array:
    """What external forces do to bodies, (frames, bodies, 6); where there is no force its point does not matter."""
    result = no_wrenches(tree, len(wrenches))
    still = (wrenches.forces == 0.0).all(axis=2)[..., None]
    points = np.where(still, 0.0, wrenches.points)
    for index, body in enumerate(wrenches.bodies):
        wrench = about_origin(wrenches.forces[:, index], points[:, index], wrenches.torques[:, index])
        result[:, tree.body_number(body, f"for '{wrenches.names[index]}' the model")] += wrench
    return result
