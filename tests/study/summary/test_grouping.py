"""Groups of a study file, with made walkers.

Their strides are found in the trials' coordinates and compared.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

from made_walker import PERIOD, recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadFile
from myomorph.lab.analysis.groups import Animal
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.trial_strides import in_one_turn

STUDY = """
[study]
name = "gait of mutants"
{subjects}
[groups]
mutant = {mutant}
control = {control}
{strides}
"""


def study(
    folder,
    mutants=("m1", "m2", "m3", "m4"),
    controls=("c1", "c2", "c3", "c4"),
    strides="",
    steps='"ik", "muscles"',
):
    model = walker()
    write_osim(model, folder / "walker.osim")
    rng = np.random.default_rng(0)
    subjects = ""
    for name in (*mutants, *controls):
        write_trc(recording(model, rng, 0.6 if name in mutants else 0.1), folder / f"{name}.trc")
        subjects += (
            f'[[subject]]\nname = "{name}"\nmodel = "walker.osim"\ntrials = ["{name}.trc"]\nsteps ='
            f" [{steps}]\n"
        )
    path = folder / "study.toml"
    text = STUDY.format(
        subjects=subjects, mutant=list(mutants), control=list(controls), strides=strides
    )
    path.write_text(text.replace("'", '"'))
    return path


def table(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_groups_are_compared_after_the_trials(tmp_path):
    # Hips that swing evenly slide the feet: the ground is told.
    outcomes = run_study(
        read_plan(study(tmp_path, strides="[strides]\nbelt = 0")), tmp_path / "out"
    )
    assert [one.error for one in outcomes] == [""] * 9
    assert outcomes[-1].done == ("groups",)
    out = tmp_path / "out"
    page = (out / "groups.html").read_text()
    assert "mutant" in page
    assert "knee_angle_r" in page
    assert "Muscle length" in page
    curves = table(out / "group_curves.csv")
    assert {row["kind"] for row in curves} == {"joint angle [°]", "muscle length [mm]"}
    # Strikes are where the foot is farthest ahead, so that the knee bends in the last half of the
    # cycle.
    knee = [row for row in curves if row["curve"] == "knee_angle_l"]
    largest = min(knee, key=lambda row: float(row["difference"]))
    assert 55.0 < float(largest["percent"]) < 95.0
    assert float(largest["difference"]) == pytest.approx(np.degrees(-0.5), abs=8.0)
    assert float(largest["p_corrected"]) == pytest.approx(2 / 70, abs=1e-6)
    parameters = {row["parameter"]: row for row in table(out / "group_parameters.csv")}
    duration = parameters["stride duration, foot_r [s]"]
    assert float(duration["mutant_mean"]) == pytest.approx(PERIOD, abs=0.01)
    assert float(parameters["stride length, foot_l [m]"]["control_mean"]) == pytest.approx(
        PERIOD, rel=0.05
    )
    assert float(parameters["phase, foot_l after foot_r"]["control_mean"]) == pytest.approx(
        0.5, abs=0.02
    )
    assert float(duration["p_holm"]) > 0.05
    strides = table(out / "group_strides.csv")
    assert {row["subject"] for row in strides} == {"m1", "m2", "m3", "m4", "c1", "c2", "c3", "c4"}
    assert not list(out.glob(".*"))


def test_phases_are_averaged_around_the_turn():
    made = (("a", (0.97, 0.03, 0.98, np.nan)), ("b", (0.04, 0.02)), ("c", (0.96, 0.99)))
    name = "phase, foot_l after foot_r"
    for shift in (0.0, 0.3, 0.5, 0.8):
        animals = [Animal(one, {name: (np.array(phases) + shift) % 1.0}) for one, phases in made]
        found = in_one_turn([*animals, Animal("d", {"speed [m/s]": np.ones(2)})])
        means = [one.scalar(name) for one in found[:3]]
        middle = shift - 1.0 if shift > 0.75 else shift
        np.testing.assert_allclose(
            means, middle + np.array([-0.02 / 3.0, 0.03, -0.025]), atol=1e-12
        )
    assert found[3].scalar("speed [m/s]") == 1.0


def test_a_trial_without_results_is_left_out_and_said(tmp_path):
    path = study(tmp_path, ("m1", "m2"), ("c1", "c2"))
    (tmp_path / "m2.trc").write_text("rubbish")
    outcomes = run_study(read_plan(path), tmp_path / "out")
    assert outcomes[-1].error == ""
    page = (tmp_path / "out" / "groups.html").read_text()
    assert "m2 is left out of group" in page
    assert "described, not tested" in page


def test_limbs_and_trunk_may_be_told(tmp_path):
    told = (
        '[strides]\ntrunk = "pelvis"\ndirection = [1, 0, 0]\nlimbs = {right = ["foot_r",'
        ' "thigh_r"]}'
    )
    run_study(read_plan(study(tmp_path, ("m1",), ("c1",), told)), tmp_path / "out")
    assert {row["limb"] for row in table(tmp_path / "out" / "group_strides.csv")} == {"right"}
    unknown = '[strides]\nlimbs = {right = "hoof_r"}'
    outcomes = run_study(read_plan(study(tmp_path, ("m1",), ("c1",), unknown)), tmp_path / "other")
    assert "hoof_r" in outcomes[-1].error


def test_what_is_wrong_with_groups_is_told_before_anything_runs(tmp_path):
    path = study(tmp_path, ("m1",), ("c1",))
    good = path.read_text()
    for old, new, told in (
        ('mutant = ["m1"]', 'mutant = ["m9"]', "names subject 'm9'"),
        ('mutant = ["m1"]', "mutant = []", "'mutant' has no subjects"),
        ('mutant = ["m1"]', 'mutant = ["c1"]', "is in both groups"),
        ('mutant = ["m1"]', 'mutant = ["m1"]\nother = ["m1"]', "expected two groups"),
        (
            'control = ["c1"]',
            'control = ["c1"]\n[strides]\ndirection = [0, 0, 0]',
            "expected a vector",
        ),
    ):
        assert old in good
        path.write_text(good.replace(old, new))
        with pytest.raises(BadFile, match=told):
            read_plan(path)
