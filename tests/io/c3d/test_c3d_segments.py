"""Poses of segments in C3D files without points, and plates whose unit of length is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.c3d.plates import plate_recordings
from myomorph.core.io.c3d.raw import RawC3d
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.inertial.read import read_inertial
from myomorph.core.model.errors import BadFile
from myomorph.core.model.spatial import rotation_from_euler_xyz, rotation_from_quaternion
from myomorph.lab.info.inspect import inspect

RATE = 120.0
NAMES = ("pelvis_4X4", "l_thigh_4X4", "l_shank_4X4")


@pytest.fixture
def poses():
    """Poses (frames, segments, 4, 4) [mm], of which one is unknown."""
    random = np.random.default_rng(3)
    result = np.zeros((9, len(NAMES), 4, 4))
    angles = random.uniform(-1.0, 1.0, (9, len(NAMES), 3))
    for place in np.ndindex(9, len(NAMES)):
        result[place][:3, :3] = rotation_from_euler_xyz(angles[place])
    result[:, :, :3, 3] = random.uniform(-500.0, 1500.0, (9, len(NAMES), 3))
    result[:, :, 3, 3] = 1.0
    result[4, 1, :3, :3] = 0.0
    return result


@pytest.fixture
def recorded(tmp_path, poses):
    """Write them to a file by ezc3d."""
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file.add_parameter("ROTATION", "USED", [len(NAMES)])
    file.add_parameter("ROTATION", "RATE", [RATE])
    file.add_parameter("ROTATION", "RATIO", [1])
    file.add_parameter("ROTATION", "LABELS", list(NAMES))
    file["data"]["points"] = np.zeros((4, 0, 9))
    file["data"]["rotations"] = poses.transpose(2, 3, 1, 0)
    path = tmp_path / "walk.c3d"
    file.write(str(path))
    return path


def test_poses_of_segments_are_read(recorded, poses):
    trial = read_c3d(recorded)
    assert trial.markers is None
    segments = trial.segments
    assert segments.names == ("pelvis", "l_thigh", "l_shank")
    np.testing.assert_allclose(segments.time, np.arange(9) / RATE, atol=1e-9)
    known = np.ones((9, 3), bool)
    known[4, 1] = False
    np.testing.assert_allclose(segments.rotations[known], poses[known][:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(segments.origins[known], 1e-3 * poses[known][:, :3, 3], atol=1e-6)
    assert np.isnan(segments.rotations[4, 1]).all()
    assert np.isnan(segments.origins[4, 1]).all()


def test_segments_are_sensors_of_orientation(recorded, poses):
    sensors = read_inertial(recorded)
    assert sensors.names == ("pelvis", "l_thigh", "l_shank")
    rotations = rotation_from_quaternion(sensors.orientations[:, 0])
    np.testing.assert_allclose(rotations, poses[:, 0, :3, :3], atol=1e-6)
    assert np.isnan(sensors.orientations[4, 1]).all()


def test_info_says_what_the_file_is(recorded):
    facts = dict(inspect(recorded).facts)
    assert facts["segments with poses"] == "3: pelvis, l_thigh, l_shank"
    assert facts["frames of segments"] == "9 at 120 Hz"


def test_a_file_cut_off_keeps_its_whole_poses(recorded):
    whole = recorded.read_bytes()
    size = 4 * 17 * len(NAMES)
    recorded.write_bytes(whole[: len(whole) - len(whole) % 512 - 2 * size])
    assert 0 < len(read_c3d(recorded).segments) < 9


@pytest.mark.parametrize("length", [600, 1500])
def test_a_damaged_file_is_read_or_refused_by_name(recorded, length):
    recorded.write_bytes(recorded.read_bytes()[:length])
    with pytest.raises(BadFile):
        read_c3d(recorded)


def _plates(unit_scale: float) -> RawC3d:
    """Make a file of one plate of 0.6 by 0.4 m, its corners in units of so many meters."""
    corners = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]])
    group = {
        "TYPE": np.array([2.0]),
        "CORNERS": corners.ravel() / unit_scale,
        "ORIGIN": np.array([0.0, 0.0, -0.04]) / unit_scale,
        "CHANNEL": np.arange(1.0, 7.0),
    }
    units = ("N", "N", "N", "Nm", "Nm", "Nm")
    return RawC3d(
        groups={"FORCE_PLATFORM": group, "ANALOG": {"UNITS": units}},
        first_frame=1,
        point_rate=100.0,
        analog_rate=100.0,
        points=np.zeros((5, 0, 3)),
        residuals=np.zeros((5, 0)),
        analog=np.ones((5, 6)),
    )


@pytest.mark.parametrize("scale", [1e-3, 1e-2, 1.0])
@pytest.mark.parametrize("stated", [1e-3, 1e-2, 1.0])
def test_a_plate_is_of_the_size_of_plates(scale, stated):
    notes = []
    (plate,) = plate_recordings(_plates(scale), stated, notes)
    edges = np.linalg.norm(np.diff(plate.corners, axis=0), axis=1)
    np.testing.assert_allclose(edges, [0.6, 0.4, 0.6], atol=1e-9)
    assert len(notes) == (scale != stated)
    assert all("force plates would be" in note for note in notes)


def test_plates_of_any_usual_size_are_left_as_the_file_says():
    raw = _plates(1.0)
    for factor in (0.4, 1.0, 4.0, 6.0):
        group = dict(raw.groups["FORCE_PLATFORM"])
        group["CORNERS"] = group["CORNERS"] * factor
        notes = []
        changed = replace(raw, groups={**raw.groups, "FORCE_PLATFORM": group})
        (plate,) = plate_recordings(changed, 1.0, notes)
        assert np.ptp(plate.corners[:, 0]) == pytest.approx(0.6 * factor)
        assert not notes
