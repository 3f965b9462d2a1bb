"""Frames of recordings from their first bytes: what the readers find in the whole file."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.frame_count import FrameCount, count_frames
from myomorph.core.io.trc import read_trc, write_trc
from myomorph.core.model.series import Markers


def markers(frames, rate=100.0):
    values = np.random.default_rng(1).normal(size=(frames, 12, 3))
    return Markers(np.arange(frames) / rate, tuple(f"m{index}" for index in range(12)), values)


@pytest.mark.parametrize("frames", [2, 50, 3000])
def test_a_trc_file(tmp_path, frames):
    write_trc(markers(frames), tmp_path / "walk.trc")
    found = count_frames(tmp_path / "walk.trc")
    assert found.frames == frames
    assert found.rate == pytest.approx(100.0)


def test_a_header_that_promises_more_than_there_is(tmp_path):
    path = tmp_path / "cut.trc"
    write_trc(markers(1000), path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:200]))
    assert count_frames(path).frames == pytest.approx(len(read_trc(path).markers), abs=3)


def test_a_part_of_a_recording():
    count = FrameCount(500, 100.0)
    assert count.within(None) == 500
    assert count.within((1.0, 2.0)) == 101
    assert count.within((1.0, 90.0)) == 500
    assert FrameCount(500, 100.0, 2.0).within((1.0, 3.0)) == 101
    assert FrameCount(500, 100.0, 2.0).within((6.5, 9.0)) == 50
    assert FrameCount(500, 100.0, 2.0).within((8.0, 9.0)) == 0
    assert FrameCount(500).within((1.0, 2.0)) == 500
    assert FrameCount().within((1.0, 2.0)) is None


@pytest.mark.parametrize("name", ["walk.trc", "walk.c3d", "walk.h5", "walk.mat"])
@pytest.mark.parametrize("content", [b"", b"\0" * 2000, b"DataRate\n" * 40, b"Frame#\tTime\tA\n"])
def test_what_is_damaged_tells_nothing(tmp_path, name, content):
    assert count_frames(tmp_path / name) == FrameCount()
    (tmp_path / name).write_bytes(content)
    assert count_frames(tmp_path / name) == FrameCount()


def test_a_c3d_file_that_claims_nonsense(tmp_path):
    path = tmp_path / "walk.c3d"
    path.write_bytes(b"\x02P" + b"\xff" * 3000)
    found = count_frames(path)
    assert found.frames is None or found.frames > 0


@pytest.mark.parametrize(
    ("name", "frames"),
    [
        ("rajagopal-walk-emg/markers_walk.trc", 238),
        ("c3d-opensim-walking/walking2.c3d", 1249),
        ("mouse-skeleton-keypoints/mouse_mocap_3600_frames.h5", 3600),
    ],
)
def test_recordings(data, name, frames):
    assert count_frames(data(name)).frames == frames
