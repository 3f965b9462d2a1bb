"""A body is found however it stands.

Inverse kinematics tries headings of the whole body, knowing none.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.starts import _headings
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure


@pytest.mark.parametrize(
    "turns", [(0.0, 0.0, np.pi), (np.pi, 0.0, 0.0), (0.0, np.pi, 0.0), (0.5 * np.pi, 0.2, 3.0)]
)
def test_a_turned_body_is_found(turns):
    model = stick_figure()
    rng = np.random.default_rng(1)
    values = np.tile(rng.normal(scale=0.15, size=len(model.coordinates)), (3, 1))
    for side in "rl":
        values[:, model.coordinate_names.index(f"tibia_{side}_r0")] = -0.6
    values[
        :, [k for k, name in enumerate(model.coordinate_names) if name.startswith("pelvis_r")]
    ] += turns
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    seen = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    found = inverse_kinematics(model, Markers(np.arange(3) / 100.0, model.marker_names, seen))
    assert found.rms.max() < 1e-5


def test_headings_turn_one_root_rotation_by_quarters():
    rest = np.array([0.3, -0.2, 0.1, 0.5])
    turns = np.array(_headings(rest, [1, 3])) - rest
    expected = [np.zeros(4), *(k * np.pi / 2.0 * np.eye(4)[j] for j in (1, 3) for k in (1, 2, 3))]
    np.testing.assert_allclose(
        turns[np.lexsort(turns.T)], np.array(expected)[np.lexsort(np.array(expected).T)], atol=1e-12
    )
