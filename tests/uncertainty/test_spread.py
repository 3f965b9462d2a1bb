"""Statistics of draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from myomorph.core.tension.quantities import MUSCLE_FORCE
from myomorph.lab.uncertainty import spread as spreads
from myomorph.lab.uncertainty.spread import Draws, Spread, limit_error, widened

TIME = np.arange(3) / 10.0
NAMES = ("a", "b")
SCALE = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


def normal_draws(count=400):
    levels = ndtri((np.arange(count) + 0.5) / count)
    with Draws(count, {"torques": SCALE.shape}) as draws:
        for k, level in enumerate(levels):
            draws.put(k, {"torques": 10.0 + level * SCALE})
        return draws.spread("torques", TIME, NAMES)


def test_limits_are_those_of_a_normal_distribution():
    found = normal_draws()
    np.testing.assert_allclose(found.high - 10.0, ndtri(0.95) * SCALE, rtol=0.01)
    np.testing.assert_allclose(10.0 - found.low, ndtri(0.95) * SCALE, rtol=0.01)
    np.testing.assert_allclose(found.deviation, SCALE, rtol=0.01)


def test_on_disk_and_in_parts_they_are_the_same(monkeypatch):
    expected = normal_draws()
    monkeypatch.setattr(spreads, "IN_MEMORY", 0.0)
    monkeypatch.setattr(spreads, "AT_ONCE", 1.0)
    found = normal_draws()
    np.testing.assert_array_equal(found.low, expected.low)
    np.testing.assert_array_equal(found.deviation, expected.deviation)


def test_draws_without_a_solution_do_not_count():
    with Draws(4, {"torques": (1, 1)}) as draws:
        for k in (0, 1, 3):
            draws.put(k, {"torques": np.array([[float(k)]])})
        found = draws.spread("torques", np.zeros(1), ("a",))
    np.testing.assert_allclose(found.deviation, np.std([0.0, 1.0, 3.0], ddof=1))


def test_a_frame_that_few_draws_do_not_solve_has_the_limits_of_the_others():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(20, 3, 2))
    values[4, 1] = np.nan  # One draw of twenty.
    values[:3, 2, 0] = np.nan  # Three of twenty: too many.
    with Draws(20, {"torques": (3, 2)}) as draws:
        for number, table in enumerate(values):
            draws.put(number, {"torques": table})
        found = draws.spread("torques", TIME, NAMES)
    others = np.delete(values[:, 1], 4, axis=0)
    np.testing.assert_allclose(found.low[1], np.quantile(others, 0.05, axis=0), rtol=1e-5)
    np.testing.assert_allclose(found.deviation[1], others.std(axis=0, ddof=1), rtol=1e-5)
    assert np.isnan(found.high[2, 0])
    assert np.isfinite(found.high[2, 1])


def test_between_its_frames_limits_keep_their_distance():
    found = normal_draws()
    own = np.full((3, 2), 10.0)
    time = np.array([0.0, 0.05, 0.1, 0.15, 0.2])
    nominal = 100.0 + np.arange(10.0).reshape(5, 2)
    between = found.over(time, own, nominal)
    np.testing.assert_allclose(between.high[::2] - nominal[::2], found.high - own)
    np.testing.assert_allclose(
        between.high[1] - nominal[1], 0.5 * ((found.high[0] + found.high[1]) - 20.0)
    )


def test_widened_limits_are_further_apart_and_never_below_what_can_be():
    time = np.zeros(1)
    low = np.array([[1.0, 10.0]])
    high = np.array([[3.0, 30.0]])
    spread = Spread(
        time=time, names=("knee", "hip_f"), low=low, high=high, deviation=np.ones((1, 2))
    )
    wider = widened(spread, 3.0)
    np.testing.assert_allclose([wider.low, wider.high], [[[-1.0, 0.0]], [[5.0, 50.0]]])
    forces = replace(spread, quantity=MUSCLE_FORCE)
    assert (widened(forces, 3.0).low == 0.0).all()
    assert widened(forces, 1.0) is forces


def test_limits_scatter_as_the_line_of_a_result_says():
    values = np.random.default_rng(11).normal(size=(2000, 200))
    limits = np.quantile(values, 0.95, axis=1)
    assert np.isclose(limits.std() / ndtri(0.95), limit_error(200), rtol=0.1)
