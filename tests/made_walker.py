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


SLIDES = ("pelvis_tx", "pelvis_ty")
SIDES = {"r": 0.1, "l": -0.1}  # Where the hips are, along z [m].


def walker():
    """Make a pelvis that slides in the plane, and two legs with a hip and a knee."""
    joints = [root_joint(), *(joint for side in SIDES for joint in leg_joints(side))]
    bodies = [joint.child for joint in joints]
    names = [name for joint in joints for name in joint.coordinates]
    markers = [Marker(f"P{k}", "pelvis", np.eye(3)[k] * 0.1) for k in range(3)]
    for body in bodies[1:]:
        markers += leg_markers(body)
    return Model(
        name="walker",
        bodies=tuple(
            Body(name=name, mass=10.0, mass_center=np.zeros(3), inertia=0.1 * np.eye(3))
            for name in bodies
        ),
        joints=tuple(joints),
        coordinates=tuple(
            Coordinate(
                name, "translational" if name in SLIDES else "rotational", range=(-10.0, 10.0)
            )
            for name in names
        ),
        gravity=np.array([0.0, -9.81, 0.0]),
        markers=tuple(markers),
        muscles=tuple(map(rectus, SIDES)),
    )


def root_joint():
    """Return the joint by which the pelvis slides along x and y."""
    axes = tuple(
        Axis(kind="translation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(name,))
        for i, name in enumerate(SLIDES)
    )
    return Joint(
        name="root",
        kind="CustomJoint",
        parent=GROUND,
        child="pelvis",
        parent_frame=HERE,
        child_frame=HERE,
        axes=axes,
        coordinates=SLIDES,
    )


def leg_joints(side):
    """Return hip and knee of a side, the hip first."""
    thigh = f"thigh_{side}"
    foot = f"foot_{side}"
    hip = hinge("pelvis", thigh, at(0.0, 0.0, SIDES[side]), HERE, f"hip_flexion_{side}")
    knee = hinge(thigh, foot, at(0.0, -0.4, 0.0), at(0.0, 0.4, 0.0), f"knee_angle_{side}")
    return hip, knee


def hinge(parent, child, in_parent, in_child, angle):
    """Return a hinge about z, by the frames of the joint in both bodies."""
    axis = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=(angle,),
    )
    return Joint(
        name=f"to_{child}",
        kind="CustomJoint",
        parent=parent,
        child=child,
        parent_frame=in_parent,
        child_frame=in_child,
        axes=(axis,),
        coordinates=(angle,),
    )


def leg_markers(body):
    """Return the two markers on a thigh or a foot."""
    places = ((0.1, 0.0, 0.0), (0.0, -0.1, 0.05))
    return [Marker(f"{body}_{k}", body, np.array(place)) for k, place in enumerate(places)]


def rectus(side):
    """Return the muscle of a side, from the pelvis over hip and knee to the foot."""
    points = (
        PathPoint("a", "pelvis", np.array([0.1, 0.0, SIDES[side]])),
        PathPoint("b", f"foot_{side}", np.array([0.05, 0.3, 0.0])),
    )
    return Muscle(
        name=f"rectus_{side}",
        kind="Thelen2003Muscle",
        path=Path(points),
        max_isometric_force=500.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.3,
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
