"""`ik --imu`: sensors alone, sensors and markers, and warnings of sensors that do not fit."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.io.inertial.read import read_inertial
from sensor_files import write_orientations
from truths.simulated_sensors import NO_ERRORS, Mounting, mounted_sensors

BODIES = ("upper", "fore")


@pytest.fixture
def sensors(arm):
    """Files of the sensors of the reaching arm, and of its calibration pose."""
    model = mm.read_model(arm.model)
    made = mounted_sensors(
        model,
        mm.read_motion(arm.motion, model),
        Mounting(bodies=BODIES, rotations=np.tile(np.eye(3), (2, 1, 1))),
        NO_ERRORS,
    )
    files = arm.folder / "walk_imu.sto", arm.folder / "pose_imu.sto"
    for path, part in zip(files, (made.sensors, made.pose), strict=True):
        write_orientations(path, part)
    return files


def angles(path, arm):
    model = mm.read_model(arm.model)
    return mm.read_motion(path, model).values


def test_sensors_alone_give_the_angles(arm, sensors, command):
    out = arm.folder / "q.mot"
    start = (
        "ik",
        "--model",
        arm.model,
        "--imu",
        sensors[0],
        "--imu-pose",
        sensors[1],
        "--out",
        out,
    )
    told = command(*start, "--imu-heading", "upper_imu=x")
    assert told.status == 0, told.err
    assert "2 inertial sensors" in told.out
    np.testing.assert_allclose(angles(out, arm), angles(arm.motion, arm), atol=1e-4)
    # Two parallel axes without bounds look the same from behind.
    told = command(*start)
    assert told.status == 0, told.err
    assert "--imu-heading" in told.err


def test_sensors_and_markers_together_with_intervals(arm, sensors, command):
    out = arm.folder / "q.mot"
    told = command(
        "ik",
        "--model",
        arm.model,
        "--markers",
        arm.markers,
        "--imu",
        sensors[0],
        "--draws",
        10,
        "--out",
        out,
    )
    assert told.status == 0, told.err
    assert "2 sensors explained" in told.out
    low = angles(out.with_name("q_low.mot"), arm)
    high = angles(out.with_name("q_high.mot"), arm)
    assert (high > low).any()
    assert np.mean((low < angles(arm.motion, arm)) & (angles(arm.motion, arm) < high)) > 0.8


def test_intervals_are_wider_where_only_sensors_see(arm, sensors, command):
    widths = []
    for name, recording in (("a", ("--markers", arm.markers)), ("b", ("--imu-pose", sensors[1]))):
        out = arm.folder / f"{name}.mot"
        told = command(
            "ik", "--model", arm.model, *recording, "--imu", sensors[0], "--draws", 20, "--out", out
        )
        assert told.status == 0, told.err
        widths.append(
            (
                angles(out.with_name(f"{name}_high.mot"), arm)
                - angles(out.with_name(f"{name}_low.mot"), arm)
            ).mean()
        )
    assert widths[1] > 1.2 * widths[0]


def test_what_does_not_fit_is_said(arm, sensors, command):
    out = ("--out", arm.folder / "q.mot")
    start = ("ik", "--model", arm.model, "--imu", sensors[0])
    for more, words in (
        (("--imu-bodies", "fore_imu=frore"), ("'frore'", "'fore'")),
        (("--imu-bodies", "for_imu=fore"), ("'for_imu'", "'fore_imu'")),
        (("--imu-pose", arm.markers), (arm.markers.name, ".mvnx")),
        (("--imu-pose", sensors[1], "--imu-heading", "fore_imu=q"), ("axis 'q'", "'-x'")),
        (("--imu-mounting", "model"), ("--imu-mounting model",)),
        (("--imu-noise", "0"), ("imu_noise",)),
    ):
        told = command(*start, *more, *out)
        assert told.status == 2, told
        for word in words:
            assert word in told.err, told.err
    told = command("ik", "--model", arm.model, "--imu-pose", sensors[1], *out)
    assert told.status == 2
    assert "--imu" in told.err
    assert not (arm.folder / "q.mot").exists()


def test_written_and_read_orientations_are_the_same(arm, sensors):
    read = read_inertial(sensors[0])
    assert read.names == ("upper_imu", "fore_imu")
    assert np.allclose(np.linalg.norm(read.orientations, axis=2), 1.0)
