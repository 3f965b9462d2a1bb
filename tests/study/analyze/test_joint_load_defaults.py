"""Loads of joints that analyze asks for by itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from made_standing import standing
from myomorph.core.io.trc import write_trc
from myomorph.lab.analyze.analyze import prepare_request
from myomorph.lab.analyze.joint_load_defaults import chosen_contact_points
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from myomorph.lab.study.inputs.contact_points import ContactPointsFile
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.plan.plan import read_plan
from walker import model as walker


def test_a_person_who_stands_gets_loads_of_joints_and_of_both_sides_of_knees(
    tmp_path: Path,
) -> None:
    write_trc(standing(0.3), tmp_path / "walk.trc")
    request = AnalyzeRequest((tmp_path / "walk.trc",), 70.0)
    plan = read_plan(prepare_request(request, tmp_path / "out").study)
    assert plan.settings["tension"]["reactions"] == "child"
    assert [one.get(ContactPointsFile) for one in plan.trials] == [ContactPointsFile("auto")]


@pytest.mark.parametrize(
    ("inputs", "options", "found"),
    [
        (ByType(), {"tension": {"reactions": "none"}}, ""),
        (ByType(ContactPointsFile("points.toml")), {}, "points.toml"),
    ],
)
def test_what_was_stated_stays(inputs: ByType, options: dict, found: str) -> None:
    body = walker()
    assert chosen_contact_points(body, inputs, options).contact_points == found


def test_a_body_without_feet_gets_no_contact_points() -> None:
    assert chosen_contact_points(walker(), ByType(), {}) == ContactPointsFile("")
