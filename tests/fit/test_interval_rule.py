"""The one rule for intervals, against published quantiles and known distributions."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.fit.interval_rule import drawn_limits, half_width


def test_half_widths_are_those_of_tables_of_quantiles():
    # Student's t at 0.95 with 5 degrees of freedom, as in any printed table.
    np.testing.assert_allclose(half_width([1.0, 2.0], freedom=5.0), [2.015, 4.030], atol=5e-4)
    assert float(half_width(1.0)) == pytest.approx(1.6449, abs=5e-5)
    assert float(half_width(1.0, level=0.95)) == pytest.approx(1.95996, abs=1e-5)


def test_limits_of_draws_hold_their_share_in_each_column():
    draws = np.random.default_rng(3).normal(size=(4001, 2)) * [1.0, 3.0]
    low, high = drawn_limits(draws)
    assert low.shape == high.shape == (2,)
    share = ((draws > low) & (draws < high)).mean(axis=0)
    np.testing.assert_allclose(share, 0.9, atol=1e-3)


def test_a_value_below_all_draws_moves_the_limits_down():
    """A distance that every draw makes larger: its limits lie at the draws' lower end."""
    draws = np.linspace(1.0, 2.0, 1001)
    low, high = drawn_limits(draws, value=0.5)
    plain_low, plain_high = drawn_limits(draws)
    assert low < plain_low
    assert high < plain_high


def test_a_value_in_the_middle_gives_the_quantiles_of_the_draws():
    draws = np.linspace(-1.0, 1.0, 1001)
    np.testing.assert_allclose(drawn_limits(draws, value=0.0), drawn_limits(draws), atol=1e-12)
