"""Normals of a surface on its way: those of the moved surface, as the map says exactly."""

from __future__ import annotations

import numpy as np

from myomorph.bones.morph.registration.affine import unit
from myomorph.bones.morph.registration.smooth import _Moving
from myomorph.core.surfaces.linear_maps import AffineMap
from myomorph.core.surfaces.surface_points import Samples


def test_normals_follow_an_affine_displacement():
    random = np.random.default_rng(0)
    points = random.normal(size=(40, 3))
    normals = unit(random.normal(size=(40, 3)))
    before = AffineMap(
        np.array([[1.1, 0.2, 0.0], [0.0, 0.9, -0.1], [0.3, 0.0, 1.2]]), np.array([0.5, -0.2, 0.1])
    )
    change = np.array([[0.2, -0.3, 0.1], [0.0, 0.1, 0.4], [-0.2, 0.0, -0.1]])
    moving = _Moving(Samples(points, normals, np.zeros(40, np.bool_)), before)
    moving.follow(lambda places: places)
    found = moving.at(change.T)
    whole = before.matrix + change
    np.testing.assert_allclose(found.points, before.apply(points) + points @ change.T, atol=1e-12)
    expected = unit(normals @ np.linalg.inv(whole))
    np.testing.assert_allclose(found.normals, expected, atol=1e-7)
