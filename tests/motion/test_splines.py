"""Natural splines are those of scipy, whose import they spare."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate

from myomorph.core.model.errors import BadData
from myomorph.core.motion.splines import NATURAL_ORDERS, natural_spline


def scipy_spline(time, values, degree):
    ends = [(order, np.zeros(values.shape[1:])) for order in NATURAL_ORDERS[degree]]
    return scipy.interpolate.make_interp_spline(time, values, k=degree, bc_type=(ends, ends))


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
@pytest.mark.parametrize("frames", [6, 7, 60])
def test_values_and_derivatives_are_those_of_scipy(degree, shape, frames):
    rng = np.random.default_rng(frames)
    time = 3.0 + np.cumsum(rng.uniform(0.005, 0.015, frames))
    values = np.cumsum(rng.normal(size=(frames, *shape)), axis=0)
    ours = natural_spline(time, values, degree)
    theirs = scipy_spline(time, values, degree)
    # Beyond the ends the outer polynomials continue.
    at = np.linspace(time[0] - 0.005, time[-1] + 0.005, 101)
    for order in range(degree):
        expected = theirs(at, order)
        tolerance = 1e-10 * np.abs(expected).max()
        np.testing.assert_allclose(ours(at, order), expected, rtol=0.0, atol=tolerance)
        np.testing.assert_array_equal(ours.derivative(order)(at), ours(at, order))


@pytest.mark.parametrize("degree", [3, 5])
def test_derivatives_vanish_at_the_ends(degree):
    time = np.linspace(0.0, 0.5, 51)
    spline = natural_spline(time, np.exp(-time)[:, None] * [1.0, 2.0], degree)
    for order in NATURAL_ORDERS[degree]:
        inside = np.abs(spline(time[5:-5], order)).max()
        assert np.abs(spline(time[[0, -1]], order)).max() < 1e-6 * inside


def test_one_point_gives_one_value():
    time = np.linspace(0.0, 1.0, 11)
    spline = natural_spline(time, np.column_stack([time, 2.0 * time]))
    np.testing.assert_allclose(spline(0.25), [0.25, 0.5], atol=1e-12)


@pytest.mark.parametrize(
    ("time", "values", "text"),
    [
        (np.arange(5.0), np.zeros(5), "at least 6 frames"),
        (np.arange(8.0), np.full(8, np.nan), "finite values"),
        (np.zeros(8), np.zeros(8), "times that increase"),
    ],
)
def test_what_has_no_spline_is_refused(time, values, text):
    with pytest.raises(BadData, match=text):
        natural_spline(time, values)


@pytest.mark.parametrize("shape", [(0,), (0, 3)])
def test_nothing_has_a_spline_of_nothing(shape):
    """A recording whose forces were all set aside is filtered like any other."""
    time = np.arange(8) / 100.0
    spline = natural_spline(time, np.zeros((8, *shape)))
    for order in range(3):
        assert spline(time, order).shape == (8, *shape)
