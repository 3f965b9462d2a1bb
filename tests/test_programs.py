"""Programs of the page on Python: short, without private names, and what they find obeys laws."""

from __future__ import annotations

import ast
import csv
import re
from functools import cache

import numpy as np
import pytest
from docs_build.examples import DOCS, run_python, was_printed, working_in
from docs_build.programs import code_lines, programs, shown

import myomorph as mm

MAX_LINES = 15
PAGE = DOCS / "python.md"
BY_NAME = {program.stem: program for program in programs()}


@pytest.fixture(scope="session")
def ran(tmp_path_factory):
    """Run each program once, in a folder of its own."""

    @cache
    def run(name):
        matplotlib = pytest.importorskip("matplotlib")
        matplotlib.use("Agg")
        folder = tmp_path_factory.mktemp(name)
        names = {"__name__": name}
        with working_in(folder):
            printed = run_python(BY_NAME[name].read_text(encoding="utf-8"), names, name)
        return folder, names, printed

    return run


def test_there_are_ten():
    assert len(BY_NAME) == 10


@pytest.mark.parametrize("name", BY_NAME)
def test_a_program_is_short_and_uses_public_names_alone(name):
    assert code_lines(BY_NAME[name]) <= MAX_LINES
    tree = ast.parse(BY_NAME[name].read_text(encoding="utf-8"))
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert imported <= {"myomorph", "numpy"}
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not any(attribute.startswith("_") for attribute in used)


@pytest.mark.parametrize("name", BY_NAME)
def test_the_page_shows_what_a_program_prints(name, ran):
    _, _, printed = ran(name)
    lines = [line for line in shown(PAGE)[name].splitlines() if line.strip()]
    assert lines
    assert [line for line in lines if not was_printed(line, printed)] == []


def test_each_trial_of_a_folder_is_in_the_table(ran):
    _, names, _ = ran("batch")
    trials = names["analysis"].trials
    assert len(trials) == len(names["analysis"].reports) == 2
    knee = names["chosen"][names["chosen"].quantity == "knee_angle_r, range in a stride"]
    for trial, number in (("simulated_walk_1", 1), ("simulated_walk_2", 2)):
        walk = mm.sample("walk", number)
        true = walk.truth["coordinate_value"].strides(walk.events)["knee_angle_r"][:2]
        ranges = np.degrees(np.ptp(true, axis=1))
        found = knee[knee.trial == trial].value.item()
        assert found == pytest.approx(ranges.mean(), abs=4.0)


def test_another_criterion_costs_effort_and_balances_as_well(ran):
    _, names, printed = ran("own_criterion")
    forces = [float(value) for value in re.findall(r"([\d.]+) N at most", printed)]
    efforts = [float(value) for value in re.findall(r"effort ([\d.]+)", printed)]
    assert forces[1] < 0.5 * forces[0]
    assert efforts[1] > efforts[0]
    tension = names["tension"]
    assert tension.optimal.all()
    assert np.abs(tension.equilibrium_residual).max() < 0.1


def test_a_weaker_muscle_is_helped_by_its_neighbor(ran):
    _, names, printed = ran("what_if")
    soleus = [float(value) for value in re.findall(r"soleus ([\d.]+) N", printed)]
    neighbor = [float(value) for value in re.findall(r"gastrocnemius ([\d.]+) N", printed)]
    assert soleus == sorted(soleus, reverse=True)
    assert neighbor == sorted(neighbor)
    strength = names["walk"].model.muscle("soleus_r").max_isometric_force
    assert names["model"].muscle("soleus_r").max_isometric_force == pytest.approx(0.25 * strength)


def test_groups_differ_where_they_do_and_p_is_that_of_all_relabellings(ran):
    _, names, _ = ran("compare_groups")
    knee = names["knee"]
    # Of 70 ways to put eight into two groups of four, two are as extreme.
    assert knee.least_p == pytest.approx(2.0 / 70.0)
    for start, stop in knee.regions:
        inside = slice(round(start) + 1, round(stop))
        apart = (knee.low[inside] > 0.0) | (knee.high[inside] < 0.0)
        assert apart.mean() > 0.9


def test_identified_masses_are_nearer_to_the_true_ones(ran):
    _, names, _ = ran("identify")
    assumed = names["wrong"].body("torso").mass
    true = names["walk"].model.body("torso").mass
    found = names["found"]
    # The interval holds what was assumed: the mass stays, and the expected one is nearer.
    index = found.model.body_names.index("torso")
    assert abs(found.expected[index, 0] - true) < 0.5 * abs(assumed - true)
    assert found.mass_evidence["torso"] == "not shown"
    assert found.model.body("torso").mass == pytest.approx(assumed, rel=1e-4)
    assert names["interval"].low < true < names["interval"].high
    assert found.model.mass == pytest.approx(70.0, abs=1e-6)
    moments = {way: residual[0] for way, residual in found.residuals.items()}
    assert moments["identified, own"] < 0.5 * moments["generic, scaled"]


def test_points_of_muscles_move_with_the_bone(ran):
    _, names, _ = ran("morph")
    source = names["leg"]
    target = names["morph"].model
    knee = {model.name: _distance(model) for model in (source, target)}
    assert knee[target.name] / knee[source.name] == pytest.approx(1.08, abs=0.01)
    for muscle in ("vaslat_r", "semiten_r"):
        lengths = [
            mm.default_path_lengths(model)[model.muscle_names.index(muscle)]
            for model in (source, target)
        ]
        assert 1.0 < lengths[1] / lengths[0] < 1.09


def _distance(model):
    """Distance of hip and knee in the default pose [m]."""
    rest = mm.Motion([0.0], (), np.zeros((1, 0)))
    poses = mm.viewer.bone_poses(model, rest)
    places = [poses.points(body, np.zeros((1, 3)))[0, 0] for body in ("femur_r", "tibia_r")]
    return np.linalg.norm(places[0] - places[1])


def test_sensors_show_what_markers_do_not(ran):
    _, _, printed = ran("sensors")
    without, with_sensors = map(float, re.findall(r"knee ([\d.]+)°", printed))
    assert with_sensors < 1.0 < 5.0 < without


def test_the_figure_is_written_and_marks_a_time_in_late_stance(ran):
    folder, names, _ = ran("own_plot")
    assert (folder / "moments.png").stat().st_size > 10_000
    assert 40.0 < names["push_off"] < 62.0
    assert len(names["axes"]) == 3


def test_exported_files_hold_the_same(ran):
    folder, names, _ = ran("export")
    with (folder / "angles.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    knee = np.array([float(row["knee_angle_r"]) for row in rows])
    np.testing.assert_allclose(knee, names["fit"].motion["knee_angle_r"], atol=1e-12)
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(folder / "walk.nc", engine="h5netcdf") as dataset:
        stored = dataset["coordinate_value"].sel(coordinate="knee_angle_r")
        np.testing.assert_allclose(stored, knee)
    assert names["again"].mass == pytest.approx(names["walk"].model.mass)
    assert names["certificate"].steps
    assert abs(names["certificate"].mass) < 1e-6


def test_live_torques_are_those_of_afterwards(ran):
    _, names, _ = ran("live")
    knee = names["knee"]
    assert names["apart"] < 0.05 * np.ptp(knee)
    assert len(names["solved"]) > 0.9 * len(names["frames"])
