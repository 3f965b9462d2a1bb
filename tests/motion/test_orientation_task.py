"""Bodies turned as inertial sensors report count beside markers, and without any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from task_equations import held_against_differences

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.tasks.orientations import OrientationTask
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure
from trees import random_tree

FRAMES = 12


def moving(model):
    """Angles of the figure, and the rotations of its bodies."""
    tree = compile_tree(model)
    t = np.linspace(0.0, 1.0, FRAMES)[:, None]
    values = 0.3 * np.sin(5.0 * t + np.arange(len(tree.defaults)))
    values[:, [name.startswith("tibia") for name in model.coordinate_names]] -= 0.6
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    points = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    turned = {
        name: poses.rotations[:, index] for name, index in tree.body_index.items() if index > 0
    }
    return values, turned, Markers(0.01 * np.arange(FRAMES), model.marker_names, points)


def sensors(turned, names):
    return InverseKinematicsOptions(
        tasks=[OrientationTask(name, name, turned[name]) for name in names], tolerance=1e-9
    )


@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_curvature_are_derivatives_of_the_cost(seed):
    model = random_tree(seed)
    tree = compile_tree(model)
    rng = np.random.default_rng(seed)
    c = rng.uniform(-0.5, 0.5, len(tree.defaults))
    # Sensors that fit at c: there the Gauss-Newton curvature is all of it.
    rotations = forward_kinematics(tree, c[None]).rotations
    names = model.body_names[-3:]
    tasks = [
        OrientationTask(
            sensor=name, body=name, rotations=rotations[:, tree.body_index[name]], weight=0.5 + i
        )
        for i, name in enumerate(names)
    ]
    held_against_differences(tree, tasks, c, c + rng.normal(scale=0.2, size=len(c)))


def test_segments_without_markers_turn_as_their_sensors_say():
    model = stick_figure()
    values, turned, markers = moving(model)
    bare = model.with_markers(tuple(marker for marker in model.markers if marker.body == "pelvis"))
    names = [name for name in model.body_names if name in turned and name != "pelvis"]
    fit = inverse_kinematics(bare, markers, sensors(turned, names))
    assert fit.converged.all()
    np.testing.assert_allclose(fit.motion.values, values, atol=1e-5)
    assert fit.largest.max() < 1e-5
    assert fit.sensor_names == tuple(names)
    assert fit.sensor_error.shape == (FRAMES, len(names))
    assert fit.sensor_error.max() < 1e-5
    # What is unknown in some frames is left out there.
    gone = turned["torso"].copy()
    gone[4:6] = np.nan
    fit = inverse_kinematics(bare, markers, sensors(turned | {"torso": gone}, names))
    trunk = [name.startswith("torso") for name in model.coordinate_names]
    assert np.abs(fit.motion.values - values)[4:6][:, trunk].max() > 1e-3
    np.testing.assert_allclose(
        np.delete(fit.motion.values, [4, 5], axis=0), np.delete(values, [4, 5], axis=0), atol=2e-5
    )


def test_sensors_alone_are_enough_for_angles():
    model = stick_figure()
    values, turned, markers = moving(model)
    nothing = Markers(markers.time, (), np.empty((FRAMES, 0, 3)))
    fit = inverse_kinematics(model, nothing, sensors(turned, turned))
    turns = [coordinate.motion == "rotational" for coordinate in model.coordinates]
    np.testing.assert_allclose(fit.motion.values[:, turns], values[:, turns], atol=1e-5)
    assert fit.marker_names == ()


def test_a_task_of_other_frames_is_refused():
    model = stick_figure()
    _, turned, markers = moving(model)
    task = OrientationTask("torso_imu", "torso", turned["torso"][:5])
    with pytest.raises(BadData, match=rf"torso.*\b5\b.*\b{FRAMES}\b"):
        inverse_kinematics(model, markers, replace(InverseKinematicsOptions(), tasks=[task]))


def test_what_counts_more_has_the_smaller_error():
    """Two sensors of one body that differ: the body lies between them as their weights say."""
    model = stick_figure()
    _, turned, markers = moving(model)
    nothing = Markers(markers.time, (), np.empty((FRAMES, 0, 3)))
    angle = 0.2
    c = np.cos(angle)
    s = np.sin(angle)
    other = turned["torso"] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    tasks = [
        OrientationTask(sensor="a", body="torso", rotations=turned["torso"], weight=3.0),
        OrientationTask(sensor="b", body="torso", rotations=other, weight=1.0),
    ]
    fit = inverse_kinematics(model, nothing, InverseKinematicsOptions(tasks=tasks, tolerance=1e-9))
    np.testing.assert_allclose(
        fit.sensor_error, np.tile([0.25 * angle, 0.75 * angle], (FRAMES, 1)), atol=1e-5
    )
