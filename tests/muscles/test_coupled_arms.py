"""Moment arms of muscles over closed loops: virtual work along motions, and OpenSim's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from looped import four_bar, four_bar_angles, looped_tree
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Coordinate, Coupler
from myomorph.core.model.paths import MovingPathPoint, Muscle, Path, PathPoint
from myomorph.core.model.series import Motion
from myomorph.core.muscles.coupled_arms import loop_couplings, loop_groups
from myomorph.core.muscles.kinematics import ReportedPaths, muscle_kinematics
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.loops import close_loops, closure_jacobian
from myomorph.core.rigid.tree import compile_tree

SHOULDERS = (
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_2kgWeight.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim",
    "shoulder-thoracoscapular/model_rmr/TSM_subject_noWeight.osim",
)


def strung(model, ends):
    """Return the model with straight muscles between bodies, at points off their origins."""
    rng = np.random.default_rng(8)
    muscles = tuple(
        Muscle(
            name=f"m{i}",
            kind="Thelen2003Muscle",
            path=Path(
                tuple(
                    PathPoint(f"p{k}", body, 0.2 * rng.normal(size=3))
                    for k, body in enumerate(pair)
                )
            ),
            max_isometric_force=100.0,
            optimal_fiber_length=0.1,
            tendon_slack_length=0.1,
        )
        for i, pair in enumerate(ends)
    )
    return replace(model, muscles=muscles)


def poses_of(values, names):
    return Motion(np.arange(len(values)) / 10, names, values)


def test_crank_arm_is_the_slope_of_length_along_the_linkage():
    model = strung(
        four_bar(),
        [("ground", "coupler_bar"), ("crank_bar", "rocker_bar"), ("ground", "rocker_bar")],
    )
    turn = np.linspace(0.3, 1.5, 5)
    arms = muscle_kinematics(
        model, poses_of(four_bar_angles(turn), model.coordinate_names), velocities=False
    )
    paths = compile_paths(model)
    step = 1e-5
    lengths = [paths.evaluate(four_bar_angles(turn + sign * step))[0] for sign in (1, -1)]
    angles = [four_bar_angles(turn + sign * step) for sign in (1, -1)]
    slope = (lengths[0] - lengths[1]) / (2 * step)
    rates = (angles[0] - angles[1]) / (2 * step)
    # One degree of freedom: the arm about each coordinate is the slope of length per slope of that
    # coordinate.
    for j in range(3):
        np.testing.assert_allclose(
            arms.moment_arm[:, :, j], -slope / rates[:, j, None], rtol=1e-6, atol=1e-8
        )


@pytest.mark.parametrize("functional", [False, True])
def test_virtual_work_along_the_closed_motion(functional):
    model, start = looped_tree(3, functional=functional)
    bodies = model.body_names
    model = strung(model, [(bodies[i], bodies[-1 - i]) for i in range(4)])
    tree = compile_tree(model)
    paths = compile_paths(model)
    rng = np.random.default_rng(2)
    near = start + 0.02 * rng.normal(size=(2, len(start)))
    couple_frames(tree.arrays, near)
    c = close_loops(tree, near)
    arms = muscle_kinematics(
        model, poses_of(c, model.coordinate_names), velocities=False
    ).moment_arm
    step = 1e-5
    for group in loop_groups(tree):
        couplings = loop_couplings(tree, group, c)
        G = closure_jacobian(tree, c)[:, :, group.coordinates[group.leading]]
        np.testing.assert_allclose(G @ couplings, 0.0, atol=1e-8)
        for k, j in enumerate(group.coordinates):
            lengths = []
            for sign in (1, -1):
                moved = c.copy()
                moved[:, group.coordinates[group.leading]] += sign * step * couplings[:, :, k]
                couple_frames(tree.arrays, moved)
                lengths.append(paths.evaluate(moved)[0])
            slope = (lengths[0] - lengths[1]) / (2 * step)
            np.testing.assert_allclose(arms[:, :, j], -slope, atol=1e-6)


def test_a_coordinate_moves_by_one_and_others_as_little_as_they_can():
    model, start = looped_tree(4)
    tree = compile_tree(model)
    c = close_loops(tree, start[None])
    for group in loop_groups(tree):
        couplings = loop_couplings(tree, group, c)
        n = len(group.coordinates)
        np.testing.assert_allclose(couplings[0][np.arange(n), np.arange(n)], 1.0)
        # The projection is symmetric: k's part in j's motion is j's in k's, each per its own.
        sizes = 1.0 / (couplings[0] ** 2).sum(axis=0)
        projection = couplings[0] * sizes
        np.testing.assert_allclose(projection, projection.T, atol=1e-10)
        np.testing.assert_allclose(projection @ projection, projection, atol=1e-10)


def test_a_follower_of_a_loop_belongs_to_it():
    model = four_bar()
    joint = model.joints[0]
    # The crank's axis takes a coordinate that follows another at half its pace.
    axis = replace(joint.axes[0], coordinates=("half",))
    model = replace(
        model,
        joints=(replace(joint, axes=(axis,), coordinates=("crank", "half")), *model.joints[1:]),
        coordinates=(*model.coordinates, Coordinate("half")),
        couplers=(
            Coupler(name="gear", dependent="half", function=linear(0.5), independents=("crank",)),
        ),
    )
    (group,) = loop_groups(compile_tree(model))
    assert group.coordinates.tolist() == [0, 1, 2, 3]
    assert group.leading.tolist() == [0, 1, 2]
    model = strung(model, [("ground", "coupler_bar")])
    turn = np.array([0.5, 0.9])
    angles = four_bar_angles(turn)
    values = np.column_stack([2 * angles[:, 0], angles[:, 1:], angles[:, 0]])
    arms = muscle_kinematics(
        model, poses_of(values, model.coordinate_names), velocities=False
    ).moment_arm[:, 0]
    np.testing.assert_allclose(arms[:, 3], 2.0 * arms[:, 0])


def test_files_and_values_agree(data):
    path = data(SHOULDERS[1])
    model = read_osim(path)
    motion = motion_from_table(read_sto(data("shoulder-thoracoscapular/ik/SHRUG01.mot")), model)
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)[::150]
    dense = muscle_kinematics(
        model, poses_of(values, model.coordinate_names), velocities=False
    ).moment_arm
    reported = ReportedPaths(model)
    still = poses_of(values, model.coordinate_names)
    found = reported.evaluate(replace(still, velocities=np.zeros_like(values)), slice(None))[2]
    kept = np.zeros_like(dense)
    for column, (muscle, coordinate) in zip(found.T, reported.pairs, strict=True):
        kept[:, model.muscle_names.index(muscle), model.coordinate_names.index(coordinate)] = column
    np.testing.assert_allclose(kept, dense, atol=1e-12)


def trusted(model, theirs, state, name):
    """Return whether OpenSim's forces of a muscle fit its length.

    They do not with a moving point next to one of its own body, nor with two surfaces at once,
    whose points it places in ground as they were before the last round.
    """
    points = model.muscle(name).path.points
    if any(isinstance(point, MovingPathPoint) for point in points):
        return False
    path = theirs.getMuscles().get(name).getGeometryPath().getCurrentPath(state)
    wrapped = sum(
        path.get(i).getConcreteClassName() == "PathWrapPoint" for i in range(path.getSize())
    )
    return wrapped <= 2


@pytest.mark.parametrize("name", SHOULDERS)
def test_opensim_has_the_same_arms(name, data):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = read_osim(data(name))
    tree = compile_tree(model)
    motion = motion_from_table(read_sto(data("shoulder-thoracoscapular/ik/FLX01.mot")), model)
    values = close_loops(tree, tree.coordinates_of(motion)[[100, 400]])
    arms = muscle_kinematics(
        model, poses_of(values, model.coordinate_names), velocities=False
    ).moment_arm
    theirs = opensim.Model(str(data(name)))
    state = theirs.initSystem()
    named = theirs.getCoordinateSet()
    compared = 0
    for frame in range(len(values)):
        for j, one in enumerate(model.coordinate_names):
            named.get(one).setValue(state, float(values[frame, j]), False)
        theirs.realizePosition(state)
        for i, muscle in enumerate(model.muscle_names):
            if not trusted(model, theirs, state, muscle):
                continue
            path = theirs.getMuscles().get(muscle).getGeometryPath()
            expected = [
                path.computeMomentArm(state, named.get(one)) for one in model.coordinate_names
            ]
            np.testing.assert_allclose(arms[frame, i], expected, atol=1e-9)
            compared += 1
    assert compared > 50


def test_a_locked_coordinate_stays_but_for_its_own_arm(data):
    """As OpenSim where its first request is this one.

    After one request for a locked coordinate, OpenSim leaves that one free ever after.
    """
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = read_osim(data(SHOULDERS[1]))
    locked = tuple(
        replace(one, locked=one.locked or one.name == "clav_prot") for one in model.coordinates
    )
    model = replace(model, coordinates=locked)
    theirs = opensim.Model(str(data(SHOULDERS[1])))
    theirs.updCoordinateSet().get("clav_prot").set_locked(True)
    state = theirs.initSystem()
    named = theirs.getCoordinateSet()
    values = np.array([[named.get(name).getValue(state) for name in model.coordinate_names]])
    ours = muscle_kinematics(model, poses_of(values, model.coordinate_names), velocities=False)
    path = theirs.getMuscles().get("SerratusAnterior_S").getGeometryPath()
    first = path.computeMomentArm(state, named.get("clav_elev"))
    own = path.computeMomentArm(state, named.get("clav_prot"))
    again = path.computeMomentArm(state, named.get("clav_elev"))
    assert ours.moment_arm_of("SerratusAnterior_S", "clav_elev")[0] == pytest.approx(
        first, abs=1e-9
    )
    assert ours.moment_arm_of("SerratusAnterior_S", "clav_prot")[0] == pytest.approx(own, abs=1e-9)
    assert abs(again - first) > 1e-3
