"""Postures by which frames are chosen: places of markers seen from the first body, whatever that does."""

from __future__ import annotations

import numpy as np

from myomorph.motion.body.postures import _seen_from_base
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from stick_figure import stick_figure


def test_a_posture_is_the_same_wherever_the_first_body_stands():
    """Against places in ground turned and moved back; the pelvis's own markers stay where the model has them."""
    model = stick_figure()
    rng = np.random.default_rng(0)
    values = np.tile(rng.normal(scale=0.3, size=len(model.coordinates)), (4, 1))
    values[:, :6] = rng.normal(scale=2.0, size=(4, 6))
    found = _seen_from_base(model, values).reshape(4, -1, 3)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    for k, marker in enumerate(model.markers):
        body = tree.body_index[marker.body]
        for frame in range(4):
            place = poses.origins[frame, body] + poses.rotations[frame, body] @ marker.location
            local = np.linalg.solve(poses.rotations[frame, 1], place - poses.origins[frame, 1])
            np.testing.assert_allclose(found[frame, k], local, atol=1e-12)
        if marker.body == model.bodies[0].name:
            np.testing.assert_allclose(found[:, k], np.tile(marker.location, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(found, np.tile(found[:1], (4, 1, 1)), atol=1e-12)
