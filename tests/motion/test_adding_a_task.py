"""A kind of task is one file (`orientation_task.py`) and one line: orientations count beside and without markers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from orientation_task import OrientationTask

from myomorph.model.errors import BadData
from myomorph.model.series import Markers
from myomorph.motion import newton
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics, pose_problem
from myomorph.motion.newton import solve_frames
from myomorph.motion.pose_equations import normal_equations
from myomorph.motion.tasks.task import new_work, sum_of_costs
from myomorph.rigid.couplers import couple
from myomorph.rigid.kernels import kernel, signatures_on_disk
from myomorph.rigid.kinematics import body_poses, forward_kinematics
from myomorph.rigid.tree import compile_tree
from stick_figure import stick_figure
from trees import random_tree

STEP = 1e-5
FRAMES = 12


@kernel
def equations_at(T, P, independent):
    """Cost of the pose alone, cost with derivatives, gradient and Hessian of half of it."""
    c = independent.copy()
    work = new_work(T, c.shape[0])
    couple(T, c)
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    plain = sum_of_costs(P.tasks, c, 0, work)
    return plain, normal_equations(T, P, 0, c, work), work.g, work.H


def moving(model):
    """Angles of the figure, and the rotations of its bodies."""
    tree = compile_tree(model)
    t = np.linspace(0.0, 1.0, FRAMES)[:, None]
    values = 0.3 * np.sin(5.0 * t + np.arange(len(tree.defaults)))
    values[:, [name.startswith("tibia") for name in model.coordinate_names]] -= 0.6
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    points = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    turned = {name: poses.rotations[:, index] for name, index in tree.body_index.items() if index > 0}
    return values, turned, Markers(0.01 * np.arange(FRAMES), model.marker_names, points)


def sensors(turned, names):
    return InverseKinematicsOptions(tasks=[OrientationTask(name, turned[name]) for name in names], tolerance=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_curvature_are_derivatives_of_the_cost(seed):
    model = random_tree(seed)
    tree, rng = compile_tree(model), np.random.default_rng(seed)
    c = rng.uniform(-0.5, 0.5, len(tree.defaults))
    # Sensors that fit at c: there the Gauss-Newton curvature is all of it.
    fitting = forward_kinematics(tree, c[None]).rotations[0]
    names = model.body_names[-3:]
    tasks = [OrientationTask(name, fitting[None, tree.body_index[name]], 0.5 + i) for i, name in enumerate(names)]
    P = pose_problem(
        tree, (), np.empty(0), InverseKinematicsOptions(tasks=tasks), Markers(np.zeros(1), (), np.empty((1, 0, 3)))
    )
    plain, cost, g, H = equations_at(tree.arrays, P, c)
    assert plain < 1e-20
    assert cost < 1e-20
    np.testing.assert_allclose(g, 0.0, atol=1e-10)
    away = c + rng.normal(scale=0.2, size=len(c))
    plain, cost, slope, _ = equations_at(tree.arrays, P, away)
    assert cost == pytest.approx(plain, rel=1e-12)
    for i in P.free:
        step = STEP * np.eye(len(c))[i]
        around = [equations_at(tree.arrays, P, pose + sign * step) for pose in (c, away) for sign in (1.0, -1.0)]
        np.testing.assert_allclose(H[i][P.free], ((around[0][2] - around[1][2]) / (2.0 * STEP))[P.free], atol=1e-6)
        assert slope[i] == pytest.approx((around[2][0] - around[3][0]) / (4.0 * STEP), abs=1e-7)


def test_segments_without_markers_turn_as_their_sensors_say():
    model = stick_figure()
    values, turned, markers = moving(model)
    bare = model.with_markers(tuple(marker for marker in model.markers if marker.body == "pelvis"))
    names = [name for name in model.body_names if name in turned and name != "pelvis"]
    fit = inverse_kinematics(bare, markers, sensors(turned, names))
    assert fit.converged.all()
    np.testing.assert_allclose(fit.motion.values, values, atol=1e-5)
    assert fit.largest.max() < 1e-5
    assert fit.task_errors["OrientationTask"].shape == (FRAMES, len(names))
    assert fit.task_errors["OrientationTask"].max() < 1e-5
    # What is unknown in some frames is left out there.
    gone = turned["torso"].copy()
    gone[4:6] = np.nan
    fit = inverse_kinematics(bare, markers, sensors(turned | {"torso": gone}, names))
    trunk = [name.startswith("torso") for name in model.coordinate_names]
    assert np.abs(fit.motion.values - values)[4:6][:, trunk].max() > 1e-3
    np.testing.assert_allclose(
        np.delete(fit.motion.values, [4, 5], axis=0), np.delete(values, [4, 5], axis=0), atol=2e-5
    )


def test_sensors_alone_are_enough_for_angles():
    model = stick_figure()
    values, turned, markers = moving(model)
    nothing = Markers(markers.time, (), np.empty((FRAMES, 0, 3)))
    fit = inverse_kinematics(model, nothing, sensors(turned, turned))
    turns = [coordinate.motion == "rotational" for coordinate in model.coordinates]
    np.testing.assert_allclose(fit.motion.values[:, turns], values[:, turns], atol=1e-5)
    assert fit.marker_names == ()


def test_one_line_makes_it_a_kind_of_the_package(monkeypatch):
    """With the line, problems without a sensor have empty arrays of it, and the same results."""
    model = stick_figure()
    _, _, markers = moving(model)
    before = inverse_kinematics(model, markers)
    monkeypatch.setattr(newton, "KINDS", (*newton.KINDS, OrientationTask))
    fit = inverse_kinematics(model, markers)
    np.testing.assert_allclose(fit.motion.values, before.motion.values, atol=1e-12)
    assert "OrientationTask" not in before.task_errors
    assert fit.task_errors["OrientationTask"].shape == (FRAMES, 0)


def test_a_task_of_other_frames_is_refused():
    model = stick_figure()
    _, turned, markers = moving(model)
    task = OrientationTask("torso", turned["torso"][:5])
    with pytest.raises(BadData, match=rf"torso.*\b5\b.*\b{FRAMES}\b"):
        inverse_kinematics(model, markers, replace(InverseKinematicsOptions(), tasks=[task]))


def test_kernels_of_kinds_from_elsewhere_do_not_go_to_disk():
    """Another process, which may not have their classes, reads the same index."""
    assert "OrientationArrays" not in str(signatures_on_disk(solve_frames))
