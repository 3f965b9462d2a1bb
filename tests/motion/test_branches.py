"""Two triples of angles turn a ball joint alike: a motion stays with one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.model.series import Markers, Motion
from myomorph.model.spatial import Transform
from myomorph.motion import ik
from myomorph.motion.branches import of_one_branch, other_branch
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics, pose_problem, tracked_markers
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

STILL = Transform.identity()
NAMES = ("flexion", "adduction", "rotation")


def arm(reach: float = np.pi) -> Model:
    """An arm on a shoulder of three hinges, each free within a reach to either side."""
    axes = tuple(Axis("rotation", np.eye(3)[k], linear(1.0), (name,)) for k, name in zip((2, 0, 1), NAMES, strict=True))
    coordinates = tuple(Coordinate(name, range=(-reach, reach), clamped=True) for name in NAMES)
    places = ((0.0, -0.3, 0.0), (0.05, -0.2, 0.0), (0.0, -0.1, 0.06), (-0.04, -0.25, 0.03))
    return Model(
        name="arm",
        gravity=np.array([0.0, -9.81, 0.0]),
        bodies=(Body("humerus", mass=2.0, mass_center=np.array([0.0, -0.15, 0.0]), inertia=0.01 * np.eye(3)),),
        joints=(Joint("shoulder", "CustomJoint", GROUND, "humerus", STILL, STILL, axes, NAMES),),
        coordinates=coordinates,
        markers=tuple(Marker(f"m{i}", "humerus", np.array(one)) for i, one in enumerate(places)),
    )


def through_the_side() -> np.ndarray:
    """(80, 3) angles that pass near an adduction of a right angle, where both branches meet."""
    phase = np.linspace(0.0, 2.0 * np.pi, 80)
    return np.column_stack([0.4 * np.sin(phase), 1.45 * np.sin(0.5 * phase), 0.3 * np.cos(phase)])


def branched(model: Model, values: np.ndarray) -> np.ndarray:
    """The motion with stretches on the other branch, put back."""
    tree = compile_tree(model)
    markers = Markers(np.arange(len(values)) * 0.01, model.marker_names, np.zeros((len(values), 4, 3)))
    options = InverseKinematicsOptions()
    arrays = pose_problem(tree, *tracked_markers(model, markers, options), options)
    return of_one_branch(tree, arrays, values)


def test_stretches_on_the_other_branch_come_back_to_the_one_of_the_first_frame():
    model, true = arm(2.0 * np.pi), through_the_side()
    given = true.copy()
    for part in (slice(16, 32), slice(48, 64)):
        given[part] = [other_branch(one) for one in true[part]]
    given[40] = np.nan
    rotations = [forward_kinematics(compile_tree(model), one[16:32]).rotations for one in (true, given)]
    np.testing.assert_allclose(*rotations, atol=1e-12)
    seen = np.isfinite(given).all(axis=1)
    np.testing.assert_allclose(branched(model, given)[seen], true[seen], atol=1e-12)
    np.testing.assert_array_equal(branched(model, true), true)


def test_angles_that_would_leave_their_bounds_stay():
    given = through_the_side()
    given[20:] = [other_branch(one) for one in given[20:]]
    given[20:] -= 2.0 * np.pi * np.round(given[20:] / (2.0 * np.pi))
    np.testing.assert_array_equal(branched(arm(0.35), given), given)


def test_inverse_kinematics_that_begins_a_stretch_on_the_other_branch_does_not_jump(monkeypatch):
    model, true = arm(), through_the_side()
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


def test_a_joint_whose_axes_are_not_perpendicular_is_left():
    model = arm(2.0 * np.pi)
    tilted = Axis("rotation", np.array([0.6, 0.0, 0.8]), linear(1.0), ("adduction",))
    joint = replace(model.joints[0], axes=(model.joints[0].axes[0], tilted, model.joints[0].axes[2]))
    given = through_the_side()
    given[20:] = [other_branch(one) for one in given[20:]]
    np.testing.assert_array_equal(branched(replace(model, joints=(joint,)), given), given)
