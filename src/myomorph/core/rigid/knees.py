"""Knees of a model: which joints they are, along which axes they lie and turn."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

THIGH = ("femur", "thigh")
SHANK = ("tibia", "shank")  # Words in the names of the bodies above and below a knee
FLEXIONS = np.radians([0.0, 15.0, 30.0, 45.0, 60.0])  # At which knees are looked at [rad]


def knee_joints(model: Model) -> tuple[Joint, ...]:
    """Joints between a body called femur or thigh and one called tibia or shank."""
    return tuple(
        joint for joint in model.joints if _is(joint.parent, THIGH) and _is(joint.child, SHANK)
    )


def _is(body: str, words: tuple[str, ...]) -> bool:
    return any(word in body.lower() for word in words)


def flexion_coordinate(model: Model, knee: Joint) -> str:
    """Name of the coordinate that bends a knee, "" of one that does not turn."""
    return next(
        (
            name
            for axis in knee.axes
            for name in axis.coordinates
            if model.coordinate(name).motion == "rotational" and not model.coordinate(name).locked
        ),
        "",
    )


def long_axis(model: Model, joint: Joint) -> Array | None:
    """Unit vector on the joint's child from its center to that of the next joint, None where none
    follows.
    """
    center = joint.child_frame.translation
    ways = [
        next_joint.parent_frame.translation - center
        for next_joint in model.joints
        if next_joint.parent == joint.child
    ]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    if not lengths or max(lengths) < 1e-9:
        return None
    farthest = int(np.argmax(lengths))
    return np.asarray(ways[farthest] / lengths[farthest])


def flexed(model: Model, knee: Joint) -> Poses | None:
    """Poses of the model, but for a knee at its defaults, at `FLEXIONS` of it; None of a knee that
    does not turn.
    """
    tree = compile_tree(model)
    turning = flexion_coordinate(model, knee)
    if not turning:
        return None
    low, high = model.coordinate(turning).range
    # A knee that bends towards negative angles has its range there.
    sign = -1.0 if abs(low) > abs(high) else 1.0
    motion = Motion(
        np.arange(len(FLEXIONS), dtype=np.float64), (turning,), sign * FLEXIONS[:, None]
    )
    return forward_kinematics(tree, tree.coordinates_of(motion))


def hinge_axis(model: Model, knee: Joint, poses: Poses, down: Array) -> Array:
    """Unit vector across the tibia about which a knee turns; `poses`: of `flexed`; `down`: the
    tibia's `long_axis`.
    """
    index = compile_tree(model).body_index
    femur = index[knee.parent]
    tibia = index[knee.child]
    turned = poses.rotations[:, tibia].transpose(0, 2, 1) @ poses.rotations[:, femur]
    change = turned[-1] @ turned[0].T
    axis = np.array(
        [change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]
    )
    axis -= (axis @ down) * down
    return axis / np.linalg.norm(axis)
