"""One verdict on a trial, by a rule on its checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.causes import FEET_BESIDE
from myomorph.core.model.message_groups import grouped_messages
from myomorph.lab.report.trial.answer.judgement import Judgement, judged
from myomorph.lab.report.trial.prepared import Prepared, prepare
from myomorph.lab.report.trial.report_input import ReportInput
from walker import everything, having


def verdict(given: ReportInput) -> Judgement:
    prepared = prepare(given)
    return judged(prepared, grouped_messages(given.head.warnings))


def with_errors(given: ReportInput, size: float, share: float) -> ReportInput:
    """Give the same with marker errors of a size [m] in a share of the frames."""
    fit = given.kinematics.fit
    assert fit is not None
    errors = np.full_like(fit.marker_error, 0.005)
    errors[: round(share * len(errors))] = size
    return having(given, fit=replace(fit, marker_error=errors))


def without_checks(prepared: Prepared) -> Prepared:
    return replace(prepared, verdicts=())


def test_markers_that_miss_the_body_in_many_frames_spoil_everything() -> None:
    found = verdict(with_errors(everything(100), 0.05, 0.2))
    assert found.use == "nothing"
    assert found.words == "Do not use"
    assert "limit" in found.reason


def test_a_few_frames_that_miss_are_named_and_spoil_nothing() -> None:
    few = verdict(with_errors(everything(100), 0.05, 0.02))
    none = verdict(with_errors(everything(100), 0.005, 0.0))
    assert few.use == none.use != "nothing"
    assert "markers miss the body there" in few.reason
    assert "markers miss the body there" not in none.reason


def test_one_marker_that_is_off_throughout_spoils_everything() -> None:
    given = everything(100)
    fit = given.kinematics.fit
    assert fit is not None
    errors = np.full_like(fit.marker_error, 0.001)
    errors[:, 0] = 0.05
    found = verdict(having(given, fit=replace(fit, marker_error=errors)))
    assert found.use == "nothing"
    assert fit.marker_names[0] in found.reason or "Markers miss" in found.reason


def test_without_forces_angles_alone_are_usable() -> None:
    given = with_errors(everything(100), 0.005, 0.0)
    found = verdict(having(given, torques=None, wrenches=None, tension=None))
    assert found.use == "angles"
    assert "No force was measured" in found.reason


def test_a_foot_beside_the_plates_leaves_angles() -> None:
    given = with_errors(everything(100), 0.005, 0.0)
    text = FEET_BESIDE.message("the load on 'calcn_r' is not determined", size=38.0)
    found = verdict(having(given, warnings=(text,)))
    assert found.use == "angles"
    assert "38" in found.reason


def test_torques_without_muscles_are_said_to_be_so() -> None:
    given = with_errors(everything(100), 0.005, 0.0)
    prepared = without_checks(prepare(having(given, tension=None)))
    found = judged(prepared, ())
    assert found.use == "angles and torques"


def test_when_all_checks_pass_everything_is_usable() -> None:
    given = with_errors(everything(100), 0.005, 0.0)
    found = judged(without_checks(prepare(given)), ())
    assert found.use == "everything"
    assert found.words == "Usable"
