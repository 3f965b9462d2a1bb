"""The default filter with a recording's noise: its torques, gaps, ends and standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import myomorph as mm
from myomorph.core.motion.cutoff_choice import choose_cutoff, recording_noise
from myomorph.core.motion.smoother import smoothed_by

RATE = 100.0
NAMES = ("hip", "knee", "ankle", "other_hip", "other_knee", "other_ankle")
STRIDES = 0.95  # A second
SIZES = (0.4, 0.3, 0.08, 0.02, 0.004)  # Of the harmonics of a stride [rad]


def walk(time, order=0):
    """Angles of six joints, each with the harmonics of a walk, or a derivative of them."""
    random = np.random.default_rng(4)
    columns = []
    for _ in NAMES:
        pulses = 2.0 * np.pi * STRIDES * np.arange(1, 6)
        phases = random.uniform(0.0, 2.0 * np.pi, 5) + 0.5 * np.pi * order
        sizes = np.array(SIZES) * pulses**order
        columns.append((sizes * np.sin(np.outer(time, pulses) + phases)).sum(axis=1))
    return np.column_stack(columns)


def recorded(seconds=3.0, noise=0.003, seed=21):
    time = np.arange(0.0, seconds, 1.0 / RATE)
    errors = noise * np.random.default_rng(seed).standard_normal((len(time), len(NAMES)))
    return mm.Motion(time, NAMES, walk(time) + errors)


def error(motion):
    """Root mean square error of the accelerations, ends left out."""
    wrong = (motion.accelerations - walk(motion.time, 2))[10:-10]
    return float(np.sqrt(np.nanmean(wrong**2)))


def best(motion):
    return min(error(mm.differentiate(motion, cutoff)) for cutoff in np.arange(3.0, 20.0, 0.5))


@pytest.mark.parametrize("noise", [0.003, 0.01])
def test_white_noise_is_filtered_nearly_as_well_as_by_the_best_cutoff(noise):
    motion = recorded(noise=noise)
    # The bound for the wobble of skin may keep the cutoff below the best.
    assert error(mm.smooth_motion(motion).motion) < 1.4 * best(motion)


@pytest.mark.parametrize("times", [2, 5])
def test_noise_that_was_splined_is_not_taken_for_motion(times):
    motion = recorded()
    fine = np.linspace(0.0, motion.time[-1], times * (len(motion) - 1) + 1)
    values = scipy.interpolate.CubicSpline(motion.time, motion.values)(fine)
    smoothed = mm.smooth_motion(mm.Motion(fine, NAMES, values))
    assert smoothed.cutoff is not None
    wrong = (smoothed.motion.accelerations - walk(fine, 2))[10 * times : -10 * times]
    assert np.sqrt(np.mean(wrong**2)) < 1.4 * best(motion)


@pytest.mark.parametrize("cutoff", [15.0, 20.0, 30.0])
def test_noise_that_a_camera_smoothed_is_not_taken_for_motion(cutoff):
    motion = recorded()
    sections = scipy.signal.butter(2, cutoff / 0.802, fs=RATE, output="sos")
    values = scipy.signal.sosfiltfilt(sections, motion.values, axis=0)
    smoothed = mm.smooth_motion(mm.Motion(motion.time, NAMES, values)).motion
    assert error(smoothed) < 1.4 * best(motion)


def test_travel_does_not_change_the_cutoff():
    motion = recorded()
    travel = mm.Motion(motion.time, NAMES, motion.values + 1.3 * motion.time[:, None])
    assert choose_cutoff(travel).cutoff == pytest.approx(choose_cutoff(motion).cutoff, rel=1e-6)


@pytest.mark.parametrize("empty", [slice(14, None, 29), slice(150, 151), slice(150, 156)])
def test_short_gaps_change_little(empty):
    motion = recorded()
    values = motion.values.copy()
    values[empty] = np.nan
    smoothed = mm.smooth_motion(mm.Motion(motion.time, NAMES, values))
    assert np.isfinite(smoothed.motion.accelerations).all()
    assert smoothed.bridged.sum() == np.isnan(values[:, 0]).sum()
    assert not smoothed.blank.any()
    assert error(smoothed.motion) < 1.15 * error(mm.smooth_motion(motion).motion)
    gap = smoothed.bridged
    inside = slice(100, 130)
    assert np.all(smoothed.acceleration_sd[gap] >= smoothed.acceleration_sd[inside].min(axis=0))


def test_a_long_gap_stays_empty_and_its_neighbours_are_marked():
    motion = recorded()
    values = motion.values.copy()
    values[140:175] = np.nan
    smoothed = mm.smooth_motion(mm.Motion(motion.time, NAMES, values))
    assert np.flatnonzero(smoothed.blank).tolist() == list(range(140, 175))
    assert np.isnan(smoothed.motion.values[smoothed.blank]).all()
    assert np.isfinite(smoothed.motion.values[~smoothed.blank]).all()
    assert smoothed.uncertain[[0, 139, 175, 299]].all()
    assert not smoothed.uncertain[[60, 220]].any()


def test_a_clip_of_twenty_frames_is_filtered():
    motion = recorded().frames(slice(140, 160))
    smoothed = mm.smooth_motion(motion)
    assert smoothed.cutoff is not None
    wrong = smoothed.motion.accelerations - walk(motion.time, 2)
    unfiltered = mm.differentiate(motion).accelerations - walk(motion.time, 2)
    assert np.sqrt(np.mean(wrong**2)) < 0.2 * np.sqrt(np.mean(unfiltered**2))


def test_standard_deviations_hold_the_errors():
    held = []
    for seed in range(31, 37):
        motion = recorded(seed=seed)
        smoothed = mm.smooth_motion(motion)
        wrong = np.abs(smoothed.motion.accelerations - walk(motion.time, 2))
        held.append(np.mean(wrong < 1.645 * smoothed.acceleration_sd))
    assert 0.8 < np.mean(held) < 0.97


def test_a_movement_is_asked_where_the_noise_is_not_known():
    motion = recorded(noise=0.02)
    sections = scipy.signal.butter(4, 9.0, fs=RATE, output="sos")
    filtered = scipy.signal.sosfiltfilt(sections, motion.values, axis=0)
    smooth = mm.Motion(motion.time, NAMES, filtered)
    alone = choose_cutoff(smooth)
    walking = choose_cutoff(smooth, movement="walking")
    assert alone.origin == "speed"
    assert walking.origin == "movement"
    assert walking.cutoff == pytest.approx(6.0, rel=0.2)
    assert np.isnan(recording_noise(smooth, walking).sd).all()


def test_noise_is_that_of_the_recording():
    motion = recorded()
    values = motion.values.copy()
    values[50:53] = np.nan
    holed = mm.Motion(motion.time, NAMES, values)
    noise = recording_noise(holed, choose_cutoff(holed))
    np.testing.assert_allclose(noise.sd, 0.003, rtol=0.25)
    np.testing.assert_allclose(noise.correlation_time, 1.0 / RATE, rtol=0.1)
    np.testing.assert_allclose(noise.gaps, 3 / 300)


def test_what_was_computed_is_not_filtered():
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    exact = mm.Motion(time, NAMES, walk(time))
    smoothed = mm.smooth_motion(exact)
    assert smoothed.cutoff is None
    np.testing.assert_array_equal(
        smoothed.motion.accelerations, mm.differentiate(exact).accelerations
    )


def test_times_rounded_to_milliseconds_change_little():
    rate = 120.0
    time = np.arange(0.0, 3.0, 1.0 / rate)
    values = walk(time) + 0.003 * np.random.default_rng(5).standard_normal((len(time), 6))
    exact = mm.smooth_motion(mm.Motion(time, NAMES, values))
    rounded = mm.smooth_motion(mm.Motion(time.round(3), NAMES, values))
    np.testing.assert_allclose(
        rounded.motion.accelerations[20:-20], exact.motion.accelerations[20:-20], atol=0.2
    )
    assert np.isfinite(rounded.acceleration_sd).all()


def test_another_cutoff_is_that_of_the_given_filter():
    motion = recorded()
    choice = choose_cutoff(motion)
    ours = smoothed_by(motion, choice, cutoff=8.0).motion.accelerations
    theirs = mm.differentiate(motion, 8.0).accelerations
    inside = slice(60, -60)
    np.testing.assert_allclose(ours[inside], theirs[inside], atol=0.03 * np.abs(theirs).max())


def test_no_frames_are_refused():
    motion = recorded()
    values = np.full_like(motion.values, np.nan)
    values[:4] = motion.values[:4]
    with pytest.raises(mm.BadData, match="6 frames"):
        mm.smooth_motion(mm.Motion(motion.time, NAMES, values))
