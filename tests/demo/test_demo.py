"""The demos run the whole chain; what the project simulates is true to its own equations."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from myomorph.core.model.errors import UnknownName
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.analysis.columns import compared
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import read_result
from myomorph.lab.store.stored_fit import get_fit
from myomorph.lab.store.stored_tension import get_tension
from myomorph.lab.study.trial.reporting import report_folder
from myomorph.show.demo.demos import demo_model, demo_trial, run_demo
from myomorph.show.simulate.squat import (
    FEET,
    SimulationOptions,
    balancing_wrenches,
    marked_body,
    measured_markers,
    squat_splines,
)

OPTIONS = SimulationOptions(duration=2.0, squats=1, rate=40.0)


@pytest.fixture(scope="module")
def body():
    pytest.importorskip("myo_sim")
    return marked_body()


@pytest.fixture(scope="module")
def squat(body):
    return squat_splines(body, OPTIONS).at(OPTIONS.rate, OPTIONS.duration)


def test_nothing_is_left_at_the_root(body, squat):
    wrenches = balancing_wrenches(compile_tree(body), squat)
    torques = inverse_dynamics(body, squat, wrenches)
    root = [torques[name] for name in body.joints[0].coordinates]
    assert np.abs(root).max() < 1e-8
    weight = body.mass * np.linalg.norm(body.gravity)
    mean = wrenches.forces.sum(axis=1).mean(axis=0)
    # Over a whole squat the body gains no momentum, so the feet carry its weight on average.
    np.testing.assert_allclose(mean, -body.mass * body.gravity, atol=0.02 * weight)


def test_force_of_the_feet_is_newtons_law(body, squat):
    """Total force is mass times (acceleration of the center of mass - gravity).

    The acceleration is by differences.
    """
    tree = compile_tree(body)
    fine = squat_splines(body, OPTIONS).at(1000.0, OPTIONS.duration)
    centers = center_of_mass(tree, forward_kinematics(tree, tree.coordinates_of(fine)))
    acceleration = np.diff(centers, 2, axis=0) * 1000.0**2
    force = balancing_wrenches(tree, fine).forces.sum(axis=1)[1:-1]
    np.testing.assert_allclose(force, body.mass * (acceleration - body.gravity), atol=0.05)


def test_center_of_pressure_lies_under_the_feet(body, squat):
    tree = compile_tree(body)
    wrenches = balancing_wrenches(tree, squat)
    poses = forward_kinematics(tree, tree.coordinates_of(squat))
    for index, name in enumerate(FEET):
        heel = poses.origins[:, tree.body_index[name]]
        ahead = (heel - wrenches.points[:, index]) @ [0.0, 1.0, 0.0]
        # The body faces -y; the heel's origin lies some 20 cm behind the toes.
        assert ahead.min() > 0.0
        assert ahead.max() < 0.1
        np.testing.assert_allclose(wrenches.points[:, index, 0], heel[:, 0], atol=0.01)


def test_feet_stay_planted(body, squat):
    tree = compile_tree(body)
    poses = forward_kinematics(tree, tree.coordinates_of(squat))
    for name in FEET:
        assert np.ptp(poses.origins[:, tree.body_index[name]], axis=0).max() < 0.002


def test_without_noise_the_motion_is_found_again(body, squat):
    from dataclasses import replace

    quiet = replace(OPTIONS, marker_noise=0.0, tissue=0.0)
    markers = measured_markers(body, squat, quiet, np.random.default_rng(0))
    found = inverse_kinematics(body, markers).motion
    for name in squat.names:
        np.testing.assert_allclose(found[name], squat[name], atol=1e-4)


def test_noise_is_as_stated(body, squat):
    random = np.random.default_rng(1)
    options = SimulationOptions(duration=2.0, squats=1, rate=40.0, tissue=0.0, marker_noise=0.003)
    noisy = measured_markers(body, squat, options, random).values
    still = measured_markers(
        body, squat, SimulationOptions(tissue=0.0, marker_noise=0.0), random
    ).values
    assert (noisy - still).std() == pytest.approx(0.003, rel=0.02)


def test_unknown_demo():
    with pytest.raises(UnknownName, match="'simulated'"):
        demo_trial("walk")


@pytest.mark.long
def test_simulated_demo_ends_near_its_truth(tmp_path):
    pytest.importorskip("myo_sim")
    outcome = run_demo("simulated", tmp_path)
    assert outcome.error == ""
    assert outcome.done == ("ik", "id", "muscles", "tension", "report")
    with (tmp_path / "quality.csv").open(encoding="utf-8") as table:
        checks = {row["quantity"]: row["state"] for row in csv.DictReader(table)}
    assert len(checks) >= 11
    assert set(checks.values()) == {"ok"}
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "nobody was measured" in page
    found = read_result(tmp_path / "squat.nc", leave_out=("moment_arm",))
    truth = store.get_truth(found)
    tension = get_tension(found, TensionOptions())
    assert tension.optimal.all()
    angles = {one.name: one for one in compared(get_fit(found).motion, truth["coordinate_value"])}
    assert all(angles[f"knee_angle_{side}"].rmse < np.deg2rad(1.0) for side in "rl")
    torques = {
        one.name: one for one in compared(store.get_torques(found), truth["generalized_force"])
    }
    assert all(
        torques[f"knee_angle_{side}"].rmse < 0.05 * torques[f"knee_angle_{side}"].span
        for side in "rl"
    )
    from myomorph.core.model.series import Series

    shares = compared(Series(found.time, tension.muscles, tension.activation), truth["activation"])
    assert np.median([one.rmse for one in shares]) < 0.02


def test_jump_demo(tmp_path):
    pytest.importorskip("myo_sim")
    pytest.importorskip("biomdp")
    outcome = run_demo("jump", tmp_path)
    assert outcome.error == ""
    assert outcome.rms < 0.02
    found = read_result(tmp_path / "countermovement_jump.nc", leave_out=("moment_arm",))
    notes = json.loads(found.facts["notes"])
    assert notes["real"]
    assert notes["assumed"]
    assert not notes["simulated"]
    before = (tmp_path / "report.html").stat().st_mtime_ns
    assert report_folder(tmp_path, demo_model=demo_model) == [tmp_path / "report.html"]
    assert (tmp_path / "report.html").stat().st_mtime_ns > before
