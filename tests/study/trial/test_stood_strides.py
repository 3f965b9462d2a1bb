"""Tables and pages leave out the same strides: those whose foot stood beside the plates."""

from __future__ import annotations

import numpy as np
import pytest

from made_walker import recording, walker
from myomorph.core.model.series import Series, Wrenches
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.lab.analysis.stood_strides import stood_strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side


@pytest.fixture(scope="module")
def walk():
    """Model, times of the motion, and strides of a made walker."""
    model = walker()
    motion = inverse_kinematics(model, recording(model, np.random.default_rng(0), 0.1)).motion
    strides = walking_strides(model, motion)
    assert strides is not None
    return model, motion.time, strides


def plate_under(stride, time, weight, body):
    """Make a plate that one stance of a foot was on."""
    forces = np.zeros((len(time), 1, 3))
    forces[(time >= stride.start) & (time <= stride.lift), 0, 1] = weight
    nothing = np.zeros_like(forces)
    return Wrenches(
        time=time, names=("plate",), bodies=(body,), forces=forces, points=nothing, torques=nothing
    )


def test_moments_count_where_the_foot_was_on_a_plate(walk):
    model, time, strides = walk
    own = strides.of("foot_r")
    assert len(own) > 2
    wrenches = plate_under(own[1], time, model.weight, "foot_r")
    trial = TrialStrides.whole("walk", strides).on_plates(model, wrenches)
    assert trial.stood["foot_r"] == tuple(number == 1 for number in range(len(own)))
    assert not any(trial.stood["foot_l"])
    series = Series(time, ("hip_r", "hip_l", "lumbar"), np.ones((len(time), 3)))
    known = np.isfinite(by_side(series, trial, of_plates=True).values).any(axis=1)
    assert known[:, 0].sum() == 1
    assert known[1, 0]
    assert not known[:, 1].any()
    # What belongs to no side does not follow from one foot.
    assert known[:, 2].sum() == len(own)
    angles = np.isfinite(by_side(series, trial).values).any(axis=1)
    assert angles[:, 0].sum() == len(own)


def test_without_plates_nothing_is_left_out(walk):
    model, time, strides = walk
    trial = TrialStrides.whole("walk", strides).on_plates(model, None)
    assert trial.stood == {}
    series = Series(time, ("hip_r",), np.ones((len(time), 1)))
    of_plates = by_side(series, trial, of_plates=True)
    np.testing.assert_array_equal(of_plates.values, by_side(series, trial).values)


def test_half_a_stance_on_a_plate_is_none(walk):
    _, _, strides = walk
    stride = strides.of("foot_r")[0]
    samples = 51
    whole = np.zeros((1, samples))
    whole[0, : int(stride.duty * samples)] = 1.0
    half = whole.copy()
    half[0, : int(0.5 * stride.duty * samples)] = 0.0
    assert stood_strides((stride,), whole).all()
    assert not stood_strides((stride,), half).any()
