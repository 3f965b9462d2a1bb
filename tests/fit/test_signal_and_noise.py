"""Motion and noise distinguished, on spectra whose noise, edge and filter are known."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from myomorph.core.fit.noise_fit import SPLINE
from myomorph.core.fit.signal_and_noise import signal_and_noise
from myomorph.core.fit.spectra import spectra_of

RATE = 100.0
SD = 0.002


def stride(time):
    """Six coordinates of harmonics that fall off as those of a walk."""
    random = np.random.default_rng(3)
    columns = []
    for _ in range(6):
        phases = random.uniform(0.0, 2.0 * np.pi, 6)
        sizes = 0.4 / np.arange(1, 7) ** 3
        angles = 2.0 * np.pi * np.outer(time, np.arange(1, 7)) + phases
        columns.append((sizes * np.sin(angles)).sum(axis=1))
    return np.column_stack(columns)


def coloured(random, frames, keep):
    white = random.standard_normal((frames, 6))
    white[1:] *= np.sqrt(1.0 - keep**2)
    return scipy.signal.lfilter([1.0], [1.0, -keep], white, axis=0)


def recorded(frames=300, keep=0.0, seed=0):
    time = np.arange(frames) / RATE
    return time, stride(time) + SD * coloured(np.random.default_rng(seed), frames, keep)


def test_power_adds_up_to_the_variance_of_noise():
    noise = np.random.default_rng(0).normal(scale=SD, size=(400, 40))
    spectra = spectra_of(noise, RATE)
    # Slow second differences hold so little of noise that fast ones leak into them.
    band = spectra.frequency > 8.0
    power = spectra.width[band] @ spectra.power[band] * RATE / 2.0 / spectra.width[band].sum()
    assert np.sqrt(power.mean()) == pytest.approx(SD, rel=0.05)


def test_travel_has_no_power():
    time, values = recorded()
    moved = values + 1.3 * time[:, None]
    np.testing.assert_allclose(
        spectra_of(moved, RATE).power, spectra_of(values, RATE).power, rtol=1e-6
    )


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_white_noise_is_found_to_a_fifth(seed):
    found = signal_and_noise(spectra_of(recorded(seed=seed)[1], RATE))
    assert found.shape.edge is None
    assert not found.doubtful
    assert found.known.all()
    np.testing.assert_allclose(found.sd, SD, rtol=0.25)
    assert np.median(found.sd) == pytest.approx(SD, rel=0.1)


@pytest.mark.parametrize("times", [2, 5])
def test_a_spline_is_seen_and_noise_below_its_edge_is_found(times):
    time, values = recorded(seed=14)
    fine = np.linspace(0.0, time[-1], times * (len(time) - 1) + 1)
    splined = scipy.interpolate.CubicSpline(time, values)(fine)
    found = signal_and_noise(spectra_of(splined, times * RATE))
    assert found.shape.edge == pytest.approx(0.5 * RATE, rel=0.15)
    assert found.shape.order == SPLINE
    assert not found.doubtful
    assert np.median(found.sd) == pytest.approx(SD, rel=0.3)


@pytest.mark.parametrize("cutoff", [20.0, 30.0])
def test_the_filter_of_a_camera_is_seen(cutoff):
    values = recorded(frames=500, seed=15)[1]
    sections = scipy.signal.butter(2, cutoff, fs=RATE, output="sos")
    smooth = scipy.signal.sosfiltfilt(sections, values, axis=0)
    found = signal_and_noise(spectra_of(smooth, RATE))
    assert found.shape.edge == pytest.approx(cutoff, rel=0.3)


def test_coloured_noise_is_coloured():
    found = signal_and_noise(spectra_of(recorded(frames=500, keep=0.9, seed=16)[1], RATE))
    assert found.shape.factor >= 0.4
    assert not found.doubtful
    # Most of it hides below the motion.
    above = found.frequency > 10.0
    truth = (
        SD**2
        * (1.0 - 0.9**2)
        / 0.5
        / RATE
        / (1.0 - 2.0 * 0.9 * np.cos(2.0 * np.pi * found.frequency / RATE) + 0.9**2)
    )
    share = (found.noise[above] / truth[above, None]).mean(axis=1)
    assert np.median(share) == pytest.approx(1.0, rel=0.25)


def test_motion_that_somebody_filtered_says_nothing_about_noise():
    values = recorded(frames=400, seed=17)[1]
    sections = scipy.signal.butter(4, 6.0, fs=RATE, output="sos")
    smooth = scipy.signal.sosfiltfilt(sections, values, axis=0)
    assert signal_and_noise(spectra_of(smooth, RATE)).doubtful


def test_units_do_not_matter_and_what_stands_still_is_left_out():
    values = recorded(seed=18)[1]
    both = signal_and_noise(spectra_of(np.column_stack([values, np.full(len(values), 0.3)]), RATE))
    scaled = signal_and_noise(spectra_of(1000.0 * values, RATE))
    assert both.moves.tolist() == [True] * 6 + [False]
    np.testing.assert_allclose(scaled.sd, 1000.0 * both.sd[:6], rtol=1e-9)
    assert both.sd[6] == 0.0


def test_nothing_that_moves_has_no_noise():
    assert signal_and_noise(spectra_of(np.ones((100, 2)), RATE)) is None
