"""Lines and running means are those of scipy, whose modules take long to import."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from myomorph.core.fit.trends import detrended, running_mean


@pytest.mark.parametrize("shape", [(1,), (2,), (31,), (30, 3), (17, 2, 3)])
def test_a_line_is_taken_off_as_scipy_does(shape):
    values = np.random.default_rng(1).standard_normal(shape).cumsum(axis=0)
    np.testing.assert_allclose(
        detrended(values), scipy.signal.detrend(values, axis=0), rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize("shape", [(1,), (40,), (40, 3), (9, 2, 3)])
@pytest.mark.parametrize("window", [1, 2, 5, 8, 30])
def test_a_running_mean_is_that_of_scipy(shape, window):
    values = 100.0 + np.random.default_rng(2).standard_normal(shape).cumsum(axis=0)
    expected = scipy.ndimage.uniform_filter1d(values, window, axis=0)
    np.testing.assert_allclose(running_mean(values, window), expected, rtol=0.0, atol=1e-10)
