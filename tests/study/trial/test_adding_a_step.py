"""A new step is one file (`power_step.py`) and one line in the table of steps; all else follows."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.lab.cli import main
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.dry_run import dry_run
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.step.step_table import STEPS

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = ["ik", "id", "power", "report"]
[options.power]
{options}
"""


@pytest.fixture
def power(monkeypatch):
    """Register the step by the one line."""
    monkeypatch.setitem(STEPS["trial"], "power", "tests.study.trial.power_step")


def plan(arm, options=""):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(options=options))
    return read_plan(path)


def test_it_is_run_stored_reused_and_reported(arm, power):
    (outcome,) = run_study(plan(arm), arm.out)
    assert (outcome.error, outcome.done) == ("", ("ik", "id", "power", "report"))
    home = arm.out / "s01" / "reach"
    found = read_result(home / "reach.nc")
    expected = found.values["generalized_force"] * found.values["coordinate_velocity"]
    np.testing.assert_allclose(found.values["joint_power"], expected, atol=1e-12)
    assert found.provenance["power"].options["power.generated"] is False
    assert "elbow_flexion" in read_sto(home / "joint_power.sto").names
    with (home / "values.csv").open(encoding="utf-8") as stream:
        quantities = {row["quantity"] for row in csv.DictReader(stream) if row["step"] == "power"}
    assert "elbow_flexion_power, maximum" in quantities
    page = (home / "report.html").read_text(encoding="utf-8")
    assert 'id="power"' in page
    assert "joint power" in page

    (again,) = run_study(plan(arm), arm.out)
    assert again.reused == ("ik", "id", "power", "report")


def test_its_options_are_settings(arm, power, capsys):
    run_study(plan(arm), arm.out)
    changed = plan(arm, "generated = true")
    reasons = dry_run(graph_of(changed, arm.out), arm.out).rows[0].reasons
    assert reasons["id"] == ()
    assert reasons["power"] == ("power.generated False -> True",)
    (outcome,) = run_study(changed, arm.out)
    assert outcome.reused == ("ik", "id")
    assert read_result(arm.out / "s01" / "reach" / "reach.nc").values["joint_power"].min() >= 0.0
    with pytest.raises(
        BadFile, match=r"unknown key .options\.power\.generate.: there are .*generated"
    ):
        plan(arm, "generate = true")


def test_it_has_a_command(arm, power, capsys):
    run_study(plan(arm), arm.out)
    motion = arm.out / "s01" / "reach" / "coordinates.mot"
    out = arm.folder / "alone"
    capsys.readouterr()
    assert main(["power", "--help"]) == 0
    assert "--generated" in capsys.readouterr().out
    assert (
        main(
            [
                "power",
                "--model",
                str(arm.model),
                "--motion",
                str(motion),
                "--out",
                str(out),
                "--generated",
            ]
        )
        == 0
    )
    assert read_result(out / "power.nc").values["joint_power"].min() >= 0.0


def test_a_step_that_does_not_exist_is_named(arm):
    with pytest.raises(BadFile, match=r"unknown key .options\.power."):
        plan(arm)
