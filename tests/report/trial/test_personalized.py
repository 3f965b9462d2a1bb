"""Lines of `personalize`: what was held out; a score that disagrees with the torque is not called better in silence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.report.trial.personalized import personal_lines
from myomorph.study.workers.ahead import two_links
from myomorph.tension.personal.fit import HeldOut
from myomorph.tension.personal.personalize import Estimate, Personalized


def held(score, left):
    return HeldOut(("walk2",), 40, 5.0, score, np.array([7.0, 7.0]), np.array(left), ())


@pytest.fixture
def found():
    model = two_links()
    estimates = (
        Estimate("muscle_0", "optimal_fiber_length", 0.3, 0.33, 0.3, 0.36, 0.1, "yes"),
        Estimate("muscle_0", "tendon_slack_length", 0.3, 0.2, 0.1, 0.3, 0.9, "no", "low"),
    )
    ends = np.array([[0.45, 1.2]])
    return Personalized(
        model,
        estimates,
        ("walk1",),
        ("second_angle",),
        None,
        held(4.0, [5.0, 5.0]),
        ends,
        ends,
        np.array([2.5]),
        (30, 60),
    )


def test_numbers_units_places_and_verdicts(found):
    text = "\n".join(personal_lines(found))
    assert (
        "walk2, held out: better than generic muscles (score 4.00, generic 5.00; torque left 5.00, generic 7.00 N m)"
        in text
    )
    assert "worst second_angle 2.5 N m" in text
    assert "of 2 parameters 1 identifiable, 0 partly, 1 as assumed before" in text
    assert "(muscle_0 tendon slack length)" in text
    assert "fibers work from 0.45 (muscle_0) to 1.20 optimal lengths (muscle_0): 1 muscles outside 0.5 to 1.5" in text


def test_worse_is_said(found):
    assert "NO better" in personal_lines(replace(found, held_out=held(6.0, [5.0, 5.0])))[1]
    assert "torque left 11.00, generic 7.00" in personal_lines(replace(found, held_out=held(4.0, [11.0, 11.0])))[1]
    assert any("nothing was held out" in one for one in personal_lines(replace(found, held_out=None)))
