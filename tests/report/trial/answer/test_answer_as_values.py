"""The answer as values: rows of its table, stances, windows in which torques hold, knee loads."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.findings import Finding
from myomorph.core.model.known import Known
from myomorph.core.model.messages import as_message
from myomorph.core.model.series import Series
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.gait_curves import KEYS, GaitCurves
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.report.trial.answer.answer import answer_of
from myomorph.lab.report.trial.answer.answer_table import answer_rows, write_answer
from myomorph.lab.report.trial.answer.foot_stances import FootStance
from myomorph.lab.report.trial.answer.knee_load import knee_load_curve
from myomorph.lab.report.trial.answer.plate_strip import plate_strip
from myomorph.lab.report.trial.answer.torque_window import torque_windows
from myomorph.lab.report.trial.prepared import Prepared, prepare
from walker import everything, fitted, having

LEGS_ALONE = "a body without a trunk: no residual is judged"


def stance(start: float, stop: float, *measured: tuple[float, float]) -> FootStance:
    return FootStance(side="right", start=start, stop=stop, measured=measured)


def test_a_stance_says_how_much_of_it_was_measured() -> None:
    assert stance(1.0, 2.0, (1.0, 1.99)).words == "measured"
    assert stance(1.0, 2.0, (1.4, 1.6)).words == "measured in part"
    assert stance(1.0, 2.0).words == "not measured"


def test_a_strip_fills_what_was_measured() -> None:
    drawn = plate_strip([stance(0.2, 0.8, (0.2, 0.8)), stance(1.2, 1.8)], (0.0, 2.0))
    assert drawn.count('class="stance right"') == 2
    assert drawn.count('class="stance measured right"') == 1
    assert "measured 1 of 2 as a whole" in drawn
    assert plate_strip([], (0.0, 2.0)) == ""


def known_torques(*spans: tuple[float, float]) -> Prepared:
    """Make a trial whose torques hold but for spans in which a foot's load was not measured."""
    given = having(everything(200), root_note=LEGS_ALONE)
    motion = given.kinematics.motion
    assert motion is not None
    given = having(given, fit=fitted(motion, 0.001))
    finding = Finding(
        kind=UNDETERMINED, place="tibia_r", text=as_message("not determined"), times=spans
    )
    wrenches = given.dynamics.wrenches
    assert wrenches is not None
    return prepare(having(given, wrenches=replace(wrenches, findings=(finding,))))


def test_torques_hold_where_each_load_was_measured() -> None:
    first, second = torque_windows(known_torques((0.5, 0.9)))
    assert first == pytest.approx((0.0, 0.49), abs=0.011)
    assert second == pytest.approx((0.91, 1.99), abs=0.011)


def test_torques_hold_nowhere_with_large_residuals() -> None:
    prepared = prepare(everything(200))
    assert prepared.center_height > 0.0
    assert torque_windows(prepared) == ()


def test_without_torques_there_is_no_window() -> None:
    assert torque_windows(prepare(having(everything(50), torques=None))) == ()


def test_the_table_says_what_the_page_says(tmp_path: Path) -> None:
    prepared = known_torques((0.5, 0.9))
    answer = answer_of(prepared)
    assert answer.result is not None
    rows = list(answer_rows(prepared, answer))
    by_kind = {row.kind: row.text for row in rows}
    assert by_kind["sentence"] == str(answer.result.sentence)
    assert by_kind["verdict"] == answer.judgement.words
    assert by_kind["reason"] == answer.judgement.reason
    assert sum(row.kind == "torques hold" for row in rows) == 2
    poses = [row for row in rows if row.kind == "key pose"]
    assert [row.start for row in poses] == [pose.time for pose in answer.result.poses]
    write_answer(tmp_path, prepared, answer)
    with (tmp_path / "answer.csv").open(newline="", encoding="utf-8") as stream:
        written = list(csv.DictReader(stream))
    assert [row["kind"] for row in written] == [row.kind for row in rows]
    assert list(written[0]) == ["kind", "text", "side", "start_s", "stop_s"]


def strides(side: str, *starts: float) -> tuple[Stride, ...]:
    return tuple(
        Stride(
            limb=f"tibia_{side[0]}",
            start=start,
            lift=start + 0.5,
            stop=start + 0.8,
            length=1.0,
            width=0.1,
            seen=1.0,
            source="plates",
        )
        for start in starts
    )


def test_a_knee_load_is_that_of_strides_on_plates() -> None:
    """A stride whose foot was on no plate, and a leg without tensions, have none."""
    time = np.arange(200) / 100.0
    weight = 60.0 * 9.80665
    load = np.where(time < 1.0, 2.0 + np.sin(2.0 * np.pi * time), 9.0) * weight
    forces = Series(time, ("knee_r", "knee_l"), np.stack([load, np.full(200, np.nan)], axis=1))
    values = np.full((2, 51, len(KEYS)), np.nan)
    values[0, :, KEYS.index("knee_moment")] = 1.0
    gait = GaitCurves(
        right=Cycles(KEYS, values),
        left=Cycles(KEYS, values[:1]),
        strides={"right": strides("right", 0.1, 1.1), "left": strides("left", 0.2)},
    )
    curve = knee_load_curve(prepare(having(everything(200), joint_force=forces)), gait)
    assert curve is not None
    (side,) = curve.sides
    assert side.side == "right"
    assert side.cycles.shape == (1, SAMPLES)
    assert side.value(side.highest) == pytest.approx(3.0, abs=0.01)
    assert curve.at[side.highest] == pytest.approx(100.0 * (0.25 - 0.1) / 0.8, abs=1.5)


@pytest.mark.parametrize(
    ("movement", "walks"), [("walking", True), ("running", False), ("upper limb", False)]
)
def test_only_who_walks_gets_a_page_of_gait(movement: str, walks: bool) -> None:
    known = Known(value=movement, origin="user")  # type: ignore[type-var]
    prepared = prepare(having(everything(300), movement=known))
    assert prepared.walks == (walks and prepared.strides is not None)
    assert walks or prepared.gait is None
