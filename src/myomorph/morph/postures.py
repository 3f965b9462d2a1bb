"""Postures over the joints' ranges of motion, the same in two models: at equal shares of the coordinates' ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import UnknownName
from myomorph.model.model import Coordinate, Model

COUNT = 256
"""Postures: a muscle over three coordinates meets most of their 125 combinations."""

LEVELS = 5
"""Values of each coordinate, evenly from one end of its range to the other."""

WIDEST = 2.1
"""A turn is taken up to so far from the default where its range goes on [rad]."""

LONGEST = 0.05
"""And a slide [m]."""

CoordinateTable = Mapping[str, tuple[str, float, float]]
"""By coordinate of the source: the target's coordinate, factor and offset, target = factor source + offset."""


@dataclass(frozen=True, eq=False)
class Postures:
    """Coordinates of both models, the default postures first.

    Attributes
    ----------
    source, target : (postures, coordinates) in each model's order [rad or m]
    """

    source: Array
    target: Array


def paired_postures(
    source: Model,
    target: Model,
    pairs: CoordinateTable | None = None,
    defaults: tuple[Mapping[str, float], Mapping[str, float]] = ({}, {}),
) -> Postures:
    """Postures that go through the ranges of both models alike.

    Every coordinate that both have takes one of `LEVELS` values spread over its range, drawn independently of the
    others, so any few of them meet in nearly all combinations; one evaluation then serves every muscle. The target's
    coordinate stands at the same share of its own range, from the other end where the pair's factor is negative. What
    only one of them has, and what is locked, stays.

    Parameters
    ----------
    pairs : None where both have the same coordinates
    defaults : of the default postures, where they differ from the models'

    Raises
    ------
    UnknownName : a coordinate that a model does not have
    """
    if pairs is None:
        pairs = {name: (name, 1.0, 0.0) for name in source.coordinate_names}
    rng = np.random.default_rng(0)
    found = [_standing(model, values) for model, values in zip((source, target), defaults, strict=True)]
    for name, (theirs, factor, _) in pairs.items():
        ours = source.coordinate(name)
        shares = rng.integers(0, LEVELS, COUNT) / (LEVELS - 1.0)
        if ours.locked or name in source.dependent_coordinates:
            continue
        low, high = _window(ours)
        taken = low + shares * (high - low)
        found[0][1:, source.coordinate_names.index(name)] = taken
        other = target.coordinate(theirs)
        found[1][1:, target.coordinate_names.index(theirs)] = _alike(taken, ours, other, factor > 0.0)
    return Postures(*found)


def _standing(model: Model, values: Mapping[str, float]) -> Array:
    for name in values:
        if name not in model.coordinate_names:
            raise UnknownName("coordinate", name, model.coordinate_names)
    row = [values.get(one.name, one.default) for one in model.coordinates]
    return np.tile(np.array(row, dtype=np.float64), (COUNT + 1, 1))


def _window(coordinate: Coordinate) -> tuple[float, float]:
    reach = LONGEST if coordinate.motion == "translational" else WIDEST
    low, high = np.clip(coordinate.range, coordinate.default - reach, coordinate.default + reach)
    return float(low), float(high)


def _alike(values: Array, ours: Coordinate, theirs: Coordinate, along: bool) -> Array:
    """Values at the same share of another range; where one has no end, as far from its default."""
    (low, high), (start, end) = ours.range, theirs.range
    if not along:
        start, end = end, start
    if np.isfinite([low, high, start, end]).all() and high > low:
        return start + (values - low) / (high - low) * (end - start)
    return theirs.default + (values - ours.default if along else ours.default - values)
