"""Envelopes follow the amplitude of noise and ignore what is outside the band."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Series
from myomorph.core.motion.envelope import EnvelopeOptions, envelopes

TIME = np.arange(8000) / 2000.0


def test_envelope_follows_the_amplitude():
    amplitude = 0.5 - 0.5 * np.cos(2 * np.pi * 0.5 * TIME)
    noise = np.random.default_rng(3).standard_normal(len(TIME))
    found = envelopes(Series(TIME, ("a",), (amplitude * noise)[:, None]))
    assert np.corrcoef(found["a"], amplitude)[0, 1] > 0.97
    assert found.values.max() == pytest.approx(1.0)
    assert found.values.min() >= 0.0


def test_drift_and_offset_are_not_muscle():
    carrier = np.sin(2 * np.pi * 100.0 * TIME)
    drift = 5.0 + 3.0 * np.sin(2 * np.pi * 1.0 * TIME)
    plain = envelopes(Series(TIME, ("a",), carrier[:, None]))
    drifting = envelopes(Series(TIME, ("a",), (carrier + drift)[:, None]))
    np.testing.assert_allclose(drifting.values[1000:-1000], plain.values[1000:-1000], atol=0.02)


def test_silence_stays_silent():
    assert envelopes(Series(TIME, ("a",), np.zeros((len(TIME), 1)))).values.max() == 0.0


def test_too_short_is_refused():
    with pytest.raises(BadData, match="EMG of 20 samples"):
        envelopes(Series(TIME[:20], ("a",), np.ones((20, 1))))


def test_a_cutoff_beyond_the_rate_is_refused():
    slow = Series(np.arange(400) / 60.0, ("a",), np.ones((400, 1)))
    with pytest.raises(BadData, match="cutoff of 30 Hz: expected below half the rate of 60 Hz"):
        envelopes(slow, EnvelopeOptions(cutoff=30.0))
