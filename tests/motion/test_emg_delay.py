"""EMG to activation: shapes, shifts, and how many samples a correlation is worth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import EmgCalibration, independent_samples, shaped, shifted
from myomorph.core.motion.filters import lowpass


def test_independent_samples_of_noise_are_all_and_of_slow_series_few():
    rng = np.random.default_rng(7)
    first, second = rng.standard_normal((2, 2000))
    assert independent_samples(first, second) > 1500
    slow = lowpass(np.array([first, second]).T, 100.0, 2.0)
    assert 30 < independent_samples(slow[:, 0], slow[:, 1]) < 200


def test_independent_samples_of_autoregressive_series_are_those_of_the_formula():
    """Of x_k = 0.9 x_(k-1) + noise (Bartlett 1946): n (1 - 0.81) / (1 + 0.81)."""
    first, second = lfilter(
        [1.0], [1.0, -0.9], np.random.default_rng(7).standard_normal((2, 40000))
    )
    assert independent_samples(first, second) == pytest.approx(40000 * 0.19 / 1.81, rel=0.08)


def test_a_shape_joins_nothing_and_all_by_a_curve_above_the_line():
    """(exp(A e) - 1) / (exp(A) - 1): Lloyd and Besier 2003."""
    e = np.linspace(0.0, 1.0, 11)[:, None]
    both = shaped(np.repeat(e, 3, axis=1), np.array([0.0, -1e-9, -3.0]))
    np.testing.assert_allclose(both[:, 0], e[:, 0])
    np.testing.assert_allclose(both[:, 1], e[:, 0])
    assert (both[1:-1, 2] > e[1:-1, 0]).all()
    np.testing.assert_allclose(both[[0, -1], 2], [0.0, 1.0])
    assert both[5, 2] == pytest.approx((np.exp(-1.5) - 1.0) / (np.exp(-3.0) - 1.0))
    assert np.isnan(shaped(np.array([[np.nan]]), np.array([-2.0]))).all()


def test_a_calibration_shapes_then_scales_then_adds_rest():
    time = np.arange(0.0, 1.0, 0.01)
    emg = Emg(time, ("a",), np.full((100, 1), 0.4))
    found = EmgCalibration(
        channels=("a",),
        delays=np.array([0.1]),
        gains=np.array([0.5]),
        offsets=np.array([0.05]),
        shapes=np.array([-2.0]),
    )
    told = found.applied(emg, time).values[:, 0]
    wanted = 0.5 * np.expm1(-0.8) / np.expm1(-2.0) + 0.05
    np.testing.assert_allclose(told[11:], wanted)
    assert np.isnan(told[:10]).all()
    np.testing.assert_allclose(shifted(emg, time, np.array([0.1]))[20:], 0.4)
