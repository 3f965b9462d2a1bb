"""Angles that give the same pose.

A floating root has no bounds, and a ball joint keeps to one of two triples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.test_ik import walker

from myomorph.core.io.formats import read_model
from myomorph.core.io.trc import read_trc
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.motion import ik
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    inverse_kinematics,
    pose_problem,
    tracked_markers,
)
from myomorph.core.motion.starts import nearest_turns
from myomorph.core.motion.turns import (
    floating_coordinates,
    nearest_turn,
    of_one_branch,
    of_one_turn,
    other_angles,
    other_branch,
)
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure

ROOT = ("root_tx", "root_ty", "root_tz", "root_rz", "root_rx", "root_ry")


def bounded_walker():
    """Return the walker with a root that may rotate by 90 degrees and stand within 5 m."""
    model = walker()
    coordinates = [
        (
            replace(
                one,
                clamped=True,
                range=(-5.0, 5.0) if one.motion == "translational" else (-np.pi / 2, np.pi / 2),
            )
            if one.name in ROOT
            else one
        )
        for one in model.coordinates
    ]
    return replace(model, coordinates=tuple(coordinates))


def recorded(model, turn: float, x: float) -> tuple[Markers, Motion]:
    """Ten frames of the walker somewhere, and its motion."""
    tree = compile_tree(model)
    values = np.tile(tree.defaults, (10, 1))
    names = model.coordinate_names
    values[:, names.index("root_ry")] = turn
    values[:, names.index("root_tx")] = x
    values[:, names.index("hip_z_r")] = np.linspace(0.0, 0.5, 10)
    values[:, names.index("knee_l")] = np.linspace(-0.5, -0.1, 10)
    motion = Motion(np.arange(10) * 0.01, names, values)
    values = tree.coordinates_of(motion)
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    places = poses.points(bodies, np.array([one.location for one in model.markers]))
    return Markers(motion.time, model.marker_names, places), replace(motion, values=values)


def test_the_floating_root_is_found_and_a_hinge_is_not():
    model = walker()
    assert set(floating_coordinates(model)) == set(ROOT)
    hinge = replace(
        model.joints[0],
        axes=(
            Axis(
                kind="rotation", vector=np.eye(3)[2], function=linear(1.0), coordinates=("root_rz",)
            ),
        ),
    )
    assert floating_coordinates(replace(model, joints=(hinge, *model.joints[1:]))) == ()
    sled = replace(
        model.joints[0],
        axes=(
            Axis(
                kind="translation",
                vector=np.eye(3)[0],
                function=linear(1.0),
                coordinates=("root_tx",),
            ),
        ),
    )
    assert floating_coordinates(replace(model, joints=(sled, *model.joints[1:]))) == ()


@pytest.mark.parametrize(("turn", "x"), [(2.5, 0.3), (-1.2, 9.0), (np.pi, -7.0)])
def test_a_body_is_found_beyond_the_bounds_of_its_root(turn, x):
    model = bounded_walker()
    markers, true = recorded(model, turn, x)
    free = inverse_kinematics(model, markers)
    assert free.largest.max() < 1e-5
    inner = [i for i, name in enumerate(model.coordinate_names) if name not in ROOT]
    np.testing.assert_allclose(free.motion.values[:, inner], true.values[:, inner], atol=1e-4)
    held = inverse_kinematics(model, markers, InverseKinematicsOptions(root_bounds=True))
    assert held.largest.max() > 0.05
    assert np.abs(held.motion["root_tx"]).max() <= 5.0 + 1e-9


def test_within_its_bounds_the_result_is_the_same():
    model = bounded_walker()
    markers, _ = recorded(model, 0.4, 1.0)
    free = inverse_kinematics(model, markers)
    held = inverse_kinematics(model, markers, InverseKinematicsOptions(root_bounds=True))
    np.testing.assert_allclose(free.motion.values, held.motion.values, atol=1e-7)


def test_of_all_angles_of_a_rotation_the_nearest_to_the_reference_are_taken():
    model = walker()
    tree = compile_tree(model)
    turning = [model.coordinate_names.index(name) for name in ROOT[3:]]
    pose = tree.defaults.copy()
    pose[turning] = 0.3, -0.2, 3.0
    other = pose.copy()
    other[turning] = 0.3 + np.pi, np.pi + 0.2, 3.0 - np.pi
    before = forward_kinematics(tree, np.array([pose, other])).rotations
    np.testing.assert_allclose(before[0], before[1], atol=1e-12)
    np.testing.assert_allclose(
        nearest_turns(tree, turning, other, pose)[turning], pose[turning], atol=1e-12
    )
    np.testing.assert_allclose(
        nearest_turns(tree, turning, pose, other)[turning], other[turning], atol=1e-12
    )


@pytest.mark.parametrize("degrees", [90.0, 180.0, -90.0])
def test_a_walk_along_another_axis_has_the_same_joint_angles(data, degrees):
    model = read_model(data("knee-implant-walk/scaled.osim"))
    markers = read_trc(data("knee-implant-walk/walk1.trc")).markers
    markers = replace(markers, time=markers.time[:40], values=markers.values[:40])
    angle = np.radians(degrees)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    straight = inverse_kinematics(model, markers).motion
    turned = inverse_kinematics(model, replace(markers, values=markers.values @ turn.T)).motion
    inner = [i for i, name in enumerate(straight.names) if not name.startswith("pelvis")]
    np.testing.assert_allclose(
        turned.values[:, inner], straight.values[:, inner], atol=np.radians(0.01)
    )


STILL = Transform.identity()
NAMES = ("flexion", "adduction", "rotation")


def arm(reach: float = np.pi) -> Model:
    """Make an arm on a shoulder of three hinges, each free within a range to either side."""
    axes = tuple(
        Axis(kind="rotation", vector=np.eye(3)[k], function=linear(1.0), coordinates=(name,))
        for k, name in zip((2, 0, 1), NAMES, strict=True)
    )
    coordinates = tuple(Coordinate(name, range=(-reach, reach), clamped=True) for name in NAMES)
    places = ((0.0, -0.3, 0.0), (0.05, -0.2, 0.0), (0.0, -0.1, 0.06), (-0.04, -0.25, 0.03))
    return Model(
        name="arm",
        gravity=np.array([0.0, -9.81, 0.0]),
        bodies=(
            Body(
                "humerus",
                mass=2.0,
                mass_center=np.array([0.0, -0.15, 0.0]),
                inertia=0.01 * np.eye(3),
            ),
        ),
        joints=(
            Joint(
                name="shoulder",
                kind="CustomJoint",
                parent=GROUND,
                child="humerus",
                parent_frame=STILL,
                child_frame=STILL,
                axes=axes,
                coordinates=NAMES,
            ),
        ),
        coordinates=coordinates,
        markers=tuple(Marker(f"m{i}", "humerus", np.array(one)) for i, one in enumerate(places)),
    )


def _through_the_side() -> np.ndarray:
    """(80, 3) angles that pass near an adduction of a right angle, where both branches meet."""
    phase = np.linspace(0.0, 2.0 * np.pi, 80)
    return np.column_stack([0.4 * np.sin(phase), 1.45 * np.sin(0.5 * phase), 0.3 * np.cos(phase)])


def problem_of(model: Model, frames: int):
    """Return what inverse kinematics solves for frames of a model, whatever the markers are."""
    markers = Markers(
        np.arange(frames) * 0.01, model.marker_names, np.zeros((frames, len(model.markers), 3))
    )
    options = InverseKinematicsOptions()
    tree = compile_tree(model)
    return tree, pose_problem(tree, *tracked_markers(model, markers, options), options)


def _branched(model: Model, values: np.ndarray) -> np.ndarray:
    """Return the motion with intervals on the other branch, put back."""
    return of_one_branch(*problem_of(model, len(values)), values)


def test_stretches_on_the_other_branch_come_back_to_the_one_of_the_first_frame():
    model = arm(2.0 * np.pi)
    true = _through_the_side()
    given = true.copy()
    for part in (slice(16, 32), slice(48, 64)):
        given[part] = [other_branch(one) for one in true[part]]
    given[40] = np.nan
    rotations = [
        forward_kinematics(compile_tree(model), one[16:32]).rotations for one in (true, given)
    ]
    np.testing.assert_allclose(*rotations, atol=1e-12)
    seen = np.isfinite(given).all(axis=1)
    np.testing.assert_allclose(_branched(model, given)[seen], true[seen], atol=1e-12)
    np.testing.assert_array_equal(_branched(model, true), true)


def test_angles_that_would_leave_their_bounds_stay():
    given = _through_the_side()
    given[20:] = [other_branch(one) for one in given[20:]]
    given[20:] -= 2.0 * np.pi * np.round(given[20:] / (2.0 * np.pi))
    np.testing.assert_array_equal(_branched(arm(0.35), given), given)


def test_inverse_kinematics_that_begins_a_stretch_on_the_other_branch_does_not_jump(monkeypatch):
    model = arm()
    true = _through_the_side()
    motion = Motion(np.arange(80) * 0.01, NAMES, true)
    poses = forward_kinematics(compile_tree(model), true)
    places = poses.points(np.ones(4, int), np.array([one.location for one in model.markers]))
    scout = ik.scout_poses

    def astray(*given):
        found = scout(*given)
        turned = np.array([other_branch(one) for one in found])
        turned -= 2.0 * np.pi * np.round(turned / (2.0 * np.pi))
        found[3:] = turned[3:]
        return found

    monkeypatch.setattr(ik, "scout_poses", astray)
    found = inverse_kinematics(model, Markers(motion.time, model.marker_names, places))
    assert found.largest.max() < 1e-5
    assert np.abs(np.diff(found.motion.values, axis=0)).max() < 0.5
    np.testing.assert_allclose(found.motion.values, true, atol=1e-4)


@pytest.mark.parametrize("last", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-0.0846, 0.9947, -0.0584)])
def test_two_triples_of_angles_about_any_axes_are_one_rotation(last):
    axes = np.array([(0.0, 0.0, 1.0), (0.6, 0.8, 0.0), np.array(last) / np.linalg.norm(last)])

    def rotation(angles: np.ndarray) -> np.ndarray:
        return np.linalg.multi_dot(
            [axis_rotation(axis, angle) for axis, angle in zip(axes, angles, strict=True)]
        )

    for angles in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3)):
        other = other_angles(angles, axes)
        np.testing.assert_allclose(rotation(other), rotation(angles), atol=1e-12)
        assert np.abs(nearest_turn(other, angles) - angles).max() > 0.1
        np.testing.assert_allclose(
            nearest_turn(other_angles(other, axes), angles), angles, atol=1e-9
        )


def test_stretches_on_the_other_branch_come_back_where_axes_are_not_perpendicular():
    model = arm(2.0 * np.pi)
    tilted = Axis(
        kind="rotation",
        vector=np.array([0.6, 0.0, 0.8]),
        function=linear(1.0),
        coordinates=("adduction",),
    )
    joint = replace(
        model.joints[0], axes=(model.joints[0].axes[0], tilted, model.joints[0].axes[2])
    )
    true = 0.3 * _through_the_side()
    turned = true.copy()
    turned[20:50] = [
        other_angles(angles, np.array([axis.vector for axis in joint.axes]))
        for angles in true[20:50]
    ]
    np.testing.assert_allclose(_branched(replace(model, joints=(joint,)), turned), true, atol=1e-9)


def free(model: Model) -> Model:
    """Return the model without bounds of angles."""
    turning = [
        replace(one, clamped=one.clamped and one.motion != "rotational")
        for one in model.coordinates
    ]
    return replace(model, coordinates=tuple(turning))


def test_angles_go_on_on_the_nearest_turn_after_a_gap_and_stay_within_bounds():
    angle = np.array([0.1, 0.2, np.nan, 0.3, 0.4, 3.0, 3.5, 6.0])
    given = np.zeros((8, 3))
    given[:, 0] = angle + 2.0 * np.pi * np.array([1, 1, 0, -2, -2, -2, -3, -3])
    found = of_one_turn(*problem_of(free(arm()), 8), given)
    np.testing.assert_allclose(found[:, 0], angle, atol=1e-12)
    np.testing.assert_array_equal(found[:, 1:], 0.0)
    np.testing.assert_allclose(
        of_one_turn(*problem_of(arm(2.5 * np.pi), 8), given)[:, 0], angle, atol=1e-12
    )
    # 6 rad are beyond the bounds: nothing moves.
    np.testing.assert_array_equal(of_one_turn(*problem_of(arm(), 8), given)[:, 0], given[:, 0])


def test_a_whole_turn_and_another_branch_at_once_come_back():
    model = free(arm())
    given = _through_the_side()[:20]
    turned = given.copy()
    turned[8:12, 2] -= 2.0 * np.pi
    turned[12:16] = [other_branch(one) for one in given[12:16]] + 2.0 * np.pi * np.array(
        [1.0, 0.0, -1.0]
    )
    np.testing.assert_allclose(_branched(model, turned), given, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_without_bounds_a_motion_in_chunks_has_no_turns_and_its_torques_are_those_of_one(seed):
    """Simulated markers with errors of 1 mm: stretches of frames are solved from other poses."""
    model = free(stick_figure())
    tree = compile_tree(model)
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(200)
    phase = 2.0 * np.pi * time[:, None] * rng.uniform(0.3, 1.0, len(tree.defaults)) + rng.uniform(
        0.0, 6.0
    )
    poses = forward_kinematics(tree, tree.defaults + 0.5 * np.sin(phase))
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    places = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    markers = Markers(time, model.marker_names, places + rng.normal(scale=1e-3, size=places.shape))
    motion = inverse_kinematics(model, markers).motion
    assert np.abs(np.diff(motion.values, axis=0)).max() < 0.5 * np.pi
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("myomorph.core.motion.newton.CHUNK", len(time))
        whole = inverse_kinematics(model, markers).motion
    torques = [inverse_dynamics(model, differentiate(one, 6.0)).values for one in (motion, whole)]
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-3 * np.abs(torques[1]).max())
