"""Errors of attachments in the interval of the muscles' viscosity, and their laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_specimen import Release, arm_specimen, swing

from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import swing_recordings
from myomorph.swings.viscosity.trust.attachments import (
    MovedArms,
    attachment_limits,
    moved_arms,
    with_attachments,
)
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions

MUSCLE = 90.0
ARM = 0.02
OFFSET = 0.006
"""Viscosity of every muscle [N s/m], and components of an arm and of its error [m]."""
FRAMES = 60
STRANDS = 6
SAMPLES = 24


def simulated(seed: int) -> MovedArms:
    """Torques of muscles whose arms are known with errors that do not change with the pose."""
    random = np.random.default_rng(seed)
    phases = np.linspace(0.0, 12.0, FRAMES)
    rates = np.sin(phases[:, None] + [0.0, 1.0, 2.0])
    true = ARM * random.standard_normal((1, STRANDS, 3)) * np.ones((FRAMES, 1, 1))
    speeds = np.einsum("fsa,fa->fs", true, rates)
    shape = (1, STRANDS, 3)
    given = true + OFFSET * random.standard_normal(shape)
    once = given + OFFSET * random.standard_normal((SAMPLES, *shape))
    again = [once + OFFSET * random.standard_normal((SAMPLES, *shape)) for _ in range(2)]
    return MovedArms(
        torque=-MUSCLE * np.einsum("fsa,fs->fa", true, speeds),
        rates=rates,
        arms=given,
        samples=np.array([once, *again]),
        spring=np.zeros((3, FRAMES, 0)),
    )


def test_limits_hold_the_truth_although_errors_make_the_value_too_small():
    """An error of an arm counts in its square, so the value is too small by more than by chance."""
    values = []
    held = []
    plain = []
    for seed in range(80):
        moved = simulated(seed)
        value = float(moved.common(moved.arms[None])[0])
        limits = attachment_limits(moved, 300, seed, 0.9)
        assert limits is not None
        values.append(value / MUSCLE)
        held.append(Interval(value, value * limits.low, value * limits.high).holds(MUSCLE))
        # Draws about the value, as if the data held no errors yet.
        plain.append(value / limits.high <= MUSCLE <= value / limits.low)
    assert np.mean(values) < 0.97
    assert 0.82 <= np.mean(held) <= 0.97
    assert np.mean(plain) < np.mean(held) - 0.05


def test_swings_that_no_muscle_resists_have_no_limits():
    moved = simulated(0)
    assert attachment_limits(replace(moved, torque=-moved.torque), 20, 0, 0.9) is None


@pytest.fixture(scope="module")
def tracked():
    specimen = arm_specimen()
    trials = [
        swing(specimen, Release(name=f"swing {i}", turned=(0.6, 0.2 * i, -0.5))).trial
        for i in range(2)
    ]
    return track(specimen, trials)


@pytest.fixture(scope="module")
def identified(tracked):
    options = ViscosityOptions(draws=20, stiffness=False)
    bare = swing_recordings(tracked, 10.0, muscles=False)
    return identify_specimen("arm", bare, swing_recordings(tracked, 10.0), options=options)


def test_samples_are_arms_of_points_that_are_moved(tracked, identified):
    exact = moved_arms(tracked, identified.intact, 0.05, MomentArmOptions(offset=1e-9))
    assert exact.samples[0, 0] == pytest.approx(exact.arms, abs=1e-7)
    moved = moved_arms(tracked, identified.intact, 0.05, MomentArmOptions(offset=2e-3))
    spreads = np.array([np.std(each - moved.arms) for each in moved.samples])
    # Points of each strand are off on every bone, so that an arm errs by about as much as they do.
    assert 1e-3 < spreads[0] < 4e-3
    assert spreads[1:] == pytest.approx(np.sqrt(2.0) * spreads[0], rel=0.2)


def test_attachments_that_were_digitized_add_nothing(tracked, identified):
    exact = MomentArmOptions(offset=0.0)
    same, shares = with_attachments(identified, (), tracked, exact, 0.9)
    assert same is identified
    assert shares == ()
    same, shares = with_attachments(identified, (), None, MomentArmOptions(), 0.9)
    assert same is identified
