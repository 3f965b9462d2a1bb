"""The smoother as a filter: what it passes, how it bridges gaps, what its variances promise."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.motion.kalman import smoothed_states

RATE = 100.0
CUTOFF = 6.0
STEP = 2.0 * np.pi * CUTOFF / RATE
FREE = np.zeros(1)


@pytest.mark.parametrize("frequency", [1.0, 3.0, 6.0, 9.0, 12.0])
def test_inside_it_is_the_butterworth_filter_of_third_order_both_ways(frequency):
    time = np.arange(600) / RATE
    passed = smoothed_states(np.sin(2.0 * np.pi * frequency * time)[:, None], STEP, FREE)
    inside = slice(200, 400)
    expected = np.sin(2.0 * np.pi * frequency * time[inside]) / (1.0 + (frequency / CUTOFF) ** 6)
    np.testing.assert_allclose(passed.mean[inside, 0, 0], expected, atol=0.02)


def test_derivatives_are_those_of_the_values():
    time = np.arange(300) / RATE
    states = smoothed_states(np.sin(2.0 * np.pi * time)[:, None], STEP, FREE)
    inside = slice(60, -60)
    pulse = 2.0 * np.pi * CUTOFF
    velocity = states.mean[inside, 0, 1] * pulse
    acceleration = states.mean[inside, 0, 2] * pulse**2
    np.testing.assert_allclose(
        velocity, 2.0 * np.pi * np.cos(2.0 * np.pi * time[inside]), atol=1e-3
    )
    np.testing.assert_allclose(
        acceleration, -((2.0 * np.pi) ** 2) * np.sin(2.0 * np.pi * time[inside]), atol=0.01
    )


def test_a_parabola_passes_whole_ends_and_gaps_included():
    time = np.arange(80) / RATE
    values = (0.2 + 0.5 * time + 3.0 * time**2)[:, None]
    holed = values.copy()
    holed[[0, 30, 31, 32, 60]] = np.nan
    states = smoothed_states(holed, STEP, FREE)
    np.testing.assert_allclose(states.mean[1:, :, 0], values[1:], atol=1e-5)


def test_backwards_in_time_it_is_the_same():
    values = np.random.default_rng(0).standard_normal((90, 2)).cumsum(axis=0)
    values[40:43, 0] = np.nan
    decay = np.array([0.0, 0.3])
    there = smoothed_states(values, STEP, decay)
    back = smoothed_states(values[::-1], STEP, decay)
    np.testing.assert_allclose(there.mean[:, 0, 0], back.mean[::-1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(there.variance[20:70], back.variance[::-1][20:70], rtol=0.05)


def test_variances_are_those_of_noise_and_grow_in_gaps_and_at_ends():
    random = np.random.default_rng(1)
    noise = random.standard_normal((200, 400))
    noise[90:94] = np.nan
    states = smoothed_states(noise, STEP, np.zeros(400))
    # Of noise alone the filter leaves less than of motion with white jerk, which it is made for.
    left = states.mean.var(axis=1)
    promised = states.variance[:, 0]
    assert np.all(left < 1.1 * promised)
    assert promised[91, 0] > 1.5 * promised[60, 0]
    assert np.all(promised[0] > 1.5 * promised[60])


def test_it_promises_what_it_keeps_for_the_motion_it_is_made_for():
    random = np.random.default_rng(2)
    frames = 120
    columns = 300
    fine = 20
    step = STEP / fine
    state = np.zeros((3, columns))
    truth = np.empty((frames, columns, 3))
    for frame in range(frames):
        truth[frame] = state.T
        for _ in range(fine):
            jerk = random.standard_normal(columns) * np.sqrt(STEP * step)
            state = state + np.array(
                [state[1] * step, state[2] * step, jerk - 0.2 * state[2] * step]
            )
    measured = truth[:, :, 0] + random.standard_normal((frames, columns))
    measured[50:54] = np.nan
    states = smoothed_states(measured, STEP, np.full(columns, 0.2))
    errors = (states.mean - truth) / np.sqrt(states.variance)
    squares = np.square(errors).mean(axis=1)
    np.testing.assert_allclose(squares, 1.0, atol=0.35)
    assert squares.mean() == pytest.approx(1.0, abs=0.05)
