"""Knees of a model: their joints, long axes and hinge axes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

# Words in the names of the bodies above and below a knee
THIGH = ("femur", "femoral", "thigh")
SHANK = ("tibia", "shank")
FLEXIONS = np.radians([0.0, 15.0, 30.0, 45.0, 60.0])  # At which the hinge axis is determined [rad]
MIN_LENGTH = 1e-9  # Of a body between two joints [m]


def knee_joints(model: Model) -> tuple[Joint, ...]:
    """Find the joints between a body named femur or thigh (a part of one) and a tibia or shank."""
    return tuple(
        joint
        for joint in model.joints
        if _is_called(joint.parent, THIGH) and _is_called(joint.child, SHANK)
    )


def _is_called(body: str, words: tuple[str, ...]) -> bool:
    """Whether the name of a body has one of some words."""
    return any(word in body.lower() for word in words)


def flexion_coordinate(model: Model, knee: Joint) -> str:
    """Name of the coordinate that bends a knee, "" for a knee that does not bend."""
    return next(_free_rotations(model, knee), "")


def _free_rotations(model: Model, joint: Joint) -> Iterator[str]:
    """Names of the rotational coordinates of a joint that are not locked."""
    for axis in joint.axes:
        for name in axis.coordinates:
            coordinate = model.coordinate(name)
            if coordinate.motion == "rotational" and not coordinate.locked:
                yield name


def flexion_sign(model: Model, coordinate: str) -> float:
    """Return -1 for a knee whose flexion counts below 0, as its range shows, else 1."""
    low, high = model.coordinate(coordinate).range
    return -1.0 if abs(low) > abs(high) else 1.0


def long_axis(model: Model, joint: Joint) -> Array | None:
    """Axis of a joint's child from the joint's center to that of the farthest next joint.

    Parameters
    ----------
    model : that has the joint
    joint : at the body's proximal end

    Returns
    -------
    (3,) unit vector in the child, None where no joint follows
    """
    center = joint.child_frame.translation
    to_next = [next_center - center for next_center in _centers_beyond(model, joint.child)]
    lengths = [float(np.linalg.norm(vector)) for vector in to_next]
    if not lengths or max(lengths) < MIN_LENGTH:
        return None
    farthest = int(np.argmax(lengths))
    return np.asarray(to_next[farthest] / lengths[farthest])


def _centers_beyond(model: Model, body: str) -> Iterator[Array]:
    """(3,) centers of the joints that follow a body and what is welded to it, in its frame [m]."""
    for joint in model.joints:
        if joint.parent != body:
            continue
        center = joint.parent_frame.translation
        yield center
        if not joint.axes:
            turn = joint.parent_frame.rotation @ joint.child_frame.rotation.T
            origin = center - turn @ joint.child_frame.translation
            for beyond in _centers_beyond(model, joint.child):
                yield origin + turn @ beyond


def joint_above(model: Model, body: str) -> Joint | None:
    """Find the next joint above a body, past bodies that it is welded to; None at the ground."""
    above = next((joint for joint in model.joints if joint.child == body), None)
    while above is not None and not above.axes:
        parent = above.parent
        above = next((joint for joint in model.joints if joint.child == parent), None)
    return above


def flexed(model: Model, knee: Joint) -> Poses | None:
    """Poses with a knee at each of `FLEXIONS` and all else at its default.

    Returns
    -------
    a frame for each flexion, None for a knee that does not bend
    """
    tree = compile_tree(model)
    flexion = flexion_coordinate(model, knee)
    if not flexion:
        return None
    sign = flexion_sign(model, flexion)
    motion = Motion(
        time=np.arange(len(FLEXIONS), dtype=np.float64),
        names=(flexion,),
        values=sign * FLEXIONS[:, None],
    )
    return forward_kinematics(tree, tree.coordinates_of(motion))


def hinge_axis(model: Model, knee: Joint, poses: Poses, down: Array) -> Array:
    """Axis across the tibia about which a knee bends from its first to its last pose.

    With R the rotation of the femur seen from the tibia and Q = R_last R_first^T, the axis of Q is
    along (Q_32 - Q_23, Q_13 - Q_31, Q_21 - Q_12); its part along the tibia is taken off.

    Parameters
    ----------
    model : that has the knee
    knee : between femur and tibia
    poses : of `flexed`
    down : (3,) the tibia's `long_axis`

    Returns
    -------
    (3,) unit vector in the tibia; 0 for a knee whose coordinate does not turn it so
    """
    body_index = compile_tree(model).body_index
    femur = body_index[knee.parent]
    tibia = body_index[knee.child]
    rotations = poses.rotations[:, tibia].transpose(0, 2, 1) @ poses.rotations[:, femur]
    change = rotations[-1] @ rotations[0].T
    axis = np.array(
        [change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]
    )
    axis -= (axis @ down) * down
    size = float(np.linalg.norm(axis))
    return axis / size if size > 0.0 else np.zeros(3)
