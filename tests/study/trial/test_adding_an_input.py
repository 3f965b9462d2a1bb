"""A new input is one file (`heart_input.py`) and one line in the table of inputs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.study.trial.heart_input import HeartFile

from myomorph.core.model.errors import BadFile
from myomorph.lab.cli.options import inputs_class, inputs_of_flags
from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs.table import INPUTS
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.dry_run import dry_run
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = [{trial}]
steps = ["ik", "id"]
"""


@pytest.fixture
def heart(arm, monkeypatch):
    """Register the input by the one line, and write a file of heartbeats."""
    monkeypatch.setitem(INPUTS, "heart", "tests.study.trial.heart_input")
    path = arm.folder / "beats.txt"
    path.write_text("0.0\n0.5\n1.0\n")
    return path


def plan(arm, trial):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(trial=trial))
    return read_plan(path)


def test_it_is_a_key_is_hashed_reported_and_listed(arm, heart):
    study = plan(arm, '{ markers = "reach.trc", heart = "beats.txt" }')
    (outcome,) = run_study(study, arm.out)
    assert outcome.error == ""
    stored = read_result(arm.out / "s01" / "reach" / "reach.nc")
    assert stored.facts["heart_rate"] == "120.0"
    assert "heart rate from beats.txt" in json.loads(stored.facts["notes"])["real"][0]
    assert any(source.role == "heart" for source in stored.provenance["id"].sources)

    heart.write_text("0.0\n1.0\n2.0\n")
    (row,) = dry_run(graph_of(study, arm.out), arm.out).rows
    assert "beats.txt" in row.work.files
    assert row.reasons["id"] == ("heart beats.txt has changed",)


def test_it_is_found_beside_a_recording(arm, heart):
    heart.rename(arm.folder / "reach_heart.txt")
    study = plan(arm, '"reach.trc"')
    assert study.trials[0].get(HeartFile).heart == arm.folder / "reach_heart.txt"
    assert any("heart from reach_heart.txt" in remark for remark in study.remarks)


def test_what_is_wrong_with_it_is_named(arm, heart):
    with pytest.raises(BadFile, match=r"heart.*'pulse\.txt' does not exist"):
        plan(arm, '{ markers = "reach.trc", heart = "pulse.txt" }')


def test_it_is_a_flag(heart):
    made = inputs_class("heart").__origin__
    assert inputs_of_flags(made(heart=Path("beats.txt"))).get(HeartFile) == HeartFile(
        Path("beats.txt")
    )
    assert inputs_of_flags(made()).get(HeartFile) is None


def test_an_input_that_does_not_exist_is_no_key(arm):
    with pytest.raises(BadFile, match=r"unknown key .*heart"):
        plan(arm, '{ markers = "reach.trc", heart = "beats.txt" }')
