"""A kind of task is one file (`height_task.py`) and one line.

Measured heights count together with markers.
"""

from __future__ import annotations

import numpy as np
import pytest
from height_task import HeightTask
from task_equations import held_against_differences

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.motion import newton
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.newton import solve_chunk
from myomorph.core.rigid.kernels import interpreted, signatures_on_disk
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure
from trees import random_tree

FRAMES = 12


@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_curvature_are_derivatives_of_the_cost(seed):
    model = random_tree(seed)
    tree = compile_tree(model)
    rng = np.random.default_rng(seed)
    c = rng.uniform(-0.5, 0.5, len(tree.defaults))
    poses = forward_kinematics(tree, c[None])
    tasks = []
    for name in model.body_names[-3:]:
        location = rng.normal(size=3)
        number = tree.body_index[name]
        place = poses.rotations[0, number] @ location + poses.origins[0, number]
        height = np.array([place @ model.up])
        tasks.append(HeightTask(body=name, location=location, heights=height, weight=0.5))
    held_against_differences(tree, tasks, c, c + rng.normal(scale=0.2, size=len(c)))


def moving():
    """Make a figure that moves, with its poses and markers."""
    model = stick_figure()
    tree = compile_tree(model)
    t = np.linspace(0.0, 1.0, FRAMES)[:, None]
    values = 0.1 * np.sin(5.0 * t + np.arange(len(tree.defaults)))
    values[:, [name.startswith("tibia") for name in model.coordinate_names]] -= 0.6
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    points = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    return model, poses, Markers(0.01 * np.arange(FRAMES), model.marker_names, points)


def test_a_measured_height_moves_the_body():
    model, poses, markers = moving()
    body = model.markers[0].body
    number = compile_tree(model).body_index[body]
    lifted = poses.origins[:, number] @ model.up + 0.1
    plain = inverse_kinematics(model, markers)
    task = HeightTask(body=body, location=np.zeros(3), heights=lifted, weight=1e4)
    fit = inverse_kinematics(model, markers, InverseKinematicsOptions(tasks=[task]))
    assert fit.converged.all()
    assert fit.task_errors["HeightTask"].shape == (FRAMES, 1)
    np.testing.assert_allclose(fit.task_errors["HeightTask"], 0.0, atol=1e-3)
    assert plain.rms.max() < 1e-4 < fit.rms.max()


def test_interpreted_kernels_give_the_same_coordinates():
    model, _, markers = moving()
    few = Markers(markers.time[:3], markers.names, markers.values[:3])
    compiled = inverse_kinematics(model, few)
    with interpreted():
        plain = inverse_kinematics(model, few)
    np.testing.assert_array_equal(plain.motion.values, compiled.motion.values)
    np.testing.assert_array_equal(plain.marker_error, compiled.marker_error)
    np.testing.assert_array_equal(plain.iterations, compiled.iterations)


def test_one_line_makes_it_a_kind_of_the_package(monkeypatch):
    """With the line, problems without a measured height have empty arrays of it.

    The results are the same.
    """
    model, _, markers = moving()
    before = inverse_kinematics(model, markers)
    monkeypatch.setattr(newton, "TASK_KINDS", (*newton.TASK_KINDS, HeightTask))
    fit = inverse_kinematics(model, markers)
    np.testing.assert_allclose(fit.motion.values, before.motion.values, atol=1e-12)
    assert "HeightTask" not in before.task_errors
    assert fit.task_errors["HeightTask"].shape == (FRAMES, 0)


def test_a_task_of_other_frames_is_refused():
    model, _, markers = moving()
    task = HeightTask(model.markers[0].body, np.zeros(3), np.zeros(5))
    with pytest.raises(BadData, match=rf"heights.*\b5\b.*\b{FRAMES}\b"):
        inverse_kinematics(model, markers, InverseKinematicsOptions(tasks=[task]))


def test_kernels_of_kinds_from_elsewhere_do_not_go_to_disk():
    """Another process, which may not have their classes, reads the same index."""
    assert "HeightArrays" not in str(signatures_on_disk(solve_chunk))
