"""The limits of a trial's results: by command, by study, and held against what they must be."""

from __future__ import annotations

import csv
import re
from collections import Counter

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.tension.recruitment import RecruitmentOptions
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs.table import settings_of_keys
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.load import load
from myomorph.lab.study.trial.steps.drawn_trials import chain_of, drawn_costs, drawn_criterion
from myomorph.lab.study.trial.steps.id import solve_dynamics
from myomorph.lab.study.trial.steps.ik import recorded_poses
from myomorph.lab.study.trial.steps.uncertainty import attempts
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial
from myomorph.lab.study.workers.local_workers import LocalWorkers
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources
from myomorph.lab.uncertainty.spread import FACTORS

NONE = {name: 0.0 for names in GROUPS.values() for name in names}
STUDY = """
[study]
name = "reaching"
[uncertainty]
draws = 12
contributions = 2
{line}
[[subject]]
name = "s01"
model = "arm.osim"
trials = [{{ markers = "reach.trc", loads = "reach_grf.xml" }}]
"""


def opened(arm, thin, **sizes):
    files = TrialFiles(
        arm.model, inputs=settings_of_keys({"motion": arm.motion, "loads": arm.loads})
    )
    trial = open_trial(files, {"id": {"cutoff": 6.0}, "uncertainty": NONE | sizes})
    poses = recorded_poses(trial)
    torques = solve_dynamics(trial, poses.recorded)
    return chain_of(trial, poses, torques, True, thin), torques, trial.options[Sources]


def test_criteria_are_drawn_alike_often():
    draws = [Draw(number, Sources(), Normals(90)) for number in range(90)]
    exponents = Counter(drawn_criterion(TensionOptions(), one).exponent for one in draws)
    loads = Counter(
        drawn_costs(RecruitmentOptions(joint_load=0.1, joint_load_joints="all"), one).joint_load
        for one in draws
    )
    assert exponents == {1.5: 30, 2.0: 30, 3.0: 30}
    assert loads == {0.0: 30, 0.1: 30, 0.2: 30}


@pytest.mark.parametrize("thin", [False, True])
def test_without_errors_what_is_drawn_is_the_result(arm, thin):
    chain, torques, none = opened(arm, thin)
    drawn = chain.drawn(Draw(0, none, Normals(2)))
    for _, one in chain.quantities():
        np.testing.assert_allclose(drawn[one.name], one.values, atol=1e-9)
    np.testing.assert_allclose(drawn["generalized_force"], torques.torques.values, atol=1e-12)


def test_an_error_of_the_force_comes_out_as_its_moment(arm):
    """Torques are linear in the force.

    Their standard deviation is the gain's share of the moment of the force.
    """
    chain, torques, sources = opened(arm, False, plate_gain=0.02)
    values = np.stack(
        [chain.drawn(Draw(k, sources, Normals(100)))["generalized_force"] for k in range(100)]
    )
    files = TrialFiles(arm.model, inputs=settings_of_keys({"motion": arm.motion}))
    trial = open_trial(files, {"id": {"cutoff": 6.0}})
    poses = recorded_poses(trial)
    moment = torques.torques.values - solve_dynamics(trial, poses.recorded).torques.values
    np.testing.assert_allclose(values.std(axis=0), 0.02 * np.abs(moment), rtol=0.05, atol=1e-6)


def test_misplaced_markers_turn_angles_by_what_they_subtend(arm):
    """Angles of a chain whose markers are misplaced.

    Least squares on its own Jacobian gives their deviation.
    """
    chain, _, sources = opened(arm, False, placement=0.002)
    values = np.stack(
        [chain.drawn(Draw(k, sources, Normals(200)))["coordinate_value"][0] for k in range(200)]
    )
    model = read_model(arm.model)
    angles = chain.recorded.values[0]
    rows = []
    for marker in model.markers:
        # Planar pins: a marker on the upper arm moves with the shoulder, one on the forearm with
        # both.
        place = np.asarray(marker.location)[:2]
        turn = angles[0]
        elbow = angles[0] + angles[1]
        across = np.array([[0.0, -1.0], [1.0, 0.0]])

        def rotation(angle):
            return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        if marker.body == "upper":
            rows.append(np.column_stack([across @ rotation(turn) @ place, np.zeros(2)]))
        else:
            own = across @ rotation(elbow) @ place
            rows.append(
                np.column_stack([across @ rotation(turn) @ np.array([0.0, -0.3]) + own, own])
            )
    jacobian = np.concatenate(rows)
    expected = 0.002 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose(values.std(axis=0), expected, rtol=0.12)


def test_processes_that_share_the_draws_come_to_the_same(arm, monkeypatch):
    chain, _, sources = opened(arm, True, placement=0.002, plate_gain=0.02)
    draws = [Draw(k, sources, Normals(9)) for k in range(9)]
    alone = list(attempts(chain, draws, 1))
    begun = []
    begin = LocalWorkers._begin
    monkeypatch.setattr(LocalWorkers, "_begin", lambda self: begun.append(begin(self)) or begun[-1])
    together = attempts(chain, draws, 3)
    found = [next(together) for _ in range(3)]
    # One of them is lost: what it had is done here.
    begun[0].child.kill()
    found += together
    assert len(begun) >= 3
    assert all(one.child.poll() is not None for one in begun)
    for one, other in zip(alone, found, strict=True):
        for name, values in one.items():
            np.testing.assert_array_equal(other[name], values)


def test_limits_are_widened_by_factors_that_the_last_line_names(arm, command):
    sizes = arm.folder / "sizes.toml"
    words = ("id", "--model", arm.model, "--motion", arm.motion, "--loads", arm.loads)
    found = {}
    for state in ("true", "false"):
        sizes.write_text(f"draws = 12\ncontributions = 0\nwidened = {state}\n")
        done = command(*words, "--uncertainty", sizes, "--out", arm.folder / "torques.sto")
        assert done.status == 0, done.err
        assert (f"generalized force {FACTORS['generalized_force']:g}" in done.out) == (
            state == "true"
        )
        assert "limits of 90 % from 12 draws" in done.out
        low = read_sto(arm.folder / "torques_low.sto").values
        high = read_sto(arm.folder / "torques_high.sto").values
        found[state] = 0.5 * (low + high), high - low
    np.testing.assert_allclose(found["true"][0], found["false"][0], atol=1e-6)
    np.testing.assert_allclose(
        found["true"][1], FACTORS["generalized_force"] * found["false"][1], rtol=1e-5, atol=1e-6
    )


def test_who_draws_is_nobodys_business_without_draws(arm, command):
    out = arm.folder / "torques.sto"
    done = command("id", "--model", arm.model, "--motion", arm.motion, "--out", out, "--workers", 2)
    assert (done.status, len(done.err.splitlines())) == (2, 1)
    assert "--workers 2 without --draws" in done.err


def test_by_command_tables_of_limits_stand_beside_the_table(arm, command):
    out = arm.folder / "torques.sto"
    words = (
        "id",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--loads",
        arm.loads,
        "--cutoff",
        6,
    )
    done = command(*words, "--out", out, "--draws", 8)
    assert done.status == 0, done.err
    table = read_sto(arm.folder / "torques.sto")
    low = read_sto(arm.folder / "torques_low.sto")
    high = read_sto(arm.folder / "torques_high.sto")
    assert low.names == table.names == high.names
    assert (low.values < high.values).all()
    with (arm.folder / "torques_uncertainty.csv").open(encoding="utf-8") as stream:
        rows = {(row["quantity"], row["column"]): row for row in csv.DictReader(stream)}
    assert rows["generalized_force", "elbow_flexion"]["unit"] == "N m"
    assert float(rows["generalized_force", "elbow_flexion"]["masses_total"]) > 0.0


def test_frames_without_joint_loads_have_no_limits_either(tmp_path, data, command):
    """Somebody rises from a seat, and plates carry more than the motion needs for a moment."""
    folder = data("opencap-subject4-multitask")
    files = {
        "--model": folder / "models/manually_scaled.osim",
        "--motion": folder / "ik_manual_scaling/STS1_ik.mot",
        "--loads": folder / "grf/STS1_external_forces.xml",
        "--out": tmp_path / "out",
    }
    words = [word for pair in files.items() for word in pair]
    options = ("--reactions", "child", "--time", 0.5, 1.3, "--draws", 2)
    done = command("tension", *words, *options)
    assert done.status == 0, done.err
    known = [
        np.isfinite(read_sto(tmp_path / f"out/joint_reactions{end}.sto")["knee_r_force"])
        for end in ("", "_low", "_high")
    ]
    assert 0 < known[0].sum() < len(known[0])
    np.testing.assert_array_equal(known[1], known[0])
    np.testing.assert_array_equal(known[2], known[0])


def test_angles_have_limits_in_degrees(arm, command):
    out = arm.folder / "angles.mot"
    assert (
        command(
            "ik", "--model", arm.model, "--markers", arm.markers, "--out", out, "--draws", 8
        ).status
        == 0
    )
    table = read_sto(arm.folder / "angles.mot")
    low = read_sto(arm.folder / "angles_low.mot")
    high = read_sto(arm.folder / "angles_high.mot")
    assert (table.facts["inDegrees"], low.facts["inDegrees"]) == ("yes", "yes")
    assert ((low.values < table.values) & (table.values < high.values)).mean() > 0.8


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("segment_mas = 0.1", "'segment_mas'.*'segment_mass'"),
        ("placement = -0.01", "'placement' is -0.01: expected 0 or more"),
        ("placement = 'far'", "'far'.*expected a number"),
        ("widened = 1", "'1' as 'widened'; expected true or false"),
    ],
)
def test_a_file_of_sizes_that_is_wrong_is_refused_in_one_line(arm, command, line, text):
    sizes = arm.folder / "sizes.toml"
    sizes.write_text(line)
    out = arm.folder / "torques.sto"
    done = command(
        "id", "--model", arm.model, "--motion", arm.motion, "--out", out, "--uncertainty", sizes
    )
    assert done.status == 2
    assert len(done.err.splitlines()) == 1
    assert re.search(text, done.err)
    assert not out.exists()


def test_a_study_draws_where_it_says_so(arm):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(line="strength = 0.3"))
    (outcome,) = run_study(read_plan(path), arm.out)
    assert outcome.error == ""
    assert "uncertainty" in outcome.done
    home = arm.out / "s01" / "reach"
    stored = read_result(home / "reach.nc")
    assert stored.provenance["uncertainty"].options["uncertainty.strength"] == 0.3
    low = stored.values["activation_low"]
    high = stored.values["activation_high"]
    assert low.shape == stored.values["activation"].shape
    assert (low <= high + 1e-12).all()
    page = (home / "report.html").read_text(encoding="utf-8")
    assert 'id="uncertainty"' in page
    # A drawn arm may be too weak for the motion.
    assert re.search("1[0-2] of 12 inputs", page)
    with (home / "uncertainty_sources.csv").open(encoding="utf-8") as stream:
        origins = {row["source"]: (row["sd"], row["origin"]) for row in csv.DictReader(stream)}
    assert (origins["strength"], origins["placement"]) == (("0.3", "stated"), ("0.005", "usual"))
    with (arm.out / "results_tidy.csv").open(encoding="utf-8") as stream:
        values = {row["quantity"]: row for row in csv.DictReader(stream)}
    peak = values["elbow_flexion_moment, maximum"]
    assert float(peak["low"]) < float(peak["value"]) < float(peak["high"])
    # Between the limits of a peak lies 3.29 times its deviation where it is normal, and it is
    # widened.
    assert 2.0 < (float(peak["high"]) - float(peak["low"])) / float(peak["sd"]) < 4.5
    assert values["frames"]["low"] == ""
    (result,) = load(home).values()
    assert result.uncertainty.spreads["muscle_force"].low.shape == low.shape


def test_without_a_word_a_study_draws_nothing(arm):
    path = arm.folder / "study.toml"
    path.write_text(
        STUDY.format(line="").replace("[uncertainty]\ndraws = 12\ncontributions = 2\n", "")
    )
    assert "uncertainty" not in read_plan(path).steps[0]


def test_an_unknown_source_of_a_study_is_named(arm):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(line="plate_gane = 0.1"))
    with pytest.raises(BadFile, match="plate_gane"):
        read_plan(path)
