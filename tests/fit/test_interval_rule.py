"""The one rule for intervals, against published quantiles and known distributions."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.fit.interval_rule import (
    drawn_limits,
    half_width,
    interval_of_errors,
    reflected_limits,
)


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


def test_draws_are_reflected_at_the_value_and_distances_as_squares():
    draws = np.linspace(5.0, 7.0, 1001)
    low, high = drawn_limits(draws)
    np.testing.assert_allclose(reflected_limits(4.0, draws), (8.0 - high, 8.0 - low))
    squares = reflected_limits(6.0, draws, distance=True)
    np.testing.assert_allclose(np.square(squares), (72.0 - high**2, 72.0 - low**2))
    # Errors alone can make a distance that is none.
    assert reflected_limits(1.0, draws, distance=True) == (0.0, 0.0)


def test_a_number_without_a_finite_draw_has_no_interval():
    interval = interval_of_errors(3.0, np.array([np.nan, np.inf]))
    assert interval.value == 3.0
    assert np.isnan([interval.low, interval.high]).all()


def test_intervals_of_maxima_and_distances_hold_the_truth_where_errors_are_added_twice():
    """Of curves that hold an error, draws add another: nine in ten intervals hold the truth."""
    rng = np.random.default_rng(7)
    truth = 20.0 * np.sin(np.linspace(0.0, 9.0, 120))

    def errors(count):
        waves = rng.standard_normal((count, 2, 10))
        turns = np.outer(np.arange(1.0, 11.0), np.linspace(0.0, 2.0 * np.pi, 120))
        return (waves[:, 0] @ np.sin(turns) + waves[:, 1] @ np.cos(turns)) / np.sqrt(10.0)

    held = {"maximum": 0, "range": 0, "distance": 0}
    numbers = {
        "maximum": lambda curves: curves.max(axis=1),
        "range": lambda curves: np.ptp(curves, axis=1),
        "distance": lambda curves: np.sqrt(np.mean(np.square(curves - 0.9 * truth), axis=1)),
    }
    repeats = 300
    for _ in range(repeats):
        measured = truth + errors(1)
        added = errors(100)
        drawn = measured + added
        twice = [drawn + np.roll(added, shift, axis=0) for shift in (1, 2, 3, 4)]
        for name, number in numbers.items():
            low, high = reflected_limits(
                number(measured)[0],
                number(drawn),
                distance=name == "distance",
                again=np.array([number(curves) for curves in twice]),
            )
            held[name] += bool(low <= number(truth[None])[0] <= high)
    # Of 300 intervals of 90 %, 83 to 97 % hold with certainty enough.
    assert all(0.83 * repeats <= count <= 0.97 * repeats for count in held.values()), held
