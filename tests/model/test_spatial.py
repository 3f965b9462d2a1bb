"""Rotations and vectors against NumPy."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.spatial import cross_products


def test_cross_products_are_those_of_numpy():
    rng = np.random.default_rng(3)
    first = rng.normal(size=(4, 5, 3))
    second = rng.normal(size=(4, 5, 3))
    np.testing.assert_array_equal(cross_products(first, second), np.cross(first, second))
