"""The cutoff that a motion asks for: by laws, by known accelerations, and by measured forces."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.series import Motion
from myomorph.core.motion.cutoff_choice import (
    MAX_PER_SPEED,
    PER_SPEED,
    SLOWEST,
    USUAL,
    choose_cutoff,
    inertia_rows,
)
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.smoother import smooth_motion
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics

RATE = 120.0
NAMES = ("hip", "knee", "ankle")


def _walk(noise: float, seconds: float = 4.0, fundamental: float = 1.0) -> Motion:
    """Three coordinates of five harmonics that fall off as those of a walk; synthetic."""
    random = np.random.default_rng(5)
    time = np.arange(int(seconds * RATE)) / RATE
    values = np.zeros((len(time), 3))
    for j in range(3):
        for k, size in enumerate((0.4, 0.3, 0.08, 0.02, 0.004), start=1):
            turn = 2.0 * np.pi * fundamental * k
            values[:, j] += size * np.sin(turn * time + random.uniform(0.0, 2.0 * np.pi))
    values += noise * random.standard_normal(values.shape)
    return Motion(time, NAMES, values)


def test_a_motion_that_somebody_filtered_well_is_left_as_it_is() -> None:
    filtered = differentiate(_walk(0.01), 6.0)
    choice = choose_cutoff(Motion(filtered.time, filtered.names, filtered.values))
    assert choice.origin == "smooth"
    assert choice.cutoff is None


def test_a_motion_that_is_twice_as_fast_has_about_twice_the_cutoff() -> None:
    slow = choose_cutoff(_walk(0.01))
    fast = choose_cutoff(_walk(0.01, fundamental=2.0))
    assert slow.origin == fast.origin == "noise"
    assert fast.cutoff == pytest.approx(2.0 * slow.cutoff, rel=0.2)


def test_noisier_markers_need_lower_cutoffs() -> None:
    cutoffs = [choose_cutoff(_walk(noise)).cutoff for noise in (0.002, 0.02, 0.2)]
    assert cutoffs[0] > 1.1 * cutoffs[2]
    assert cutoffs == sorted(cutoffs, reverse=True)


def test_a_pose_that_is_held_is_filtered_about_as_the_slowest_movement() -> None:
    time = np.arange(480) / RATE
    held = np.column_stack([0.3 * np.sin(0.3 * time), 0.2 * np.cos(0.4 * time)])
    held += 0.01 * np.random.default_rng(2).standard_normal(held.shape)
    cutoff = choose_cutoff(Motion(time, ("hip", "knee"), held)).cutoff
    assert 0.5 * SLOWEST < cutoff < 2.0 * SLOWEST


def test_size_and_start_of_coordinates_do_not_matter() -> None:
    motion = _walk(0.01)
    other = Motion(motion.time + 7.0, motion.names, 3.0 * motion.values + 1.0)
    assert choose_cutoff(other).cutoff == pytest.approx(choose_cutoff(motion).cutoff, rel=1e-9)


def test_long_recordings_of_strides_keep_the_cutoff_of_short_ones() -> None:
    short = choose_cutoff(_walk(0.01, seconds=3.0)).cutoff
    long = choose_cutoff(_walk(0.01, seconds=60.0)).cutoff
    assert long == pytest.approx(short, rel=0.15)


def test_short_motions_have_the_usual_cutoff_and_motions_at_rest_none() -> None:
    motion = _walk(0.01)
    for frames in (6, 20):
        choice = choose_cutoff(motion.frames(slice(0, frames)))
        assert choice.cutoff is not None
        assert choice.cutoff <= MAX_PER_SPEED / PER_SPEED * USUAL
    still = Motion(motion.time, motion.names, np.zeros_like(motion.values))
    assert choose_cutoff(still).cutoff is None


def test_inertia_rows_are_those_of_the_mass_matrix(data) -> None:
    model = read_model(data("opensim-gait-subject01/ref_id/subject01.osim"))
    motion = motion_from_table(
        read_sto(data("opensim-gait-subject01/ref_id/subject01_walk1_ik.mot")), model
    )
    rows = inertia_rows(model, motion)
    assert rows is not None
    pose = np.median(motion.values, axis=0)
    random = np.random.default_rng(0)
    accelerations = np.stack(
        [np.zeros(len(motion.names)), random.standard_normal(len(motion.names))]
    )
    still = Motion(
        time=np.arange(2.0),
        names=motion.names,
        values=np.stack([pose, pose]),
        velocities=np.zeros((2, len(motion.names))),
        accelerations=accelerations,
    )
    torques = inverse_dynamics(model, still).values
    needed = torques[1] - torques[0]
    for row in rows @ accelerations[1]:
        assert np.abs(needed - row).min() < 1e-9 * np.abs(needed).max()


def test_what_holds_the_pelvis_of_a_recorded_walk_is_a_fifth_of_that_without_a_filter(data) -> None:
    model = read_model(data("opensim-gait-subject01/ref_id/subject01.osim"))
    recorded = motion_from_table(
        read_sto(data("opensim-gait-subject01/ref_id/subject01_walk1_ik.mot")), model
    )
    measured = read_external_loads(data("opensim-gait-subject01/ref_id/subject01_walk1_grf.xml"))
    residuals = []
    for motion in (differentiate(recorded), smooth_motion(recorded, model).motion):
        torques = inverse_dynamics(model, motion, resample_wrenches(measured, motion.time))
        on_plates = (motion.time > 0.6) & (motion.time < 1.4)
        held = np.stack([torques[f"pelvis_t{axis}"][on_plates] for axis in "xyz"])
        residuals.append(float(np.sqrt(np.mean(np.sum(held**2, axis=0)))))
    assert residuals[1] < 0.2 * residuals[0]


def test_it_is_found_once_for_a_motion(monkeypatch) -> None:
    motion = _walk(0.01)
    first = choose_cutoff(motion)
    monkeypatch.setattr(
        "myomorph.core.motion.cutoff_choice._choice", lambda *_: pytest.fail("found again")
    )
    assert choose_cutoff(motion) is first
