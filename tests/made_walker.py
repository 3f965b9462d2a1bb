"""A made walker for tests of studies: a pelvis that slides in the plane, two legs with a hip and a knee."""

from __future__ import annotations

import numpy as np

from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.model.paths import Muscle, Path, PathPoint
from myomorph.model.series import Markers, Motion
from myomorph.model.spatial import Transform
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

PERIOD, CYCLES, RATE = 0.5, 5, 50.0
HERE = Transform.identity()


def at(x, y, z):
    return Transform(np.eye(3), np.array([x, y, z]))


def walker():
    """A pelvis that slides in the plane, and two legs with a hip and a knee."""
    slides = ("pelvis_tx", "pelvis_ty")
    root = tuple(Axis("translation", np.eye(3)[i], linear(1.0), (name,)) for i, name in enumerate(slides))
    bodies, joints, names = (
        ["pelvis"],
        [Joint("root", "CustomJoint", GROUND, "pelvis", HERE, HERE, root, slides)],
        [*slides],
    )
    markers, muscles = [Marker(f"P{k}", "pelvis", np.eye(3)[k] * 0.1) for k in range(3)], []
    for side, z in (("r", 0.1), ("l", -0.1)):
        for parent, child, place, angle in (
            ("pelvis", f"thigh_{side}", at(0.0, 0.0, z), f"hip_flexion_{side}"),
            (f"thigh_{side}", f"foot_{side}", at(0.0, -0.4, 0.0), f"knee_angle_{side}"),
        ):
            hinge = (Axis("rotation", np.array([0.0, 0.0, 1.0]), linear(1.0), (angle,)),)
            joints.append(
                Joint(
                    f"to_{child}",
                    "CustomJoint",
                    parent,
                    child,
                    place,
                    at(0.0, 0.4 * child.startswith("foot"), 0.0),
                    hinge,
                    (angle,),
                )
            )
            bodies.append(child)
            names.append(angle)
            markers += [
                Marker(f"{child}_{k}", child, np.array(p)) for k, p in enumerate(((0.1, 0.0, 0.0), (0.0, -0.1, 0.05)))
            ]
        points = (
            PathPoint("a", "pelvis", np.array([0.1, 0.0, z])),
            PathPoint("b", f"foot_{side}", np.array([0.05, 0.3, 0.0])),
        )
        muscles.append(Muscle(f"rectus_{side}", "Thelen2003Muscle", Path(points), 500.0, 0.1, 0.3))
    return Model(
        "walker",
        tuple(Body(name, 10.0, np.zeros(3), 0.1 * np.eye(3)) for name in bodies),
        tuple(joints),
        tuple(
            Coordinate(name, "translational" if name in slides else "rotational", range=(-10.0, 10.0)) for name in names
        ),
        np.array([0.0, -9.81, 0.0]),
        tuple(markers),
        tuple(muscles),
    )


def recording(model, rng, extra):
    """Markers of a walk at 1 m/s; mutants bend the knee by `extra` more in swing."""
    time = np.arange(0.0, CYCLES * PERIOD, 1.0 / RATE)
    swing = 0.35 + 0.03 * rng.standard_normal()
    columns = {"pelvis_tx": time, "pelvis_ty": np.full_like(time, 0.8)}
    for side, shift in (("r", 0.0), ("l", 0.5)):
        phase = 2.0 * np.pi * (time / PERIOD - shift)
        columns[f"hip_flexion_{side}"] = swing * np.cos(phase)
        bend = 0.1 + 0.05 * rng.standard_normal() + extra * np.clip(-np.sin(phase), 0.0, 1.0) ** 2
        columns[f"knee_angle_{side}"] = -bend
    motion = Motion(time, tuple(columns), np.column_stack(list(columns.values())))
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    numbers = np.array([tree.body_index[one.body] for one in model.markers])
    return Markers(time, model.marker_names, poses.points(numbers, np.array([one.location for one in model.markers])))
