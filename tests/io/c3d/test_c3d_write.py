"""What is written as C3D is read again, by ezc3d and by Myomorph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.c3d.raw import read_raw_c3d
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.c3d.write import write_c3d, write_trial
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Analog, Event, Markers, PlateRecording, Trial


@pytest.fixture
def recording() -> tuple[Markers, PlateRecording]:
    random = np.random.default_rng(0)
    markers = Markers(np.arange(20) / 200.0, ("one", "two"), random.standard_normal((20, 2, 3)))
    corners = np.array([[0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0], [0.2, -0.3, 0.0]])
    plate = PlateRecording(
        name="plate",
        kind=2,
        corners=corners,
        origin=np.array([0.0, 0.0, -0.04]),
        channels=random.standard_normal((200, 6)),
    )
    return markers, plate


def test_round_trip(recording, tmp_path):
    markers, plate = recording
    write_c3d(tmp_path / "one.c3d", markers, plate)
    found = read_c3d(tmp_path / "one.c3d")
    assert found.markers.names == markers.names
    np.testing.assert_allclose(found.markers.time, markers.time, atol=1e-9)
    np.testing.assert_allclose(found.markers.values, markers.values, atol=1e-6)
    (again,) = found.plate_recordings
    np.testing.assert_allclose(again.channels, plate.channels, atol=1e-5)
    np.testing.assert_allclose(again.corners, plate.corners, atol=1e-6)
    np.testing.assert_allclose(again.origin, plate.origin, atol=1e-6)


def test_moments_in_newton_millimeters_are_told_by_where_they_put_the_force(recording, tmp_path):
    """As Vicon 370 wrote them, although its own unit says N m.

    A force near the plate's middle or edge is left as it is.
    """
    markers, plate = recording
    channels = np.zeros((200, 6))
    channels[:, 2] = -700.0
    channels[:, 3:5] = np.random.default_rng(1).uniform(-100.0, 100.0, (200, 2))
    path = tmp_path / "one.c3d"
    write_c3d(path, markers, replace(plate, channels=channels))
    right = read_c3d(path)
    path.write_bytes(path.read_bytes().replace(b"Nmm", b"Nm "))
    repaired = read_c3d(path)
    np.testing.assert_allclose(right.plate_recordings[0].channels, channels, atol=1e-4)
    np.testing.assert_allclose(repaired.plate_recordings[0].channels, channels, atol=1e-4)
    assert not right.warnings
    assert "taken as N mm" in repaired.warnings[0]


def test_what_cannot_be_written_is_named(recording, tmp_path):
    markers, plate = recording
    few = PlateRecording(
        name="plate",
        kind=2,
        corners=plate.corners,
        origin=plate.origin,
        channels=plate.channels[:10],
    )
    with pytest.raises(BadData, match="10 samples for 20 frames"):
        write_c3d(tmp_path / "few.c3d", markers, few)
    with pytest.raises(BadFile, match="cannot be written"):
        write_c3d(tmp_path / "nowhere" / "one.c3d", markers)


FILES = (
    "c3d-opensim-walking/walking2.c3d",
    "knee-implant-walk/walk1.c3d",
    "c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d",
    "c3d-functional-joints/static.c3d",
    "c3d-vendor-samples/C3DSamples/c3d.org/sample10/TYPE-4.C3D",
    "c3d-vendor-samples/C3DSamples/c3d.org/sample28/type1.C3D",
)


@pytest.mark.parametrize("name", FILES)
def test_recordings_of_laboratories_are_written_and_read_again(name, data, tmp_path):
    """Markers, hidden ones too, plates, other channels and events of real files.

    They agree to the precision of a 32-bit real.
    """
    trial = read_c3d(data(name))
    write_trial(tmp_path / "again.c3d", trial)
    again = read_c3d(tmp_path / "again.c3d")
    assert not [text for text in again.warnings if "not finite" not in text]
    assert again.markers.names == trial.markers.names
    assert again.events == trial.events
    np.testing.assert_allclose(again.markers.time, trial.markers.time, atol=1e-9)
    np.testing.assert_allclose(again.markers.values, trial.markers.values, rtol=1e-6, atol=2e-7)
    for one, other in zip(trial.plate_recordings, again.plate_recordings, strict=True):
        channels = one.channels if one.calibration is None else one.channels @ one.calibration.T
        np.testing.assert_allclose(other.channels, channels, rtol=1e-6, atol=2e-5)
        np.testing.assert_allclose(other.corners, one.corners, atol=1e-6)
    plates = {label for one in trial.plate_recordings for label in one.channel_names}
    for label in set(trial.analog.names) - plates:
        np.testing.assert_allclose(again.analog[label], trial.analog[label], rtol=1e-6, atol=1e-9)
    own = read_raw_c3d(tmp_path / "again.c3d")
    np.testing.assert_allclose(own.points / 1000.0, again.markers.values, atol=1e-9)


def test_many_labels_long_recordings_and_late_starts(tmp_path):
    """More labels than one parameter holds, and frames beyond 16 bits.

    The first frame is not number 1.
    """
    random = np.random.default_rng(1)
    names = tuple(f"marker_{k}" for k in range(300))
    markers = Markers(2.5 + np.arange(12) / 120.0, names, random.standard_normal((12, 300, 3)))
    channels = tuple(f"emg_{k}" for k in range(270))
    time = 2.5 + np.arange(48) / 480.0
    analog = Analog(time, channels, random.standard_normal((48, 270)), units=("V",) * 270)
    events = (Event(2.52, "Foot Strike", "Left"), Event(2.57, "Foot Off", "Right"))
    trial = Trial(markers=markers, analog=analog, plate_time=time, events=events)
    write_trial(tmp_path / "many.c3d", trial)
    again = read_c3d(tmp_path / "many.c3d")
    assert again.markers.names == names
    assert again.analog.names == channels
    np.testing.assert_allclose(again.markers.time, markers.time, atol=1e-9)
    np.testing.assert_allclose(again.markers.values, markers.values, atol=1e-6)
    np.testing.assert_allclose(again.analog.values, analog.values, rtol=1e-6, atol=1e-7)
    assert [(one.label, one.side) for one in again.events] == [
        (one.label, one.side) for one in events
    ]
    np.testing.assert_allclose(
        [one.time for one in again.events], [one.time for one in events], atol=1e-5
    )
    long = Markers(np.arange(70_000) / 1000.0, ("one",), random.standard_normal((70_000, 1, 3)))
    write_c3d(tmp_path / "long.c3d", long)
    assert len(read_c3d(tmp_path / "long.c3d").markers) == 70_000
