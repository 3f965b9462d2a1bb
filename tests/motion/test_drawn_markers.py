"""Paths that a program drew over a gap are found and filled; markers that rest are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.test_marker_checks import RECORDINGS

from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.drawn_markers import drawn_findings
from myomorph.core.motion.gap_filling import carried_path
from myomorph.core.motion.marker_checks import checked_kinematics
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.lab.study.inputs.reading import fitted_to, open_model, read_recording
from stick_figure import stick_figure

MARKERS = {"knee": "LShankLateral", "gait2354": "R.Shank.Front"}
# Frames in which the shank moves: while it stands, a marker that stays is not told from skin.
STRETCHES = {"knee": slice(60, 85), "gait2354": slice(30, 55)}


@pytest.fixture(params=RECORDINGS)
def walk(request, data):
    """Open a scaled model, a clean walk of 90 frames, and a marker of it."""
    model, recording = map(data, RECORDINGS[request.param])
    body = open_model(model)
    markers = fitted_to(body, read_recording(recording)).markers
    markers = replace(markers, time=markers.time[:90], values=markers.values[:90])
    return body, markers, MARKERS[request.param], STRETCHES[request.param]


def _changed(markers, name, stretch, path):
    values = np.array(markers.values)
    values[stretch, markers.names.index(name)] = path
    return replace(markers, values=values)


@pytest.mark.parametrize("kind", ["frozen", "line"])
def test_a_drawn_path_is_filled_by_the_body(walk, kind):
    model, markers, name, stretch = walk
    true = markers[name]
    before = true[stretch.start - 1]
    share = np.linspace(0.0, 1.0, stretch.stop - stretch.start + 2)[1:-1, None]
    line = (1.0 - share) * before + share * true[stretch.stop]
    drawn = np.broadcast_to(before, line.shape) if kind == "frozen" else line
    found = checked_kinematics(model, _changed(markers, name, stretch, drawn))
    (finding,) = [one for one in found.findings if one.kind == "drawn path"]
    assert finding.place == name
    assert finding.repaired
    assert finding.text.severity == "good to know"
    assert finding.times[0][0] == pytest.approx(markers.time[stretch.start], abs=0.04)
    assert finding.times[0][1] == pytest.approx(markers.time[stretch.stop - 1], abs=0.04)
    left = np.linalg.norm(found.markers[name] - true, axis=1).max()
    assert left < 0.25 * np.linalg.norm(drawn - true[stretch], axis=1).max()


def test_a_clean_walk_has_no_drawn_path(walk):
    model, markers, *_ = walk
    names = [name for name in markers.names if name in model.marker_names]
    assert not list(drawn_findings(model, markers, names, 1.0))


def test_a_body_without_noise_may_rest():
    """All markers of a body stay, or go along lines together."""
    model = stick_figure()
    names = list(model.marker_names)
    time = np.arange(60) / 100.0
    values = np.zeros((60, len(model.coordinates)))
    values[20:40, 0] = np.linspace(0.0, 1.0, 20)
    values[40:, 0] = 1.0
    places = marker_positions(model, Motion(time, model.coordinate_names, values))
    markers = Markers(time, places.names, places.values)
    assert not list(drawn_findings(model, markers, names, 1.0))


def test_a_marker_keeps_its_place_on_a_body_that_turns():
    """Three others show the turn exactly."""
    time = np.arange(40) / 100.0
    angle = 0.5 * np.sin(7.0 * time)
    turns = np.stack(
        [
            np.stack([np.cos(angle), -np.sin(angle), 0.0 * angle], axis=1),
            np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1),
            np.tile([0.0, 0.0, 1.0], (40, 1)),
        ],
        axis=1,
    )
    origin = np.stack([time, time**2, 0.1 * time], axis=1)
    places = np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1], [0.2, 0.1, -0.1]])
    paths = origin[:, None] + np.einsum("fij,mj->fmi", turns, places)
    filled = carried_path(time, paths[:, 3], paths[:, :3], 10, 30)
    np.testing.assert_allclose(filled, paths[10:30, 3], atol=1e-12)
