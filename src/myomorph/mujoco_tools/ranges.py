"""The poses in which a model is compared with its copy in MuJoCo."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Coordinate, Model
from myomorph.rigid.coordinates import couple_frames
from myomorph.rigid.tree import compile_tree

WIDEST = {"rotational": np.pi, "translational": 0.1, "coupled": np.pi}
"""Range on both sides of a coordinate's default beyond which no joint goes [rad or m]."""

FREE_RANGE = np.pi / 2
"""That of a coordinate without a range [rad or m]."""

SWEEP, FEWEST, ALTOGETHER = 41, 7, 1600
"""Poses of each coordinate alone, the others at their defaults: at most, at least, and of all coordinates."""


def range_of(coordinate: Coordinate) -> tuple[float, float]:
    """Bounds between which a coordinate is compared with MuJoCo [rad or m]; a locked one stands."""
    if coordinate.locked:
        return coordinate.default, coordinate.default
    low, high = coordinate.range
    widest = min(WIDEST[coordinate.motion], np.inf if np.isfinite([low, high]).all() else FREE_RANGE)
    return max(low, coordinate.default - widest), min(high, coordinate.default + widest)


def poses_over_ranges(model: Model, count: int, seed: int = 0) -> tuple[Array, Array]:
    """Coordinates over their ranges, dependent ones consistent.

    Returns
    -------
    coordinates : (poses, coordinates), first each moved alone, then `count` poses of all together [rad or m]
    swept : (poses,) number of the coordinate that moves alone, -1 where all do
    """
    tree = compile_tree(model)
    bounds = np.array([range_of(coordinate) for coordinate in model.coordinates])
    count_alone = int(np.clip(ALTOGETHER // max(len(tree.independent), 1), FEWEST, SWEEP))
    rows, swept = [], []
    for j in tree.independent:
        if bounds[j, 1] > bounds[j, 0]:
            rows.append(np.tile(tree.defaults, (count_alone, 1)))
            rows[-1][:, j] = np.linspace(bounds[j, 0], bounds[j, 1], count_alone)
            swept += [j] * count_alone
    together = np.random.default_rng(seed).random((count, len(bounds)))
    rows.append(bounds[:, 0] + (bounds[:, 1] - bounds[:, 0]) * together)
    coordinates = np.concatenate(rows)
    couple_frames(tree.arrays, coordinates)
    return coordinates, np.array(swept + [-1] * count)
