"""Clocks of two recordings: known offsets and drifts are recovered.

Also round trips, and what cannot be determined is named.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Analog, Series, Wrenches
from myomorph.core.motion.clocks import Clock, ClockOptions, fit_clock, resample


def estimate_clock(time, signal, other_time, other_signal, options=None):
    """Estimate the clock of one recording against another that holds the same signal.

    The signals agree up to a factor and a constant.
    """
    rows = np.stack([signal, np.ones(len(time))], axis=1)[:, None]
    return fit_clock(time, rows, other_time, np.reshape(other_signal, (-1, 1)), options)


def wandering(seed: int = 0, cutoff: float = 3.0, seconds: float = 40.0):
    """Return a smooth random function of time that never repeats itself."""
    random = np.random.default_rng(seed)
    frequencies = random.uniform(0.1, cutoff, 60)
    phases = random.uniform(0, 2 * np.pi, 60)
    sizes = random.normal(size=60)
    return lambda time: np.sin(2 * np.pi * np.multiply.outer(time, frequencies) + phases) @ sizes


def recorded(offset: float, drift: float, noise: float = 0.0, seconds: float = 30.0):
    """Two recordings of one signal, the second at 2000 Hz, another unit and another clock."""
    signal = wandering()
    random = np.random.default_rng(7)
    time = np.arange(0, seconds, 0.005)
    other = np.arange(0, seconds, 0.0005)
    there = signal(other + offset + drift * other)
    mine = signal(time)
    return (
        time,
        mine + noise * mine.std() * random.normal(size=len(time)),
        other,
        -3.2 * there + 40.0,
    )


@pytest.mark.parametrize(
    ("offset", "drift"), [(0.0, 0.0), (0.0371, 60e-6), (-0.84, -250e-6), (1.3, 1e-3)]
)
def test_offset_and_drift_come_back(offset, drift):
    clock = estimate_clock(*recorded(offset, drift), ClockOptions(cutoff=10.0))
    assert clock.offset == pytest.approx(offset + drift * clock.epoch, abs=2e-6)
    assert clock.drift == pytest.approx(drift, abs=2e-7)
    assert clock.explained > 0.9999


def test_with_noise_the_target_is_met_and_its_deviation_is_told():
    """Markers with noise of 2 % of the signal: 0.1 ms and a few ppm over 30 s."""
    clock = estimate_clock(*recorded(0.0371, 60e-6, noise=0.02))
    assert abs(clock.offset - 0.0371 - 60e-6 * clock.epoch) < 1e-4
    assert abs(clock.drift - 60e-6) < 5e-6
    assert abs(clock.offset - 0.0371 - 60e-6 * clock.epoch) < 4 * clock.offset_sd
    assert "the clocks drift: " in clock.notes[-1]
    assert f"{1e6 * clock.drift:.1f} ± {1e6 * clock.drift_sd:.1f} ppm" in clock.notes[-1]


def test_a_clock_without_drift_says_none_and_can_be_told_not_to_look():
    given = recorded(0.02, 0.0, noise=0.02)
    assert not estimate_clock(*given).notes
    fixed = estimate_clock(*given, ClockOptions(drift=False))
    assert fixed.drift == 0.0
    assert fixed.drift_sd == 0.0
    assert fixed.offset == pytest.approx(0.02, abs=1e-4)


def test_deviations_are_those_that_runs_show():
    errors = []
    deviations = []
    time = np.arange(0, 30, 0.005)
    other = np.arange(0, 30, 0.0005)
    signal = wandering()
    random = np.random.default_rng(1)
    there = signal(other)
    mine = signal(time)
    for _ in range(16):
        clock = estimate_clock(
            time,
            mine + 0.5 * random.normal(size=len(time)),
            other,
            there + random.normal(size=len(other)),
        )
        errors.append((clock.offset, clock.drift))
        deviations.append((clock.offset_sd, clock.drift_sd))
    found = np.sqrt(np.mean(np.square(errors), axis=0)) / np.sqrt(
        np.mean(np.square(deviations), axis=0)
    )
    assert np.all((found > 0.65) & (found < 1.5))


def test_gaps_and_left_out_frames_do_no_harm():
    time, mine, other, there = recorded(0.0371, 60e-6)
    rows = np.stack([mine, np.ones(len(time))], axis=-1)[:, None]
    rows[800:860] = np.nan
    used = np.ones(len(time), dtype=bool)
    used[3000:3300] = False
    rows[3100:3200] *= 1.5
    clock = fit_clock(time, rows, other, there[:, None], ClockOptions(cutoff=10.0), used)
    assert clock.offset == pytest.approx(0.0371 + 60e-6 * clock.epoch, abs=5e-6)


def test_a_swing_that_repeats_itself_is_called_doubtful():
    time = np.arange(0, 20, 0.005)
    other = np.arange(0, 20, 0.0005)
    clock = estimate_clock(time, np.sin(2 * np.pi * time), other, np.sin(2 * np.pi * (other + 0.1)))
    assert "repeats itself" in clock.notes[0]
    near = estimate_clock(
        time,
        np.sin(2 * np.pi * time),
        other,
        np.sin(2 * np.pi * (other + 0.1)),
        ClockOptions(search=0.3),
    )
    assert near.offset == pytest.approx(0.1, abs=1e-5)


def test_recordings_of_different_things_are_refused():
    time = np.arange(0, 20, 0.005)
    other = np.arange(0, 20, 0.0005)
    random = np.random.default_rng(0)
    with pytest.raises(BadData, match="do not explain each other"):
        estimate_clock(
            time,
            random.normal(size=len(time)),
            other,
            random.normal(size=len(other)),
            ClockOptions(cutoff=20.0),
        )


def test_bad_input_is_named():
    time, mine, other, there = recorded(0.0, 0.0, seconds=5.0)
    with pytest.raises(BadData, match="missing frames"):
        estimate_clock(
            np.delete(time, slice(100, 120)), np.delete(mine, slice(100, 120)), other, there
        )
    with pytest.raises(BadData, match="not finite"):
        estimate_clock(time, mine, other, np.where(other == other[50], np.nan, there))
    with pytest.raises(BadData, match="no time in common"):
        estimate_clock(time, mine, other + 60.0, there)
    with pytest.raises(BadData, match="cutoff is -1"):
        ClockOptions(cutoff=-1.0)


def test_times_drift_about_the_epoch():
    clock = Clock(0.02, 1e-4, epoch=15.0)
    time = np.linspace(0, 30, 7)
    np.testing.assert_allclose(clock.times(time), time + 0.02 + 1e-4 * (time - 15.0), atol=1e-12)
    zeros = np.zeros((7, 1, 3))
    wrenches = Wrenches(
        time=time, names=("plate",), bodies=("",), forces=zeros, points=zeros, torques=zeros
    )
    np.testing.assert_allclose(clock.apply(wrenches).time, clock.times(time))
    np.testing.assert_allclose(
        clock.apply(Series(time, ("a",), time[:, None])).time, clock.times(time)
    )


def test_resampling_keeps_what_is_slow_and_drops_what_the_new_rate_cannot_hold():
    time = np.arange(0, 4, 0.0005)
    new = np.arange(0, 4, 0.005)
    slow = np.sin(2 * np.pi * 3 * time)
    analog = Analog(
        time=time,
        names=("slow", "both"),
        values=np.stack([slow, slow + np.sin(2 * np.pi * 190 * time)], axis=1),
        units=("V", "V"),
    )
    found = resample(analog, new)
    inner = slice(40, -40)
    np.testing.assert_allclose(
        found.values[inner, 0], np.sin(2 * np.pi * 3 * new)[inner], atol=1e-3
    )
    # 190 Hz would come back as 10 Hz.
    np.testing.assert_allclose(found.values[inner, 1], found.values[inner, 0], atol=0.05)
    assert np.isnan(resample(analog, np.arange(0, 5, 0.005)).values[-1]).all()
