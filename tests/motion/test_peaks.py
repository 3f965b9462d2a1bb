"""Peaks against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from myomorph.core.motion.peaks import prominent_peaks


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("apart", [1.0, 3.4, 12.0])
def test_peaks_are_those_of_scipy(seed, apart):
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(size=200))
    if seed % 2 and apart == 1.0:
        # Flat tops and bottoms. Which of two that are as high stays, SciPy leaves open.
        values = np.round(values)
    prominence = rng.uniform(0.1, 3.0)
    theirs, _ = scipy.signal.find_peaks(
        values, prominence=prominence, plateau_size=1, distance=apart
    )
    np.testing.assert_array_equal(prominent_peaks(values, prominence, apart), theirs)


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0], [2.0, 2.0, 2.0], [0.0, 1.0, 2.0]])
def test_a_curve_that_never_turns_has_no_peak(values):
    assert not len(prominent_peaks(np.array(values), 0.0))
