"""Reserves beside activations: what they do, where they come from, and what is left to feedback."""

from __future__ import annotations

import numpy as np
import pytest
from tests.trees import floating_tree, swinging

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Series, Table
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.forward.drives import Drives
from myomorph.forward.reserves import read_reserves
from myomorph.forward.shares import muscle_torques, shares_of
from myomorph.forward.simulate import SimulationOptions, simulate
from myomorph.lab.cli.program import main
from myomorph.lab.store.quantity_files import quantity_table

ARM = "opensim-reference-small/arm26_bounds.osim"
OPTIONS = SimulationOptions(seconds=0.25, rate=200.0, tolerance=1e-8)


def run(*words):
    return main([str(word) for word in words])


def driven_arm(model):
    """Activations of all muscles and torques of both joints, and the motion under them."""
    time = np.linspace(0.0, 0.3, 61)
    phases = np.arange(len(model.muscles))
    activations = 0.2 + 0.1 * np.sin(8.0 * time[:, None] + phases)
    torques = np.stack([1.5 * np.sin(9.0 * time), 0.7 - 3.0 * time], axis=1)
    drives = Drives(
        activations=Series(time, model.muscle_names, activations),
        reserves=Series(time, ("r_shoulder_elev", "r_elbow_flex"), torques),
    )
    return drives, simulate(model, None, drives, OPTIONS)


def test_reserves_are_what_inverse_dynamics_leaves_of_the_muscles(data):
    model = read_model(data(ARM))
    drives, simulation = driven_arm(model)
    assert drives.reserves is not None
    torques = inverse_dynamics(model, simulation.motion)
    columns = [model.coordinate_names.index(name) for name in drives.reserves.names]
    left = torques.values[:, columns] - muscle_torques(simulation)[:, columns]
    given = np.stack(
        [
            np.interp(simulation.time, drives.reserves.time, column)
            for column in drives.reserves.values.T
        ],
        axis=1,
    )
    np.testing.assert_allclose(left, given, atol=1e-5)
    work = dict(zip(simulation.energy.names, simulation.energy.work[-1], strict=True))
    assert abs(work["reserves"]) > 1e-3
    assert work["torques"] == 0.0
    assert simulation.energy.largest_share < 1e-6


def test_a_motion_is_followed_by_its_own_tensions_with_hardly_any_feedback(data, tmp_path, capsys):
    path = data(ARM)
    model = read_model(path)
    _, simulation = driven_arm(model)
    motion = tmp_path / "motion.sto"
    write_sto(quantity_table(simulation.motion, model), motion)
    # Strong reserves, which take a good part of the muscles.
    words = ("tension", "--model", path, "--motion", motion, "--cutoff", 0, "--reserve", 50)
    solved = tmp_path / "tension"
    assert run(*words, "--out", solved) == 0
    reserves = read_sto(solved / "reserves.sto")
    assert np.abs(reserves.values).max() > 0.1
    words = ("simulate", "--model", path, "--start", motion, "--follow", 5)
    words += ("--activations", solved / "activations.sto")
    sizes = {}
    for name, more in {
        "without": (),
        "with": ("--reserves", solved / "reserves.sto"),
        "passive": ("--reserves", solved / "reserves.sto", "--passive"),
    }.items():
        capsys.readouterr()
        assert run(*words, *more, "--out", tmp_path / name) == 0
        printed = capsys.readouterr().out
        line = next(line for line in printed.splitlines() if "Joints, RMS" in line)
        assert ("reserves" in line) == bool(more)
        assert ("Passive forces of muscles: none, as in" in printed) == (name != "passive")
        sizes[name] = float(line.split("feedback ")[1].split()[0])
    assert sizes["with"] < 0.02 * sizes["without"]
    assert sizes["with"] < 0.02 * sizes["passive"]


def slopes_of_root(model, motion, coordinate):
    """Differentiate place and turn of the root by one coordinate, by differences."""
    tree = compile_tree(model)
    body = model.joints[0].child
    number = tree.body_number(body)
    step = 1e-6
    ends = []
    for sign in (1.0, -1.0):
        moved = motion.values.copy()
        moved[:, coordinate] += sign * step
        poses = forward_kinematics(tree, moved)
        turn = poses.rotations[:, number]
        ends.append((poses.origins[:, number] + turn @ model.body(body).mass_center, turn))
    here = forward_kinematics(tree, motion.values).rotations[:, number]
    turning = (ends[0][1] - ends[1][1]) @ np.swapaxes(here, 1, 2) / (2.0 * step)
    spin = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
    return (ends[0][0] - ends[1][0]) / (2.0 * step), spin


def test_residuals_do_the_work_of_forces_on_their_body(tmp_path):
    model = floating_tree(3, bodies=4)
    motion = swinging(model, 5, 0.01, seed=1)
    names = tuple(actuator.name for actuator in default_reserves(model))
    forces = np.random.default_rng(0).normal(size=(5, len(names)))
    write_sto(Table(motion.time, names, forces), tmp_path / "reserves.sto")
    reserves, notes = read_reserves(tmp_path / "reserves.sto", model, motion)
    assert not notes
    by_name = dict(zip(names, forces.T, strict=True))
    for j, coordinate in enumerate(model.coordinate_names):
        if coordinate in model.dependent_coordinates:
            continue
        shift, spin = slopes_of_root(model, motion, j)
        expected = by_name.get(f"reserve_{coordinate}", 0.0)
        for i, axis in enumerate("XYZ"):
            expected = expected + shift[:, i] * by_name[f"residual_F{axis}"]
            expected = expected + spin[:, i] * by_name[f"residual_M{axis}"]
        np.testing.assert_allclose(reserves[coordinate], expected, atol=1e-7)
    with pytest.raises(BadData, match="--start"):
        read_reserves(tmp_path / "reserves.sto", model, None)


def test_a_table_of_something_else_is_named(data, tmp_path):
    model = read_model(data(ARM))
    write_sto(Table(np.arange(3.0), ("markers",), np.zeros((3, 1))), tmp_path / "wrong.sto")
    with pytest.raises(UnknownName, match="reserve_r_elbow_flex"):
        read_reserves(tmp_path / "wrong.sto", model, None)


def test_torques_and_reserves_exclude_each_other(data):
    model = read_model(data(ARM))
    table = Series(np.zeros(1), ("r_elbow_flex",), np.ones((1, 1)))
    with pytest.raises(BadData, match="torques hold what reserves do"):
        simulate(model, None, Drives(torques=table, reserves=table))


def test_shares_name_joints_and_the_body_that_floats():
    model = floating_tree(3, bodies=4)
    motion = swinging(model, 11, 0.01, seed=1)
    names = tuple(model.coordinate_names)
    reserves = Series(motion.time, names, np.ones((11, len(names))))
    drives = Drives(reserves=reserves, follow=motion, feedback=5.0)
    options = SimulationOptions(seconds=0.05)
    shares = shares_of(simulate(model, motion, drives, options), drives)
    assert shares[0].where == "Joints"
    assert {share.where for share in shares} == {"Joints", "body0"}
    assert {share.unit for share in shares} == {"N m", "N"}
    for share in shares:
        assert share.sizes["reserves"] == pytest.approx(1.0)
        assert share.sizes["feedback"] > 0.0
