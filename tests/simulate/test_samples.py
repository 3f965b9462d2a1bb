"""Samples by name: what they say of themselves, and that what is simulated obeys its laws."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.io import samples
from myomorph.core.model.frozen_map import FrozenMap

NAMES = ("walk", "run", "squat", "jump", "mouse", "swings")
SIMULATED = ("walk", "run", "squat", "mouse", "swings")


@cache
def taken(name):
    if name == "jump":
        pytest.importorskip("biomdp")
    return mm.sample(name)


@cache
def fitted(name):
    one = taken(name)
    options = mm.InverseKinematicsOptions(marker_weights=one.marker_weights)
    return mm.inverse_kinematics(one.model, one.markers, options)


@pytest.mark.parametrize("name", NAMES)
def test_a_sample_says_what_it_is(name):
    one = taken(name)
    assert one.source.kind == ("simulated" if name in SIMULATED else "recorded")
    assert one.source.kind in repr(one)
    assert one.source.kind in repr(one.source)
    assert one.source.licence
    assert one.source.citation
    assert one.mass > 0.0
    assert ("nobody was recorded" in one.source.text or "no animal" in one.source.text) == (
        name in SIMULATED
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_model_has_the_markers_of_the_recording(name):
    one = taken(name)
    assert set(one.markers.names) & set(one.model.marker_names)
    start, stop = one.window
    seen = (fitted(name).motion.time >= start) & (fitted(name).motion.time <= stop)
    assert np.nanmean(fitted(name).rms[seen]) < 0.01


@pytest.mark.parametrize("name", ["walk", "run", "squat", "mouse"])
def test_true_angles_are_found_again(name):
    truth = taken(name).truth["coordinate_value"]
    for angle in ("hip_flexion_r", "knee_angle_r", "ankle_angle_r"):
        error = np.degrees(fitted(name).motion[angle] - truth[angle])
        assert np.sqrt(np.mean(error**2)) < 1.6


def true_torques(name):
    one = taken(name)
    motion = one.truth["coordinate_value"]
    wrenches = mm.resample_wrenches(one.loads, motion.time)
    return mm.inverse_dynamics(one.model, motion, wrenches)


def test_the_walk_is_in_balance():
    torques = true_torques("walk")
    for name in ("pelvis_tx", "pelvis_ty", "pelvis_tz"):
        assert np.sqrt(np.mean(torques[name] ** 2)) < 5.0
    for name in ("pelvis_tilt", "pelvis_list", "pelvis_rotation"):
        assert np.sqrt(np.mean(torques[name] ** 2)) < 8.0


def test_the_runner_flies_and_carries_its_weight_on_average():
    one = taken("run")
    vertical = one.loads.forces[:, :, 1].sum(axis=1)
    strikes = [event.time for event in one.events if event.label == "Foot Strike"]
    whole = (one.loads.time >= strikes[0]) & (one.loads.time < strikes[-1])
    assert np.mean(vertical[whole]) == pytest.approx(one.model.weight, rel=0.01)
    assert 0.15 < np.mean(vertical[whole] < 10.0) < 0.35
    assert 1.8 < vertical.max() / one.model.weight < 2.6


@pytest.mark.parametrize("name", ["walk", "run"])
def test_centers_of_pressure_lie_under_the_feet(name):
    one = taken(name)
    wrenches = mm.resample_wrenches(one.loads, one.markers.time)
    for foot, side in enumerate("RL"):
        firm = wrenches.forces[:, foot, 1] > 0.2 * one.model.weight
        pressed = wrenches.points[firm, foot, 0]
        assert (pressed - one.markers[f"{side}HEE"][firm, 0]).min() > -0.05
        # Toes reach beyond the head of the second metatarsal.
        assert (pressed - one.markers[f"{side}TOE"][firm, 0]).max() < 0.08


@pytest.mark.parametrize(("name", "count"), [("walk", 5), ("run", 6)])
def test_true_strides_are_found(name, count):
    one = taken(name)
    found = mm.walking_strides(one.model, fitted(name).motion, wrenches=one.loads)
    true = {
        side: np.array(
            [
                event.time
                for event in one.events
                if event.label == "Foot Strike" and event.side == side
            ]
        )
        for side in ("Right", "Left")
    }
    for foot, side in (("calcn_r", "Right"), ("calcn_l", "Left")):
        strides = found.of(foot)
        assert len(strides) == count
        starts = np.array([stride.start for stride in strides])
        assert np.abs(starts - true[side][:count]).max() < 0.03


def test_curves_over_strides_are_those_of_the_truth():
    one = taken("walk")
    truth = one.truth["coordinate_value"]
    found = mm.walking_strides(one.model, fitted("walk").motion, wrenches=one.loads)
    from_markers = fitted("walk").motion.strides(found)
    from_truth = truth.strides(one.events)
    for name in ("hip_flexion_r", "knee_angle_r", "knee_angle_l"):
        error = np.degrees(from_markers.mean(name) - from_truth.mean(name))
        assert np.sqrt(np.mean(error**2)) < 2.0
        assert np.abs(np.degrees(from_markers.sd(name) - from_truth.sd(name))).max() < 3.0


def test_the_swing_is_that_of_its_mass():
    one = taken("swings")
    lowest = one.loads.forces[:, 0, 2]
    moved = one.truth["mass"].values.item() * 9.81
    assert np.abs(lowest).mean() == pytest.approx(moved, rel=0.2)


def test_other_recordings_of_a_name_differ_in_steps_and_noise():
    first = taken("walk")
    second = mm.sample("walk", 2)
    assert second.model is first.model
    assert np.abs(second.markers.values[:100] - first.markers.values[:100]).max() > 0.005
    with pytest.raises(mm.BadData, match="there is one"):
        mm.sample("squat", 2)


def test_an_unknown_sample_is_answered_by_those_that_exist():
    with pytest.raises(mm.BadData) as told:
        mm.sample("swim")
    assert all(f"'{name}'" in str(told.value) for name in NAMES)


def test_a_missing_package_is_named_with_its_extra(monkeypatch):
    jump = samples.SAMPLES["jump"]
    absent = type(jump)(make=jump.make, needs=FrozenMap({"no_such_module": "biomdp"}), extra="demo")
    monkeypatch.setitem(samples.SAMPLES, "jump", absent)
    with pytest.raises(mm.MyomorphError, match=r"myomorph\[demo\]"):
        mm.sample("jump")


@pytest.mark.parametrize("name", ["walk", "mouse"])
def test_files_say_what_is_simulated_and_are_read_again(name, tmp_path):
    one = taken(name)
    files = one.write(tmp_path / "files")
    assert files.recording.name.startswith("simulated_")
    model = mm.read_model(files.model)
    assert model.mass == pytest.approx(one.mass)
    markers = mm.read_recording(files.recording).markers
    np.testing.assert_allclose(markers.values, one.markers.values, atol=1e-5)
    assert (files.loads is None) == (one.loads is None)
    if files.loads is not None:
        fit = mm.inverse_kinematics(model, markers)
        loads = mm.read_loads(files.loads, model, fit.motion)
        np.testing.assert_allclose(loads.forces, one.loads.forces, atol=0.01)
