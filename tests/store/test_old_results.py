"""Results that version 0.1 wrote are read by this one.

A run reuses them while nothing has changed, defaults included. `old_results/reach.nc` was written
by commit 34e3048 from the files of the example arm: steps ik, id, muscles and tension, `cutoff =
6`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs.input import OptionSet
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.trial.reporting import report_input
from myomorph.lab.study.trial.run_trial import TrialSteps
from myomorph.lab.study.trial.trial_inputs import open_trial

STEPS = ("ik", "id", "muscles", "tension")
"""Those of the version that wrote the file."""
OLD = Path(__file__).with_name("old_results") / "reach.nc"
STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = ["ik", "id", "muscles", "tension"]
[options.id]
cutoff = 6
"""


@pytest.mark.parametrize("step", STEPS)
def test_every_step_reads_its_result(step):
    stored = read_result(OLD)
    found = step_of(step).read(stored, OptionSet())
    assert isinstance(found, step_of(step).gives)


def test_a_report_is_made_of_them(arm):
    given = report_input(read_result(OLD), open_model(arm.model))
    assert given.head.title == "s01: reach"
    assert [one.name for one in given.head.steps] == [step_of(name).title for name in STEPS]
    assert given.kinematics.fit is not None
    assert given.dynamics.torques is not None
    assert given.dynamics.wrenches is not None
    assert given.muscles.lengths is not None
    assert given.tension is not None
    assert np.isfinite(given.tension.muscle_force).all()


def test_they_are_reused_as_long_as_nothing_has_changed(arm, monkeypatch):
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    plan = read_plan(path)
    monkeypatch.setattr(
        "myomorph.lab.store.results.__version__", read_result(OLD).provenance["ik"].version
    )
    trial = open_trial(plan.trials[0], plan.settings)
    home = arm.folder / "there"
    home.mkdir()
    shutil.copy(OLD, home / "reach.nc")
    reasons = TrialSteps(trial, STEPS, home).all_reasons(STEPS)
    # Of coordinates that no marker shows something else is assumed since (decision 38), so all is
    # computed again, and it is said why; nothing else has changed.
    assert {name: reasons[name] for name in ("ik", "id", "muscles")} == dict.fromkeys(
        ("ik", "id", "muscles"), ("ik.untracked_coordinates None -> upright",)
    )
    # The criterion weighs loads of knees since (decision 29), so tensions are computed again, and
    # it is said why.
    assert "tension.joint_load_joints None -> knees" in reasons["tension"]
    monkeypatch.setattr("myomorph.lab.store.results.__version__", "99.0")
    version = read_result(OLD).provenance["ik"].version
    assert all(
        reasons[0] == f"version {version} -> 99.0"
        for reasons in TrialSteps(trial, STEPS, home).all_reasons(STEPS).values()
    )
