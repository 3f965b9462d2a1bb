"""Curvature that ties add: the squares of the slopes of gaps.

They are in lengths, in coordinates, and between them.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.motion.frame_blocks import TIED, FrameEquations, add_ties


def test_ties_add_the_products_of_the_slopes_of_their_gaps():
    random = np.random.default_rng(0)
    by_length = random.normal(size=(18, 4))
    by_coordinate = random.normal(size=(18, 7))
    by_coordinate[3:6, 2] = by_coordinate[:3, 2]
    free = np.array([1, 2, 5, 6])
    own = random.normal(size=(4, 4))
    mixed = random.normal(size=(4, 4))
    lengths = random.normal(size=(4, 4))
    found = own.copy(), mixed.copy(), lengths.copy()
    equations = FrameEquations(A=found[0], E=found[1], H=found[2], g=np.zeros(4))
    add_ties(free, by_length, by_coordinate, equations)
    gaps = [table.reshape(3, 2, 3, -1) for table in (by_length, by_coordinate[:, free])]
    length_gap, coordinate_gap = gaps
    length = (length_gap[:, 1] - length_gap[:, 0]).reshape(9, -1)
    coordinate = (coordinate_gap[:, 1] - coordinate_gap[:, 0]).reshape(9, -1)
    np.testing.assert_allclose(
        found[0], own + np.tril(TIED * coordinate.T @ coordinate), atol=1e-9 * TIED
    )
    np.testing.assert_allclose(found[1], mixed + TIED * coordinate.T @ length, atol=1e-9 * TIED)
    np.testing.assert_allclose(
        found[2], lengths + np.tril(TIED * length.T @ length), atol=1e-9 * TIED
    )
