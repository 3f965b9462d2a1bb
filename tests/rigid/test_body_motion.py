"""Velocities and accelerations of bodies are the derivatives of their poses."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.rigid.kinematics import body_motion
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, random_tree


@pytest.mark.parametrize("make", [random_tree, functional_tree])
def test_rates_are_differences_of_poses(make):
    model = make(3)
    tree = compile_tree(model)
    step = 1e-4
    rng = np.random.default_rng(0)
    q, v, a = 0.3 * rng.normal(size=(3, len(model.coordinates)))
    at = step * np.arange(-1, 2)[:, None]
    moved = body_motion(tree, q + v * at + 0.5 * a * at**2, v + a * at, np.tile(a, (3, 1)))
    bodies = np.arange(len(tree.arrays.parent))
    points, speeds, accelerations = moved.of_points(bodies, rng.normal(size=(len(bodies), 3)))
    np.testing.assert_allclose(speeds[1], (points[2] - points[0]) / (2 * step), atol=1e-5)
    np.testing.assert_allclose(accelerations[1], (speeds[2] - speeds[0]) / (2 * step), atol=1e-4)
    turned = (
        (moved.rotations[2] - moved.rotations[0])
        / (2 * step)
        @ np.swapaxes(moved.rotations[1], 1, 2)
    )
    found = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    np.testing.assert_allclose(moved.angular_velocities[1], found, atol=1e-5)
