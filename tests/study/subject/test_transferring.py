"""The step `transfer`: trials go on with the motion transferred to the detailed model."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study

STUDY = """
[study]
name = "many links"
[[subject]]
name = "s1"
model = "{folder}/rajagopal-walk-emg/subject_walk_scaled.osim"
mass = 85.27
steps = {steps}
{detailed}
[[subject.trials]]
name = "first"
markers = "{folder}/rajagopal-walk-emg/markers_walk.trc"
loads = "{folder}/rajagopal-walk-emg/grf_walk.xml"
time = [0.1, 1.2]
[[subject.trials]]
name = "second"
markers = "{folder}/rajagopal-walk-emg/markers_walk.trc"
loads = "{folder}/rajagopal-walk-emg/grf_walk.xml"
time = [1.2, 2.2]
[options.identify]
cutoff = 6.0
check = "{check}"
compare = false
soft_tissue = "never"
spacing = 0.03
"""
DETAILED = 'detailed = "{folder}/fullbody-many-muscles/cyclistFullBodyMuscle.osim"'
STEPS = '["transfer", "ik", "identify"]'


def plan(data, home, steps=STEPS, detailed=DETAILED, check="second"):
    path = home / "study.toml"
    folder = data("rajagopal-walk-emg").parent
    path.write_text(
        STUDY.format(
            folder=folder, steps=steps, detailed=detailed.format(folder=folder), check=check
        )
    )
    return read_plan(path)


def test_the_model_with_more_joints_must_be_named(data, tmp_path):
    for steps, detailed in ((STEPS, ""), ('["ik", "identify"]', DETAILED)):
        with pytest.raises(
            BadFile, match="'transfer' and 'detailed', the model with more joints, go together"
        ):
            plan(data, tmp_path, steps, detailed)


@pytest.mark.long
def test_masses_of_many_links_are_identified_from_the_carried_motion(data, tmp_path):
    subject, *trials = run_study(plan(data, tmp_path), tmp_path / "out")
    assert (subject.error, subject.done) == ("", ("transfer", "identify"))
    assert [trial.error for trial in trials] == ["", ""]
    home = tmp_path / "out" / "s1"
    model = read_osim(home / "identified.osim")
    assert len(model.bodies) == 80
    assert model.mass == pytest.approx(85.27, abs=0.01)
    carried = read_sto(home / "transfer/motions/first.mot")
    used = read_sto(home / "first/coordinates.mot")
    np.testing.assert_allclose(used.values, carried.values, atol=1e-6)
    rows = list(
        csv.DictReader((home / "identification" / "cross_validation.csv").read_text().splitlines())
    )
    assert {row["motion"] for row in rows} == {"second"}
    again = run_study(plan(data, tmp_path), tmp_path / "out")
    assert [outcome.reused for outcome in again] == [("transfer", "identify"), ("ik",), ("ik",)]
    wrong = run_study(plan(data, tmp_path, check="third"), tmp_path / "out")
    assert "unknown trial 'third'" in wrong[0].error
