"""The reflection of a plate is found from the frames in which it bears load.

What it reads in the other frames does not matter.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.contact.force_checks import _mirror

FRAMES = 60


@pytest.mark.parametrize(
    ("axes", "middle"), [((0,), (0.37,)), ((2,), (-0.21,)), ((0, 2), (0.37, -0.21))]
)
def test_a_reflection_is_taken_back(axes, middle):
    clock = np.linspace(0.0, 1.0, FRAMES)
    feet = np.zeros((FRAMES, 2, 3))
    feet[:, 0] = np.column_stack([0.9 - 0.6 * clock, 0.0 * clock, 0.12 + 0.1 * clock**2])
    feet[:, 1] = [1.5, 0.3, -0.4]
    heels = feet - [0.1, 0.0, 0.0]
    tips = feet + [0.1, 0.0, 0.0]
    loaded = np.arange(FRAMES) % 3 > 0
    centers = np.array(feet[:, 0])
    for axis, at in zip(axes, middle, strict=True):
        centers[:, axis] = 2.0 * at - centers[:, axis]
    centers[~loaded] = np.random.default_rng(0).normal(scale=5.0, size=(int((~loaded).sum()), 3))
    carriers = np.tile([True, False], (FRAMES, 1))

    def distances(points):
        return np.linalg.norm(points[:, :, None] - feet[:, None], axis=-1)

    inspection = SimpleNamespace(
        feet=SimpleNamespace(up=np.eye(3)[1], soles=(heels, tips), distances=distances)
    )
    found = _mirror(inspection, centers, carriers, np.where(loaded, 700.0, 0.0))
    np.testing.assert_array_equal(found.axes, np.eye(3)[list(axes)])
    np.testing.assert_allclose(found.middle, middle, atol=1e-9)
    assert found.distance < 1e-9
