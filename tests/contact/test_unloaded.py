"""Plates that were not set to zero or drift are named, and those at zero are not."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.contact.unloaded import without_zeros, zero_messages, zero_of
from myomorph.core.model.series import Wrenches

RATE = 500.0
TIME = np.arange(1500) / RATE
UP = np.array([0.0, 1.0, 0.0])


def step(start, stop, peak=700.0):
    """Load (samples,) of a step [N]."""
    share = np.clip((TIME - start) / (stop - start), 0.0, 1.0)
    return peak * np.sqrt(np.sin(np.pi * share) ** 2)


def wrenches(*lifts):
    """One wrench for each load (samples,)."""
    forces = np.zeros((len(TIME), len(lifts), 3))
    forces[:, :, 1] = np.stack(lifts, axis=1)
    names = tuple(f"plate_{number + 1}" for number in range(len(lifts)))
    return Wrenches(
        time=TIME,
        names=names,
        bodies=("",) * len(lifts),
        forces=forces,
        points=np.zeros_like(forces),
        torques=np.zeros_like(forces),
    )


def test_plates_at_zero_are_not_named():
    noise = np.random.default_rng(1).normal(0.0, 1.5, len(TIME))
    assert zero_messages(wrenches(step(0.5, 1.2) + noise, step(1.0, 1.7)), UP) == ()


@pytest.mark.parametrize("zero", [-40.0, 40.0])
def test_a_zero_is_named_with_its_plate(zero):
    (message,) = zero_messages(wrenches(step(0.5, 1.2), step(1.0, 1.7) + zero), UP)
    assert message.place == "plate_2"
    assert message.cause.key == "plate_zero"
    assert message.size == pytest.approx(40.0, rel=0.02)
    assert "was it set to zero?" in message


def test_a_drift_is_named_with_both_ends():
    drift = np.linspace(0.0, 60.0, len(TIME))
    (message,) = zero_messages(wrenches(step(0.8, 1.5) + drift, step(1.0, 1.7)), UP)
    assert message.place == "plate_1"
    assert "drifts" in message
    assert message.severity == "changes results"


def test_a_plate_that_is_never_empty_says_nothing():
    standing = 350.0 + 60.0 * np.sin(3.0 * TIME)
    assert zero_of(standing, RATE, float(standing.max())) is None
    assert zero_messages(wrenches(standing, standing[::-1]), UP) == ()


def slow_steps(peak=700.0):
    """Load (samples,) of steps whose heels rise and fall slowly, nearly all of the time [N]."""
    pace = np.abs(np.sin(2.0 * np.pi * TIME / 2.0)) - 0.35
    return peak * np.clip(pace, 0.0, None)


@pytest.mark.parametrize("zero", [-25.0, 60.0])
def test_a_zero_is_found_where_feet_come_and_go_slowly(zero):
    (message,) = zero_messages(wrenches(slow_steps() + zero), UP)
    assert message.size == pytest.approx(abs(zero), abs=2.0)
    assert zero_messages(wrenches(slow_steps()), UP) == ()


def test_a_leg_that_rests_on_a_plate_is_no_zero():
    """Somebody who sits loads a plate evenly, but not whenever it is flat."""
    legs = np.where(TIME < 0.8, 45.0, 0.0)
    assert zero_messages(wrenches(step(1.2, 1.9) + legs), UP) == ()
    (message,) = zero_messages(wrenches(step(1.2, 1.9) + legs + 50.0), UP)
    assert message.size == pytest.approx(50.0, abs=1.0)


def test_an_empty_plate_that_counts_as_loaded_changes_results():
    loads = wrenches(step(0.5, 1.2, peak=2000.0) + 45.0)
    (lighter,) = zero_messages(loads, UP, weight=600.0)
    (heavier,) = zero_messages(loads, UP, weight=1200.0)
    assert lighter.severity == "changes results"
    assert heavier.severity == "may change results"
    assert lighter.cause.order < 1


def test_zeros_are_taken_off_and_loads_in_the_hands_are_not():
    drift = np.linspace(10.0, 60.0, len(TIME))
    box = np.full(len(TIME), -120.0)
    faulty = wrenches(step(0.5, 1.2) + drift, step(1.0, 1.7), box)
    clean = wrenches(step(0.5, 1.2), step(1.0, 1.7), box)
    np.testing.assert_allclose(without_zeros(faulty, UP).forces, clean.forces, atol=8.0)
    assert without_zeros(clean, UP) is clean
