"""A plate whose corners are counted from the wrong one is turned back under what stands on it; others stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.contact.plate_corners import counted_from, first_corner
from myomorph.contact.plates import episodes, force_plates, loaded_samples
from myomorph.model.series import Markers, PlateRecording, Trial
from myomorph.study.trial.inputs import open_trial

CORNERS = np.array([[-0.07, 0.06, 0.0], [0.08, 0.06, 0.0], [0.08, -0.09, 0.0], [-0.07, -0.09, 0.0]])
TIME = np.arange(1500) / 1000.0


def crossing(shift=0, scale=1.0, off=0.0):
    """A mouse of 0.2 N that walks along y over a plate, whose file counts the corners `shift` from the wrong one."""
    load = np.where((TIME > 0.4) & (TIME < 1.1), 0.2, 0.0) * scale
    place = np.stack([np.full_like(TIME, 0.03), -0.08 + 0.1 * TIME, np.zeros_like(TIME)], axis=1)
    x, y = CORNERS[0] - CORNERS[1], CORNERS[0] - CORNERS[3]
    axes = np.stack([x / np.linalg.norm(x), y / np.linalg.norm(y), [0.0, 0.0, -1.0]], axis=1)
    force = np.stack([0.1 * load, -0.05 * load, load], axis=1)
    own = force @ axes
    moment = np.cross((place - CORNERS.mean(axis=0)) @ axes, own)
    noise = 1e-3 * scale * np.random.default_rng(2).normal(size=(len(TIME), 3))
    channels = np.concatenate([own + noise, moment], axis=1)
    recording = PlateRecording("plate_1", 2, np.roll(CORNERS, shift, axis=0), np.zeros(3), channels)
    seen = place[::5, None] + np.array([[0.0, 0.02, 0.03], [0.01, -0.02, 0.03], [off - 0.01, 0.0, 0.02]])
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
    np.testing.assert_allclose(np.linalg.norm(turned.forces, axis=1), np.linalg.norm(plate.forces, axis=1))


def test_what_is_not_clear_is_left_alone():
    """Markers far beside, in the plate's middle, or none: the file's order stays."""
    trial, _, _ = crossing(1)
    assert trial.markers is not None
    beside = replace(trial, markers=replace(trial.markers, values=trial.markers.values + [0.5, 0.0, 0.0]))
    for other in (beside, replace(trial, markers=None)):
        found = force_plates(other)
        np.testing.assert_array_equal(found.plates[0].corners, trial.plate_recordings[0].corners)
        assert not any("counted" in one for one in found.warnings)
    plate = force_plates(trial).plates[0]
    assert first_corner(replace(plate, points=np.full_like(plate.points, np.nan)), TIME, trial.markers) is None


@pytest.mark.parametrize("name", ["1L_05_01_26_trial_1", "1R_12_01_26_trial_2", "none_12_01_26_trial_3"])
def test_mice_on_a_small_plate(data, name):
    """A quarter of a newton is a load: contact is where the animal is, and the forces are those of a mouse."""
    trial = open_trial(data(f"mouse-gait-c3d-force/Cage6_{name}.c3d"))
    plate = trial.plates[0]
    found = first_corner(plate, trial.plate_time, trial.markers)
    assert found is not None
    assert found.best == 0
    assert found.distances[0] < 0.03
    assert any("counted from its corner 2" in one for one in trial.warnings)
    pressing = plate.forces[:, 2]
    spells = [(a, b) for a, b in episodes(loaded_samples([plate], 1000.0)[0]) if b - a > 200]
    first, last = spells[0]
    assert 0.4 < (last - first) / 1000.0 < 1.1
    assert 0.2 < pressing[first:last].max() < 0.35
    # Mice weigh 15 to 45 g; no more than all of one stands on the plate on average.
    assert 0.1 < pressing[first:last].mean() < 0.45
    quiet = np.ones(len(pressing), bool)
    for start, stop in episodes(loaded_samples([plate], 1000.0)[0]):
        quiet[max(start - 50, 0) : stop + 50] = False
    assert np.abs(pressing[quiet]).max() < 0.05
