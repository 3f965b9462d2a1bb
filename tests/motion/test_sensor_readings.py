"""Recordings of sensors that fit only read another way: exchanged labels, other conventions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_sensor_kinematics import BODIES, errors_of, walk

from myomorph.body.causes import SENSOR_READING
from myomorph.body.sensors.arrangement import CONVENTIONS, Arrangement, Convention, exchanges
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.body.sensors.steps import largest_step
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from myomorph.core.motion.sensors.mounting import SensorOptions
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure
from truths.simulated_sensors import SensorErrors, simulated_sensors

SMALL = SensorErrors(skin=0.02, axes=0.01, pose=0.02, noise=0.005)


@pytest.fixture(scope="module")
def recorded():
    """Twelve seconds of a walk, and its sensors with errors."""
    model, motion = walk(12.0)
    made = simulated_sensors(model, motion, BODIES, SMALL, seed=11)
    return model, motion, SensorRecording(made.sensors, pose=made.pose)


def changed(recording, change):
    """Change the quaternions (frames, sensors, 4) of the recording and of its pose."""
    return replace(
        recording,
        sensors=_changed(recording.sensors, change),
        pose=_changed(recording.pose, change),
    )


def _changed(sensors, change):
    return replace(sensors, orientations=change(np.array(sensors.orientations)))


def readings(fit):
    return [note for note in fit.mounting.notes if note.cause is SENSOR_READING]


def exchanged_shanks(quaternions):
    pair = [BODIES.index("tibia_r"), BODIES.index("tibia_l")]
    quaternions[:, pair] = quaternions[:, pair[::-1]]
    return quaternions


def scalar_last(quaternions):
    return np.roll(quaternions, -1, axis=-1)


def turned_shank(quaternions):
    index = BODIES.index("tibia_l")
    turn = axis_rotation((0.0, 0.0, 1.0), np.radians(80.0))
    rotations = turn @ rotation_from_quaternion(quaternions[:, index])
    quaternions[:, index] = quaternion_from_rotation(rotations)
    return quaternions


def test_a_clean_recording_is_read_as_labelled(recorded):
    model, motion, recording = recorded
    fit = sensor_kinematics(model, recording)
    assert not readings(fit)
    assert errors_of(fit, motion, model) < 4.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchanged_shanks, "exchanged"),
        (scalar_last, "x, y, z, w"),
        (turned_shank, "heading"),
    ],
)
def test_another_reading_is_found_and_named(recorded, change, words):
    model, motion, recording = recorded
    fit = sensor_kinematics(model, changed(recording, change))
    (note,) = readings(fit)
    assert words in note
    assert errors_of(fit, motion, model) < 5.0


def test_a_sensor_that_turns_half_way_is_turned_back(recorded):
    model, motion, recording = recorded
    quaternions = np.array(recording.sensors.orientations)
    half = len(quaternions) // 2
    index = BODIES.index("femur_r")
    about = axis_rotation((0.6, 0.0, 0.8), np.radians(25.0))
    turned = rotation_from_quaternion(quaternions[half:, index]) @ about
    quaternions[half:, index] = quaternion_from_rotation(turned)
    sensors = replace(recording.sensors, orientations=quaternions)
    fit = sensor_kinematics(model, replace(recording, sensors=sensors))
    (note,) = readings(fit)
    assert note.place == "femur_r_imu"
    assert "on its body" in note
    assert errors_of(fit, motion, model) < 6.0


@pytest.mark.parametrize("mounting", ["recording", "pose"])
@pytest.mark.parametrize("body", ["femur_r", "tibia_r"])
def test_a_sensor_turned_after_the_pose_is_worth_more_than_none(recorded, body, mounting):
    """It is not left out, and of what the recording leaves open of its turn little is taken."""
    model, motion, recording = recorded
    quaternions = np.array(recording.sensors.orientations)
    index = BODIES.index(body)
    about = axis_rotation((0.0, 1.0, 0.0), np.radians(20.0))
    turned = rotation_from_quaternion(quaternions[:, index]) @ about
    quaternions[:, index] = quaternion_from_rotation(turned)
    sensors = replace(recording.sensors, orientations=quaternions)
    sizes = SensorOptions(imu_mounting=mounting)
    fit = sensor_kinematics(model, replace(recording, sensors=sensors, sizes=sizes))
    assert not any("left out" in note or "exchanged" in note for note in readings(fit))
    assert errors_of(fit, motion, model) < 8.0


def test_noise_has_no_step_and_a_step_is_found_where_it_is():
    rng = np.random.default_rng(5)
    time = np.linspace(0.0, 20.0, 60)
    errors = 0.03 * rng.normal(size=(60, 3, 3))
    assert largest_step(time, errors) is None
    errors[40:, 1] += np.array([0.0, 0.1, 0.05])
    errors[10:12, 1] = np.nan
    step = largest_step(time, errors)
    assert step.sensor == 1
    assert step.time == pytest.approx(0.5 * (time[39] + time[40]))
    np.testing.assert_allclose(step.vector, [0.0, 0.1, 0.05], atol=0.03)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_convention_is_its_own_inverse_reading(convention):
    """What is written in a convention is read back by it."""
    rng = np.random.default_rng(3)
    true = rng.normal(size=(5, 2, 4))
    true /= np.linalg.norm(true, axis=-1, keepdims=True)
    written = rotation_from_quaternion(true)
    if convention.y_up:
        written = axis_rotation((1.0, 0.0, 0.0), -0.5 * np.pi) @ written
    if convention.to_sensor:
        written = np.swapaxes(written, 2, 3)
    numbers = quaternion_from_rotation(written)
    if convention.scalar_last:
        numbers = np.roll(numbers, -1, axis=-1)
    read = rotation_from_quaternion(convention.read(numbers))
    np.testing.assert_allclose(read, rotation_from_quaternion(true), atol=1e-12)


def test_exchanges_are_those_of_people():
    tree = compile_tree(stick_figure())
    names = tuple(f"{body}_imu" for body in BODIES)
    pairs = {frozenset(one.exchanged) for one in exchanges(tree, names, BODIES)}
    assert frozenset({"tibia_r_imu", "tibia_l_imu"}) in pairs
    assert frozenset({"femur_r_imu", "tibia_r_imu"}) in pairs
    assert frozenset({"tibia_r_imu", "foot_l_imu"}) not in pairs
    assert len(pairs) == 10


def test_an_arrangement_says_what_is_different():
    words = Arrangement(convention=Convention(scalar_last=True, y_up=True)).words
    assert words == "quaternions read as x, y, z, w, in an earth whose y points up"
    assert Arrangement(exchanged=("a", "b")).words == "sensors a and b exchanged"
