"""Bony markers that lie elsewhere on one side, told by distances alone."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.series import Markers
from myomorph.core.motion.marker_sides import side_findings
from myomorph.lab.session.recordings import bare, look_at

RIGHT = {
    "RASI": (0.01, 0.0, 0.12),
    "RPSI": (-0.15, 0.02, 0.04),
    "RKNE": (0.0, -0.40, 0.13),
    "RANK": (-0.02, -0.80, 0.12),
    "RHEE": (-0.07, -0.85, 0.09),
    "RTOE": (0.12, -0.85, 0.10),
    "RTHI": (0.0, -0.25, 0.16),
}
RECORDING = "c3d-functional-joints/static.trc"


def walking(frames=40, seed=0):
    """Markers of a body whose sides mirror each other, which turns and walks away."""
    places = dict(RIGHT)
    places |= {f"L{name[1:]}": (x, y, -z) for name, (x, y, z) in RIGHT.items()} | {
        "CLAV": (0.05, 0.5, 0.0)
    }
    angle = np.linspace(0.0, 1.0, frames)
    c = np.cos(angle)
    s = np.sin(angle)
    zero = np.zeros(frames)
    one = np.ones(frames)
    turns = np.array([[c, zero, s], [zero, one, zero], [-s, zero, c]]).transpose(2, 0, 1)
    values = np.einsum("fij,mj->fmi", turns, np.array(list(places.values())))
    values[:, :, 0] += np.linspace(0.0, 3.0, frames)[:, None]
    values += 0.002 * np.random.default_rng(seed).standard_normal(values.shape)
    return Markers(np.arange(frames) / 100.0, tuple(places), values)


def moved(markers, name, towards, distance=0.05):
    i = markers.names.index(name)
    j = markers.names.index(towards)
    values = np.array(markers.values)
    way = values[:, j] - values[:, i]
    values[:, i] += distance * way / np.linalg.norm(way, axis=1, keepdims=True)
    return replace(markers, values=values)


def found(markers):
    return list(side_findings(markers, markers.names))


def test_a_body_whose_sides_mirror_each_other_has_no_misplaced_marker():
    assert found(walking()) == []


@pytest.mark.parametrize(
    ("name", "towards"), [("LKNE", "LANK"), ("RANK", "RKNE"), ("LASI", "LPSI"), ("RTOE", "RHEE")]
)
def test_a_misplaced_marker_is_named_with_its_pair_and_size(name, towards):
    (finding,) = found(moved(walking(), name, towards))
    assert finding.kind == "displaced marker"
    assert f"'{name}'" in finding.text.split(" lies ")[0]
    assert "cm apart" in finding.text


def test_points_of_the_skin_may_lie_anywhere():
    assert found(moved(walking(), "LTHI", "LKNE", 0.1)) == []


def test_a_small_difference_is_none():
    assert found(moved(walking(), "LKNE", "LANK", 0.02)) == []


def test_the_tolerance_shrinks_with_the_body():
    markers = moved(walking(), "LKNE", "LANK", 0.02)
    assert list(side_findings(markers, markers.names, 0.5))


def test_markers_that_nobody_uses_and_recordings_without_frames_say_nothing():
    markers = moved(walking(), "LKNE", "LANK")
    assert list(side_findings(markers, [name for name in markers.names if name != "LKNE"])) == []
    assert found(Markers(np.zeros(0), markers.names, np.zeros((0, len(markers.names), 3)))) == []


@pytest.fixture(scope="module")
def recording(data):
    one = look_at(data(RECORDING))
    markers = one.laboratory.trial(one.trial).markers
    return replace(markers, names=tuple(map(bare, markers.names)))


def test_a_real_body_has_none_until_a_marker_is_moved(recording):
    assert found(recording) == []
    (finding,) = found(moved(recording, "RLFE", "RGT"))
    assert "'RLFE'" in finding.text


def test_the_distances_told_are_those_of_the_markers_named():
    markers = moved(walking(), "RANK", "RKNE")
    (finding,) = found(markers)
    told = re.search(
        r"'(\w+)' and '(\w+)' are ([\d.]+) cm apart, '(\w+)' and '(\w+)' ([\d.]+) cm", finding.text
    )
    for first, other, length in (told.groups()[:3], told.groups()[3:]):
        apart = np.linalg.norm(markers[first] - markers[other], axis=1)
        assert float(length) == pytest.approx(100.0 * np.median(apart), abs=0.15)
