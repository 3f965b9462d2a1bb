"""The answer of a trial: numbers of the sentence are those of the curves."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.known import Known
from myomorph.lab.analysis.muscle_names import plain_name
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.answer.answer import Answer, answer_of
from myomorph.lab.report.trial.answer.answer_chart import answer_chart
from myomorph.lab.report.trial.answer.answer_curve import FEW, SideCurve
from myomorph.lab.report.trial.answer.squat import squat
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import Kinematics, ReportInput
from walker import everything, having


def answered(given: ReportInput) -> Answer:
    return answer_of(prepare(given))


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> Answer:
    """Of a real walk on a belt, whose angles alone are known."""
    home = data("opensim-gait-subject01") / "ref_id"
    model = read_model(home / "subject01.osim")
    motion = motion_from_table(read_sto(home / "subject01_walk1_ik.mot"), model)
    return answered(
        ReportInput(PageHead("s01: walk"), model, kinematics=Kinematics(coordinates=motion))
    )


def test_numbers_of_the_sentence_are_those_of_the_first_curve(walk: Answer) -> None:
    assert walk.result is not None
    knee = walk.result.curves[0]
    text = str(walk.result.sentence)
    for side in knee.sides:
        assert f"{side.value(side.highest):.0f}°" in text


def test_the_sentence_is_short(walk: Answer) -> None:
    assert walk.result is not None
    text = str(walk.result.sentence)
    assert len(text) <= 110
    assert text.endswith(".")
    assert len(re.findall(r"\d+(?:\.\d+)?", text)) <= 4


def test_sides_are_colored_as_they_are_named(walk: Answer) -> None:
    assert walk.result is not None
    for phrase in walk.result.sentence.phrases:
        if phrase.side:
            assert phrase.side in phrase.text


def test_poses_stand_on_the_axis_in_order(walk: Answer) -> None:
    assert walk.result is not None
    places = [pose.at for pose in walk.result.poses]
    assert places == sorted(places)
    assert all(0.0 <= place <= 100.0 for place in places)


def test_few_cycles_are_drawn_each_and_many_as_a_band() -> None:
    cycles = np.random.default_rng(3).normal(size=(FEW, 20))
    few = SideCurve(side="right", label="right", cycles=cycles[:-1])
    many = SideCurve(side="right", label="right", cycles=cycles)
    assert few.spread is None
    assert many.spread == pytest.approx(cycles.std(axis=0, ddof=1))
    assert many.mean == pytest.approx(cycles.mean(axis=0))


def test_a_chart_says_its_values_to_those_who_cannot_see(walk: Answer) -> None:
    assert walk.result is not None
    chart = answer_chart(walk.result.curves[0], walk.result, last=False)
    assert re.search(r'aria-label="Knee flexion \[°\]: right \d', chart)


@pytest.mark.parametrize("movement", ["squatting", "running", "jumping", "upper limb", "other"])
def test_every_movement_has_an_answer(movement: str) -> None:
    """Even one that was stated although the recording shows another."""
    known = Known(value=movement, origin="user")  # type: ignore[type-var]
    found = answered(having(everything(100), movement=known))
    assert found.result is not None
    assert str(found.result.sentence)
    assert 1 <= len(found.result.curves) <= 3


def test_muscles_have_their_plain_names() -> None:
    assert plain_name("recfem_r") == "rectus femoris"
    assert plain_name("semimem_l") == "hamstrings"
    assert plain_name("addbrev_r") == "adductors"
    assert plain_name("lat_gas_r") == "gastrocnemius"
    assert plain_name("nobody_knows_it") == ""


def test_what_is_not_known_is_not_said() -> None:
    """Torques that are missing at the deepest point give no number, and no mark on a curve."""
    given = everything(100)
    torques = given.dynamics.torques
    assert torques is not None
    hidden = replace(torques, values=np.full_like(torques.values, np.nan))
    partly = torques.values.copy()
    partly[10:] = np.nan
    for series in (hidden, replace(torques, values=partly)):
        found = squat(prepare(having(given, torques=series)), "everything")
        assert found is not None
        assert "nan" not in str(found.sentence) + found.caveat
        for curve in found.curves:
            assert "nan" not in answer_chart(curve, found, last=True)
