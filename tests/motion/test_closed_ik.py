"""Inverse kinematics and calibration of models that close loops.

Recovered motion, bounds, laws, and real bones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from looped import four_bar, four_bar_angles, looped_tree, markers_of
from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.body.calibrate.frame_sums import reduce, settle
from myomorph.body.calibrate.shared_problem import BLOCKS, FrameSet, SharedProblem
from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Marker
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics, pose_problem
from myomorph.core.motion.lengths import lengths_of
from myomorph.core.motion.online import OnlineKinematics
from myomorph.core.motion.stretch import stretch_of
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import close_loops, closure, closure_jacobian, free_coordinates
from myomorph.core.rigid.tree import compile_tree

BONES = "shoulder-bonepin/"


def marked(seed, functional, kinds=("PointConstraint", "WeldConstraint")):
    """Make a looped random tree with three markers per body, and a closed motion.

    It starts near where it is closed.
    """
    model, closed = looped_tree(seed, kinds, functional)
    rng = np.random.default_rng(seed)
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, rng.normal(scale=0.1, size=3))
        for body in model.bodies
        for i in range(3)
    )
    coordinates = tuple(
        replace(one, default=value) for one, value in zip(model.coordinates, closed, strict=True)
    )
    model = replace(model, markers=markers, coordinates=coordinates)
    tree = compile_tree(model)
    t = np.linspace(0.0, 1.0, 80)[:, None]
    values = closed + 0.08 * np.sin(
        t * rng.uniform(1, 5, len(closed)) + rng.uniform(0, 6, len(closed))
    )
    couple_frames(tree.arrays, values)
    return model, close_loops(tree, values)


@pytest.mark.parametrize("functional", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_a_known_motion_is_recovered_and_closed(seed, functional):
    model, values = marked(seed, functional)
    fit = inverse_kinematics(model, markers_of(model, values))
    assert fit.converged.all()
    assert fit.loop_closure_error.max() < 1e-9
    assert np.nanmax(fit.marker_error) < 1e-5
    assert fit.iterations.mean() < 5
    poses = [
        forward_kinematics(compile_tree(model), one).origins for one in (fit.motion.values, values)
    ]
    np.testing.assert_allclose(*poses, atol=1e-5)


def test_the_closed_optimum_is_stationary_in_noise():
    """The gradient has no part along any motion that the loops allow."""
    model, values = marked(1, functional=True)
    markers = markers_of(model, values, noise=0.02)
    exact = InverseKinematicsOptions(tolerance=1e-10, posture_weight=0.0)
    fit = inverse_kinematics(model, markers, exact)
    tree = compile_tree(model)
    free = free_coordinates(tree)
    assert fit.converged.all()
    assert fit.loop_closure_error.max() < 1e-9
    assert fit.iterations.mean() < 7

    def cost(c):
        couple_frames(tree.arrays, c)
        return ((markers_of(model, c).values - markers.values) ** 2).sum(axis=(1, 2))

    h = 1e-6
    found = fit.motion.values
    gradient = np.zeros((len(found), len(free)))
    for i, j in enumerate(free):
        ends = []
        for sign in (1, -1):
            moved = found.copy()
            moved[:, j] += sign * h
            ends.append(cost(moved))
        gradient[:, i] = (ends[0] - ends[1]) / (2 * h)
    J = closure_jacobian(tree, found)[:, :, free]
    for frame in range(0, len(found), 8):
        rank = np.linalg.matrix_rank(J[frame], tol=1e-9)
        allowed = np.linalg.svd(J[frame])[2][rank:]
        assert np.abs(allowed @ gradient[frame]).max() < 1e-5 * np.abs(gradient[frame]).max() + 1e-7


def test_a_loop_that_cannot_close_is_named():
    model = four_bar()
    far = replace(model.loops[0], pose_2=Transform(np.eye(3), np.array([9.0, 0.0, 0.0])))
    with pytest.raises(BadData, match="PointConstraint 'pin' cannot be closed"):
        inverse_kinematics(
            replace(model, loops=(far,)), markers_of(model, four_bar_angles(np.ones(3)))
        )


def test_frames_that_arrive_are_closed_too():
    model = four_bar()
    true = four_bar_angles(np.linspace(0.3, 2.0, 30))
    markers = markers_of(model, true)
    online = OnlineKinematics(model, markers.names)
    found = np.array(
        [online.solve(t, row)[0] for t, row in zip(markers.time, markers.values, strict=True)]
    )
    np.testing.assert_allclose(found, true, atol=1e-6)
    assert np.abs(closure(compile_tree(model), found)).max() < 1e-9


def test_bone_pins_cost_less_than_the_stored_result(data):
    """Real: every frame of OpenSim's stored result costs at least as much.

    Its loop-closure error is larger.
    """
    model = read_model(data(BONES + "subject1_abdbonepin.osim"))
    markers = read_trc(data(BONES + "abdbonepin.trc")).markers
    weights = read_ik_tasks(data(BONES + "setup_ik_abdbonepin.xml")).marker_weights
    stored = motion_from_table(read_sto(data(BONES + "std_subject1_abdbonepin_IK.mot")), model)
    rows = np.abs(markers.time[:, None] - stored.time[None]).argmin(axis=0)
    markers = Markers(markers.time[rows], markers.names, markers.values[rows])
    fit = inverse_kinematics(
        model, markers, InverseKinematicsOptions(marker_weights=weights, only_weighted=True)
    )
    assert fit.converged.all()
    assert fit.loop_closure_error.max() < 1e-9
    tree = compile_tree(model)
    theirs = tree.coordinates_of(stored)
    assert np.abs(closure(tree, theirs)).max() > fit.loop_closure_error.max()
    bodies = np.array([tree.body_index[model.marker(name).body] for name in fit.marker_names])
    places = forward_kinematics(tree, theirs).points(
        bodies, np.array([model.marker(name).location for name in fit.marker_names])
    )
    seen = markers.values[:, [markers.names.index(name) for name in fit.marker_names]]
    cost = np.nansum(fit.marker_weight * ((places - seen) ** 2).sum(axis=2), axis=1)
    assert (np.nansum(fit.marker_weight * fit.marker_error**2, axis=1) <= cost * (1 + 1e-6)).all()


def test_reduced_gradient_is_that_of_the_settled_cost():
    """The cost of all frames, with angles solved and loops closed.

    Its derivatives are with respect to the lengths and marker positions.
    """
    model = four_bar()
    markers = markers_of(
        model, four_bar_angles(1.5 + 0.8 * np.sin(np.linspace(0.0, 6.0, 7))), noise=0.01
    )
    tree = compile_tree(model)
    lengths = lengths_of(model, True)
    arrays = pose_problem(
        tree, model.marker_names, np.ones(len(model.markers)), InverseKinematicsOptions()
    )
    # Values that can be written, as calibration gives them: for others the kernels would be
    # compiled once more.
    frames = FrameSet(
        np.array(markers.values), np.tile(tree.defaults, (len(markers), 1)), np.zeros(3)
    )
    unknowns = len(lengths) + 3 * len(model.markers) + 1
    problem = SharedProblem(
        model=model,
        lengths=lengths,
        marker_names=model.marker_names,
        stretch=stretch_of(model, lengths, model.marker_names),
        pose=arrays,
        sets=(frames,),
        prior=LinearPrior(
            name="prior", blocks=BLOCKS, rows=np.zeros((0, unknowns)), right=np.zeros(0)
        ),
        posture=tree.defaults,
        posture_weight=1e-9,
    )
    x = np.concatenate(
        [
            np.random.default_rng(1).uniform(0.97, 1.03, len(lengths)),
            np.zeros(unknowns - len(lengths)),
        ]
    )
    x[len(lengths) : -1] = np.random.default_rng(2).normal(
        scale=0.01, size=unknowns - len(lengths) - 1
    )
    start = [np.tile(four_bar_angles(np.array([1.5])), (len(markers), 1))]
    at = settle(problem, x, start, 1.0)
    assert at.settled == 1.0
    reduced = reduce(problem, at)
    h = 1e-5
    for i in range(unknowns - 1):
        ends = []
        for sign in (1, -1):
            moved = x.copy()
            moved[i] += sign * h
            ends.append(settle(problem, moved, at.angles, 1.0).cost)
        assert 2.0 * reduced.g[i] == pytest.approx(
            (ends[0] - ends[1]) / (2 * h), rel=1e-3, abs=1e-5
        ), i


def test_calibration_finds_lengths_and_keeps_loops_closed(data):
    """Markers of the shoulder made larger, in poses of the recorded abduction."""
    model = read_model(data(BONES + "subject1_abdbonepin.osim"))
    markers = read_trc(data(BONES + "abdbonepin.trc")).markers
    some = Markers(markers.time[:1900:20], markers.names, markers.values[:1900:20])
    true = scale(model, {body: np.full(3, 1.15) for body in model.body_names})
    values = close_loops(compile_tree(true), inverse_kinematics(model, some).motion.values)
    made = markers_of(true, values, noise=1e-4)
    found = calibrate(model, [made], CalibrationOptions(noise=1e-4, marker_sd=1e-3))
    assert found.converged
    tree = compile_tree(found.model)
    assert max(np.abs(closure(tree, angles)).max() for angles in found.angles) < 1e-9
    shown = {
        one.length.segment: one.factor for one in found.lengths if one.length.along and one.shown
    }
    assert shown
    for factor in shown.values():
        assert factor == pytest.approx(1.15, abs=0.01)
