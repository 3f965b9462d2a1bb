"""Orientations of raw signals by the filter, compared with the motion behind the signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.spatial import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)
from myomorph.core.motion.sensors.mounting import rotations_at, with_orientations
from stick_figure import stick_figure
from truths.simulated_sensors import raw_signals

pytest.importorskip("vqf", reason="orientations of raw signals need vqf (extra sensors)")


@pytest.fixture(scope="module")
def turning():
    time = np.arange(0.0, 30.0, 0.01)
    phases = np.array([[0.0, 1.0, 2.0], [3.0, 0.5, 4.0]])
    vectors = 0.6 * np.sin(time[:, None, None] * np.array([1.3, 0.9, 1.7]) + phases)
    return InertialSensors(
        time, ("a", "b"), quaternion_from_rotation(rotation_from_vector(vectors))
    )


def errors(found, true):
    """Rotation vectors in the earth, z up, the first seconds left out [rad]."""
    flat = true.orientations.reshape(len(true), -1).T
    at = np.array([np.interp(found.time, true.time, column) for column in flat]).T.reshape(-1, 2, 4)
    rotations = rotation_from_quaternion(found.orientations)
    reference = rotation_from_quaternion(at)
    return vector_from_rotation(rotations @ np.swapaxes(reference, 2, 3))[500:]


def test_with_and_without_magnetometer(turning):
    raw = raw_signals(turning, 100.0)
    magnetic = np.degrees(errors(with_orientations(raw), turning))
    assert np.sqrt(np.mean(magnetic**2)) < 1.0
    # Without it the heading begins anywhere and drifts, and the inclination is as good.
    turned = rotation_from_vector(errors(with_orientations(raw, magnetometer=False), turning))
    assert np.degrees(np.sqrt(np.mean(np.arccos(np.clip(turned[..., 2, 2], -1.0, 1.0)) ** 2))) < 1.0
    assert np.degrees(np.abs(np.arctan2(turned[..., 1, 0], turned[..., 0, 0]))).mean() > 10.0


def test_known_orientations_are_kept_and_missing_signals_refused(turning):
    assert with_orientations(turning) is turning
    raw = raw_signals(turning, 100.0)
    with pytest.raises(BadData, match="angular velocities and accelerations"):
        with_orientations(replace(raw, angular_velocities=None))
    with pytest.raises(BadData, match="too slow"):
        with_orientations(raw_signals(turning, 10.0))
    silent = np.array(raw.angular_velocities)
    silent[:, 1] = np.nan
    found = with_orientations(replace(raw, angular_velocities=silent))
    assert np.isnan(found.orientations[:, 1]).all()
    assert any("'b' recorded nothing" in text for text in found.warnings)


def test_ground_of_a_model_whose_y_points_up(turning):
    rotations = rotations_at(turning, turning.time, stick_figure())
    own = rotation_from_quaternion(turning.orientations)
    np.testing.assert_allclose(rotations[..., 1, :], own[..., 2, :], atol=1e-12)
    assert np.isnan(rotations_at(turning, np.array([-1.0, 40.0]), stick_figure())).all()
