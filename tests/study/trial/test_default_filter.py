"""The filter of a trial that nobody stated: gaps, stated cutoffs, and what a result depends on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.motion_errors import MotionErrors
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantities import get_value, put_value
from myomorph.lab.store.results import new_result, read_result
from myomorph.lab.study.inputs.table import settings_of_keys
from myomorph.lab.study.trial.default_filter import (
    chosen_filter,
    cutoff_of,
    filter_key,
    slow_messages,
    with_bridges,
)
from myomorph.lab.study.trial.steps import id as inverse_dynamics_step
from myomorph.lab.study.trial.steps.ik import recorded_poses
from myomorph.lab.study.trial.trial_inputs import TrialFiles, open_trial


def opened(arm, cutoff=None):
    files = TrialFiles(arm.model, inputs=settings_of_keys({"motion": arm.motion}))
    return open_trial(files, {"id": {} if cutoff is None else {"cutoff": cutoff}})


def noisy(arm, trial):
    recorded = recorded_poses(trial).recorded
    noise = 0.003 * np.random.default_rng(0).standard_normal(recorded.values.shape)
    return replace(recorded, values=recorded.values + noise)


def test_an_empty_frame_is_bridged_and_said(arm):
    trial = opened(arm)
    recorded = noisy(arm, trial)
    values = recorded.values.copy()
    values[len(recorded) // 2] = np.nan
    holed = replace(recorded, values=values)
    whole = inverse_dynamics_step.solve_dynamics(trial, recorded)
    bridged = inverse_dynamics_step.solve_dynamics(trial, holed)
    assert np.isfinite(bridged.torques.values).all()
    inside = slice(15, -15)
    size = np.ptp(whole.torques.values[inside], axis=0)
    changed = np.abs(bridged.torques.values - whole.torques.values)[inside]
    assert np.all(changed < 0.2 * size)
    assert any("1 frame without a pose bridged" in note for note in bridged.notes)
    filled = with_bridges(holed, bridged.motion)
    assert np.isfinite(filled.values).all()
    known = np.isfinite(values)
    np.testing.assert_array_equal(filled.values[known], recorded.values[known])


def test_a_stated_cutoff_is_the_filter_as_it_was(arm):
    trial = opened(arm, cutoff=6.0)
    recorded = noisy(arm, trial)
    motion = inverse_dynamics_step.with_derivatives(trial, recorded).motion
    stated = differentiate(recorded, 6.0)
    np.testing.assert_array_equal(motion.accelerations, stated.accelerations)
    assert chosen_filter(trial, recorded) is None
    assert filter_key(trial) == ()


def test_another_factor_of_a_chosen_filter_changes_the_cutoff_alone(arm):
    trial = opened(arm)
    recorded = noisy(arm, trial)
    chosen = chosen_filter(trial, recorded)
    half = trial.having(replace(chosen, factor=0.5))
    assert cutoff_of(half, recorded) == 0.5 * cutoff_of(trial, recorded)
    assert len(filter_key(trial)) == 1


def test_results_store_the_errors_that_the_filter_leaves(arm, tmp_path):
    """Standard deviations and marks come back as they were written, on the frames used."""
    trial = opened(arm)
    recorded = noisy(arm, trial)
    torques = inverse_dynamics_step.solve_dynamics(trial, recorded)
    with new_result(tmp_path / "results.nc") as writer:
        store.put_derivatives(writer, torques.motion, trial.model)
        put_value(writer, torques.errors)
    errors = get_value(read_result(tmp_path / "results.nc"), MotionErrors)
    assert errors.names == torques.motion.names
    np.testing.assert_allclose(errors.acceleration_sd, torques.errors.acceleration_sd, rtol=1e-6)
    assert errors.uncertain[[0, -1]].all()
    assert not errors.uncertain[len(recorded) // 2]
    stated = inverse_dynamics_step.solve_dynamics(opened(arm, cutoff=6.0), recorded)
    assert stated.errors is None


def test_a_motion_in_milliseconds_is_asked_for_its_unit(arm):
    """Frames that are seconds apart are poses: nothing is filtered, and nothing fails."""
    trial = opened(arm)
    recorded = recorded_poses(trial).recorded
    slow = replace(recorded, time=1000.0 * recorded.time)
    assert chosen_filter(trial, slow).cutoff is None
    (said,) = [str(note) for note in slow_messages(slow)]
    assert "milliseconds" in said
    assert slow_messages(recorded) == ()


def test_poses_a_second_apart_are_no_motion_in_milliseconds():
    sweep = Motion(np.arange(20.0), ("knee",), np.zeros((20, 1)))
    assert slow_messages(sweep) == ()


def test_forces_beside_a_motion_in_milliseconds_name_the_unit():
    time = np.linspace(0.0, 1.0, 101)
    zero = np.zeros((101, 1, 3))
    wrenches = Wrenches(
        time=time, names=("plate",), bodies=("foot",), forces=zero, points=zero, torques=zero
    )
    with pytest.raises(BadData, match="times of the motion in milliseconds"):
        resample_wrenches(wrenches, 1000.0 * time)
