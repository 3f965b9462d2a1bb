"""Muscle paths that the map brought into a bone are brought out again.

Via points are moved and wrap objects grow.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.checks.moment_arms import (
    CoordinatePair,
    CoordinateTable,
    compare_moment_arms,
    compared_coordinates,
)
from myomorph.bones.morph.checks.path_changes import SAME, Ground, PathMover, wraps_of
from myomorph.bones.morph.checks.warnings import CheckOptions, arm_warnings
from myomorph.bones.morph.maps.fields import BoneMap, muscle_sizes
from myomorph.bones.morph.morphed import TransferredPoint
from myomorph.bones.morph.shapes.articular import mm
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Path, PathPoint

ROUNDS = 10

WEIGHT = 10.0
"""Of the squared change of a muscle's length and moment arms, beside that of the displacement; 3 to
30 do alike on the demo's leg.
"""

IN_VAIN = 0.5  # Via points that left more than this share of what was too deep go back.
HALVINGS = 4  # Of the share of every move that is taken back in the end.
NAMED = 3  # Points that a line names, with how far they went.


@dataclass(frozen=True, eq=False)
class Clearance:
    """Paths after they were brought out of the bones."""

    # start, model: the target before and after
    start: Model
    model: Model
    # after, before: by muscle how much deeper than allowed it runs, where it does [m]
    after: Mapping[str, float]
    before: Mapping[str, float]

    @property
    def shifts(self) -> dict[tuple[str, str], float]:
        """By muscle and via point how far it was moved [m]."""
        return _shifts(self.start, self.model)

    @property
    def grown(self) -> dict[str, float]:
        """By wrap object how many times larger it is."""
        return _growth(self.start, self.model)

    def without(self, muscles: Collection[str], ground: Ground) -> Clearance:
        """Return the same clearance, but for these muscles and the wrap objects they run around."""
        wraps = wraps_of(*map(self.start.muscle, muscles))
        model = _put_back(self.model, self.start, {*muscles, *wraps})
        return Clearance(
            start=self.start,
            model=model,
            after=ground.excess(model, model.muscle_names),
            before=self.before,
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done and what is left, one line each."""
        if not self.before:
            return ()
        furthest = 1e3 * max(self.shifts.values(), default=0.0)
        done = (
            f"paths of {len(self.before)} muscles ran deeper through bones than in the source:"
            f" {len(self.shifts)} via points were moved (at most {furthest:.1f} mm) and"
            f" {len(self.grown)} wrap objects grew; {len(self.after)} muscles still do"
        )
        return (done,)


def cleared(
    source: Model,
    target: Model,
    bones: Iterable[BoneMap],
    points: Sequence[TransferredPoint],
    table: CoordinateTable | None = None,
) -> tuple[Model, tuple[TransferredPoint, ...], tuple[str, ...]]:
    """Move the target's paths out of its bones.

    Returns the target, its points where they are then, and a line for each correction. `table`: the
    target's coordinate of each of the source's; None where they are the same.
    """
    donor = replace(source, muscles=tuple(source.muscle(muscle.name) for muscle in target.muscles))
    known = {bone.body: bone for bone in bones}
    pairs = compared_coordinates(donor, target, table)
    ground = Ground.of(donor, target, known.values(), pairs, CheckOptions())
    if ground is None:
        return target, tuple(points), ()
    clearance = clear_paths(target, ground)
    odd = _new_oddities(donor, clearance, pairs, muscle_sizes(donor, known))
    if odd:
        clearance = clearance.without(odd, ground)
    shifts = clearance.shifts
    places = {
        (muscle.name, at.name): at.location
        for muscle in clearance.model.muscles
        for at in _fixed(muscle.path)
    }
    moved = (
        (
            replace(
                point,
                target=places[point.owner, point.name],
                cleared=shifts[point.owner, point.name],
            )
            if (point.owner, point.name) in shifts
            else point
        )
        for point in points
    )
    return clearance.model, tuple(moved), (*clearance.notes, *_beyond_interval(points, shifts))


def _beyond_interval(
    points: Iterable[TransferredPoint], shifts: Mapping[tuple[str, str], float]
) -> list[str]:
    """Report points that were moved out of bone by more than their interval, or that have none."""
    known = {(point.owner, point.name): point.within for point in points}
    far = {name: shift for name, shift in shifts.items() if shift > known.get(name, np.nan)}
    unknown = {
        name: shift for name, shift in shifts.items() if not np.isfinite(known.get(name, np.nan))
    }
    lines = []
    if far:
        named = [
            f"'{owner}' ({name}) by {mm(far[owner, name])} where {mm(known[owner, name])} are"
            " likely"
            for owner, name in sorted(far, key=lambda name: known[name] - far[name])
        ]
        lines.append(
            f"{len(far)} via points were brought out of bone by more than their intervals:"
            f" {_first(named)}"
        )
    if unknown:
        named = [
            f"'{owner}' ({name}) by {mm(by)}"
            for (owner, name), by in sorted(unknown.items(), key=lambda item: -item[1])
        ]
        lines.append(
            f"{len(unknown)} via points were brought out of bone where maps give no interval:"
            f" {_first(named)}"
        )
    return lines


def _first(named: Sequence[str]) -> str:
    rest = f" and {len(named) - NAMED} more (points.csv)" if len(named) > NAMED else ""
    return ", ".join(named[:NAMED]) + rest


def clear_paths(target: Model, ground: Ground, weight: float = WEIGHT) -> Clearance:
    """Bring out of the bones what does not run through them in the source.

    Where a path is deepest, a via point beside that place goes out, or the wrap object around which
    the path runs there grows, whichever changes lengths and moment arms over the ranges of motion
    the least; origins and insertions stay. What makes a path deeper is undone and tried again with
    smaller steps: a wrap object that grows past a path's points throws the path aside. In the end
    every move is taken back as far as the path stays out. `weight`: of the change of lengths and
    moment arms beside the displacement; 0 moves points the least.
    """
    model = target
    before = left = ground.excess(target, target.muscle_names)
    watched = watched_with(target, before)
    steps: dict[str, float] = {}
    mover = PathMover(target, ground, weight)
    for _ in range(ROUNDS):
        moved = mover.moved_once(model, steps, watched) if left else None
        if moved is None:
            break
        after = ground.excess(moved, watched)
        model, worse = without_worse(model, moved, left, after)
        steps |= {name: 0.4 * steps.get(name, 1.0) for name in worse}
        left = ground.excess(model, watched) if worse else after
    vain = {
        name
        for name, _ in _shifts(target, model)
        if left.get(name, 0.0) > IN_VAIN * before.get(name, 0.0)
    }
    if vain:
        model = _put_back(model, target, vain)
        left = ground.excess(model, watched)
    smaller, left_after = _taken_back(target, model, ground, left, watched)
    return Clearance(start=target, model=smaller, after=left_after, before=before)


def _taken_back(
    start: Model, end: Model, ground: Ground, left: Mapping[str, float], watched: Sequence[str]
) -> tuple[Model, Mapping[str, float]]:
    """Make every move as small as it can be without a deeper path, by halving.

    Returns the model, and by how much paths are too deep then.
    """
    grown = _growth(start, end)
    units = {*grown, *(name for name, _ in _shifts(start, end))}
    if not units:
        return end, left
    least = dict.fromkeys(units, 0.0)
    most = dict.fromkeys(units, 1.0)

    def concerned(now: Mapping[str, float]) -> set[str]:
        """Return the moves that touch paths which are deeper."""
        deeper = [end.muscle(name) for name in now if now[name] > left.get(name, 0.0) + SAME]
        return units & (wraps_of(*deeper) | {muscle.name for muscle in deeper})

    for _ in range(HALVINGS):
        tried = {name: 0.5 * (least[name] + most[name]) for name in units}
        too_far = concerned(ground.excess(_between(start, end, tried), watched))
        least |= {name: tried[name] for name in too_far}
        most |= {name: tried[name] for name in units - too_far}
    while True:
        model = _between(start, end, most)
        now = ground.excess(model, watched)
        again = {name for name in concerned(now) if most[name] < 1.0}
        if not again:
            return model, now
        most |= dict.fromkeys(again, 1.0)


def _between(start: Model, model: Model, shares: Mapping[str, float]) -> Model:
    """Interpolate a muscle's points and wrap objects between two models, by the given shares."""

    def point(old: PathPoint, new: PathPoint, share: float) -> PathPoint:
        return replace(new, location=old.location + share * (new.location - old.location))

    muscles = list(model.muscles)
    wraps = list(model.wrap_objects)
    for index, (old, new) in enumerate(zip(start.muscles, model.muscles, strict=True)):
        share = shares.get(new.name, 1.0)
        if share < 1.0:
            points = tuple(
                point(a, b, share) if isinstance(a, PathPoint) and isinstance(b, PathPoint) else b
                for a, b in zip(old.path.points, new.path.points, strict=True)
            )
            muscles[index] = replace(new, path=replace(new.path, points=points))
    for index, (first, last) in enumerate(zip(start.wrap_objects, model.wrap_objects, strict=True)):
        share = shares.get(last.name, 1.0)
        if share < 1.0:
            # An infinite cylinder stays one.
            sizes = (
                a if a == b else a + share * (b - a)
                for a, b in zip(first.size, last.size, strict=True)
            )
            wraps[index] = replace(last, size=tuple(sizes))
    return replace(model, muscles=tuple(muscles), wrap_objects=tuple(wraps))


def without_worse(
    before: Model, after: Model, left: Mapping[str, float], now: Mapping[str, float]
) -> tuple[Model, frozenset[str]]:
    """Take back the moves that made a path deeper.

    Returns the model, and the names of the wrap objects and muscles whose moves were taken back.
    """
    deeper = {name for name in now if now[name] > left.get(name, 0.0) + SAME}
    worse = wraps_of(*map(after.muscle, deeper)) & _growth(before, after).keys()
    # A path that only a wrap object has thrown aside comes back with it.
    worse |= {name for name in deeper if not wraps_of(after.muscle(name)) & worse}
    if not worse:
        return after, frozenset()
    return _put_back(after, before, worse), frozenset(worse)


def _put_back(after: Model, before: Model, names: Collection[str]) -> Model:
    """Restore muscles and wrap objects of these names as they were before."""
    muscles = (
        old if old.name in names else new
        for old, new in zip(before.muscles, after.muscles, strict=True)
    )
    wraps = (
        old if old.name in names else new
        for old, new in zip(before.wrap_objects, after.wrap_objects, strict=True)
    )
    return replace(after, muscles=tuple(muscles), wrap_objects=tuple(wraps))


def _new_oddities(
    source: Model, cleared: Clearance, pairs: Sequence[CoordinatePair], sizes: Mapping[str, float]
) -> frozenset[str]:
    """Return the muscles whose moment arms became odd because paths were moved.

    Their sign differs from the source's, or they jump.
    """
    grown = cleared.grown.keys()
    around = {muscle.name for muscle in cleared.model.muscles if grown & wraps_of(muscle)}
    moved = around | {muscle for muscle, _ in cleared.shifts}
    few = replace(
        source, muscles=tuple(muscle for muscle in source.muscles if muscle.name in moved)
    )

    def odd(model: Model) -> frozenset[tuple[str, str]]:
        same = replace(model, muscles=tuple(model.muscle(muscle.name) for muscle in few.muscles))
        warnings = arm_warnings(few, compare_moment_arms(few, same, pairs), sizes, CheckOptions())
        return frozenset(
            (warning.kind, warning.place)
            for warning in warnings
            if warning.kind in ("sign", "jump")
        )

    return (
        frozenset(name for _, name in odd(cleared.model) - odd(cleared.start))
        if moved
        else frozenset()
    )


def watched_with(model: Model, names: Collection[str]) -> tuple[str, ...]:
    """Names of muscles, and of those that run around the same wrap objects."""
    wraps = wraps_of(*map(model.muscle, names))
    return tuple(
        muscle.name for muscle in model.muscles if muscle.name in names or wraps & wraps_of(muscle)
    )


def _shifts(before: Model, after: Model) -> dict[tuple[str, str], float]:
    result = {}
    for old, new in zip(before.muscles, after.muscles, strict=True):
        for a, b in zip(_fixed(old.path), _fixed(new.path), strict=True):
            away = float(np.linalg.norm(b.location - a.location))
            if away > 0.0:
                result[old.name, a.name] = away
    return result


def _fixed(path: Path) -> list[PathPoint]:
    return [point for point in path.points if isinstance(point, PathPoint)]


def _growth(before: Model, after: Model) -> dict[str, float]:
    pairs = zip(before.wrap_objects, after.wrap_objects, strict=True)
    return {old.name: new.size[0] / old.size[0] for old, new in pairs if new.size[0] > old.size[0]}
