"""Outliers are judged by a spread that they do not change."""

from __future__ import annotations

import numpy as np

from myomorph.lab.analysis.conditions import OUTLIER_SCORE, modified_z


def test_the_score_is_the_standard_one():
    values = np.array([9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 60.0])
    # Median 12, deviations 3 2 1 0 1 2 48 with the median 2 (Iglewicz and Hoaglin 1993).
    np.testing.assert_allclose(modified_z(values), 0.6745 * (values - 12.0) / 2.0)
    assert (np.abs(modified_z(values)) > OUTLIER_SCORE).tolist() == [False] * 6 + [True]


def test_of_a_normal_distribution_few_are_called():
    scores = modified_z(np.random.default_rng(0).standard_normal(20000))
    np.testing.assert_allclose(np.std(scores), 1.0, atol=0.02)
    assert (np.abs(scores) > OUTLIER_SCORE).mean() < 0.002


def test_nothing_is_called_where_there_is_no_spread():
    assert np.isnan(modified_z([1.0, 2.0, 90.0, 3.0])).all()
    assert np.isnan(modified_z([1.0, 1.0, 1.0, 1.0, 9.0])).all()
    assert np.isnan(modified_z(1.0 + 1e-9 * np.arange(9.0))).all()
    unknown = modified_z([1.0, 2.0, np.nan, 3.0, 4.0, 5.0, 50.0])
    assert np.isnan(unknown).tolist() == [False, False, True, False, False, False, False]
