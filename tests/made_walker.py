"""A made walker for tests of studies.

It is a pelvis that slides in the plane, with two legs that have a hip and a knee.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

PERIOD = 0.5
CYCLES = 5
RATE = 50.0
HERE = Transform.identity()


def at(x, y, z):
    return Transform(np.eye(3), np.array([x, y, z]))


def walker():
    """Make a pelvis that slides in the plane, and two legs with a hip and a knee."""
    slides = ("pelvis_tx", "pelvis_ty")
    root = tuple(
        Axis(kind="translation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(name,))
        for i, name in enumerate(slides)
    )
    bodies = ["pelvis"]
    joints = [
        Joint(
            name="root",
            kind="CustomJoint",
            parent=GROUND,
            child="pelvis",
            parent_frame=HERE,
            child_frame=HERE,
            axes=root,
            coordinates=slides,
        )
    ]
    names = [*slides]
    markers = [Marker(f"P{k}", "pelvis", np.eye(3)[k] * 0.1) for k in range(3)]
    muscles = []
    for side, z in (("r", 0.1), ("l", -0.1)):
        for parent, child, place, angle in (
            ("pelvis", f"thigh_{side}", at(0.0, 0.0, z), f"hip_flexion_{side}"),
            (f"thigh_{side}", f"foot_{side}", at(0.0, -0.4, 0.0), f"knee_angle_{side}"),
        ):
            hinge = (
                Axis(
                    kind="rotation",
                    vector=np.array([0.0, 0.0, 1.0]),
                    function=linear(1.0),
                    coordinates=(angle,),
                ),
            )
            joints.append(
                Joint(
                    name=f"to_{child}",
                    kind="CustomJoint",
                    parent=parent,
                    child=child,
                    parent_frame=place,
                    child_frame=at(0.0, 0.4 * child.startswith("foot"), 0.0),
                    axes=hinge,
                    coordinates=(angle,),
                )
            )
            bodies.append(child)
            names.append(angle)
            markers += [
                Marker(f"{child}_{k}", child, np.array(p))
                for k, p in enumerate(((0.1, 0.0, 0.0), (0.0, -0.1, 0.05)))
            ]
        points = (
            PathPoint("a", "pelvis", np.array([0.1, 0.0, z])),
            PathPoint("b", f"foot_{side}", np.array([0.05, 0.3, 0.0])),
        )
        muscles.append(
            Muscle(
                name=f"rectus_{side}",
                kind="Thelen2003Muscle",
                path=Path(points),
                max_isometric_force=500.0,
                optimal_fiber_length=0.1,
                tendon_slack_length=0.3,
            )
        )
    return Model(
        name="walker",
        bodies=tuple(
            Body(name=name, mass=10.0, mass_center=np.zeros(3), inertia=0.1 * np.eye(3))
            for name in bodies
        ),
        joints=tuple(joints),
        coordinates=tuple(
            Coordinate(
                name, "translational" if name in slides else "rotational", range=(-10.0, 10.0)
            )
            for name in names
        ),
        gravity=np.array([0.0, -9.81, 0.0]),
        markers=tuple(markers),
        muscles=tuple(muscles),
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
    return Markers(
        time,
        model.marker_names,
        poses.points(numbers, np.array([one.location for one in model.markers])),
    )
