"""Lines of `personalize` on held-out recordings.

A score that disagrees with the torque is not called better without a note.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.personalize.estimates import MuscleEstimate
from myomorph.body.personalize.held_out import HeldOut
from myomorph.body.personalize.personalize import Personalized
from myomorph.core.fit.verdict import Verdict
from myomorph.lab.report.trial.personalized import personal_lines
from myomorph.lab.study.workers.ahead import two_links


def held(score, left):
    return HeldOut(
        recordings=("walk2",),
        frames=40,
        score_generic=5.0,
        score=score,
        left_generic=np.array([7.0, 7.0]),
        left=np.array(left),
        kept=(),
        verdict=Verdict(
            kinds=(("torque left", "SD"),),
            parts=("walk2",),
            estimate=np.array([[np.mean(left)]]),
            generic=np.array([[7.0]]),
            weights=np.array([40.0]),
        ),
    )


@pytest.fixture
def found():
    model = two_links()
    estimates = (
        MuscleEstimate(
            of="muscle_0",
            parameter="optimal_fiber_length",
            generic=0.3,
            person=0.33,
            low=0.3,
            high=0.36,
            variance_ratio=0.1,
            identifiable="yes",
        ),
        MuscleEstimate(
            of="muscle_0",
            parameter="tendon_slack_length",
            generic=0.3,
            person=0.2,
            low=0.1,
            high=0.3,
            variance_ratio=0.9,
            identifiable="no",
            bound="low",
        ),
    )
    ends = np.array([[0.45, 1.2]])
    return Personalized(
        model=model,
        estimates=estimates,
        recordings=("walk1",),
        coordinates=("second_angle",),
        mapped=None,
        held_out=held(4.0, [5.0, 5.0]),
        before=ends,
        after=ends,
        torque_errors=np.array([2.5]),
        frames=(30, 60),
    )


def test_numbers_units_places_and_verdicts(found):
    text = "\n".join(personal_lines(found))
    assert (
        "walk2, held out: better than generic muscles (score 4.00, generic 5.00; torque left 5.00,"
        " generic 7.00 N m)" in text
    )
    assert "worst second_angle 2.5 N m" in text
    assert "of 2 parameters 1 identifiable, 0 partly, 1 as in the prior" in text
    assert "(muscle_0 tendon slack length)" in text
    assert (
        "fibers work from 0.45 (muscle_0) to 1.20 optimal lengths (muscle_0): 1 muscles outside 0.5"
        " to 1.5" in text
    )


def test_worse_is_said(found):
    assert "NO better" in personal_lines(replace(found, held_out=held(6.0, [5.0, 5.0])))[1]
    assert (
        "torque left 11.00, generic 7.00"
        in personal_lines(replace(found, held_out=held(4.0, [11.0, 11.0])))[1]
    )
    assert any(
        "no recording was held out" in one for one in personal_lines(replace(found, held_out=None))
    )
