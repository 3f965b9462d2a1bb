"""What a study file says of models and options is what its jobs do."""

from __future__ import annotations

import shutil

import pytest

from identified_arm import put_on_plate
from myomorph.core.model.errors import BadFile
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
[subject.options.id]
cutoff = 30
[[subject]]
name = "s02"
model_of = "s01"
mass = 4.0
trials = [
    "again.trc",
    {markers = "reach.trc", options = {id = {cutoff = 12}, ik = {tolerance = 1e-6}}},
]
steps = ["ik", "id"]
[options.identify]
spacing = 0.02
compare = false
[options.tension]
cutoff = 5
"""


@pytest.fixture
def study(arm):
    put_on_plate(arm)
    shutil.copy(arm.markers, arm.folder / "again.trc")
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_a_subject_uses_the_model_that_another_makes(arm, study):
    plan = read_plan(study)
    assert (plan.maker("s01"), plan.maker("s02")) == ("s01", "s01")
    outcomes = {one.key: one for one in run_study(plan, arm.out)}
    assert {one.error for one in outcomes.values()} == {""}
    made = arm.out / "s01" / "identified.osim"
    used = read_result(arm.out / "s02" / "again" / "again.nc").provenance["ik"].sources
    assert [one.name for one in used if one.role == "model"] == [str(made)]
    assert ("s02", "") not in outcomes
    again = {one.key: one for one in run_study(plan, arm.out)}
    assert again["s02", "again"].reused == ("ik", "id")
    study.write_text(STUDY.replace("0.02", "0.03"), encoding="utf-8")
    changed = {one.key: one for one in run_study(read_plan(study), arm.out)}
    assert changed["s02", "again"].reused == ()
    assert any("identified.osim has changed" in text for text in changed["s02", "again"].changed)


def test_options_of_a_subject_and_of_a_trial_are_used(arm, study):
    run_study(read_plan(study), arm.out)

    def options(subject, trial):
        return read_result(arm.out / subject / trial / f"{trial}.nc").provenance["id"].options

    assert options("s01", "reach")["id.cutoff"] == 30.0
    assert options("s02", "again")["id.cutoff"] == 5.0
    assert (options("s02", "reach")["id.cutoff"], options("s02", "reach")["ik.tolerance"]) == (
        12.0,
        1e-6,
    )


def test_models_in_a_circle_are_refused(study):
    text = STUDY.replace('model = "arm.osim"', 'model_of = "s02"')
    study.write_text(text, encoding="utf-8")
    with pytest.raises(
        BadFile,
        match="subjects need each other's models: 's01' waits for 's02' waits for 's01'",
    ):
        read_plan(study)


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ('labels = {R = "UA9"}', "labels: unknown marker 'UA9': arm.osim has 'UA1', 'UA2'"),
        (
            'emg_muscles = {CH1 = ["flexr"]}',
            "emg_muscles: unknown muscle 'flexr': arm.osim has 'flexor'",
        ),
        (
            'trials = [{markers = "reach.trc", plates = ["", "fore_r"]}]',
            "plates: unknown body 'fore_r': arm.osim has 'fore'",
        ),
        (
            (
                'trials = [{markers = "reach.trc", loads = "reach_forces.mot", bodies = {plate_ ='
                ' "uper"}}]'
            ),
            "bodies: unknown body 'uper': arm.osim has 'upper'",
        ),
    ],
)
def test_names_that_the_model_does_not_have_are_told_before_anything_runs(arm, study, told, words):
    kept = 'trials = ["reach.trc"]\n'
    text = STUDY.replace(kept, told + "\n" if told.startswith("trials") else kept + told + "\n")
    study.write_text(text, encoding="utf-8")
    with pytest.raises(BadFile) as caught:
        read_plan(study)
    assert words in str(caught.value)
