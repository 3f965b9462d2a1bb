"""`live` on inertial sensors: poses frame by frame, and what streams of them look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.model.errors import BadData
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.cli import main
from myomorph.live.chain import LiveChain
from myomorph.live.loop import follow
from myomorph.live.sources import Replay
from myomorph.live.streams import marker_channels
from sensor_files import write_orientations
from truths.simulated_sensors import NO_ERRORS, Mounting, mounted_sensors

HOME = "rajagopal-walk-emg"
BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
ANGLES = ("pelvis_tilt", "hip_flexion_r", "knee_angle_r", "ankle_angle_l")


class Kept:
    """An output that remembers."""

    def __init__(self):
        self.frames = []

    def put(self, frame, markers):
        self.frames.append(frame)

    def close(self):
        """Nothing."""


@pytest.fixture(scope="module")
def walk(data):
    """Return a recorded walk, its model, and sensors without errors on it."""
    model = mm.read_model(data(f"{HOME}/subject_walk_scaled.osim"))
    motion = mm.read_motion(data(f"{HOME}/coordinates.sto"), model)
    motion = mm.Motion(
        motion.time, model.coordinate_names, compile_tree(model).coordinates_of(motion)
    )
    straight = np.tile(np.eye(3), (len(BODIES), 1, 1))
    return (
        model,
        motion,
        mounted_sensors(model, motion, Mounting(bodies=BODIES, rotations=straight), NO_ERRORS),
    )


def test_frames_have_the_angles_of_the_walk(walk):
    model, motion, made = walk
    recording = SensorRecording(made.sensors, pose=made.pose, headings={"pelvis_imu": "x"})
    mounting = sensor_kinematics(model, recording).mounting
    quaternions = np.array(made.sensors.orientations)
    quaternions[50:60, BODIES.index("tibia_r")] = np.nan
    source = Replay(replace(made.sensors, orientations=quaternions), None, 0.0)
    kept = Kept()
    follow(LiveChain(model, source, mounting=mounting), source, [kept])
    assert len(kept.frames) == len(motion)
    found = np.array([frame.pose for frame in kept.frames])
    whole = np.ones(len(motion), bool)
    whole[50:60] = False
    for name in ANGLES:
        away = (found[:, motion.names.index(name)] - motion[name])[whole]
        assert np.degrees(np.abs(away).max()) < 1.0, name
    assert np.isfinite(found).all()
    gone = found[:, motion.names.index("pelvis_tx")]
    assert gone[-1] - gone[0] == pytest.approx(
        motion["pelvis_tx"][-1] - motion["pelvis_tx"][0], abs=0.2
    )


def test_the_command_plays_sensors(walk, data, tmp_path, capsys):
    for name, part in (("walk.sto", walk[2].sensors), ("pose.sto", walk[2].pose)):
        write_orientations(tmp_path / name, part)
    model = ["--model", str(data(f"{HOME}/subject_walk_scaled.osim"))]
    sensors = ["--imu", str(tmp_path / "walk.sto"), "--imu-pose", str(tmp_path / "pose.sto")]
    out = tmp_path / "out"
    named = ["--imu-heading", "pelvis_imu=x", "--speed", "0", "--out", str(out)]
    status = main(["live", *model, *sensors, *named])
    assert status == 0, capsys.readouterr().err
    assert len(mm.read_motion(out / "coordinates.mot", walk[0])) > 50
    assert main(["live", *model, *sensors, *named, "--draws", "5"]) == 2
    assert "--draws" in capsys.readouterr().err


def test_channels_of_sensors():
    labels = [f"shank_{axis}" for axis in "wxyz"]
    names, columns, factor = marker_channels(labels, [""] * 4, "wxyz")
    assert (names, columns.tolist(), factor) == (("shank",), [[0, 1, 2, 3]], 1.0)
    with pytest.raises(BadData, match=r"'shank'.*only w, x, y"):
        marker_channels(labels[:3], [""] * 3, "wxyz")
