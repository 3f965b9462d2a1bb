"""A handle's sensor on a carried object.

Made recordings are recovered; a lifted box has one instrumented handle.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import rotation_from_euler_xyz, vector_from_rotation
from truths.handle_sensor import HandleForce, fit_handle, grip_point, object_motion

GRAVITY = np.array([0.0, 0.0, -9.81])
SENSOR = rotation_from_euler_xyz((0.3, 1.2, -0.8))
LINE = np.array([0.1, 1.0, 0.05])
POINT = np.array([0.02, 0.1, -0.03])
CORNERS = np.array([[0.1, 0.2, 0], [-0.1, 0.2, 0.05], [0.1, -0.2, 0.1], [-0.1, -0.2, 0]]) - [
    0,
    0,
    0.0375,
]


def carried(squeeze: bool, offset: float = 0.012, noise: float = 0.0, seconds: float = 4.0):
    """Simulate an object that hands lift, tilt and swing.

    Markers are at 100 Hz, the sensor at 2000 Hz.
    """
    random = np.random.default_rng(0)

    def pose(time):
        angles = np.stack(
            [0.5 * np.sin(2 * time), 0.4 * np.sin(2.9 * time + 1), 0.3 * np.cos(1.7 * time)], axis=1
        )
        places = np.stack(
            [0.2 * np.sin(2.3 * time), 0.1 * np.cos(3 * time), 0.2 * np.sin(1.9 * time)], axis=1
        )
        return np.array([rotation_from_euler_xyz(one) for one in angles]), places

    time = np.arange(0, seconds, 0.01)
    own = np.arange(0, seconds, 0.0005)
    rotations, places = pose(time)
    markers = places[:, None] + np.einsum("nij,mj->nmi", rotations @ rotations[0].T, CORNERS)
    there = own + offset
    before = pose(there + (-1e-3))
    now = pose(there + 0.0)
    after = pose(there + 1e-3)
    tracked = [turn @ rotations[0].T for turn, _ in (before, now, after)]
    heads = [
        place + turn @ POINT for turn, (_, place) in zip(tracked, (before, now, after), strict=True)
    ]
    push = 2.5 * ((heads[0] - 2 * heads[1] + heads[2]) * 1e6 - GRAVITY)
    force = np.einsum("nji,nj->ni", tracked[1], push)
    if squeeze:
        force = force + np.outer(20 + 10 * np.sin(1.3 * own), LINE / np.linalg.norm(LINE))
    force = force @ SENSOR + noise * random.normal(size=force.shape)
    values = markers + noise * 1e-3 * random.normal(size=markers.shape)
    return Markers(time, ("a", "b", "c", "d"), values), own, force


@pytest.mark.parametrize("squeeze", [False, True])
def test_a_made_handle_comes_back(squeeze):
    """Orientation, mass, place and clock; with two hands whatever they squeeze."""
    markers, own, force = carried(squeeze)
    motion = object_motion(markers, markers.names, 12.0)
    held = (markers.time > 0.6) & (markers.time < 3.4)
    found = fit_handle(
        motion, held, HandleForce(time=own, values=force), GRAVITY, LINE if squeeze else None
    )
    assert np.linalg.norm(vector_from_rotation(found.rotation @ SENSOR.T)) < 0.01
    assert found.share == pytest.approx(2.5, rel=0.005)
    assert found.offset == pytest.approx(0.012, abs=1e-3)
    np.testing.assert_allclose(
        found.point - (found.point @ LINE) * LINE / (LINE @ LINE),
        POINT - (POINT @ LINE) * LINE / (LINE @ LINE),
        atol=0.02,
    )
    assert found.rms < 0.15
    if squeeze:
        np.testing.assert_allclose(
            found.squeeze.mean(), 20 + 10 * np.mean(np.sin(1.3 * markers.time[held])), atol=1.0
        )


def test_one_hand_does_not_explain_what_two_do():
    markers, own, force = carried(True)
    motion = object_motion(markers, markers.names, 12.0)
    held = (markers.time > 0.6) & (markers.time < 3.4)
    alone = fit_handle(motion, held, HandleForce(time=own, values=force), GRAVITY, None)
    both = fit_handle(motion, held, HandleForce(time=own, values=force), GRAVITY, LINE)
    assert alone.rms > 10 * both.rms


def test_an_object_at_rest_shows_no_orientation():
    markers, own, force = carried(False)
    still = Markers(
        markers.time, markers.names, np.repeat(markers.values[:1], len(markers), axis=0)
    )
    with pytest.raises(BadData, match="neither turns nor is accelerated"):
        fit_handle(
            object_motion(still, still.names, 6.0),
            np.ones(len(still), bool),
            HandleForce(time=own, values=force),
            GRAVITY,
        )
    with pytest.raises(BadData, match="held in 5 frames"):
        fit_handle(
            object_motion(markers, markers.names, 6.0),
            np.arange(len(markers)) < 5,
            HandleForce(time=own, values=force),
            GRAVITY,
        )


def test_a_point_of_action_is_found_from_force_and_torque():
    random = np.random.default_rng(0)
    force = 20 * random.normal(size=(100, 3))
    point, left = grip_point(force, np.cross([0.01, -0.02, 0.05], force))
    np.testing.assert_allclose(point, [0.01, -0.02, 0.05], atol=1e-12)
    assert left < 1e-12


def test_the_handle_of_a_lifted_box(data):
    """Six voltages through the 6x6 matrix, tared at rest, against the motion of the box's markers.

    The box has eight markers. The lift takes both hands, so one hand's force is explained only
    across the line between the handles.
    """
    folder = data("c3d-shoulder-emg-handle/markers_analogs.c3d").parent
    trial = read_c3d(folder / "markers_analogs.c3d")
    matrix = np.loadtxt(folder / "forces_calibration_matrix.csv", delimiter=",")
    markers = trial.markers
    own = trial.analog.time
    force = (trial.analog.values[:, :6] @ matrix.T)[:, :3]
    before = force[own < 1.0].mean(axis=0)
    after = force[own > 4.3].mean(axis=0)
    assert np.linalg.norm(after - before) < 0.6
    names = markers.names[:8]
    motion = object_motion(markers, names, 6.0)
    assert np.median(motion.residual) < 5e-4
    corners = np.stack([markers[name][0] for name in names])
    line = corners[2:4].mean(axis=0) - corners[0:2].mean(axis=0)
    held = (markers.time > 2.05) & (markers.time < 3.65)
    two = fit_handle(motion, held, HandleForce(time=own, values=force - before), GRAVITY, line)
    one = fit_handle(motion, held, HandleForce(time=own, values=force - before), GRAVITY, None)
    assert two.rms < 1.5
    assert one.rms > 5 * two.rms
    assert 2.0 < two.share < 3.0
    assert abs(two.offset) < 3 * two.offset_sd
    # The sensor's first axis lies along the line of the handles, its second points up.
    assert abs(two.rotation[:, 0] @ line) / np.linalg.norm(line) > 0.98
    assert two.rotation[2, 1] > 0.98
