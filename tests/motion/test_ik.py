"""Inverse kinematics recovers known motions, keeps its bounds, and survives gaps and bad starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.functions import linear, simm_spline
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Coupler, Joint, Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

X, Y, Z = np.eye(3)


def _axis(kind, vector, coordinate):
    return Axis(kind=kind, vector=vector, function=linear(1.0), coordinates=(coordinate,))


def leg_joints(side, sign, names):
    """Make a hip with these coordinates, a knee that slides as it bends, and the cap's joint."""
    still = Transform.identity()
    hip = Transform(np.eye(3), np.array([0.0, -0.1, 0.1 * sign]))
    knee = Transform(np.eye(3), np.array([0.0, -0.4, 0.0]))
    slide = simm_spline([-2.0, -1.0, 0.0, 1.0], [0.02, 0.01, 0.0, 0.0])
    slides = Axis(kind="translation", vector=X, function=slide, coordinates=(f"knee_{side}",))
    return [
        Joint(
            name=f"hip_{side}",
            kind="CustomJoint",
            parent="trunk",
            child=f"thigh_{side}",
            parent_frame=hip,
            child_frame=still,
            axes=tuple(_axis("rotation", v, n) for v, n in zip((Z, X, Y), names, strict=True)),
            coordinates=names,
        ),
        Joint(
            name=f"knee_{side}",
            kind="CustomJoint",
            parent=f"thigh_{side}",
            child=f"shank_{side}",
            parent_frame=knee,
            child_frame=still,
            axes=(slides, _axis("rotation", Z, f"knee_{side}")),
            coordinates=(f"knee_{side}",),
        ),
        Joint(
            name=f"cap_{side}",
            kind="PinJoint",
            parent=f"thigh_{side}",
            child=f"cap_{side}",
            parent_frame=knee,
            child_frame=still,
            axes=(_axis("rotation", Z, f"cap_{side}"),),
            coordinates=(f"cap_{side}",),
        ),
    ]


def walker():
    """Make a floating trunk with two legs of hip (3) and knee (1), the knee caps coupled.

    Each body has four markers.
    """
    rng = np.random.default_rng(0)
    still = Transform.identity()
    bodies = [Body(name="trunk", mass=40.0, mass_center=np.zeros(3), inertia=np.eye(3))]
    root = ["root_rz", "root_rx", "root_ry", "root_tx", "root_ty", "root_tz"]
    turns = tuple(_axis("rotation", v, n) for v, n in zip((Z, X, Y), root[:3], strict=True))
    shifts = tuple(_axis("translation", v, n) for v, n in zip((X, Y, Z), root[3:], strict=True))
    joints = [
        Joint(
            name="root",
            kind="FreeJoint",
            parent=GROUND,
            child="trunk",
            parent_frame=still,
            child_frame=still,
            axes=shifts + turns,
            coordinates=tuple(root),
        )
    ]
    coordinates = [Coordinate(n) for n in root[:3]] + [
        Coordinate(n, "translational") for n in root[3:]
    ]
    couplers = []
    for side, sign in (("r", 1.0), ("l", -1.0)):
        names = tuple(f"hip_{a}_{side}" for a in ("z", "x", "y"))
        joints += leg_joints(side, sign, names)
        couplers.append(
            Coupler(
                name=f"cap_{side}",
                dependent=f"cap_{side}",
                function=linear(0.7, 0.1),
                independents=(f"knee_{side}",),
            )
        )
        bodies += [
            Body(name=f"{b}_{side}", mass=5.0, mass_center=np.zeros(3), inertia=np.eye(3) * 0.1)
            for b in ("thigh", "shank", "cap")
        ]
        coordinates += [Coordinate(n) for n in names] + [
            Coordinate(f"knee_{side}", range=(-2.0, 0.1)),
            Coordinate(f"cap_{side}"),
        ]
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, rng.normal(scale=0.15, size=3))
        for body in bodies
        for i in range(4)
    )
    return Model(
        name="walker",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0, -9.81, 0]),
        markers=markers,
        couplers=tuple(couplers),
    )


def walking(model, frames=300, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 100.0
    n = len(model.coordinates)
    values = 0.3 * np.sin(t[:, None] * rng.uniform(2, 6, n) + rng.uniform(0, 6, n))
    knees = [i for i, name in enumerate(model.coordinate_names) if name.startswith("knee")]
    values[:, knees] -= 0.5
    return Motion(
        t,
        model.coordinate_names,
        compile_tree(model).coordinates_of(Motion(t, model.coordinate_names, values)),
    )


def seen(model, motion):
    tree = compile_tree(model)
    poses = forward_kinematics(tree, motion.values)
    bodies = np.array([tree.body_index[m.body] for m in model.markers])
    return Markers(
        motion.time,
        model.marker_names,
        poses.points(bodies, np.array([m.location for m in model.markers])),
    )


def test_a_known_motion_is_recovered():
    model = walker()
    motion = walking(model)
    fit = inverse_kinematics(model, seen(model, motion))
    assert fit.converged.all()
    np.testing.assert_allclose(fit.motion.values, motion.values, atol=1e-5)
    assert np.nanmax(fit.marker_error) < 1e-5


def test_a_turned_body_is_found_from_the_default_pose():
    model = walker()
    motion = walking(model)
    values = motion.values.copy()
    values[:, 2] += np.pi
    values[:, 3] += 7.0
    turned = Motion(motion.time, motion.names, values)
    fit = inverse_kinematics(model, seen(model, turned))
    assert np.nanmax(fit.marker_error) < 1e-5


def test_the_optimum_is_stationary_in_noise():
    """No single coordinate can lower the cost: the gradient is zero where it should be."""
    model = walker()
    markers = seen(model, walking(model, 40))
    rng = np.random.default_rng(1)
    noisy = replace(
        markers, values=markers.values + rng.normal(scale=0.01, size=markers.values.shape)
    )
    fit = inverse_kinematics(
        model, noisy, InverseKinematicsOptions(tolerance=1e-9, posture_weight=0.0)
    )
    tree = compile_tree(model)

    def cost(values):
        moved = Motion(fit.motion.time, model.coordinate_names, values)
        x = seen(model, replace(moved, values=tree.coordinates_of(moved))).values
        return ((x - noisy.values) ** 2).sum(axis=2).mean(axis=1)

    step = 1e-4
    best = cost(fit.motion.values)
    for j in tree.independent:
        for sign in (-1, 1):
            values = fit.motion.values.copy()
            values[:, j] += sign * step
            assert (cost(values) > best).all()


def test_gaps_do_not_move_the_rest():
    model = walker()
    motion = walking(model)
    markers = seen(model, motion)
    values = markers.values.copy()
    values[50:70, :2] = np.nan
    values[100:110] = np.nan
    fit = inverse_kinematics(model, replace(markers, values=values))
    blank = np.zeros(300, bool)
    blank[100:110] = True
    assert np.isnan(fit.motion.values[blank]).all()
    assert not fit.converged[blank].any()
    np.testing.assert_allclose(fit.motion.values[~blank], motion.values[~blank], atol=1e-5)
    assert np.isnan(fit.marker_error[50:70, :2]).all()


def test_clamped_coordinates_stay_in_range_and_locked_ones_at_their_value():
    model = walker()
    motion = walking(model)
    changed = []
    for c in model.coordinates:
        if c.name == "knee_r":
            c = replace(c, clamped=True, range=(-0.5, 0.1))
        if c.name == "hip_y_l":
            c = replace(c, locked=True, default=0.2)
        changed.append(c)
    bounded = replace(model, coordinates=tuple(changed))
    fit = inverse_kinematics(bounded, seen(model, motion))
    knee = fit.motion["knee_r"]
    assert knee.min() >= -0.5 - 1e-9
    assert (np.abs(knee + 0.5) < 1e-6).sum() > 50
    assert (fit.motion["hip_y_l"] == 0.2).all()
    assert fit.converged.all()


def test_coordinate_tasks_pull_and_weights_choose():
    model = walker()
    markers = seen(model, walking(model))
    strong = InverseKinematicsOptions(tasks=[CoordinateTask("knee_l", 1e6, -1.0)])
    np.testing.assert_allclose(
        inverse_kinematics(model, markers, strong).motion["knee_l"], -1.0, atol=1e-3
    )
    few = InverseKinematicsOptions(
        marker_weights={"trunk_0": 1.0, "trunk_1": 2.0, "trunk_2": 1.0}, only_weighted=True
    )
    fit = inverse_kinematics(model, markers, few)
    assert fit.marker_names == ("trunk_0", "trunk_1", "trunk_2")
    np.testing.assert_allclose(fit.motion["knee_l"], 0.0, atol=1e-6)


def test_what_does_not_match_is_refused_by_name():
    model = walker()
    markers = seen(model, walking(model, 10))
    renamed = replace(markers, names=tuple(f"other{i}" for i in range(len(markers.names))))
    with pytest.raises(BadData, match=r"share no marker.*trunk_0.*other0"):
        inverse_kinematics(model, renamed)
    with pytest.raises(BadData, match="none of the 10 frames"):
        inverse_kinematics(model, replace(markers, values=np.full(markers.values.shape, np.nan)))
    with pytest.raises(UnknownName, match="'trunk_9'"):
        inverse_kinematics(
            model, markers, InverseKinematicsOptions(marker_weights={"trunk_9": 1.0})
        )
