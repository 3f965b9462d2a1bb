"""Models that close loops: made ones, and those of the data collection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Loop, Marker, Model
from myomorph.model.spatial import Transform
from myomorph.rigid.kinematics import couple_frames, forward_kinematics
from myomorph.rigid.tree import compile_tree
from trees import functional_tree, random_rotation, random_tree

SHOULDERS = (
    "shoulder-bonepin/subject1_abdbonepin.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_2kgWeight.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim",
)


def looped_tree(seed, kinds=("PointConstraint", "WeldConstraint"), functional=False, bodies=30):
    """A random tree with a loop of each kind, closed at random coordinates, and those coordinates."""
    rng = np.random.default_rng(500 + seed)
    model = functional_tree(seed, bodies) if functional else random_tree(seed, bodies)
    closed = rng.normal(scale=0.4, size=(1, len(model.coordinates)))
    tree = compile_tree(model)
    couple_frames(tree.arrays, closed)
    poses = forward_kinematics(tree, closed)
    loops = []
    for i, kind in enumerate(kinds):
        one, two = len(model.bodies) - i, 2 + i
        world = Transform(random_rotation(rng), rng.normal(size=3))
        ends = [Transform(poses.rotations[0, b], poses.origins[0, b]).inverse() @ world for b in (one, two)]
        loops.append(Loop(f"loop{i}", kind, model.bodies[one - 1].name, model.bodies[two - 1].name, *ends))
    return replace(model, loops=tuple(loops)), closed[0]


def four_bar(crank=0.3, coupler=0.7, rocker=0.6, ground=0.8, kind="PointConstraint"):
    """A planar linkage: the crank and the rocker turn on the ground, the coupler's end is tied to the rocker's.

    Turns about z; coordinates crank, coupler (relative to the crank) and rocker; four markers a body.
    """
    still = Transform.identity()
    z = np.eye(3)[2]

    def hinge(name, parent, at):
        axis = Axis("rotation", z, linear(1.0), (name,))
        return Joint(name, "PinJoint", parent, f"{name}_bar", Transform(np.eye(3), at), still, (axis,), (name,))

    joints = (
        hinge("crank", GROUND, np.zeros(3)),
        hinge("coupler", "crank_bar", np.array([crank, 0.0, 0.0])),
        hinge("rocker", GROUND, np.array([ground, 0.0, 0.0])),
    )
    lengths = (crank, coupler, rocker)
    names = ("crank", "coupler", "rocker")
    bodies = tuple(
        Body(f"{name}_bar", 1.0, np.array([0.5 * length, 0.0, 0.0]), 0.01 * np.eye(3))
        for name, length in zip(names, lengths, strict=True)
    )
    tie = Loop(
        "pin", kind, "coupler_bar", "rocker_bar",
        Transform(np.eye(3), np.array([coupler, 0.0, 0.0])), Transform(np.eye(3), np.array([rocker, 0.0, 0.0])),
    )  # fmt: skip
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, np.array([0.1 * i, 0.05 * (-1) ** i, 0.02]))
        for body in bodies
        for i in (1, 2, 3)
    )
    coordinates = tuple(Coordinate(name, default=value) for name, value in zip(names, (1.0, -0.5, 1.5), strict=True))
    return Model("four bars", bodies, joints, coordinates, np.array([0, -9.81, 0]), markers, loops=(tie,))


def four_bar_angles(turn, crank=0.3, coupler=0.7, rocker=0.6, ground=0.8):
    """(frames, 3) coordinates of `four_bar` by the law of cosines, for crank angles (frames,); elbow up."""
    end = crank * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    away = np.array([ground, 0.0]) - end
    distance = np.linalg.norm(away, axis=1)
    inner = np.arccos((coupler**2 + distance**2 - rocker**2) / (2 * coupler * distance))
    heading = np.arctan2(away[:, 1], away[:, 0]) + inner
    tip = end + coupler * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    back = np.arctan2(tip[:, 1], tip[:, 0] - ground)
    return np.stack([turn, heading - turn, back], axis=1)
