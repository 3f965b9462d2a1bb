"""Joint angles by inertial sensors that are simulated.

Mounting, heading, clock and drift are found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
    vector_from_rotation,
)
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.sensors.mounting import SensorOptions, bodies_of_sensors, named_bodies
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure
from truths.simulated_sensors import NO_ERRORS, SensorErrors, simulated_sensors

BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "foot_r", "femur_l", "tibia_l", "foot_l")
RATE = 50.0
BY_POSE = SensorOptions(imu_mounting="pose")


def walk(seconds=20.0):
    """Make a figure that walks in place: all joints swing, knees and hips most."""
    model = stick_figure()
    time = np.arange(0.0, seconds, 1.0 / RATE)
    rng = np.random.default_rng(5)
    sizes = {"pelvis": 0.05, "torso": 0.08, "femur": 0.12, "tibia": 0.5, "foot": 0.2}
    values = np.zeros((len(time), len(model.coordinates)))
    for j, coordinate in enumerate(model.coordinates):
        part = coordinate.name.split("_")[0]
        size = (
            0.4
            if coordinate.name.startswith("femur") and coordinate.name.endswith("r0")
            else sizes[part]
        )
        phase = rng.uniform(0, 2 * np.pi)
        turns = 2 * np.pi * (time + 0.1 * np.sin(0.7 * time)) + phase
        values[:, j] = size * (np.sin(turns) + 0.3 * np.sin(2.0 * turns + phase))
        if coordinate.clamped:
            values[:, j] = -0.55 + np.clip(values[:, j], -1.0, 0.5)
    return model, Motion(time, model.coordinate_names, values)


def angles(model):
    return np.array([coordinate.motion == "rotational" for coordinate in model.coordinates])


def errors_of(fit, motion, model):
    """RMS of all angles of joints [deg]."""
    joints = angles(model) & ~np.array(
        [name.startswith("pelvis") for name in model.coordinate_names]
    )
    return np.degrees(np.sqrt(np.mean((fit.fit.motion.values - motion.values)[:, joints] ** 2)))


def turned_by(fit, made):
    """Rotation vectors from the true mountings to those found [rad]."""
    return vector_from_rotation(fit.mounting.rotations @ np.swapaxes(made.rotations, 1, 2))


@pytest.fixture(scope="module")
def walking():
    return walk()


def test_perfect_sensors_give_back_the_motion(walking):
    """Pose mode with the heading that is named: OpenSim's procedure."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS)
    # An axis of the pelvis's sensor that points forward there: its x turned by the mounting.
    options = SensorOptions(imu_mounting="recording", imu_heading_error=1e-4)
    fit = sensor_kinematics(model, SensorRecording(made.sensors, pose=made.pose, sizes=options))
    np.testing.assert_allclose(
        vector_from_rotation(fit.mounting.rotations @ np.swapaxes(made.rotations, 1, 2)),
        0,
        atol=0.02,
    )
    assert errors_of(fit, motion, model) < 0.6
    assert fit.fit.converged.all()


def test_the_recording_tells_the_heading_of_the_calibration_pose(walking):
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS, seed=3)
    recording = SensorRecording(made.sensors, pose=made.pose, sizes=BY_POSE)
    fit = sensor_kinematics(model, recording)
    heading = (fit.mounting.headings[0].mean() - made.headings[0].mean() + np.pi) % (
        2 * np.pi
    ) - np.pi
    assert abs(heading) < np.radians(1.0)


def test_a_knee_at_its_bound_in_the_pose_is_known_no_better(walking):
    """How sure a mounting is does not depend on where the model's joints end."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS)
    bent = [coordinate.name for coordinate in model.coordinates if coordinate.clamped]
    assert all(model.coordinate(name).default == model.coordinate(name).range[1] for name in bent)
    opened = replace(
        model,
        coordinates=tuple(
            replace(one, range=(-4.0, 2.0)) if one.name in bent else one
            for one in model.coordinates
        ),
    )
    recording = SensorRecording(made.sensors, pose=made.pose, sizes=BY_POSE)
    at_bound = sensor_kinematics(model, recording).mounting.factor
    free = sensor_kinematics(opened, recording).mounting.factor
    np.testing.assert_allclose(at_bound @ at_bound.T, free @ free.T, atol=1e-9)


def test_a_named_axis_gives_the_heading(walking):
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS, seed=3)
    # Sensors whose x points forward on the pelvis.
    turned = rotation_from_quaternion(made.sensors.orientations) @ made.rotations.swapaxes(1, 2)
    posed = rotation_from_quaternion(made.pose.orientations) @ made.rotations.swapaxes(1, 2)
    sensors = replace(made.sensors, orientations=quaternion_from_rotation(turned))
    pose = replace(made.pose, orientations=quaternion_from_rotation(posed))
    recording = SensorRecording(sensors, pose=pose, headings={"pelvis_imu": "x"})
    fit = sensor_kinematics(model, replace(recording, sizes=BY_POSE))
    np.testing.assert_allclose(vector_from_rotation(fit.mounting.rotations), 0.0, atol=1e-6)
    assert errors_of(fit, motion, model) < 1e-3
    with pytest.raises(UnknownName, match="pelvis_imu"):
        sensor_kinematics(model, replace(recording, headings={"pelvs_imu": "x"}))
    with pytest.raises(BadData, match="upright"):
        sensor_kinematics(model, replace(recording, headings={"pelvis_imu": "y"}))


def test_a_sensor_that_slipped_after_the_pose_is_found(walking):
    """The shank's sensor is turned by 20 degrees about the shank: the knee's axis shows it."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS, seed=1)
    index = BODIES.index("tibia_r")
    quaternions = np.array(made.sensors.orientations)
    earth = rotation_from_quaternion(quaternions[:, index])
    about = (
        made.rotations[index].T @ axis_rotation((0, 1, 0), np.radians(20.0)) @ made.rotations[index]
    )
    quaternions[:, index] = quaternion_from_rotation(earth @ about)
    slipped = SensorRecording(replace(made.sensors, orientations=quaternions), pose=made.pose)
    by_pose = sensor_kinematics(model, replace(slipped, sizes=BY_POSE))
    found = sensor_kinematics(model, slipped)
    assert errors_of(found, motion, model) < 0.5 * errors_of(by_pose, motion, model)
    assert any("tibia_r_imu" in note and "rotated" in note for note in found.mounting.notes)


def test_markers_show_mounting_heading_and_clock(walking):
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES[:5], NO_ERRORS, seed=2)
    markers = marker_positions(model, motion)
    late = replace(made.sensors, time=made.sensors.time + 0.13)
    marked = inverse_kinematics(model, markers)
    tracked = TrackedMarkers(markers=markers, fit=marked)
    fit = sensor_kinematics(model, SensorRecording(late), tracked)
    assert fit.mounting.delay == pytest.approx(0.13, abs=2e-3)
    np.testing.assert_allclose(
        vector_from_rotation(fit.mounting.rotations @ made.rotations.swapaxes(1, 2)), 0, atol=5e-3
    )
    assert any("130 ms" in note for note in fit.mounting.notes)


def test_markers_show_headings_that_have_nothing_in_common(walking):
    """Sensors without magnetometer, whose orientations alone the file has."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS, seed=2)
    apart = np.random.default_rng(8).uniform(-np.pi, np.pi, len(BODIES))
    earth = rotation_from_quaternion(made.sensors.orientations)
    turns = np.array([axis_rotation((0.0, 0.0, 1.0), angle) for angle in apart])
    own = replace(made.sensors, orientations=quaternion_from_rotation(turns @ earth))
    markers = marker_positions(model, motion)
    tracked = TrackedMarkers(markers=markers, fit=inverse_kinematics(model, markers))
    fit = sensor_kinematics(model, SensorRecording(own, same_clock=True), tracked)
    np.testing.assert_allclose(turned_by(fit, made), 0.0, atol=5e-3)
    assert any("headings of the sensors" in note for note in fit.mounting.notes)


def test_a_heading_that_differs_is_found_and_reported(walking):
    """No marker and no name says how the sensors face: the other sensors do."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, SensorErrors(), seed=2)
    alike = SensorRecording(made.sensors, pose=made.pose, sizes=BY_POSE)
    labelled = sensor_kinematics(model, alike)
    assert not any("about another axis" in note for note in labelled.mounting.notes)
    turned = axis_rotation((0.0, 0.0, 1.0), np.radians(70.0))
    index = BODIES.index("tibia_l")

    def with_own_heading(sensors):
        quaternions = np.array(sensors.orientations)
        quaternions[:, index] = quaternion_from_rotation(
            turned @ rotation_from_quaternion(quaternions[:, index])
        )
        return replace(sensors, orientations=quaternions)

    own = SensorRecording(
        with_own_heading(made.sensors), pose=with_own_heading(made.pose), sizes=BY_POSE
    )
    found = sensor_kinematics(model, own)
    assert any("heading of sensor tibia_l_imu" in note for note in found.mounting.notes)
    assert errors_of(found, motion, model) < errors_of(labelled, motion, model) + 1.0


def test_the_recording_does_not_spoil_what_the_pose_gives(walking):
    """Large errors, and two minutes of sitting between walks.

    No heading compensates for the mean angles of sitting.
    """
    model, motion = walking
    seated = np.array(motion.values[0])
    for j, name in enumerate(model.coordinate_names):
        seated[j] = {"femur_r0": 1.3, "femur_l0": 1.3}.get(
            name, -1.5 if name.startswith("tibia") else 0.0
        )
    values = np.concatenate([motion.values, np.tile(seated, (6000, 1)), motion.values])
    whole = Motion(np.arange(len(values)) / RATE, motion.names, values)
    made = simulated_sensors(
        model, whole, BODIES, SensorErrors(heading=0.15, skin=0.1, axes=0.1), seed=6
    )
    recording = SensorRecording(made.sensors, pose=made.pose)
    by_pose = sensor_kinematics(model, replace(recording, sizes=BY_POSE))
    assert errors_of(sensor_kinematics(model, recording), whole, model) < errors_of(
        by_pose, whole, model
    )


def test_sensors_bridge_hidden_markers(walking):
    """Markers of both shanks hidden for two seconds: sensors take their place, and angles go on."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, SensorErrors(axes=0.0), seed=4)
    markers = marker_positions(model, motion)
    rng = np.random.default_rng(0)
    values = markers.values + 0.002 * rng.normal(size=markers.values.shape)
    hidden = np.array([name.startswith(("tibia", "foot")) for name in markers.names])
    gap = slice(400, 500)
    values[gap, hidden] = np.nan
    markers = Markers(markers.time, markers.names, values)
    marked = inverse_kinematics(model, markers)
    tracked = TrackedMarkers(markers=markers, fit=marked)
    fit = sensor_kinematics(model, SensorRecording(made.sensors), tracked)
    knees = [j for j, name in enumerate(model.coordinate_names) if name.startswith("tibia")]

    def rms(values):
        return np.degrees(np.sqrt(np.mean((values - motion.values)[gap][:, knees] ** 2)))

    assert rms(fit.fit.motion.values) < 3.0 < 10.0 < rms(marked.motion.values)
    assert fit.fit.seen.all()


def test_headings_that_drift_are_followed():
    """In three minutes one sensor's heading drifts by 20 degrees; the knee's hinge holds it."""
    model, motion = walk(180.0)
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS, seed=6)
    index = BODIES.index("tibia_r")
    quaternions = np.array(made.sensors.orientations)
    drift = np.radians(20.0) * motion.time / motion.time[-1]
    earth = rotation_from_quaternion(quaternions[:, index])
    about = np.array([axis_rotation((0, 0, 1), angle) for angle in drift])
    quaternions[:, index] = quaternion_from_rotation(about @ earth)
    drifting = SensorRecording(replace(made.sensors, orientations=quaternions), pose=made.pose)
    still = replace(drifting, sizes=SensorOptions(imu_heading_drift=0.0))
    moving = replace(drifting, sizes=SensorOptions(imu_heading_drift=0.1))
    held = sensor_kinematics(model, still)
    followed = sensor_kinematics(model, moving)
    assert errors_of(followed, motion, model) < 0.5 * errors_of(held, motion, model)
    assert np.ptp(followed.mounting.headings[:, index]) == pytest.approx(
        np.radians(20.0), abs=np.radians(5.0)
    )
    assert any("tibia_r_imu" in note and "drifts" in note for note in followed.mounting.notes)


def test_bodies_by_names():
    model = stick_figure()
    assert bodies_of_sensors(model, ("femur_r_imu", "Pelvis", "TORSO_sensor"), {}) == {
        "femur_r_imu": "femur_r",
        "Pelvis": "pelvis",
        "TORSO_sensor": "torso",
    }
    assert bodies_of_sensors(model, ("a", "b"), {"a": "pelvis", "b": ""}) == {"a": "pelvis"}
    with pytest.raises(BadData, match=r"'femr_r'.*'femur_r'.*--imu-bodies"):
        bodies_of_sensors(model, ("femr_r", "pelvis"), {})
    with pytest.raises(UnknownName, match=r"'femu_r'.*'femur_r'"):
        bodies_of_sensors(model, ("a",), {"a": "femu_r"})
    with pytest.raises(UnknownName, match="sensor"):
        bodies_of_sensors(model, ("a",), {"c": "femur_r"})
    with pytest.raises(BadData, match="left out"):
        bodies_of_sensors(model, ("a",), {"a": ""})


def test_makers_words_name_bodies():
    model = stick_figure()
    xsens = (
        "Pelvis",
        "L5",
        "T8",
        "RightUpperLeg",
        "RightLowerLeg",
        "RightFoot",
        "RightToe",
        "LeftUpperLeg",
    )
    assert named_bodies(model, xsens) == {
        "Pelvis": "pelvis",
        "T8": "torso",
        "RightUpperLeg": "femur_r",
        "RightLowerLeg": "tibia_r",
        "RightFoot": "foot_r",
        "LeftUpperLeg": "femur_l",
    }
    apdm = ("Lumbar", "Sternum", "Right Upper Leg", "Left Lower Leg", "Left Foot")
    assert tuple(named_bodies(model, apdm).values()) == (
        "pelvis",
        "torso",
        "femur_r",
        "tibia_l",
        "foot_l",
    )


def test_without_pose_or_markers_the_mounting_is_asked_for(walking):
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES[:3], NO_ERRORS)
    with pytest.raises(BadData, match="--imu-pose"):
        sensor_kinematics(model, SensorRecording(made.sensors))
    as_modelled = SensorRecording(made.sensors, sizes=SensorOptions(imu_mounting="model"))
    with pytest.raises(UnknownName, match="pelvis_imu"):
        sensor_kinematics(model, as_modelled)


def test_times_of_the_tree_are_those_of_the_model(walking):
    """The simulated truth itself: with no errors the reported rotations are those of the bodies."""
    model, motion = walking
    made = simulated_sensors(model, motion, BODIES, NO_ERRORS)
    assert made.person.body_names == model.body_names
    assert compile_tree(made.person).body_index == compile_tree(model).body_index
    assert np.ptp(made.headings) == pytest.approx(0.0, abs=1e-12)
