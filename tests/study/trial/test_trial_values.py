"""Values, curves and quality of one trial: from its results, and what they say is so."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

import myomorph.lab.analysis.walking as strides_module
from made_walker import PERIOD, recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Wrenches
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import value_source
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.table import settings_of_keys
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial import reporting
from myomorph.lab.study.trial.reporting import TrialResults
from myomorph.lab.study.trial.run_trial import run_trial
from myomorph.lab.study.trial.tidy import (
    CURVES,
    OF_STRIDE,
    OF_TRIAL,
    QUALITY,
    VALUES,
    curve_name,
    read_curves,
    read_quality,
    read_values,
    write_trial_values,
)
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial

ANGLE = "joint angle [°]"
TORQUE = "joint torque [N·m/kg]"


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Folder of the results of a made walk, in which both knees bend alike."""
    home = tmp_path_factory.mktemp("walk")
    write_osim(walker(), home / "walker.osim")
    write_trc(recording(walker(), np.random.default_rng(5), 0.5), home / "walk.trc")
    (home / "study.toml").write_text(
        '[study]\nname = "one"\n[[subject]]\nname = "s"\nmodel = "walker.osim"\nmass = 60\ntrials ='
        ' ["walk.trc"]\nsteps = ["ik", "id", "muscles"]\n'
    )
    (outcome,) = run_study(read_plan(home / "study.toml"), home / "out")
    assert outcome.error == ""
    return outcome.folder


def numbers(folder):
    return {one.quantity: one for one in read_values(folder / VALUES)}


def test_values_are_those_of_the_tables(walk):
    values = numbers(walk)
    angles = read_sto(walk / "coordinates.mot")
    torques = read_sto(walk / "torques.sto")
    knee = angles["knee_angle_l"]
    assert values["knee_angle_l, range"].value == pytest.approx(np.ptp(knee), rel=1e-5)
    assert values["knee_angle_l, mean"].value == pytest.approx(knee.mean(), rel=1e-5)
    assert (values["knee_angle_l, range"].unit, values["pelvis_tx, range"].unit) == ("deg", "m")
    moment = values["knee_angle_r_moment, maximum"]
    assert (moment.step, moment.unit) == ("id", "N m")
    assert moment.value == pytest.approx(torques["knee_angle_r_moment"].max(), rel=1e-5)
    assert values["pelvis_ty_force, mean"].unit == "N"
    lengths = read_sto(walk / "muscles" / "lengths.sto")
    assert values["rectus_r_length, minimum"].value == pytest.approx(
        lengths["rectus_r"].min(), rel=1e-5
    )
    assert values["frames"].value == len(angles.time)


def test_strides_are_measured_once_and_their_extremes_are_means(walk):
    values = numbers(walk)
    assert values["stride duration, foot_r"].value == pytest.approx(PERIOD, abs=0.01)
    assert values["strides, foot_r"].value >= 3
    # All strides are the same but for where frames lie in them.
    inside = values["knee_angle_r, minimum in a stride"].value
    whole = values["knee_angle_r, minimum"].value
    assert inside == pytest.approx(whole, abs=1.0)
    assert inside >= whole - 1e-9


def test_each_side_is_cut_at_its_own_strikes(walk):
    """The walker is its own mirror image half a cycle later.

    Both sides' curves are alike, torques too.
    """
    cycle, curves = read_curves(walk / CURVES)
    assert cycle == OF_STRIDE
    for family in (ANGLE, TORQUE, "muscle length [mm]"):
        base = "rectus" if "muscle" in family else "knee_angle"
        right = curves[family][f"{base}_r"]
        left = curves[family][f"{base}_l"]
        assert len(right) == 101
        assert np.corrcoef(right, left)[0, 1] > 0.97, family
    assert curves[ANGLE].time[-1] == 100.0
    # Torques per kilogram of the subject, not of the model.
    peak = numbers(walk)["knee_angle_r_moment, maximum in a stride"].value
    assert curves[TORQUE]["knee_angle_r"].max() == pytest.approx(peak / 60.0, rel=0.05)


def test_quality_tells_limits(walk):
    rows = {row["quantity"]: row for row in read_quality(walk / QUALITY)}
    assert rows["Marker error, largest"]["limit"] == "4"
    assert rows["Marker error, largest"]["state"] == "ok"
    assert read_quality(walk / "nothing.csv") == []


def test_what_was_taken_over_stays(walk):
    before = (walk / VALUES).read_bytes()
    (walk / VALUES).write_text("kept")
    kept = TrialResults(walk / "walk.nc", walker())
    write_trial_values(kept, Outcome("s", "walk", walk, done=("ik", "id"), reused=("ik", "id")))
    assert (walk / VALUES).read_text() == "kept"
    (walk / VALUES).write_bytes(before)
    assert not list(walk.glob(".*"))


def test_what_is_no_walk_goes_over_the_whole_trial(arm):
    path = arm.folder / "study.toml"
    path.write_text(
        '[study]\nname = "reaching"\n[[subject]]\nname = "s01"\nmodel = "arm.osim"\ntrials ='
        ' ["reach.trc"]\nsteps = ["ik", "id", "muscles", "tension"]\n'
    )
    (outcome,) = run_study(read_plan(path), arm.out)
    cycle, curves = read_curves(outcome.folder / CURVES)
    assert cycle == OF_TRIAL
    assert {ANGLE, "muscle activation", "muscle force [N]"} <= set(curves)
    values = numbers(outcome.folder)
    assert not any("stride" in name for name in values)
    forces = read_sto(outcome.folder / "forces.sto")
    assert values["flexor_force, maximum"].value == pytest.approx(forces["flexor"].max(), rel=1e-5)
    assert values["frames not optimal"].value == 0.0
    angles = read_sto(outcome.folder / "coordinates.mot")
    assert curves[ANGLE]["elbow_flexion"][-1] == pytest.approx(
        angles["elbow_flexion"][-1], rel=1e-4
    )


def test_names_of_curves_come_back(tmp_path):
    with (tmp_path / "curves.csv").open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(
            [OF_TRIAL, curve_name(ANGLE, "a: b [c]"), curve_name("muscle activation", "x")]
        )
        table.writerow(["0", "1.5", "nan"])
        table.writerow(["100", "2.5", "3"])
    cycle, curves = read_curves(tmp_path / "curves.csv")
    assert (cycle, list(curves)) == (OF_TRIAL, [ANGLE, "muscle activation"])
    assert curves[ANGLE].names == ("a: b [c]",)
    assert np.isnan(curves["muscle activation"]["x"]).tolist() == [True, False]
    assert list(read_curves(tmp_path / "curves.csv", ("joint",))[1]) == [ANGLE]
    (tmp_path / "curves.csv").write_text("time,x\n0,1\n")
    with pytest.raises(BadData, match="run the trial again"):
        read_curves(tmp_path / "curves.csv")


def test_values_are_made_again_when_the_subject_weighs_more(arm):
    """No step depends on the mass, but torques per kilogram do."""
    text = (
        '[study]\nname = "reaching"\n[[subject]]\nname = "s01"\nmodel = "arm.osim"\nmass = {}\n'
        'trials = ["reach.trc"]\nsteps = ["ik", "id"]\n'
    )
    path = arm.folder / "study.toml"
    peaks = []
    for mass in (4, 8, 8):
        path.write_text(text.format(mass))
        (outcome,) = run_study(read_plan(path), arm.out)
        assert outcome.error == ""
        peaks.append(np.abs(read_curves(outcome.folder / CURVES)[1][TORQUE].values).max())
    assert outcome.reused == ("ik", "id")
    assert peaks[1:] == pytest.approx([0.5 * peaks[0]] * 2, rel=1e-5)


def test_strides_and_the_report_are_worked_out_once(walk, tmp_path, monkeypatch):
    """Tables of values and the page come from one preparation.

    A page that is made again later is the same.
    """
    calls = []

    def counted(module, name):
        known = getattr(module, name)

        def call(*values, **options):
            calls.append(name)
            return known(*values, **options)

        monkeypatch.setattr(module, name, call)

    counted(strides_module, "find_strides")
    counted(reporting, "prepare")
    counted(reporting, "read_result")
    home = walk
    while not (home / "walker.osim").is_file():
        home = home.parent
    settings = {"id": {"cutoff": 6.0}}
    trial = open_trial(
        TrialFiles(
            home / "walker.osim",
            subject="s",
            inputs=settings_of_keys({"markers": home / "walk.trc"}),
        ),
        settings,
    )
    outcome = run_trial(trial, ("ik", "id", "muscles", "report"), tmp_path)
    assert outcome.error == ""
    assert sorted(calls) == ["find_strides", "prepare"]
    assert (tmp_path / reporting.LENGTH_CURVES).is_file()
    page = (tmp_path / "report.html").read_bytes()
    assert reporting.report_folder(tmp_path) == [tmp_path / "report.html"]
    assert (tmp_path / "report.html").read_bytes() == page


def test_what_every_step_found_doubtful_is_kept(tmp_path):
    """A step after the first adds its own warnings.

    It takes them away again when it finds nothing any more.
    """
    body = walker()
    write_osim(body, tmp_path / "walker.osim")
    write_trc(recording(body, np.random.default_rng(5), 0.5), tmp_path / "walk.trc")
    trial = open_trial(
        TrialFiles(
            tmp_path / "walker.osim", inputs=settings_of_keys({"markers": tmp_path / "walk.trc"})
        ),
        {},
    )

    def loads(motion):
        none = np.zeros((len(motion), 1, 3))
        return Wrenches(
            time=motion.time,
            names=("plate",),
            bodies=("foot_r",),
            forces=none,
            points=none,
            torques=none,
            notes=("a doubtful plate",),
        )

    for expected, one in (
        (True, trial.having(ExternalLoads.on_known_bodies(loads))),
        (False, trial),
    ):
        sources = (*trial.sources, value_source("loads", "plate", str(expected)))
        outcome = run_trial(replace(one, sources=sources), ("ik", "id"), tmp_path / "out")
        assert outcome.error == ""
        rows = read_quality(outcome.folder / QUALITY)
        assert any(row["detail"] == "a doubtful plate" for row in rows) is expected
