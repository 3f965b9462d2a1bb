"""All tables of strides take them from the same source.

Plates and events come first, the motion else (a made walker).
"""

from __future__ import annotations

import numpy as np
import pytest

from made_walker import PERIOD, recording, walker
from myomorph.core.model.series import Event, Series, Trial, Wrenches
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.sync import cut
from myomorph.lab.analysis.foot_events import Limb
from myomorph.lab.analysis.strides import find_strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.store.results import new_result, read_result
from myomorph.lab.store.stored import put_events, put_motion
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.markers import Recording
from myomorph.lab.study.trial.steps.id import Torques
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.steps.tension import strides_of_trial
from myomorph.lab.study.trial.trial_inputs import TrialInputs
from myomorph.lab.study.trial.trial_strides import StridePlan, trial_strides

SHIFT = 0.03
"""By which the recording's events are later than those of the motion [s]."""


@pytest.fixture(scope="module")
def walk():
    """Return the model, its motion, and events of the right foot that differ from the motion's."""
    model = walker()
    motion = inverse_kinematics(model, recording(model, np.random.default_rng(0), 0.1)).motion
    alone = walking_strides(model, motion)
    assert alone is not None
    events = tuple(
        Event(time + SHIFT, label, "Right")
        for label, times in (
            ("Foot Strike", alone.strikes["foot_r"]),
            ("Foot Off", alone.lifts["foot_r"]),
        )
        for time in times
    )
    return model, motion, alone, events


def test_the_step_of_tensions_uses_the_events_of_the_recording(walk):
    model, motion, alone, events = walk
    trial = TrialInputs("walk", "one", model, inputs=ByType(Recording(Trial(events=events))))
    torques = Torques(motion, Series(motion.time, motion.names, np.zeros_like(motion.values)), None)
    found = strides_of_trial(trial, Poses(motion), torques)
    assert found is not None
    np.testing.assert_allclose(found.strikes["foot_r"], alone.strikes["foot_r"] + SHIFT)
    np.testing.assert_allclose(found.strikes["foot_l"], alone.strikes["foot_l"])


def test_groups_use_the_events_that_a_result_holds(walk, tmp_path):
    model, motion, alone, events = walk
    with new_result(tmp_path / "walk.nc") as writer:
        put_motion(writer, motion, model)
        put_events(writer, events)
    found = trial_strides(read_result(tmp_path / "walk.nc"), model, StridePlan(belt=0.0))
    starts = [one.start for one in found.of("foot_r")]
    assert len(starts) > 2
    np.testing.assert_allclose(starts, alone.strikes["foot_r"][: len(starts)] + SHIFT)
    assert np.mean([one.duration for one in found.of("foot_l")]) == pytest.approx(PERIOD, abs=0.01)


def test_events_of_a_side_are_not_those_of_two_feet_on_it():
    time = np.arange(0.0, 4.0, 0.01)
    swings = [np.sin(2.0 * np.pi * (time - shift)) / 7.0 for shift in (0.0, 0.4, 0.0)]
    points = Series(
        time,
        ("fore", "hind", "trunk"),
        np.stack(
            [np.stack([time + one, 0 * time, 0 * time], axis=1) for one in (*swings[:2], 0 * time)],
            axis=1,
        ),
    )
    limbs = [Limb("fore_r", ("fore",)), Limb("hind_r", ("hind",))]
    events = [Event(at, "Foot Strike", "Right") for at in (0.3, 1.3, 2.3)]
    up = np.array([0.0, 1.0, 0.0])
    plain = find_strides(points, limbs, ["trunk"], up, events=())
    found = find_strides(points, limbs, ["trunk"], up, events=events)
    for limb in limbs:
        np.testing.assert_array_equal(found.strikes[limb.name], plain.strikes[limb.name])
    assert any("events" in note for note in found.notes)
    single = find_strides(points, limbs[:1], ["trunk"], up, events=events)
    assert set(np.round([0.3, 1.3, 2.3], 6)) <= set(np.round(single.strikes["fore_r"], 6))


def test_plates_tell_the_only_stride_of_a_recording(walk):
    """A foot that is not seen to rotate at its strikes has those that its plate shows.

    It has none outside of the motion.
    """
    model, motion, alone, _ = walk
    start, stop = alone.strikes["foot_r"][1:3]
    lift = next(one for one in alone.lifts["foot_r"] if one > start)
    time = np.arange(motion.time[0], motion.time[-1], 1e-3)
    stands = np.zeros(len(time), bool)
    for one in alone.strikes["foot_r"]:
        stands |= (time >= one) & (time < one + lift - start)
    forces = np.zeros((len(time), 1, 3))
    forces[stands, 0] = model.weight * np.asarray(model.up)
    plate = Wrenches(
        time=time,
        names=("plate",),
        bodies=("foot_r",),
        forces=forces,
        points=np.zeros_like(forces),
        torques=np.zeros_like(forces),
    )
    short = cut(motion, start - 0.05, stop + 0.05)
    without = walking_strides(model, short)
    assert without is None or "foot_r" not in {one.limb for one in without.strides}
    (found,) = [
        one for one in walking_strides(model, short, wrenches=plate).strides if one.limb == "foot_r"
    ]
    assert (found.start, found.lift, found.stop) == pytest.approx((start, lift, stop), abs=0.01)
    assert found.source == "plates"
