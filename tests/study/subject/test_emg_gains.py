"""EMG gains over all trials of a subject.

The step of a study, its file, and `tension --emg-gains-file`.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Emg, Table
from myomorph.core.motion.emg_activation import EmgCalibration, Synergies, SynergyWeights
from myomorph.lab.study.inputs.emg_gains import (
    SubjectGains,
    common_scale,
    read_gains,
    rescaled,
    write_gains,
)
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study


def gains() -> SubjectGains:
    synergies = Synergies(
        channels=("A", "B"),
        scale=np.array([0.5, 2.0]),
        vectors=np.array([[1.0, 0.2]]),
        explained=0.93,
    )
    weights = SynergyWeights(synergies, ("other",), np.array([[0.4]]))
    held = np.array([[0.5, 0.6], [np.nan, np.nan]])
    intervals = np.array([[0.5, 0.9], [np.nan, np.nan]])
    told = np.array([True, False])
    found = EmgCalibration(
        channels=("A", "B"),
        delays=np.array([0.04, 0.06]),
        gains=np.array([0.7, 0.2]),
        offsets=np.array([0.0, 0.1]),
        warnings=("one line",),
        shapes=np.array([-1.0, 0.0]),
        intervals=intervals,
        by_torque=told,
        synergies=(weights,),
        weight=0.3,
        held_out=held,
    )
    return SubjectGains(found, {"A": 2.0, "B": 300.0})


def test_a_file_of_gains_holds_all_of_them(tmp_path):
    given = gains()
    write_gains(given, tmp_path / "gains.json")
    found = read_gains(tmp_path / "gains.json")
    assert found.scale == given.scale
    emg = Emg(
        np.arange(0.0, 1.0, 0.01), ("A", "B"), np.abs(np.sin(np.arange(200.0))).reshape(100, 2)
    )
    time = np.arange(0.1, 0.9, 0.02)
    for name in ("applied", "extrapolated"):
        mine = getattr(given.calibration, name)(emg, time).values
        other = getattr(found.calibration, name)(emg, time).values
        assert mine == pytest.approx(other, abs=1e-15)
    assert found.calibration.by_torque.tolist() == [True, False]
    for name in ("intervals", "held_out"):
        assert np.array_equal(
            getattr(found.calibration, name),
            getattr(given.calibration, name),
            equal_nan=name != "by_torque",
        )
    assert found.calibration.weight == 0.3
    assert found.calibration.warnings == ("one line",)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"format": "myomorph EMG gains 1", "channels": ["A"]}', "[1]"]
)
def test_a_file_that_holds_no_gains_is_refused(tmp_path, text):
    (tmp_path / "gains.json").write_text(text)
    with pytest.raises(BadFile, match=r"gains\.json"):
        read_gains(tmp_path / "gains.json")


def test_recordings_come_to_one_unit():
    """The same electrode, a loud and a quiet recording, each scaled to its own largest value."""
    time = np.arange(4.0)
    counts = {"loud": np.array([1.0, 8.0, 4.0, 0.0]), "quiet": np.array([2.0, 1.0, 0.5, 0.0])}
    own = {name: {"A": float(one.max())} for name, one in counts.items()}
    scale = common_scale(list(own.values()))
    assert scale == {"A": 8.0}
    for name, one in counts.items():
        alone = Emg(time, ("A", "B"), np.column_stack([one / one.max(), one]))
        both = rescaled(alone, own[name], scale)
        assert both["A"] == pytest.approx(one / 8.0)
        assert both["B"] == pytest.approx(one)


STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
steps = {steps}
[[subject.trials]]
markers = "reach.trc"
name = "early"
time = [0.0, 0.3]
emg = "reach_emg.sto"
[[subject.trials]]
markers = "reach.trc"
name = "late"
time = [0.3, 0.6]
emg = "quiet_emg.sto"
[options.tension]
{options}
"""


def study(arm, steps='["ik", "emg", "id", "tension"]', options="emg_delay = 0.0", resume=False):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(steps=steps, options=options))
    return run_study(read_plan(path), arm.out, fresh=not resume)


def test_trials_of_a_subject_take_the_gains_of_all(arm, command):
    """Two halves of one motion, one with half the EMG in the same counts: one gain for both."""
    whole = read_sto(arm.emg)
    write_sto(Table(whole.time, whole.names, 10.0 * whole.values), arm.folder / "quiet_emg.sto")
    write_sto(Table(whole.time, whole.names, 20.0 * whole.values), arm.emg)
    outcomes = study(arm)
    assert [one.error for one in outcomes] == ["", "", ""]
    home = arm.out / "s01"
    assert not list(home.glob("*.osim"))
    gains = read_gains(home / "emg_gains" / "gains.json")
    assert gains.scale["flexor"] == pytest.approx(20.0 * whole["flexor"].max(), rel=1e-6)
    for name in ("early", "late"):
        rows = list(csv.DictReader((home / name / "emg_channels.csv").open()))
        assert float(rows[0]["gain"]) == pytest.approx(gains.calibration.gains[0], rel=1e-5)

    again = study(arm, resume=True)
    assert [one.reused for one in again] == [
        ("emg",),
        ("ik", "id", "tension"),
        ("ik", "id", "tension"),
    ]
    changed = study(arm, options="emg_delay = 0.02", resume=True)
    assert [one.reused for one in changed] == [(), ("ik",), ("ik",)]

    file = ("--emg-gains-file", home / "emg_gains" / "gains.json")
    told = ("tension", "--model", arm.model, "--motion", arm.motion, "--loads", arm.loads)
    found = command(*told, "--emg", arm.emg, *file, "--out", arm.folder / "one")
    assert found.status == 0, found.err
    rows = list(csv.DictReader((arm.folder / "one" / "emg_channels.csv").open()))
    now = read_gains(home / "emg_gains" / "gains.json")
    assert float(rows[0]["gain"]) == pytest.approx(now.calibration.gains[0], rel=1e-5)
    alone = command(*told, *file, "--out", arm.folder / "two")
    assert alone.status == 2
    assert "--emg-gains-file without --emg" in alone.err


def test_a_subject_without_emg_says_what_lacks(arm):
    path = arm.folder / "study.toml"
    text = STUDY.format(steps='["ik", "emg", "id"]', options="")
    arm.emg.unlink()  # which would be found by its name
    path.write_text("\n".join(line for line in text.splitlines() if not line.startswith("emg")))
    subject = run_study(read_plan(path), arm.out, fresh=True)[0]
    assert "no trial determines EMG gains (early: no EMG; late: no EMG)" in subject.error
