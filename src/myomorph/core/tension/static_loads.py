"""Forces of joints that statics allow: joint torques over published moment arms, no muscles.

Without muscles a joint transmits the force F_0 of motion, gravity and external forces, and its
torque tau is left. Muscles with the arm r that give it pull with T = tau / r along u, so that the
bones press on each other with

    F = |F_0 - T u|

The greatest published arm gives the least force, the least arm the greatest. Muscles on the other
side, and those of two joints that turn the next one, add to both.

Source: Schipplein and Andriacchi 1991.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.muscles.published_arms import (
    ACHILLES,
    BICEPS_FEMORIS,
    PATELLAR_TENDON,
    SEMIMEMBRANOSUS,
    SEMITENDINOSUS,
    TIBIALIS_ANTERIOR,
    Band,
    size_of_person,
)
from myomorph.core.rigid.dynamics import inverse_dynamics, values_and_rates
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.knees import joint_above, long_axis
from myomorph.core.rigid.leg_angles import JointAngle, leg_angles
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.load_quantities import STATIC_LOAD_HIGH, STATIC_LOAD_LOW, STATIC_LOADS
from myomorph.core.tension.reaction import joint_reactions

HAMSTRINGS = (BICEPS_FEMORIS, SEMIMEMBRANOSUS, SEMITENDINOSUS)
MIN_ARM = 0.01  # Of muscles that together bend a knee [m]


@read_only
class StaticLoads(Labelled):
    """Least and greatest forces of joints over published moment arms.

    Attributes
    ----------
    time : (frames,) [s]
    joints : knees and ankles, by name
    static_load_low, static_load_high : (frames, joints) [N]; NaN where the motion is
    flexion : (frames, joints) of the knee, dorsiflexion of the ankle [rad]
    weight : of the body [N]
    """

    quantities = STATIC_LOADS
    axes = FrozenMap({"time": "time", "static_joint": "joints"})

    time: Array
    joints: tuple[str, ...]
    static_load_low: Array
    static_load_high: Array
    flexion: Array
    weight: float

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.joints))
        freeze(self, time=(-1,), static_load_low=shape, static_load_high=shape, flexion=shape)

    def __len__(self) -> int:
        return len(self.time)

    def only(self, frames: np.ndarray) -> StaticLoads:
        """Return the same with forces of some frames alone, NaN in others.

        Parameters
        ----------
        frames : (frames,) whether a frame keeps its forces

        Returns
        -------
        of the same joints
        """
        low = np.where(frames[:, None], self.static_load_low, np.nan)
        high = np.where(frames[:, None], self.static_load_high, np.nan)
        return replace(self, static_load_low=low, static_load_high=high)

    @property
    def series(self) -> tuple[Series, Series]:
        """Least and greatest forces, a column for each joint [N]."""
        low = Series(self.time, self.joints, self.static_load_low, quantity=STATIC_LOAD_LOW)
        high = Series(self.time, self.joints, self.static_load_high, quantity=STATIC_LOAD_HIGH)
        return low, high


class Pull(NamedTuple):
    """Muscles of one side of a joint.

    Attributes
    ----------
    least, greatest : (frames,) their moment arms [m]
    direction : (frames, 3) unit vectors in which they pull the joint's child, in ground
    """

    least: Array
    greatest: Array
    direction: Array


class Hinge(NamedTuple):
    """A joint that bends, with the muscles on both sides.

    Attributes
    ----------
    angle : its coordinate
    flexors, extensors : pulls in every frame
    """

    angle: JointAngle
    flexors: Pull
    extensors: Pull


def static_joint_loads(
    model: Model, motion: Motion, wrenches: Wrenches | None = None
) -> StaticLoads:
    """Least and greatest forces of knees and ankles that statics allow, without any muscle model.

    A knee is straightened by the patellar tendon, along the shank, and bent by hamstrings, along
    the thigh; an ankle is moved by the Achilles tendon and tibialis anterior, along the shank.
    Arms are two standard deviations about the means of what was measured, scaled by the thigh's
    length; hamstrings together have the mean of their least arms.

    Parameters
    ----------
    model : of a person; muscles play no part
    motion : with velocities and accelerations
    wrenches : external forces in ground at the motion's times, None for none

    Returns
    -------
    no joints for a model that has no knees, closes loops or is not as large as a person

    Raises
    ------
    BadData : derivatives are missing, or times differ
    UnknownName : a wrench acts on a body that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> static_joint_loads(model, motion).joints
    ()
    """
    tree = compile_tree(model)
    coordinates, rates = values_and_rates(tree, motion)
    hinges = () if model.loops else tuple(_hinges(tree, coordinates))
    shape = (len(motion), len(hinges))
    low = np.zeros(shape)
    high = np.zeros(shape)
    flexion = np.zeros(shape)
    if hinges:
        known = inverse_dynamics(model, motion, wrenches)
        torques = np.stack([known[name] for name in model.coordinate_names], axis=1)
        # What springs of joints give is not asked of muscles.
        left = torques - joint_forces(tree, coordinates, rates)
        balanced = gathered(tree, coordinates, left)
        names = [hinge.angle.joint.name for hinge in hinges]
        alone = joint_reactions(model, motion, None, wrenches, names, frame="ground").forces
    for place, hinge in enumerate(hinges):
        flexion[:, place] = hinge.angle.of(coordinates)
        bending = hinge.angle.of(balanced)
        low[:, place], high[:, place] = _range(alone[:, place], bending, hinge)
    return StaticLoads(
        time=motion.time,
        joints=tuple(hinge.angle.joint.name for hinge in hinges),
        static_load_low=low,
        static_load_high=high,
        flexion=flexion,
        weight=model.weight,
    )


def _range(alone: Array, bending: Array, hinge: Hinge) -> tuple[Array, Array]:
    """Least and greatest |F_0 - T u|, with T between torque over greatest and over least arm.

    Parameters
    ----------
    alone : (frames, 3) F_0 [N]
    bending : (frames,) torque towards flexion [N m]

    Returns
    -------
    (frames,) each [N]
    """
    flexes = bending > 0.0
    least = np.where(flexes, hinge.flexors.least, hinge.extensors.least)
    greatest = np.where(flexes, hinge.flexors.greatest, hinge.extensors.greatest)
    way = np.where(flexes[:, None], hinge.flexors.direction, hinge.extensors.direction)
    weakest = np.abs(bending) / greatest
    strongest = np.abs(bending) / least
    # Where the pull itself lifts part of F_0, the least lies between both ends.
    nearest = np.clip(np.einsum("fi,fi->f", alone, way), weakest, strongest)
    sizes = [
        np.linalg.norm(alone - pull[:, None] * way, axis=1)
        for pull in (nearest, weakest, strongest)
    ]
    return sizes[0], np.maximum(sizes[1], sizes[2])


def _hinges(tree: Tree, coordinates: Array) -> Iterator[Hinge]:
    """Find knees and ankles; `coordinates` (frames, coordinates) of the model [rad or m]."""
    model = tree.model
    poses = forward_kinematics(tree, coordinates)
    for leg in leg_angles(model):
        knee = leg.knee.joint
        down = long_axis(model, knee)
        hip = joint_above(model, knee.parent)
        size = size_of_person(model, knee)
        if down is None or hip is None or size is None:
            continue
        up = -poses.rotations[:, tree.body_index[knee.child]] @ down
        to_hip = _center(tree, poses, hip) - _center(tree, poses, knee)
        along_thigh = to_hip / np.linalg.norm(to_hip, axis=1, keepdims=True)
        bend = np.degrees(leg.knee.of(coordinates))
        yield Hinge(
            angle=leg.knee,
            flexors=_hamstrings(bend, size, along_thigh),
            extensors=_pull(PATELLAR_TENDON, bend, size, up),
        )
        if leg.ankle is not None:
            bend = np.degrees(leg.ankle.of(coordinates))
            yield Hinge(
                angle=leg.ankle,
                flexors=_pull(TIBIALIS_ANTERIOR, bend, size, up),
                extensors=_pull(ACHILLES, bend, size, up),
            )


def _center(tree: Tree, poses: Poses, joint: Joint) -> Array:
    """Centers (frames, 3) of a joint in ground, on its child [m]."""
    body = tree.body_index[joint.child]
    center = joint.child_frame.translation
    return np.asarray(poses.origins[:, body] + poses.rotations[:, body] @ center)


def _hamstrings(bend: Array, size: float, way: Array) -> Pull:
    """Pull of all hamstrings together; `bend` (frames,) [deg], `way` (frames, 3)."""
    ends = np.array([band.ends(bend, size) for band in HAMSTRINGS])
    least = np.maximum(ends[:, 0].mean(axis=0), MIN_ARM)
    return Pull(least=least, greatest=ends[:, 1].max(axis=0), direction=way)


def _pull(band: Band, bend: Array, size: float, way: Array) -> Pull:
    """Pull of one tendon; `bend` (frames,) [deg], `way` (frames, 3)."""
    low, high = band.ends(bend, size)
    return Pull(least=low, greatest=high, direction=way)
