"""Recordings that ended in tracebacks or refusals, through commands to their results.

Truth: motions of the reaching arm, written as the files that sensors and cameras make; a plate that
reads noise beside somebody who stands.
"""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from made_standing import standing
from myomorph.core.io.c3d.write import write_c3d
from myomorph.core.model.series import Z_UP_TO_Y_UP, Markers, PlateRecording
from myomorph.core.model.spatial import rotation_from_quaternion
from truths.simulated_sensors import NO_ERRORS, Mounting, mounted_sensors

RATE = 128.0
BODIES = ("upper", "fore")


@pytest.fixture
def turned(arm):
    """Orientations (frames, bodies, 4) of both bodies of the arm: its pose, held, then its motion.

    And angles (frames, coordinates) of the motion [rad].
    """
    model = mm.read_model(arm.model)
    motion = mm.read_motion(arm.motion, model)
    mounted = np.tile(np.eye(3), (2, 1, 1))
    made = mounted_sensors(model, motion, Mounting(bodies=BODIES, rotations=mounted), NO_ERRORS)
    held = np.repeat(made.pose.orientations[:1], 64, axis=0)
    return np.concatenate([held, made.sensors.orientations]), np.asarray(motion.values)


def as_apdm(folder, quaternions):
    """Write APDM's format 7: microseconds, orientations behind raw signals."""
    head = ",".join(f"{1000 + i},,,{name}" + "," * 10 for i, name in enumerate(BODIES))
    signals = "Accelerometer,,,Gyroscope,,,Magnetometer,,,Barometer,Orientation,,,"
    axes = "X,Y,Z,X,Y,Z,X,Y,Z,,S,X,Y,Z"
    lines = [f"Format=7,{head}", f"Time,{signals},{signals}", f",{axes},{axes}"]
    raw = "0.0,0.0,9.81,0.0,0.0,0.0,20.0,0.0,-40.0,101.3"
    for frame, row in enumerate(quaternions):
        cells = [f"{raw}," + ",".join(f"{part:.9f}" for part in sensor) for sensor in row]
        lines.append(f"{1.6e15 + 1e6 * frame / RATE:.1f}," + ",".join(cells))
    path = folder / "trial.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def as_segments(folder, quaternions):
    """Write a C3D file that holds poses of segments and no points."""
    ezc3d = pytest.importorskip("ezc3d")
    poses = np.zeros((*quaternions.shape[:2], 4, 4))
    poses[..., :3, :3] = rotation_from_quaternion(quaternions)
    poses[..., 3, 3] = 1.0
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file.add_parameter("ROTATION", "USED", [len(BODIES)])
    file.add_parameter("ROTATION", "RATE", [RATE])
    file.add_parameter("ROTATION", "RATIO", [1])
    file.add_parameter("ROTATION", "LABELS", [f"{name}_4X4" for name in BODIES])
    file["data"]["points"] = np.zeros((4, 0, len(poses)))
    file["data"]["rotations"] = poses.transpose(2, 3, 1, 0)
    path = folder / "trial.c3d"
    file.write(str(path))
    return path


@pytest.mark.parametrize("written", [as_apdm, as_segments])
def test_angles_of_sensors_and_of_segments(arm, turned, command, written):
    quaternions, angles = turned
    path = written(arm.folder, quaternions)
    out = arm.folder / "q.mot"
    pose = ("--imu-pose-time", 0, 0.4, "--imu-heading", "upper=x")
    told = command("ik", "--model", arm.model, "--imu", path, *pose, "--out", out)
    assert told.status == 0, told.err
    found = mm.read_motion(out, mm.read_model(arm.model)).values
    np.testing.assert_allclose(found[64:], angles, atol=1e-3)


@pytest.fixture
def beside_plates(tmp_path):
    """Write somebody who stands beside a plate, which reads noise."""
    random = np.random.default_rng(5)
    stands = standing(shift=0.02)
    markers = Markers(stands.time, stands.names, stands.values @ Z_UP_TO_Y_UP)
    square = np.array([[0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0], [0.2, -0.3, 0.0]])
    plate = PlateRecording(
        name="plate",
        kind=2,
        corners=square + [0.0, 1.5, 0.0],
        origin=np.array([0.0, 0.0, -0.04]),
        channels=random.normal(0.0, 0.2, (10 * len(markers), 6)),
    )
    path = tmp_path / "stand.c3d"
    write_c3d(path, markers, plate)
    return path


def test_nobody_on_the_plates_is_converted_without_forces(beside_plates, command, tmp_path):
    out = tmp_path / "converted"
    told = command("convert", beside_plates, "--out", out)
    assert told.status == 0, told.err
    assert "no plate is loaded: no table of forces is written" in told.err
    assert not list(out.glob("*_grf*"))
    assert (out / "stand.trc").is_file()


@pytest.mark.long
def test_nobody_on_the_plates_is_analyzed_without_them(beside_plates, command, tmp_path):
    out = tmp_path / "results"
    told = command("analyze", beside_plates, "--mass", 70, "--out", out)
    assert told.status == 0, told.err
    assert "1 of 1 trials done" in told.out
    (trial,) = mm.load(out).values()
    assert trial.wrenches is None or not trial.wrenches.names
    assert np.isfinite(trial.torques.values).all()
