"""Coordinates that bend hips, knees and ankles, whichever way a model counts them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Joint, Model
from myomorph.core.rigid.kinematics import body_motion
from myomorph.core.rigid.knees import (
    flexion_coordinate,
    flexion_sign,
    joint_above,
    knee_joints,
    long_axis,
)
from myomorph.core.rigid.tree import Tree, compile_tree


class JointAngle(NamedTuple):
    """The coordinate that bends a joint.

    Attributes
    ----------
    joint : of the model
    coordinate : its number
    sign : -1 where it counts flexion, or dorsiflexion, below 0, else 1
    """

    joint: Joint
    coordinate: int
    sign: float

    def of(self, values: Array) -> Array:
        """Take the joint's column, above 0 for flexion.

        Parameters
        ----------
        values : (frames, coordinates) of coordinates or torques [rad or N m]

        Returns
        -------
        (frames,) in the same unit
        """
        return np.asarray(self.sign * values[:, self.coordinate])


class LegAngles(NamedTuple):
    """Flexion of one leg; None for an ankle or a hip that does not turn."""

    hip: JointAngle | None
    knee: JointAngle
    ankle: JointAngle | None


def _all_legs(model: Model) -> tuple[LegAngles, ...]:
    """Find the legs of `leg_angles`."""
    return tuple(_legs(model))


leg_angles = Latest(_all_legs)
"""Legs of a model, by their knees that bend."""


def _legs(model: Model) -> Iterator[LegAngles]:
    """Find hip and ankle of every knee that bends."""
    tree = compile_tree(model)
    for joint in knee_joints(model):
        name = flexion_coordinate(model, joint)
        down = long_axis(model, joint)
        if not name or down is None:
            continue
        number = model.coordinate_names.index(name)
        knee = JointAngle(joint=joint, coordinate=number, sign=flexion_sign(model, name))
        yield LegAngles(hip=_hip(tree, knee), knee=knee, ankle=_ankle(tree, joint, down))


def _hip(tree: Tree, knee: JointAngle) -> JointAngle | None:
    """Find what turns the thigh about the knee's axis, against the knee's own flexion."""
    model = tree.model
    hip = joint_above(model, knee.joint.parent)
    if hip is None:
        return None
    axis = knee.sign * _spin(tree, knee.joint, knee.coordinate)
    best = None
    most = 0.5 * float(np.linalg.norm(axis))
    for name in dict.fromkeys(name for part in hip.axes for name in part.coordinates):
        coordinate = model.coordinate(name)
        number = model.coordinate_names.index(name)
        along = float(_spin(tree, hip, number) @ axis)
        if coordinate.motion == "rotational" and not coordinate.locked and abs(along) > most:
            most = abs(along)
            best = JointAngle(joint=hip, coordinate=number, sign=-1.0 if along > 0.0 else 1.0)
    return best


def _spin(tree: Tree, joint: Joint, number: int) -> Array:
    """Angular velocity (3,) of a joint's child seen from its parent, for unit rate [rad/s]."""
    values = tree.defaults[None]
    rates = np.zeros_like(values)
    rates[0, number] = 1.0
    spins = body_motion(tree, values, rates, np.zeros_like(values)).angular_velocities[0]
    return np.asarray(spins[tree.body_index[joint.child]] - spins[tree.body_index[joint.parent]])


def _ankle(tree: Tree, knee: Joint, down: Array) -> JointAngle | None:
    """Find the joint that turns below a shank; `down` (3,) along the shank.

    A foot's mass lies before its ankle: where the coordinate bends the ankle dorsally, the center
    of mass of all that hangs on it goes up along the shank.
    """
    model = tree.model
    joint = _joint_below(model, knee.child)
    if joint is None:
        return None
    number = model.coordinate_names.index(flexion_coordinate(model, joint))
    values = tree.defaults[None]
    rates = np.zeros_like(values)
    rates[0, number] = 1.0
    motion = body_motion(tree, values, rates, np.zeros_like(values))
    hanging = tree.hanging(joint.child)
    bodies = [body for body in model.bodies if hanging[tree.body_index[body.name]]]
    masses = np.array([body.mass for body in bodies])
    numbers = np.array([tree.body_index[body.name] for body in bodies])
    centers = motion.of_points(numbers, np.array([body.mass_center for body in bodies]))
    falls = masses @ centers.velocities[0] @ motion.rotations[0, tree.body_index[knee.child]] @ down
    return JointAngle(joint=joint, coordinate=number, sign=-1.0 if falls > 0.0 else 1.0)


def _joint_below(model: Model, shank: str) -> Joint | None:
    """Find the joint that turns below a shank and what is welded to it."""
    for joint in model.joints:
        if joint.parent == shank:
            below = joint if flexion_coordinate(model, joint) else None
            found = below if joint.axes else _joint_below(model, joint.child)
            if found is not None:
                return found
    return None
