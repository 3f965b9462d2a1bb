"""Delays of EMG: made ones are found again within the interval that is told, and doubt is told too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from myomorph.model.errors import BadData, UnknownName
from myomorph.model.series import Emg, Series
from myomorph.motion.emg_delay import USUAL, DelayOptions, find_delays, independent_samples, shifted
from myomorph.motion.filters import lowpass

TIME = np.arange(-0.5, 12.5, 0.01)
INSIDE = TIME[(TIME >= 0.0) & (TIME <= 12.0)]


def bursts(rng, channels: int, cutoff: float = 4.0) -> np.ndarray:
    """Envelopes (frames, channels) that come and go."""
    return np.maximum(lowpass(rng.standard_normal((len(TIME), channels)), 100.0, cutoff), 0.0)


def recording(rng, delay: float, channels: int = 3, noise: float = 0.5) -> tuple[Emg, Series]:
    """Envelopes, and activations that follow them `delay` later with noise of that share of their spread."""
    names = tuple(f"channel {k}" for k in range(channels))
    emg = Emg(TIME, names, bursts(rng, channels))
    gains = rng.uniform(0.3, 3.0, channels)
    activations = gains * shifted(emg, INSIDE, np.full(channels, delay))
    other = np.array(lowpass(rng.standard_normal(activations.shape), 100.0, 4.0))
    activations += noise * activations.std(axis=0) * other / other.std(axis=0)
    return emg, Series(INSIDE, names, activations)


@pytest.mark.parametrize("delay", [0.02, 0.057, 0.11])
@pytest.mark.parametrize("by", ["subject", "channel"])
def test_a_made_delay_is_found_again(delay, by):
    found = find_delays([recording(np.random.default_rng(1), delay, noise=0.1)], DelayOptions(by=by))
    np.testing.assert_allclose(found.seconds, delay, atol=0.006)
    assert found.found.all()
    assert (found.correlation > 0.95).all()


def test_the_interval_holds_the_delay_about_as_often_as_it_says():
    rng = np.random.default_rng(2)
    inside, widths = 0, []
    for _ in range(60):
        delay = rng.uniform(0.05, 0.11)
        found = find_delays([recording(rng, delay, channels=1)])
        inside += found.interval[0, 0] - 5e-4 <= delay <= found.interval[0, 1] + 5e-4
        widths.append(np.ptp(found.interval[0]))
    assert inside >= 51
    assert np.median(widths) < 0.06


def test_more_recordings_make_it_surer():
    rng = np.random.default_rng(3)
    recordings = [recording(rng, 0.07, channels=2, noise=1.0) for _ in range(6)]
    one, all_six = find_delays(recordings[:1]), find_delays(recordings)
    assert np.ptp(all_six.interval[0]) < np.ptp(one.interval[0])
    assert all_six.seconds[0] == pytest.approx(0.07, abs=0.012)


def test_noise_tells_no_delay():
    rng = np.random.default_rng(4)
    emg, _ = recording(rng, 0.05)
    other = Series(INSIDE, emg.names, lowpass(rng.standard_normal((len(INSIDE), 3)), 100.0, 4.0))
    found = find_delays([(emg, other)])
    assert not found.found.any()
    np.testing.assert_array_equal(found.seconds, USUAL)
    np.testing.assert_array_equal(found.interval, [[0.010, 0.150]] * 3)


def test_a_delay_beyond_the_bounds_is_put_on_the_bound_and_not_called_found():
    found = find_delays([recording(np.random.default_rng(5), 0.25, noise=0.05)], DelayOptions(correlation=0.1))
    assert not found.found.any()
    np.testing.assert_allclose(found.seconds, 0.15)


def test_size_does_not_matter_and_a_flat_channel_tells_nothing():
    emg, predicted = recording(np.random.default_rng(6), 0.06)
    larger = Emg(emg.time, emg.names, emg.values * [1.0, 1e4, 1e-4])
    np.testing.assert_array_equal(find_delays([(larger, predicted)]).seconds, find_delays([(emg, predicted)]).seconds)
    flat = Series(predicted.time, predicted.names, predicted.values * [1.0, 1.0, 0.0] + 0.02)
    found = find_delays([(emg, flat)])
    assert np.isnan(found.correlation[2])
    assert found.seconds[0] == pytest.approx(0.06, abs=0.02)


def test_independent_samples_of_noise_are_all_and_of_slow_series_few():
    rng = np.random.default_rng(7)
    first, second = rng.standard_normal((2, 2000))
    assert independent_samples(first, second) > 1500
    slow = lowpass(np.array([first, second]).T, 100.0, 2.0)
    assert 30 < independent_samples(slow[:, 0], slow[:, 1]) < 200


def test_independent_samples_of_autoregressive_series_are_those_of_the_formula():
    """Of x_k = 0.9 x_(k-1) + noise (Bartlett 1946): n (1 - 0.81) / (1 + 0.81)."""
    first, second = lfilter([1.0], [1.0, -0.9], np.random.default_rng(7).standard_normal((2, 40000)))
    assert independent_samples(first, second) == pytest.approx(40000 * 0.19 / 1.81, rel=0.08)


def test_what_cannot_be_compared_is_named():
    emg, predicted = recording(np.random.default_rng(8), 0.05)
    later = Series(predicted.time + 20.0, predicted.names, predicted.values)
    with pytest.raises(BadData, match=r"EMG runs from -0.5 to .* the motion from 20 to 31.99 s"):
        find_delays([(emg, later)])
    with pytest.raises(UnknownName, match="'other'"):
        find_delays([(emg, Series(predicted.time, ("other", "b", "c"), predicted.values))])
    with pytest.raises(BadData, match="rising range"):
        DelayOptions(least=0.1, most=0.05)
