"""Steps on a subject: trials use the model that they make; unchanged results are reused."""

from __future__ import annotations

import pytest

from identified_arm import UPPER, put_on_plate
from myomorph.core.io.osim.read import read_osim
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
mass = 4.0
trials = ["reach.trc"]
steps = ["ik", "identify", "id"]
[options.identify]
spacing = 0.02
mass_sd = {mass_sd}
soft_tissue = "always"
masses = "expected"
compare = false
"""


def run(arm, mass_sd=0.5, resume=False):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(mass_sd=mass_sd))
    return run_study(read_plan(path), arm.out, fresh=not resume)


def test_inverse_dynamics_uses_the_identified_model(arm):
    put_on_plate(arm)
    subject, trial = run(arm)
    assert (subject.trial, subject.done, subject.error) == ("", ("identify",), "")
    assert (trial.trial, trial.done, trial.error) == ("reach", ("ik", "id"), "")
    home = arm.out / "s01"
    assert read_osim(home / "identified.osim").body("upper").mass == pytest.approx(UPPER, abs=0.15)
    assert (home / "identification" / "report.html").is_file()
    made = read_result(home / "reach" / "reach.nc").provenance["id"]
    assert [one.name for one in made.sources if one.role == "model"] == [
        str(home / "identified.osim")
    ]

    again = run(arm, resume=True)
    assert [one.reused for one in again] == [("identify",), ("ik", "id")]
    # What may not be believed is said at every run, also of a result that was reused.
    assert any("soft tissue" in text for text in subject.findings), subject.findings
    assert again[0].findings == subject.findings
    # As results of versions that did not write it yet.
    (home / "identification" / "soft_tissue.csv").unlink()
    assert run(arm, resume=True)[0].changed == ("identification/soft_tissue.csv is missing",)
    changed = run(arm, mass_sd=0.01, resume=True)
    assert [one.reused for one in changed] == [(), ()]


def test_a_subject_that_cannot_be_identified_stops_its_own_trials(arm):
    arm.loads.unlink()
    subject, trial = run(arm)
    assert "no trial has external forces" in subject.error
    assert trial.error == f"not run: {subject.error}"
    assert "'s01'" in subject.error
    assert not subject.fault
    assert not (arm.out / "s01" / "identified.osim").exists()
