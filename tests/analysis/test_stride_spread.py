"""How numbers differ between strides: against the standard library, and what intervals promise."""

from __future__ import annotations

import statistics

import numpy as np
import pytest

from myomorph.lab.analysis.stride_spread import (
    LEVEL,
    MIN_STRIDES,
    StrideSpread,
    stride_spread,
    stride_spreads,
)
from myomorph.lab.report.trial.answer.answer_curve import FEW

T_90 = {5: 2.131847, 12: 1.795885}
"""Student's t of 95 % for n - 1 degrees of freedom, from printed tables."""


@pytest.mark.parametrize("count", [5, 12])
def test_spread_is_that_of_the_standard_library(count):
    values = np.random.default_rng(count).normal(62.0, 4.0, count)
    found = stride_spread(values)
    sd = statistics.stdev(values.tolist())
    half = T_90[count] * sd / count**0.5
    mean = statistics.fmean(values.tolist())
    assert found.count == count
    assert (found.mean, found.sd) == pytest.approx((mean, sd))
    assert (found.low, found.high) == pytest.approx((mean - half, mean + half), rel=1e-6)


def test_spread_of_many_strides_is_the_one_they_were_made_with():
    values = np.random.default_rng(0).normal(62.0, 4.0, (4000, 3))
    for found in stride_spreads(values):
        assert found.sd == pytest.approx(4.0, rel=0.04)


def test_the_interval_of_the_mean_holds_what_it_promises():
    """90 % of recordings of few or many strides hold the mean that strides were drawn about."""
    rng = np.random.default_rng(7)
    for count in (MIN_STRIDES, 20):
        found = stride_spreads(rng.normal(62.0, 4.0, (count, 4000)))
        held = np.mean([each.low <= 62.0 <= each.high for each in found])
        assert held == pytest.approx(LEVEL, abs=0.015)


def test_few_strides_have_no_interval_and_one_has_no_spread():
    four = stride_spread(np.array([1.0, 2.0, 4.0, np.nan, 3.0]))
    assert four.count == 4
    assert four.sd == pytest.approx(statistics.stdev([1.0, 2.0, 4.0, 3.0]))
    assert np.isnan(four.low)
    assert np.isnan(four.high)
    one = stride_spread(np.array([np.nan, 2.5]))
    assert (one.mean, one.count) == (2.5, 1)
    assert np.isnan(one.sd)
    assert stride_spread(np.array([np.nan])).count == 0
    assert StrideSpread(mean=1.0, sd=1.0, low=0.0, high=2.0, count=5) != four


def test_curves_draw_single_strides_where_the_mean_has_no_interval():
    assert FEW == MIN_STRIDES
