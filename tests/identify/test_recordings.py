"""Which frames can be used: real recordings, and the same with one thing wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.body.identify.recordings import (
    EDGE,
    NO_FORCE,
    NO_MOTION,
    OUTSIDE,
    REACH,
    UNMEASURED,
    RecordingOptions,
    check_excited,
    usable,
)
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.motion.sync import cut

OPENCAP = "opencap-subject4-multitask"
OPTIONS = RecordingOptions(cutoff=6.0)


@pytest.fixture(scope="module")
def opencap(data):
    model = read_model(data(f"{OPENCAP}/models/manually_scaled.osim"))

    def trial(name):
        motion = motion_from_table(
            read_sto(data(f"{OPENCAP}/ik_manual_scaling/{name}_ik.mot")), model
        )
        return motion, read_external_loads(data(f"{OPENCAP}/grf/{name}_external_forces.xml"))

    return model, trial


def used(found):
    return found.recording.motion.time[found.use]


def test_frames_on_the_chair_and_on_the_box_are_left_out(opencap):
    """Sit-to-stand on a chair without a plate, and a jump from a box without one.

    The source is the README of the data.
    """
    model, trial = opencap
    rising = usable(model, *trial("STS1"), name="STS1", options=OPTIONS)
    assert rising.left_out[UNMEASURED] > 600
    assert ((used(rising) > 4.0) & (used(rising) < 5.0)).sum() == 99
    assert not ((used(rising) > 2.7) & (used(rising) < 3.3)).any()
    jump = usable(model, *trial("DJ1"), name="DJ1", options=OPTIONS)
    assert used(jump)[0] > 1.05
    for found in (rising, jump):
        assert sum(found.left_out.values()) + found.use.sum() == found.frames
    assert rising.weighs == pytest.approx(60.0, abs=1.0)


def test_a_walk_on_plates_keeps_all_but_its_ends(opencap):
    model, trial = opencap
    found = usable(model, *trial("walking1"), name="walking1", options=OPTIONS)
    assert set(found.left_out) == {EDGE, UNMEASURED}
    assert found.use.sum() > 90


def test_missing_forces_are_left_out_with_what_the_filter_smears(opencap):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    forces = np.array(wrenches.forces)
    hole = (wrenches.time > 0.6) & (wrenches.time < 0.65)
    forces[hole, 0] = np.nan
    found = usable(model, motion, replace(wrenches, forces=forces), options=OPTIONS)
    near = np.abs(found.recording.motion.time - 0.625) < 0.01 + REACH / 6.0
    assert not found.use[near].any()
    assert found.left_out[NO_FORCE] == pytest.approx(near.sum(), abs=4)
    whole = usable(model, motion, wrenches, options=OPTIONS)
    assert whole.use.sum() > found.use.sum()
    with pytest.raises(BadData, match="no finite value"):
        usable(model, motion, replace(wrenches, forces=np.full_like(forces, np.nan)))


def test_motion_beyond_the_forces_is_counted(opencap):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    early = wrenches.time <= 1.0
    short = replace(
        wrenches,
        time=wrenches.time[early],
        forces=wrenches.forces[early],
        points=wrenches.points[early],
        torques=wrenches.torques[early],
    )
    found = usable(model, motion, short, options=OPTIONS)
    assert found.left_out[OUTSIDE] == (motion.time > 1.0 + 1e-9).sum()
    with pytest.raises(BadData, match="no time in common"):
        usable(model, motion, replace(wrenches, time=wrenches.time + 100.0))


def test_one_leg_off_the_plates_is_left_out(opencap):
    """A force that stops while the foot still stands, as on a step beside the plate."""
    model, trial = opencap
    motion, wrenches = trial("walking1")
    forces = np.array(wrenches.forces)
    forces[wrenches.time > 0.7] = 0.0
    found = usable(model, motion, replace(wrenches, forces=forces), options=OPTIONS)
    assert used(found)[-1] < 0.7
    assert found.left_out[UNMEASURED] > 40


@pytest.mark.parametrize("lacking", [1.0, 0.8])
def test_plates_tared_with_the_load_on_them_are_named(opencap, lacking):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    motion = cut(motion, 0.15, 1.3)
    forces = np.array(wrenches.forces)
    forces[:, 0, 1] -= lacking * model.mass * 9.81
    with pytest.raises(BadData, match="tared"):
        usable(model, motion, replace(wrenches, forces=forces), options=OPTIONS)


def test_standing_still_excites_nothing(opencap):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    frames = len(motion)
    still = replace(motion, values=np.repeat(motion.values[:1], frames, axis=0))
    weight = np.zeros((frames, 1, 3))
    weight[:, 0, 1] = 9.81 * model.mass
    point = np.zeros((frames, 1, 3))
    point[:, 0, 0] = still["pelvis_tx"][0]
    point[:, 0, 2] = still["pelvis_tz"][0]
    standing = replace(
        wrenches,
        time=motion.time,
        names=("plate",),
        bodies=("calcn_r",),
        forces=weight,
        points=point,
        torques=0 * point,
    )
    found = usable(model, still, standing)
    assert found.use.all()
    with pytest.raises(BadData, match="is not exciting"):
        check_excited(model, (found,))
    walking = usable(model, motion, wrenches, options=OPTIONS)
    check_excited(model, (walking,))
    with pytest.raises(BadData, match=r"fewer than 5.*edge of the filter"):
        check_excited(model, (walking,), RecordingOptions(min_duration=5.0))


def test_free_fall_is_used_and_counted(opencap):
    """Nothing touches, and the true wrench is zero: that tells as much as any other frame."""
    model, trial = opencap
    motion, wrenches = trial("walking1")
    values = np.repeat(motion.values[:1], len(motion), axis=0)
    values[:, motion.names.index("pelvis_ty")] -= (
        0.5 * 9.80665 * (motion.time - motion.time[0]) ** 2
    )
    none = np.zeros((len(motion), 1, 3))
    empty = replace(
        wrenches,
        time=motion.time,
        names=("plate",),
        bodies=("calcn_r",),
        forces=none,
        points=none,
        torques=none,
    )
    exact = RecordingOptions(cutoff=0.0)
    found = usable(model, replace(motion, values=values), empty, options=exact)
    assert found.flight == found.use.sum() > 0.9 * len(motion)


def test_a_mass_that_the_forces_do_not_say_is_told(opencap):
    model, trial = opencap
    found = usable(model, *trial("walking1"), mass=70.0, name="walk", options=OPTIONS)
    assert "63." in found.notes[0]
    assert "70.0" in found.notes[0]


def test_a_mass_so_wrong_that_no_frame_is_left_is_told(opencap):
    model, trial = opencap
    found = usable(model, *trial("walking1"), mass=80.0, name="walk", options=OPTIONS)
    assert not found.use.any()
    with pytest.raises(
        BadData, match=r"forces correspond to 6\d\.\d kg, but the specified mass is 80"
    ):
        check_excited(model, (found,))


def test_forces_of_another_place_are_refused(opencap):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    away = replace(wrenches, points=np.array(wrenches.points) + np.array([0.5, 0.0, 0.0]))
    with pytest.raises(BadData, match="belong to this recording"):
        usable(model, motion, away, name="walk", options=OPTIONS)


def test_forces_are_not_blamed_for_noise_of_the_motion(opencap):
    """With 0.3 degrees of noise nothing is refused, and whoever names no cutoff gets a filter."""
    model, trial = opencap
    motion, wrenches = trial("walking1")
    noise = np.radians(0.3) * np.random.default_rng(3).normal(size=motion.values.shape)
    turning = [model.coordinate(name).motion == "rotational" for name in motion.names]
    noisy = replace(motion, values=motion.values + noise * turning)
    found = usable(model, noisy, wrenches)
    assert 2.0 < found.cutoff < 12.0
    assert found.use.sum() > 60
    unfiltered = usable(model, noisy, wrenches, options=RecordingOptions(cutoff=0.0))
    assert unfiltered.cutoff is None
    assert unfiltered.use.sum() > 60


def test_forces_of_another_place_are_refused_behind_noise_too(opencap):
    model, trial = opencap
    motion, wrenches = trial("walking1")
    noise = np.radians(0.3) * np.random.default_rng(3).normal(size=motion.values.shape)
    turning = [model.coordinate(name).motion == "rotational" for name in motion.names]
    noisy = replace(motion, values=motion.values + noise * turning)
    elsewhere = replace(wrenches, points=wrenches.points + np.array([0.0, 0.0, 1.5]))
    with pytest.raises(BadData, match="do they belong to this recording"):
        usable(model, noisy, elsewhere, options=RecordingOptions(cutoff=0.0))


def test_a_short_gap_is_bridged_where_nobody_states_a_cutoff(arm):
    """A frame without a pose cuts no motion in two: its neighbors are used as others are."""
    model = read_model(arm.model)
    time = np.arange(0.0, 3.0, 0.01)
    noise = 0.002 * np.random.default_rng(0).standard_normal((len(time), 2))
    exact = np.column_stack([np.sin(3.0 * time), 1.0 + 0.8 * np.sin(5.0 * time)])
    motion = mm.Motion(time, model.coordinate_names, exact + noise)
    moved = mm.differentiate(mm.Motion(time, model.coordinate_names, exact))
    at = mm.joint_reactions(model, moved, None, joints=["shoulder"], frame="ground")
    wrenches = mm.Wrenches(time, ("shoulder",), ("upper",), at.forces, at.points, at.moments)
    values = motion.values.copy()
    values[150] = np.nan
    whole = usable(model, motion, wrenches)
    bridged = usable(model, replace(motion, values=values), wrenches)
    assert NO_MOTION not in bridged.left_out
    np.testing.assert_array_equal(bridged.use, whole.use)
    assert bridged.use[140:160].all()
    assert bridged.recording.seen_noise.names == motion.names
    stated = RecordingOptions(cutoff=6.0)
    assert usable(model, replace(motion, values=values), wrenches, options=stated).left_out[EDGE]
