"""Markers are lost and found: poses without a jump."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.online import BLEND, OnlineKinematics, SteadyKinematics

FRAMES = slice(60, 130)
HIDDEN = slice(20, 40)
"""Frames of the walk, and of those the frames in which markers are hidden."""


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Markers]:
    model = read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    markers = read_trc(data("rajagopal-walk-emg/markers_walk.trc")).markers
    assert markers is not None
    return model, Markers(markers.time[FRAMES], markers.names, markers.values[FRAMES])


def _followed(
    model: Model, markers: Markers, hidden: tuple[str, ...] = (), frames: slice = HIDDEN
) -> np.ndarray:
    """Return (frames, coordinates) with some markers hidden in some frames.

    All of them are hidden where none is named.
    """
    positions = np.array(markers.values)
    columns = [markers.names.index(name) for name in hidden] or list(range(len(markers.names)))
    for column in columns:
        positions[frames, column] = np.nan
    steady = SteadyKinematics(model, markers.names)
    return np.array(
        [
            steady.solve(float(t), row).coordinates
            for t, row in zip(markers.time, positions, strict=True)
        ]
    )


def left(frames: int) -> float:
    """Share of a jump that a critically damped spring has left."""
    x = 0.01 * frames / BLEND
    return float((1.0 + x) * np.exp(-x))


def _steps(values: np.ndarray) -> np.ndarray:
    """(frames - 2, coordinates) second differences: a jump shows, a steady motion does not."""
    return np.abs(np.diff(values, 2, axis=0))


def test_with_all_markers_it_is_inverse_kinematics(walk: tuple[Model, Markers]) -> None:
    model, markers = walk
    batch = inverse_kinematics(model, markers).motion.values
    np.testing.assert_allclose(_followed(model, markers, (), slice(0, 0)), batch, atol=3e-5)


@pytest.mark.parametrize("hidden", [("R.Knee",), ("R.SH1", "R.SH2", "R.Ankle"), ("R.ASIS", "S2")])
def test_markers_that_come_and_go_make_no_jump(
    walk: tuple[Model, Markers], hidden: tuple[str, ...]
) -> None:
    """Where plain inverse kinematics jumps, this goes on steadily.

    It agrees with the result when nothing is hidden to 0.3 degrees.
    """
    model, markers = walk
    free = _followed(model, markers, (), slice(0, 0))
    found = _followed(model, markers, hidden)
    plain = OnlineKinematics(model, markers.names)
    positions = np.array(markers.values)
    positions[HIDDEN, [[markers.names.index(name)] for name in hidden]] = np.nan
    jumping = np.array(
        [plain.solve(float(t), row)[0] for t, row in zip(markers.time, positions, strict=True)]
    )
    for event in (HIDDEN.start, HIDDEN.stop):
        at = event - 2
        excess = _steps(found)[at] - _steps(free)[at]
        assert excess.max() < np.deg2rad(0.3)
        assert excess.max() < 0.5 * (_steps(jumping)[at] - _steps(free)[at]).max()


def test_after_the_blend_it_is_as_if_nothing_had_been_hidden(walk: tuple[Model, Markers]) -> None:
    model, markers = walk
    free = _followed(model, markers, (), slice(0, 0))
    found = _followed(model, markers, ("R.Knee", "R.SH1", "R.ASIS"), slice(10, 25))
    away = np.abs(found - free).max(axis=1)
    assert away[15] > 1e-3
    assert away[-1] < 2.0 * left(len(free) - 1 - 25) * away.max() + 1e-5


def test_what_no_marker_shows_keeps_its_value(walk: tuple[Model, Markers]) -> None:
    """Without the forearm's and hand's markers, elbow and forearm stay.

    The rest of the body walks on.
    """
    model, markers = walk
    bodies = {one.name: one.body for one in model.markers}
    lost = tuple(
        name
        for name in markers.names
        if bodies.get(name) in ("ulna_r", "radius_r", "hand_r") or name == "R.Elbow"
    )
    assert len(lost) >= 2
    found = _followed(model, markers, lost)
    elbow = model.coordinate_names.index("elbow_flex_r")
    hip = model.coordinate_names.index("hip_flexion_r")
    # Once the jump is given back, nothing moves it.
    settled = found[HIDDEN.start + 15 : HIDDEN.stop]
    assert np.ptp(settled[:, elbow]) < np.deg2rad(0.5)
    assert np.ptp(settled[:, hip]) > np.deg2rad(1.0)


def test_without_any_marker_the_body_is_held_and_found_again_without_a_jump(
    walk: tuple[Model, Markers],
) -> None:
    model, markers = walk
    free = _followed(model, markers, (), slice(0, 0))
    found = _followed(model, markers)
    held = found[HIDDEN.start - 1]
    np.testing.assert_array_equal(found[HIDDEN], np.tile(held, (HIDDEN.stop - HIDDEN.start, 1)))
    np.testing.assert_allclose(found[HIDDEN.stop], held, atol=1e-9)
    assert (
        np.abs(np.diff(found[HIDDEN.stop :], axis=0)).max()
        < 0.5 * np.abs(found[HIDDEN.stop + 20] - held).max()
    )
    apart = np.abs(free[HIDDEN.stop] - held).max()
    np.testing.assert_allclose(
        found[-1], free[-1], atol=2.0 * left(len(free) - 1 - HIDDEN.stop) * apart
    )


def test_a_marker_that_flickers_moves_the_body_by_less_than_the_marker_does(
    walk: tuple[Model, Markers],
) -> None:
    """Hidden in every second frame: the pose stays between those with and without the marker."""
    model, markers = walk
    free = _followed(model, markers, (), slice(0, 0))
    without = _followed(model, markers, ("R.Knee",), slice(0, None))
    flickering = _followed(model, markers, ("R.Knee",), slice(20, None, 2))
    apart = np.abs(without - free).max()
    assert np.abs(flickering - free).max() < 1.5 * apart
    assert np.abs(_steps(flickering) - _steps(free)).max() < 0.3 * apart


def test_before_any_marker_nothing_is_known(walk: tuple[Model, Markers]) -> None:
    model, markers = walk
    steady = SteadyKinematics(model, markers.names)
    frame = steady.solve(0.0, np.full((len(markers.names), 3), np.nan))
    assert frame.held
    assert np.isnan(frame.coordinates).all()
    assert np.isfinite(steady.solve(0.01, markers.values[0]).coordinates).all()
    with pytest.raises(BadData, match="above 0"):
        SteadyKinematics(model, markers.names, blend=0.0)
    with pytest.raises(BadData, match="share no marker"):
        SteadyKinematics(model, ("nobody",))
