"""Moment arms of two models over the ranges of their coordinates, and postures for both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.model import Coordinate, Model, index_of
from myomorph.core.muscles.model_paths import compile_paths

COUNT = 256  # Postures: a muscle over three coordinates meets most of their 125 combinations.
LEVELS = 5  # Values of each coordinate, evenly from one end of its range to the other.
MAX_TURN = 2.1  # A turn is taken up to so far from the default where its range goes on [rad].
MAX_SLIDE = 0.05  # And a slide [m].
CoordinateTable = Mapping[str, tuple[str, float, float]]
"""By coordinate of the source: the target's coordinate, factor and offset, target = factor source +
offset.
"""


@read_only
class Postures:
    """Coordinates of both models, the default postures first."""

    # source, target: (postures, coordinates) in each model's order [rad or m]
    source: Array
    target: Array


def paired_postures(
    source: Model,
    target: Model,
    pairs: CoordinateTable | None = None,
    defaults: tuple[Mapping[str, float], Mapping[str, float]] = ({}, {}),
) -> Postures:
    """Return postures that go through the ranges of both models alike.

    Every coordinate that both have takes one of `LEVELS` values spread over its range, drawn
    independently of the others, so any few of them meet in nearly all combinations; one evaluation
    then serves every muscle. The target's coordinate stands at the same share of its own range,
    from the other end where the pair's factor is negative. What only one of them has, and what is
    locked, stays.
    """
    if pairs is None:
        pairs = {name: (name, 1.0, 0.0) for name in source.coordinate_names}
    rng = np.random.default_rng(0)
    source_defaults, target_defaults = defaults
    of_source = _standing(source, source_defaults)
    of_target = _standing(target, target_defaults)
    for name, (theirs, factor, _) in pairs.items():
        ours = source.coordinate(name)
        shares = rng.integers(0, LEVELS, COUNT) / (LEVELS - 1.0)
        if ours.locked or name in source.dependent_coordinates:
            continue
        reach = MAX_SLIDE if ours.motion == "translational" else MAX_TURN
        low, high = np.clip(ours.range, ours.default - reach, ours.default + reach)
        taken = low + shares * (high - low)
        of_source[1:, source.coordinate_names.index(name)] = taken
        other = target.coordinate(theirs)
        of_target[1:, target.coordinate_names.index(theirs)] = _alike(
            taken, ours, other, factor > 0.0
        )
    return Postures(source=of_source, target=of_target)


def _standing(model: Model, values: Mapping[str, float]) -> Array:
    for name in values:
        check_name("coordinate", name, model.coordinate_names)
    row = [values.get(coordinate.name, coordinate.default) for coordinate in model.coordinates]
    return np.tile(np.array(row, dtype=np.float64), (COUNT + 1, 1))


def _alike(values: Array, ours: Coordinate, theirs: Coordinate, along: bool) -> Array:
    """Values at the same share of another range; where one has no end, as far from its default."""
    low, high = ours.range
    start, end = theirs.range
    if not along:
        start, end = end, start
    if np.isfinite([low, high, start, end]).all() and high > low:
        return start + (values - low) / (high - low) * (end - start)
    return theirs.default + (values - ours.default if along else ours.default - values)


SAMPLES = 31  # Poses along a coordinate's range.
WIDEST = 2.0 * np.pi  # Rotations whose range is wider are no joint's: they are left out [rad].
SHARED = 0.25
HALVINGS = 10
# A step that differs from its neighbors by this share of the largest moment arm is looked at more
# closely.
ODD = 0.01
STAYS = 0.25
"""Share of a step that is left after `HALVINGS` of its interval where it is a jump; a bend leaves a
thousandth.
"""


@dataclass(frozen=True)
class CoordinatePair:
    """A coordinate of the source and the one of the target that it is compared with."""

    source: str
    target: str
    # factor, offset: target = factor * source + offset [rad or m]
    factor: float = 1.0
    offset: float = 0.0

    @property
    def sign(self) -> float:
        """-1 where the target's grows the other way."""
        return -1.0 if self.factor < 0.0 else 1.0

    def values(self, source: Model, target: Model, count: int) -> tuple[Array, Array]:
        """Return values of both coordinates over the range that both have.

        Where the ranges share less than a quarter, both run through their own, at equal shares of
        it.

        Parameters
        ----------
        source, target : models with the coordinates of the pair
        count : of values

        Returns
        -------
        (count,) values of the source's coordinate and (count,) of the target's [rad or m]
        """
        low, high = sorted(source.coordinate(self.source).range)
        theirs = sorted(target.coordinate(self.target).range)
        ends = sorted((end - self.offset) / self.factor for end in theirs)
        first = max(low, ends[0])
        last = min(high, ends[1])
        if last - first >= SHARED * min(high - low, ends[1] - ends[0]):
            values = np.linspace(first, last, count)
            return values, self.factor * values + self.offset
        start, end = theirs if self.factor > 0.0 else theirs[::-1]
        return np.linspace(low, high, count), np.linspace(start, end, count)


def paired_values(
    source: Model, target: Model, pairs: Sequence[CoordinatePair], count: int
) -> tuple[list[Array], list[Array]]:
    """Return `CoordinatePair.values` of each pair.

    Parameters
    ----------
    source, target : models with the coordinates of the pairs
    pairs : coordinates that correspond to each other
    count : of values

    Returns
    -------
    values of each pair, (count,) of the source's coordinates and (count,) of the target's [rad or
    m]
    """
    both = [pair.values(source, target, count) for pair in pairs]
    return [ours for ours, _ in both], [theirs for _, theirs in both]


@read_only
class MomentArms:
    """Moment arms of the muscles that one coordinate moves, the others at their defaults.

    Attributes
    ----------
    pair : the coordinate in source and target
    kind : "rotational" [rad] or "translational" [m]
    source_values, target_values : (samples,) of the coordinate [rad or m]
    muscles : names
    source, target : (samples, muscles) [m/rad or m/m], the target's turned to the source's sign
    source_jumps, target_jumps : (muscles,) largest discontinuity [m/rad or m/m]
    target_jump_at : (muscles,) value of the coordinate there in the target, NaN where there is none
    within : (samples, muscles) distance from `target` within which the moment arm lies with 90 %,
        as far as that follows from the points' intervals [m/rad or m/m]; NaN where these are not
        known, None before it is asked
    """

    pair: CoordinatePair
    kind: str
    source_values: Array
    target_values: Array
    muscles: tuple[str, ...]
    source: Array
    target: Array
    source_jumps: Array
    target_jumps: Array
    target_jump_at: Array
    within: Array | None = None


def swept(model: Model) -> tuple[Coordinate, ...]:
    """Coordinates that move a muscle and have a range: free, unlocked and bounded."""
    if not model.muscles:
        return ()
    moving = set(compile_paths(model).arm_coordinate.tolist())
    coordinates = []
    for i, coordinate in enumerate(model.coordinates):
        bounded = (
            np.isfinite(coordinate.range).all() and coordinate.range[1] - coordinate.range[0] > 0.0
        )
        if coordinate.motion == "rotational":
            bounded = bounded and coordinate.range[1] - coordinate.range[0] <= WIDEST
        if (
            i in moving
            and bounded
            and not coordinate.locked
            and coordinate.name not in model.dependent_coordinates
        ):
            coordinates.append(coordinate)
    return tuple(coordinates)


def compared_coordinates(
    source: Model, target: Model, table: CoordinateTable | None = None
) -> tuple[CoordinatePair, ...]:
    """Coordinates that both models sweep: those of one name, or as a table pairs them."""
    if table is None:
        table = {
            coordinate_name: (coordinate_name, 1.0, 0.0)
            for coordinate_name in source.coordinate_names
            if coordinate_name in target.coordinate_names
        }
    pairs = tuple(
        CoordinatePair(source=name, target=other, factor=factor, offset=offset)
        for name, (other, factor, offset) in table.items()
    )
    for pair in pairs:
        for model, name in ((source, pair.source), (target, pair.target)):
            index_of("coordinate", name, model.coordinate_names, f"model '{model.name}'")
    ours = {coordinate.name for coordinate in swept(source)}
    theirs = {coordinate.name for coordinate in swept(target)}
    return tuple(
        pair
        for pair in pairs
        if pair.source in ours and pair.target in theirs and pair.factor != 0.0
    )


def compare_moment_arms(
    source: Model, target: Model, pairs: Sequence[CoordinatePair], samples: int = SAMPLES
) -> tuple[MomentArms, ...]:
    """Compare the moment arms r = -dl/dq of muscles that both models have.

    They are taken at `samples` poses over the range of each coordinate.
    """
    arms = []
    for pair in pairs:
        moved = _moved(source, pair.source) | _moved(target, pair.target)
        muscles = tuple(
            name
            for name in source.muscle_names
            if name in moved and name in set(target.muscle_names)
        )
        if muscles:
            arms.append(_compared(source, target, pair, muscles, samples))
    return tuple(arms)


def _compared(
    source: Model, target: Model, pair: CoordinatePair, muscles: tuple[str, ...], samples: int
) -> MomentArms:
    values, target_values = pair.values(source, target, samples)
    arms = _arms_of(source, pair.source, muscles)
    target_arms = _arms_of(target, pair.target, muscles)
    r = arms(values)
    t = target_arms(target_values)
    jumps, _ = _jumps(arms, values, r)
    target_jumps, target_at = _jumps(target_arms, target_values, t)
    kind = source.coordinate(pair.source).motion
    return MomentArms(
        pair=pair,
        kind=kind,
        source_values=values,
        target_values=target_values,
        muscles=muscles,
        source=r,
        target=pair.sign * t,
        source_jumps=jumps,
        target_jumps=target_jumps,
        target_jump_at=target_at,
    )


def target_arms(model: Model, arms: Sequence[MomentArms]) -> list[Array]:
    """Return moment arms of another model with the target's coordinates and muscles.

    Parameters
    ----------
    model : to evaluate
    arms : tables that state coordinates, their values, and muscles

    Returns
    -------
    (samples, muscles) of each table's `target` coordinate, of its sign [m, or m/m]
    """
    paths = compile_paths(model)
    counts = [len(moment_arms.target_values) for moment_arms in arms]
    coordinates = np.repeat(paths.tree.defaults[None], sum(counts), axis=0)
    rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    columns = [model.coordinate_names.index(moment_arms.pair.target) for moment_arms in arms]
    for here, j, arm in zip(rows, columns, arms, strict=True):
        coordinates[here, j] = arm.target_values
    evaluated = paths.evaluate(coordinates)[2]
    result = []
    for here, j, arm in zip(rows, columns, arms, strict=True):
        number = {
            model.muscle_names.index(muscle): column for column, muscle in enumerate(arm.muscles)
        }
        table = np.zeros((len(here), len(arm.muscles)))
        for entry in np.flatnonzero(paths.arm_coordinate == j):
            muscle = int(paths.arm_muscle[entry])
            if muscle in number:
                table[:, number[muscle]] = arm.pair.sign * evaluated[here, entry]
        result.append(table)
    return result


def _moved(model: Model, coordinate: str) -> set[str]:
    """Muscles that a coordinate moves."""
    paths = compile_paths(model)
    muscles = paths.arm_muscle[paths.arm_coordinate == model.coordinate_names.index(coordinate)]
    return {model.muscle_names[index] for index in muscles}


def _arms_of(model: Model, coordinate: str, muscles: Sequence[str]) -> Callable[[Array], Array]:
    """Return a function from values of a coordinate (n,) to moment arms (n, muscles).

    The other coordinates are in their default pose, but for those that depend on this one. Loops
    that it would open are not closed.
    """
    few = replace(model, muscles=tuple(model.muscle(name) for name in muscles))
    paths = compile_paths(few)
    j = model.coordinate_names.index(coordinate)
    entries = np.flatnonzero(paths.arm_coordinate == j)
    column = paths.arm_muscle[entries]
    default = paths.tree.defaults

    def arms(values: Array) -> Array:
        coordinates = np.repeat(default[None], len(values), axis=0)
        coordinates[:, j] = values
        result = np.zeros((len(values), len(muscles)))
        result[:, column] = paths.evaluate(coordinates)[2][:, entries]
        return result

    return arms


def _jumps(arms: Callable[[Array], Array], values: Array, sampled: Array) -> tuple[Array, Array]:
    """Find the largest discontinuity of each column, by halving the oddest interval.

    Returns its size and the value at which it is, (muscles,) each.
    """
    jumps = np.zeros(sampled.shape[1])
    at = np.full(sampled.shape[1], np.nan)
    if len(values) < 4:
        return jumps, at
    steps = np.diff(sampled, axis=0)
    padded = np.concatenate([steps[1:2], steps, steps[-2:-1]])
    odd = np.abs(steps - 0.5 * (padded[:-2] + padded[2:]))
    column = np.flatnonzero(odd.max(axis=0) > ODD * np.abs(sampled).max(axis=0))
    worst = odd.argmax(axis=0)[column]
    below = sampled[worst, column]
    above = sampled[worst + 1, column]
    ends = (values[worst], values[worst + 1])
    left, place = _halved(arms, column, ends, (below, above))
    stays = left > STAYS * np.abs(above - below)
    jumps[column[stays]] = left[stays]
    at[column[stays]] = place[stays]
    return jumps, at


def _halved(
    arms: Callable[[Array], Array],
    column: np.ndarray,
    ends: tuple[Array, Array],
    at_ends: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Halve an interval of each column again and again, and go on with the half that jumps more.

    Parameters
    ----------
    arms : from values (n,) to moment arms (n, muscles)
    column : (n,) indices of muscles
    ends : (n,) values of the coordinate at which the intervals begin and end
    at_ends : (n,) moment arms there

    Returns
    -------
    (n,) what is left between the ends, and (n,) where
    """
    low, high = ends
    below, above = at_ends
    row = np.arange(len(column))
    for _ in range(HALVINGS if len(column) else 0):
        middle = 0.5 * (low + high)
        r = arms(middle)[row, column]
        first = np.abs(r - below) > np.abs(above - r)
        high = np.where(first, middle, high)
        above = np.where(first, r, above)
        low = np.where(first, low, middle)
        below = np.where(first, below, r)
    return np.abs(above - below), 0.5 * (low + high)
