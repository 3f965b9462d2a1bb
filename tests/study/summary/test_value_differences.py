"""Differences of values between conditions, and what draws of errors do to their intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from myomorph.core.model.series import Series
from myomorph.lab.study.summary.condition_values import GrowingCondition, OutlierSearch
from myomorph.lab.study.summary.value_differences import (
    KEPT_DRAWS,
    MeasuredValues,
    difference_rows,
    differences,
)
from myomorph.lab.study.trial.tidy import OF_TRIAL
from myomorph.lab.study.trial.trial_inputs import Value
from myomorph.lab.uncertainty.spread import ValueErrors, of_subject, widened_errors

NAME = ("id", "knee_angle_r_moment, maximum")
DRAWS = KEPT_DRAWS


def measured(value):
    step, quantity = NAME
    return Value(step=step, quantity=quantity, value=value, unit="N m")


def gathered(trials):
    """Trials as (subject, condition, value, errors (draws,) or None)."""
    values = MeasuredValues()
    for k, (subject, condition, value, errors) in enumerate(trials):
        drawn = None if errors is None else ValueErrors((NAME,), errors[:, None])
        values.add((subject, condition, f"t{k}"), [measured(value)], drawn)
    return differences(values, ("a", "b"))


def test_errors_that_trials_of_a_subject_share_cancel_between_its_conditions():
    rng = np.random.default_rng(1)
    shared = rng.normal(0.0, 5.0, DRAWS)
    own = {name: rng.normal(0.0, 1.0, DRAWS) for name in "ab"}
    (one,) = gathered(
        [("s", name, value, shared + own[name]) for name, value in (("a", 10.0), ("b", 14.0))]
    )
    assert one.difference == -4.0
    assert one.measured_sd == pytest.approx(np.std(own["b"] - own["a"], ddof=1), rel=1e-5)
    assert np.isnan(one.low)
    assert one.high_all - one.low_all == pytest.approx(2 * 1.95996 * one.measured_sd, rel=1e-4)


def test_errors_of_subjects_are_independent_though_their_draws_have_the_same_numbers():
    """Of n subjects with errors of one size, the mean's error falls with the root of n.

    What the draws share does not matter.
    """
    same = np.random.default_rng(2).normal(0.0, 3.0, DRAWS)
    trials = [
        (f"s{k}", name, 10.0 * k, same if name == "b" else 0.0 * same)
        for k in range(9)
        for name in "ab"
    ]
    (one,) = gathered(trials)
    assert one.paired
    assert one.measured_sd == pytest.approx(np.std(same, ddof=1) / 3.0, rel=1e-5)
    orders = [of_subject(same[:, None], f"s{k}")[:, 0] for k in range(2)]
    assert abs(np.corrcoef(*orders)[0, 1]) < 0.25


@pytest.mark.parametrize("paired", [True, False])
def test_intervals_by_the_spread_are_those_of_student_and_welch(paired):
    rng = np.random.default_rng(3)
    first = rng.normal(0.0, 1.0, 6)
    second = rng.normal(1.0, 2.0, 6)
    subjects = ("s", "s") if paired else ("s", "other")
    groups = zip("ab", subjects, (first, second), strict=True)
    trials = [(f"{who}{k}", name, x, None) for name, who, own in groups for k, x in enumerate(own)]
    (one,) = gathered(trials)
    if paired:
        expected = stats.ttest_rel(first, second).confidence_interval(0.95)
    else:
        expected = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.95)
    np.testing.assert_allclose((one.low, one.high), expected, rtol=1e-9)
    assert (one.low_all, one.high_all) == (one.low, one.high)


def test_trials_of_an_only_subject_do_not_show_what_they_share():
    """Their spread holds what differs between them.

    What they share is added, and nothing is counted twice.
    """
    rng = np.random.default_rng(4)
    tilt = rng.normal(0.0, 2.0, DRAWS)
    trials = []
    for name, sign in (("a", 0.0), ("b", 1.0)):
        for x in (1.0, 2.0, 3.0, 4.0):
            trials.append(("s", name, x + 5.0 * sign, sign * tilt + rng.normal(0.0, 1.0, DRAWS)))
    (one,) = gathered(trials)
    assert one.unit_of == "trials"
    assert one.measured_sd == pytest.approx(np.std(tilt, ddof=1), rel=0.1)
    half = one.high - one.difference
    drawn = 1.95996 * one.measured_sd
    assert one.high_all - one.difference == pytest.approx(np.hypot(half, drawn), rel=1e-4)
    head, row = difference_rows([one])
    assert dict(zip(head, row, strict=True))["n_first"] == "4"


def test_widened_errors_keep_their_middle():
    errors = np.random.default_rng(5).normal(1.0, 2.0, (200, 1))
    errors[3] = np.nan
    wide = widened_errors(errors, np.array([1.5]))
    low = np.nanquantile(errors, (0.05, 0.95))
    high = np.nanquantile(wide, (0.05, 0.95))
    assert np.diff(high)[0] == pytest.approx(1.5 * np.diff(low)[0])
    assert high.mean() == pytest.approx(low.mean())


def test_a_condition_of_one_trial_without_strides_has_no_curves_to_be_far_from():
    """Compared with another condition its curves are dropped.

    The search for outliers needs nothing of them.
    """
    curves = {
        "joint angle [deg]": Series(np.linspace(0.0, 100.0, 101), ("knee",), np.zeros((101, 1)))
    }
    condition = GrowingCondition("rise")
    search = OutlierSearch()
    condition.add("s", "rise1", [measured(1.0)], OF_TRIAL, curves)
    condition.without_whole_trials()
    search.add_curves(("s", "rise", "rise1"), condition, OF_TRIAL, curves)
    assert search.found() == []
