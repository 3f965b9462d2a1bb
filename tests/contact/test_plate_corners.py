"""A plate whose corners are counted from the wrong one.

It is rotated back under what stands on it; other plates stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.plates import (
    FirstCorner,
    _middle,
    counted_from,
    first_corner,
    force_plates,
    loaded_samples,
)
from myomorph.core.model.arrays import runs
from myomorph.core.model.series import ForcePlate, Markers, PlateRecording, Trial
from myomorph.core.model.spatial import axis_rotation
from myomorph.lab.study.inputs.reading import read_recording

CORNERS = np.array([[-0.07, 0.06, 0.0], [0.08, 0.06, 0.0], [0.08, -0.09, 0.0], [-0.07, -0.09, 0.0]])
TIME = np.arange(1500) / 1000.0


def crossing(shift=0, scale=1.0, off=0.0):
    """Simulate a mouse of 0.2 N that walks along y over a plate.

    The plate's file counts the corners `shift` from the wrong one.
    """
    load = np.where((TIME > 0.4) & (TIME < 1.1), 0.2, 0.0) * scale
    place = np.stack([np.full_like(TIME, 0.03), -0.08 + 0.1 * TIME, np.zeros_like(TIME)], axis=1)
    x = CORNERS[0] - CORNERS[1]
    y = CORNERS[0] - CORNERS[3]
    axes = np.stack([x / np.linalg.norm(x), y / np.linalg.norm(y), [0.0, 0.0, -1.0]], axis=1)
    force = np.stack([0.1 * load, -0.05 * load, load], axis=1)
    own = force @ axes
    moment = np.cross((place - CORNERS.mean(axis=0)) @ axes, own)
    noise = 1e-3 * scale * np.random.default_rng(2).normal(size=(len(TIME), 3))
    channels = np.concatenate([own + noise, moment], axis=1)
    recording = PlateRecording(
        name="plate_1",
        kind=2,
        corners=np.roll(CORNERS, shift, axis=0),
        origin=np.zeros(3),
        channels=channels,
    )
    seen = place[::5, None] + np.array(
        [[0.0, 0.02, 0.03], [0.01, -0.02, 0.03], [off - 0.01, 0.0, 0.02]]
    )
    markers = Markers(TIME[::5], ("a", "b", "c"), seen)
    return Trial(markers=markers, plate_recordings=(recording,), plate_time=TIME), force, place


@pytest.mark.parametrize("scale", [1.0, 4000.0])
@pytest.mark.parametrize("shift", [0, 1, 2, 3])
def test_forces_and_their_centers_come_back(shift, scale):
    """For a mouse of 20 g and a man of 80 kg alike."""
    trial, force, place = crossing(shift, scale)
    found = force_plates(trial)
    firm = (TIME > 0.45) & (TIME < 1.05)
    np.testing.assert_allclose(found.plates[0].forces[firm], force[firm], atol=6e-3 * scale)
    np.testing.assert_allclose(found.plates[0].points[firm], place[firm], atol=4e-3)
    assert any("counted from its corner" in one for one in found.warnings) == (shift != 0)


def test_counting_on_goes_round():
    plate = force_plates(crossing()[0]).plates[0]
    again = counted_from(counted_from(plate, 3), 1)
    for name in ("corners", "forces", "points", "torques"):
        np.testing.assert_allclose(getattr(again, name), getattr(plate, name), atol=1e-12)
    turned = counted_from(plate, 1)
    np.testing.assert_allclose(
        np.linalg.norm(turned.forces, axis=1), np.linalg.norm(plate.forces, axis=1)
    )


def test_what_is_not_clear_is_left_alone():
    """Markers far beside, in the plate's middle, or none: the file's order stays."""
    trial, _, _ = crossing(1)
    assert trial.markers is not None
    beside = replace(
        trial, markers=replace(trial.markers, values=trial.markers.values + [0.5, 0.0, 0.0])
    )
    for other in (beside, replace(trial, markers=None)):
        found = force_plates(other)
        np.testing.assert_array_equal(found.plates[0].corners, trial.plate_recordings[0].corners)
        assert not any("counted" in one for one in found.warnings)
    plate = force_plates(trial).plates[0]
    assert (
        first_corner(replace(plate, points=np.full_like(plate.points, np.nan)), TIME, trial.markers)
        is None
    )


@pytest.mark.parametrize(
    "name", ["1L_05_01_26_trial_1", "1R_12_01_26_trial_2", "none_12_01_26_trial_3"]
)
def test_mice_on_a_small_plate(data, name):
    """A quarter of a newton is a load.

    Contact is where the animal is, and the forces are those of a mouse.
    """
    trial = read_recording(data(f"mouse-gait-c3d-force/Cage6_{name}.c3d"))
    plate = trial.plates[0]
    found = first_corner(plate, trial.plate_time, trial.markers)
    assert found is not None
    assert found.best == 0
    assert found.distances[0] < 0.03
    assert any("counted from its corner 2" in one for one in trial.warnings)
    pressing = plate.forces[:, 2]
    spells = [(a, b) for a, b in runs(loaded_samples([plate], 1000.0)[0]) if b - a > 200]
    first, last = spells[0]
    assert 0.4 < (last - first) / 1000.0 < 1.1
    assert 0.2 < pressing[first:last].max() < 0.35
    # Mice weigh 15 to 45 g; no more than all of one stands on the plate on average.
    assert 0.1 < pressing[first:last].mean() < 0.45
    quiet = np.ones(len(pressing), bool)
    for start, stop in runs(loaded_samples([plate], 1000.0)[0]):
        quiet[max(start - 50, 0) : stop + 50] = False
    assert np.abs(pressing[quiet]).max() < 0.05


RATE = 64.0
"""A power of two: times of frames, and half of what is between them, are exact."""


def seen_at(times, values):
    """Sample two markers on either side of a path (frames, 3) at these times.

    They are NaN where they are not visible.
    """
    beside = np.array([[0.1, 0.0, 0.02], [-0.1, 0.0, -0.02]])
    return Markers(np.asarray(times), ("a", "b"), np.asarray(values)[:, None] + beside)


def straight(time):
    """Return a point (samples, 3) that moves along a line."""
    return np.array([0.2, -0.1, 1.0]) + np.multiply.outer(time, [1.3, -0.4, 0.05])


def test_the_middle_of_markers_on_a_line_comes_back_at_the_plate_s_times():
    clock = np.arange(65) / RATE
    plate = np.linspace(0.0, 1.0, 641)
    np.testing.assert_allclose(
        _middle(seen_at(clock, straight(clock)), plate), straight(plate), atol=1e-12
    )
    # Frames without any marker do not count, and one marker that is lost leaves the other.
    values = np.array(seen_at(clock, straight(clock)).values)
    values[::2] = np.nan
    values[1::4, 0] = np.nan
    values[1::4, 1] -= [-0.1, 0.0, -0.02]
    found = _middle(
        Markers(clock, ("a", "b"), values), plate[(plate > 1.0 / RATE) & (plate < 63.0 / RATE)]
    )
    known = np.isfinite(found).all(axis=1)
    assert known.all()
    np.testing.assert_allclose(
        found, straight(plate[(plate > 1.0 / RATE) & (plate < 63.0 / RATE)]), atol=1e-12
    )


def test_the_middle_is_known_up_to_one_and_a_half_frames_from_a_marker_that_was_seen():
    clock = np.arange(128) / RATE
    path = straight(clock)
    path[40:60] = np.nan
    markers = seen_at(clock, path)
    inside = 1.49 / RATE
    beyond = 1.51 / RATE
    last = clock[39]
    first = clock[60]
    start = clock[0]
    end = clock[-1]
    known = np.array([last + inside, first - inside, start - inside, end + inside])
    unknown = np.array(
        [last + beyond, last + 1.5 / RATE, 0.5 * (last + first), first - beyond, start - beyond]
    )
    found = _middle(markers, np.concatenate([known, unknown, [end + beyond]]))
    assert np.isfinite(found[:4]).all()
    assert np.isnan(found[4:]).all()
    np.testing.assert_allclose(found[:2], straight(known[:2]), atol=1e-12)


def test_one_frame_of_markers_tells_nothing():
    clock = np.arange(20) / RATE
    path = np.full((20, 3), np.nan)
    path[7] = straight(clock[7:8])
    assert np.isnan(_middle(seen_at(clock, path), clock)).all()
    path[8] = straight(clock[8:9])
    np.testing.assert_array_equal(
        np.isfinite(_middle(seen_at(clock, path), clock))[:, 0].nonzero()[0], [6, 7, 8, 9]
    )


def test_distances_are_those_of_a_center_turned_by_quarters_about_the_plate_s_middle():
    """A square plate, standing obliquely in the laboratory.

    The body is 3 cm above the true center of pressure.
    """
    rotation = axis_rotation(np.array([0.36, 0.48, 0.8]), 0.7)
    center = np.array([0.4, -0.3, 0.2])
    square = 0.3 * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0.0]])
    corners = center + square @ rotation.T
    normal = np.cross(corners[0] - corners[1], corners[0] - corners[3])
    normal /= np.linalg.norm(normal)
    time = np.arange(256) / RATE
    own = np.stack([0.2 * np.cos(time), 0.1 * np.sin(3.0 * time), 0.0 * time], axis=1) + [
        0.05,
        0.02,
        0.0,
    ]
    points = center + own @ rotation.T
    forces = np.multiply.outer(np.full(len(time), 500.0), normal)
    plate = ForcePlate(
        name="plate",
        kind=2,
        corners=corners,
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )
    for turns in range(4):
        quarter = axis_rotation(normal, 0.5 * np.pi * turns)
        body = center + (points - center) @ quarter.T + 0.03 * normal
        found = first_corner(plate, time, seen_at(time, body))
        away = [
            (points - center) @ (axis_rotation(normal, 0.5 * np.pi * k) - quarter).T
            for k in range(4)
        ]
        wanted = [float(np.median(np.linalg.norm(one, axis=1))) for one in away]
        np.testing.assert_allclose(found.distances, wanted, atol=1e-9)
        assert found.best == turns
        assert found.clear == (turns != 0)
        np.testing.assert_allclose(
            counted_from(plate, found.best).points, body - 0.03 * normal, atol=1e-9
        )


@pytest.mark.parametrize(
    ("distances", "best", "clear"),
    [
        ((1.0, 0.249, 0.9, 0.9), 1, True),
        ((1.0, 0.251, 0.9, 0.9), 1, False),
        ((1.0, 0.2, 0.41, 0.9), 1, True),
        ((1.0, 0.2, 0.39, 0.9), 1, False),
        ((0.1, 0.9, 0.9, 0.9), 0, False),
        ((1.0, 0.25, 0.9, 0.9), 1, False),
    ],
)
def test_another_corner_is_clear_only_where_much_nearer_than_the_file_s_and_the_next(
    distances, best, clear
):
    assert FirstCorner(distances, best).clear == clear


def test_samples_count_from_a_share_of_the_largest_force_and_from_a_least_number():
    """Light samples, whose center of pressure is wrong, do not count.

    They are light from 30 % of the load downwards.
    """
    time = np.arange(128) / RATE
    corners = 0.3 * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0.0]])
    body = np.tile([0.1, 0.05, 0.0], (len(time), 1))
    for share, counted in ((0.305, True), (0.295, False)):
        size = np.full(len(time), share)
        size[:40] = 1.0
        points = np.where((size < 1.0)[:, None], [-0.2, 0.2, 0.0], body)
        plate = ForcePlate(
            name="plate",
            kind=2,
            corners=corners,
            forces=np.outer(size, [0.0, 0.0, 700.0]),
            points=points,
            torques=np.zeros((len(time), 3)),
        )
        found = first_corner(plate, time, seen_at(time, body))
        assert (found.distances[0] > 0.1) == counted
    for count in (19, 20):
        few = np.where(np.arange(len(time))[:, None] < count, body, np.nan)
        plate = ForcePlate(
            name="plate",
            kind=2,
            corners=corners,
            forces=np.tile([0.0, 0.0, 700.0], (len(time), 1)),
            points=few,
            torques=np.zeros((len(time), 3)),
        )
        assert (first_corner(plate, time, seen_at(time, body)) is not None) == (count >= 20)
