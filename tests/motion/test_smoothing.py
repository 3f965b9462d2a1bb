"""The filter without imports against SciPy's, and its law."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from myomorph.core.motion.smoothing import smooth_both_ways


@pytest.mark.parametrize("shape", [(40,), (200, 3), (60, 2, 3)])
@pytest.mark.parametrize("cutoff", [1.0, 8.0, 40.0])
def test_equals_scipy(shape, cutoff):
    values = np.cumsum(np.random.default_rng(0).normal(size=shape), axis=0)
    sections = scipy.signal.butter(2, cutoff, fs=100.0, output="sos")
    expected = scipy.signal.sosfiltfilt(sections, values, axis=0, padlen=9)
    smoothed = smooth_both_ways(values, 100.0, cutoff, padding=9)
    np.testing.assert_allclose(smoothed, expected, rtol=0.0, atol=1e-10)


def test_a_line_passes_unchanged():
    line = np.linspace(-3.0, 5.0, 50)[:, None] * [1.0, -2.0]
    np.testing.assert_allclose(smooth_both_ways(line, 50.0, 6.0, padding=49), line, atol=1e-2)


def test_a_gap_spoils_its_own_column_only():
    values = np.zeros((30, 2))
    values[4, 1] = np.nan
    smoothed = smooth_both_ways(values, 50.0, 6.0, padding=9)
    assert np.isnan(smoothed[:, 1]).all()
    assert np.array_equal(smoothed[:, 0], np.zeros(30))
