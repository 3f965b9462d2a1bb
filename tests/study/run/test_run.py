"""A study runs trial by trial.

What fails is named, the rest is whole, and what has not changed is reused.
"""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.trial.steps import muscles

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = [{trials}]
steps = [{steps}]
[options.id]
cutoff = {cutoff}
"""


def run(
    arm, trials='"reach.trc"', steps='"ik", "id", "muscles", "tension"', cutoff="6", resume=False
):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(trials=trials, steps=steps, cutoff=cutoff))
    return run_study(read_plan(path), arm.out, fresh=not resume)


def test_all_steps_in_one_file(arm):
    (outcome,) = run(arm)
    assert (outcome.error, outcome.done, outcome.reused) == (
        "",
        ("ik", "id", "muscles", "tension"),
        (),
    )
    assert outcome.frames == 61
    assert outcome.rms < 1e-6
    home = arm.out / "s01" / "reach"
    found = read_result(home / "reach.nc")
    assert set(found.provenance) == {"ik", "id", "muscles", "tension"}
    np.testing.assert_allclose(
        found.values["muscle_force"][:, 0],
        read_sto(home / "forces.sto")["flexor"],
        rtol=1e-8,
        atol=1e-12,
    )
    columns = list(
        zip(found.names["crossing_muscle"], found.names["crossing_coordinate"], strict=True)
    )
    arms = read_sto(home / "muscles" / "moment_arms_elbow_flexion.sto")
    stored = found.values["moment_arm"][:, columns.index(("extensor", "elbow_flexion"))]
    np.testing.assert_allclose(arms["extensor"], stored, rtol=1e-8, atol=1e-12)
    assert not list(arm.out.rglob(".*"))


def test_torques_are_balanced_by_what_was_found(arm):
    """R f + reserves = inverse dynamics: every file of a trial belongs to the same frames."""
    run(arm)
    found = read_result(arm.out / "s01" / "reach" / "reach.nc")
    made = np.zeros((61, 2))
    coordinates = found.names["coordinate"]
    for column, (muscle, coordinate) in enumerate(
        zip(found.names["crossing_muscle"], found.names["crossing_coordinate"], strict=True)
    ):
        force = found.values["muscle_force"][:, found.names["muscle"].index(muscle)]
        made[:, coordinates.index(coordinate)] += found.values["moment_arm"][:, column] * force
    for column, coordinate in enumerate(found.names["actuator_coordinate"]):
        made[:, coordinates.index(coordinate)] += found.values["actuator_force"][:, column]
    np.testing.assert_allclose(made, found.values["generalized_force"], atol=1e-6)


def test_a_trial_that_fails_does_not_stop_the_others(arm):
    (arm.folder / "bad.trc").write_text("rubbish")
    outcomes = run(arm, trials='"bad.trc", "reach.trc"', steps='"ik"')
    assert [outcome.trial for outcome in outcomes] == ["bad", "reach"]
    assert "bad.trc" in outcomes[0].error
    assert not outcomes[0].fault
    assert outcomes[1].error == ""
    with (arm.out / "results.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["trial"] for row in rows] == ["bad", "reach"]
    assert "bad.trc" in rows[0]["error"]
    assert rows[1]["steps"] == "ik"


def test_steps_before_a_failure_are_kept(arm):
    arm.loads.write_text(arm.loads.read_text().replace(">fore<", ">leg<"))
    (outcome,) = run(arm)
    assert outcome.done == ("ik",)
    assert outcome.error.startswith("id: ")
    assert "'leg'" in outcome.error
    assert set(read_result(arm.out / "s01" / "reach" / "reach.nc").provenance) == {"ik"}


def test_resume_takes_over_what_has_not_changed(arm):
    first = run(arm, steps='"ik", "id"')[0]
    assert first.reused == ()
    (again,) = run(arm, resume=True)
    assert again.reused == ("ik", "id")
    assert again.done == ("ik", "id", "muscles", "tension")
    whole = read_result(arm.out / "s01" / "reach" / "reach.nc")
    assert set(whole.provenance) == {"ik", "id", "muscles", "tension"}
    assert run(arm, resume=True)[0].reused == ("ik", "id", "muscles", "tension")
    (fresh,) = run(arm)
    assert fresh.reused == ()
    np.testing.assert_array_equal(
        read_result(arm.out / "s01" / "reach" / "reach.nc").values["activation"],
        whole.values["activation"],
    )


def test_resume_sees_changed_options_and_inputs(arm):
    run(arm)
    assert run(arm, cutoff="5", resume=True)[0].reused == ("ik",)
    arm.forces.write_text(arm.forces.read_text().replace("-10", "-11"))
    assert run(arm, cutoff="5", resume=True)[0].reused == ("ik", "muscles")
    arm.model.write_text(arm.model.read_text().replace("800", "900"))
    assert run(arm, cutoff="5", resume=True)[0].reused == ()


def test_muscles_are_computed_again_where_their_motion_is_another():
    assert {*step_of("ik").roles, "soft tissue"} <= set(step_of("muscles").roles)


def test_an_interrupted_trial_goes_on_where_it_was(arm, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(muscles, "STEP", replace(muscles.STEP, run=interrupted))
        with pytest.raises(KeyboardInterrupt):
            run(arm)
    assert not list(arm.out.rglob("*.html"))
    (outcome,) = run(arm, resume=True)
    assert outcome.reused == ("ik", "id")
    assert outcome.error == ""
    assert not list(arm.out.rglob(".*"))


def test_c3d_plates_and_force_tables(arm):
    given = '{markers = "reach.trc", loads = "reach_forces.mot", bodies = {hand_ = "fore"}}'
    by_table = run(arm, trials=given, steps='"ik", "id"')[0]
    assert by_table.error == ""
    torques = read_result(arm.out / "s01" / "reach" / "reach.nc").values["generalized_force"]
    run(arm, steps='"ik", "id"')
    by_xml = read_result(arm.out / "s01" / "reach" / "reach.nc").values["generalized_force"]
    np.testing.assert_allclose(torques, by_xml, atol=1e-9)
