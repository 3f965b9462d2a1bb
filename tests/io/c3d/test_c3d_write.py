"""What is written as C3D is read again; and OpenSim in the same process does not stand in the way."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.io.c3d.ezc3d import write_c3d
from myomorph.io.c3d.read import read_c3d
from myomorph.model.errors import BadData, BadFile
from myomorph.model.series import Markers, PlateRecording


@pytest.fixture
def recording() -> tuple[Markers, PlateRecording]:
    random = np.random.default_rng(0)
    markers = Markers(np.arange(20) / 200.0, ("one", "two"), random.standard_normal((20, 2, 3)))
    corners = np.array([[0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0], [0.2, -0.3, 0.0]])
    plate = PlateRecording("plate", 2, corners, np.array([0.0, 0.0, -0.04]), random.standard_normal((200, 6)))
    return markers, plate


def test_round_trip(recording, tmp_path):
    pytest.importorskip("opensim", reason="its wrapper and that of ezc3d share names: both in one process")
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


def test_what_cannot_be_written_is_named(recording, tmp_path):
    markers, plate = recording
    few = PlateRecording("plate", 2, plate.corners, plate.origin, plate.channels[:10])
    with pytest.raises(BadData, match="10 samples for 20 frames"):
        write_c3d(tmp_path / "few.c3d", markers, few)
    with pytest.raises(BadFile, match="cannot be written"):
        write_c3d(tmp_path / "nowhere" / "one.c3d", markers)
