"""Data that sensors lost are missing: held samples, drawn lines, gaps of files and of clocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.inertial_sensors import InertialSensors, beside, steady
from myomorph.core.model.spatial import quaternion_from_rotation, rotation_from_vector
from myomorph.core.motion.sensors.dropouts import gaps_filled, without_dropouts
from myomorph.core.motion.sensors.mounting import rotations_at, with_orientations
from stick_figure import stick_figure
from truths.simulated_sensors import raw_signals

LOST = slice(400, 700)
"""Frames of three seconds."""


@pytest.fixture(scope="module")
def turning():
    """Two sensors that turn, with the noise that all sensors have."""
    time = np.arange(0.0, 20.0, 0.01)
    phases = np.array([[0.0, 1.0, 2.0], [3.0, 0.5, 4.0]])
    vectors = 0.6 * np.sin(time[:, None, None] * np.array([1.3, 0.9, 1.7]) + phases)
    noise = 2e-5 * np.random.default_rng(0).normal(size=vectors.shape).cumsum(axis=0)
    rotations = rotation_from_vector(vectors + noise)
    return InertialSensors(time, ("a", "b"), quaternion_from_rotation(rotations))


def changed(sensors, values):
    """Replace the orientations of the second sensor while it is lost."""
    quaternions = np.array(sensors.orientations)
    quaternions[LOST, 1] = values(quaternions[:, 1])
    return replace(sensors, orientations=quaternions)


def held(quaternions):
    return quaternions[LOST.start]


def line(quaternions):
    quaternions = steady(quaternions)
    share = np.linspace(0.0, 1.0, LOST.stop - LOST.start)[:, None]
    drawn = (1.0 - share) * quaternions[LOST.start] + share * quaternions[LOST.stop]
    return drawn / np.linalg.norm(drawn, axis=1)[:, None]


@pytest.mark.parametrize("values", [held, line])
def test_samples_that_repeat_are_missing(turning, values):
    found = without_dropouts(changed(turning, values))
    missing = np.isnan(found.orientations).any(axis=2)
    assert not missing[:, 0].any()
    assert missing[LOST, 1].mean() > 0.95
    assert missing[:, 1].sum() <= LOST.stop - LOST.start + 2
    (note,) = found.warnings
    assert note.place == "b"
    assert note.times[0][0] == pytest.approx(turning.time[LOST.start], abs=0.03)


def test_a_body_that_stands_still_has_lost_nothing(turning):
    assert without_dropouts(turning) is turning
    still = replace(turning, orientations=np.tile(turning.orientations[:1], (len(turning), 1, 1)))
    assert without_dropouts(still) is still


def test_raw_samples_that_repeat_are_missing(turning):
    raw = raw_signals(turning, 100.0)
    stuck = np.array(raw.angular_velocities), np.array(raw.accelerations), raw.magnetic_fields
    for part in stuck[:2]:
        part[LOST, 1] = part[LOST.start, 1]
    fields = np.array(stuck[2])
    fields[LOST, 1] = fields[LOST.start, 1]
    held_raw = replace(
        raw, angular_velocities=stuck[0], accelerations=stuck[1], magnetic_fields=fields
    )
    found = without_dropouts(held_raw)
    assert np.isnan(found.angular_velocities[LOST, 1]).mean() > 0.95
    assert np.isfinite(found.angular_velocities[:, 0]).all()
    assert without_dropouts(raw) is raw


def test_long_gaps_are_empty_and_short_ones_bridged(turning):
    model = stick_figure()
    kept = np.ones(len(turning), dtype=bool)
    kept[LOST] = False
    kept[1000:1003] = False
    torn = turning.frames(kept)
    rotations = rotations_at(torn, turning.time, model)
    empty = np.isnan(rotations).any(axis=(1, 2, 3))
    assert empty[LOST].all()
    assert not np.delete(empty, np.arange(LOST.start, LOST.stop)).any()
    whole = rotations_at(turning, turning.time, model)
    np.testing.assert_allclose(rotations[1000:1003], whole[1000:1003], atol=1e-3)
    # One sensor alone, whose file lacks packets.
    parts = [turning.only(["a"]), turning.only(["b"]).frames(kept)]
    together = beside(parts)
    assert np.isnan(together.orientations[LOST, 1]).all()
    assert np.isfinite(together.orientations[:, 0]).all()


def test_a_clock_with_gaps_is_filled(turning):
    time = np.delete(turning.time, np.arange(LOST.start, LOST.stop))
    np.testing.assert_allclose(gaps_filled(time), turning.time, atol=1e-9)
    assert gaps_filled(turning.time) is not None
    np.testing.assert_array_equal(gaps_filled(turning.time), turning.time)


def test_magnetic_fields_are_left_out_of_orientations_too(turning):
    """A file with both: without magnetic fields its orientations are computed anew."""
    pytest.importorskip("vqf", reason="orientations of raw signals need vqf (extra sensors)")
    raw = raw_signals(turning, 100.0)
    recorded = with_orientations(raw)
    without = with_orientations(recorded, magnetometer=False)
    again = with_orientations(raw, magnetometer=False)
    np.testing.assert_array_equal(without.orientations, again.orientations)
    assert np.abs(without.orientations - recorded.orientations).max() > 0.1
    alone = with_orientations(turning, magnetometer=False)
    assert any("no raw signals" in note for note in alone.warnings)
