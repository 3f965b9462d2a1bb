"""Muscle paths that the map brought into a bone, brought out again: via points are moved, wrap objects grow."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Model
from myomorph.model.paths import Muscle, Path, PathPoint, WrapObject
from myomorph.model.spatial import Transform
from myomorph.morph.checks.moment_arms import (
    CoordinatePair,
    CoordinateTable,
    compare_moment_arms,
    compared_coordinates,
    paired_values,
)
from myomorph.morph.checks.penetration import Depth, Poses, Solid, body_poses, path_depths, range_poses
from myomorph.morph.checks.warnings import CheckOptions, arm_warnings
from myomorph.morph.maps.fields import BoneMap, muscle_sizes
from myomorph.morph.morphed import TransferredPoint
from myomorph.morph.shapes.articular import mm
from myomorph.muscles.path import Paths, compile_paths

SAME = 1e-7
"""Points nearer than this are one [m]."""


@read_only
@dataclass(frozen=True, eq=False)
class PathEnd:
    """Where a straight part of a path, or an arc, ends.

    Attributes
    ----------
    lever : share of its motion with which the place looked at moves
    point : number of the via point, -1 for none
    wrap : name of the wrap object, "" for none
    rotation : (3, 3) of the via point's body in ground
    """

    lever: float
    point: int = -1
    wrap: str = ""
    rotation: Array = field(default_factory=lambda: np.eye(3))

    @property
    def movable(self) -> bool:
        """Whether it is a via point or on a wrap object, and no origin or insertion."""
        return bool(self.wrap) or self.point >= 0


def part_at(paths: Paths, model: Model, muscle: Muscle, coordinates: Array, place: Array) -> list[PathEnd]:
    """Both ends of the straight part, or of the arc around a wrap object, that a place in ground (3,) is on."""
    where = body_poses(model, coordinates)
    nodes = paths.nodes(coordinates[None])[0, model.muscle_names.index(muscle.name)]
    nodes = nodes[np.isfinite(nodes[:, 0])]
    starts, along = nodes[:-1, :3], np.diff(nodes[:, :3], axis=0)
    share = np.einsum("ij,ij->i", place - starts, along) / np.maximum(np.einsum("ij,ij->i", along, along), SAME**2)
    share = np.clip(share, 0.0, 1.0)
    k = int(np.argmin(np.linalg.norm(starts + share[:, None] * along - place, axis=1)))
    arc = bool(nodes[k + 1, 3] > 0.0)
    levers = (1.0, 1.0) if arc else (1.0 - float(share[k]), float(share[k]))
    return [_end(model, muscle, where, nodes[i, :3], lever) for i, lever in zip((k, k + 1), levers, strict=True)]


def _end(model: Model, muscle: Muscle, where: Mapping[str, Transform], node: Array, lever: float) -> PathEnd:
    points = muscle.path.points
    for number, point in enumerate(points):
        if isinstance(point, PathPoint) and np.linalg.norm(where[point.body].apply(point.location) - node) < SAME:
            inner = 0 < number < len(points) - 1
            return PathEnd(lever, number if inner else -1, rotation=where[point.body].rotation)
    around = [one for one in model.wrap_objects if one.name in _wraps_of(muscle) and one.kind != "torus"]
    touched = [(abs(_height(one, where[one.body], node)), one.name) for one in around]
    return PathEnd(lever, wrap=min(touched)[1]) if touched else PathEnd(lever)


def _height(wrap: WrapObject, body: Transform, place: Array) -> float:
    """How far a place in ground lies from a wrap object's surface, about, as a share of its size."""
    local = (body @ wrap.pose).inverse().apply(place)
    if wrap.kind == "cylinder":
        return float(np.linalg.norm(local[:2]) / wrap.size[0] - 1.0)
    return float(np.linalg.norm(local / np.array(wrap.size)) - 1.0)


ROUNDS = 10

OVER = 1.2
"""A path is moved by so many times what it is too deep: the deepest place changes as it moves."""

LEVER = 0.25
"""What moves the deepest place by less than this share of its own motion is not moved for it."""

FURTHEST = 0.04
"""A via point is moved by no more than this share of the bone's length."""

LARGEST = 1.5
"""A wrap object grows to no more than so many times its size."""

IN_VAIN = 0.5
"""Via points that left more than this share of what was too deep go back."""

SMALLEST = 0.1
"""Share of a step below which it is not tried any more."""


@dataclass(frozen=True, eq=False)
class Ground:
    """What paths are held against.

    Attributes
    ----------
    target : bones, by body
    poses : in which paths are looked at
    deeper : how much deeper than the source's, in the target's size, a path may run, as a share of the bone's length
    allowed : by muscle and body of the target how deep its path may run [m]; the share for those that are not there
    """

    target: Mapping[str, Solid]
    poses: Poses
    deeper: float
    allowed: Mapping[tuple[str, str], float]

    @staticmethod
    def of(
        source: Model,
        target: Model,
        bones: Iterable[BoneMap],
        pairs: Sequence[CoordinatePair],
        options: CheckOptions,
    ) -> Ground | None:
        """The bones of which both surfaces are known; None where there is none."""
        known = {bone.body: bone for bone in bones if bone.source is not None and bone.target is not None}
        if not known:
            return None
        values, target_values = paired_values(source, target, pairs, options.poses)
        ours = {body: Solid(bone.source) for body, bone in known.items() if bone.source is not None}
        allowed: dict[tuple[str, str], float] = {}
        poses = range_poses(source, [one.source for one in pairs], values)
        for (muscle, body), one in path_depths(source, ours, poses).items():
            key, size = (muscle, known[body].target_body), known[body].whole.scale
            allowed[key] = max(allowed.get(key, 0.0), size * one.depth)
        return Ground(
            {bone.target_body: Solid(bone.target) for bone in known.values() if bone.target is not None},
            range_poses(target, [one.target for one in pairs], target_values),
            options.deeper,
            allowed,
        )

    def too_deep(self, model: Model, muscles: Sequence[str]) -> Iterator[tuple[str, Depth, float]]:
        """Muscles that run deeper through a bone than they may, where, and by how much [m]."""
        for (muscle, body), one in path_depths(model, self.target, self.poses, muscles).items():
            over = one.depth - self.allowed.get((muscle, body), 0.0) - self.deeper * self.target[body].length
            if over > 0.0:
                yield muscle, one, over

    def excess(self, model: Model, muscles: Sequence[str]) -> dict[str, float]:
        """By muscle how much too deep it runs at most, where it does [m]."""
        found: dict[str, float] = {}
        for muscle, _, over in self.too_deep(model, muscles):
            found[muscle] = max(found.get(muscle, 0.0), over)
        return found


@dataclass(frozen=True, eq=False)
class Clearance:
    """Paths after they were brought out of the bones.

    Attributes
    ----------
    start, model : the target before and after
    before, after : by muscle how much deeper than allowed it runs, where it does [m]
    """

    start: Model
    model: Model
    before: Mapping[str, float]
    after: Mapping[str, float]

    @property
    def shifts(self) -> dict[tuple[str, str], float]:
        """By muscle and via point how far it was moved [m]."""
        return _shifts(self.start, self.model)

    @property
    def grown(self) -> dict[str, float]:
        """By wrap object how many times larger it is."""
        return _growth(self.start, self.model)

    def without(self, muscles: Collection[str], ground: Ground) -> Clearance:
        """The same, but for these muscles and the wrap objects they run around."""
        wraps = _wraps_of(*map(self.start.muscle, muscles))
        found = _put_back(self.model, self.start, {*muscles, *wraps})
        return Clearance(self.start, found, self.before, ground.excess(found, found.muscle_names))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done and what is left, one line each."""
        if not self.before:
            return ()
        furthest = 1e3 * max(self.shifts.values(), default=0.0)
        done = (
            f"paths of {len(self.before)} muscles ran deeper through bones than in the source: {len(self.shifts)} via "
            f"points were moved (at most {furthest:.1f} mm) and {len(self.grown)} wrap objects grew; {len(self.after)} "
            "muscles still do"
        )
        return (done,)


def cleared(
    source: Model,
    target: Model,
    bones: Iterable[BoneMap],
    points: Sequence[TransferredPoint],
    table: CoordinateTable | None = None,
) -> tuple[Model, tuple[TransferredPoint, ...], tuple[str, ...]]:
    """The target with its paths out of the bones, its points where they are then, and what was done.

    Parameters
    ----------
    bones : those of which both surfaces are known count
    points : on their way so far
    table : the target's coordinate of each of the source's; None where they are the same
    """
    donor = replace(source, muscles=tuple(source.muscle(one.name) for one in target.muscles))
    known = {bone.body: bone for bone in bones}
    pairs = compared_coordinates(donor, target, table)
    ground = Ground.of(donor, target, known.values(), pairs, CheckOptions())
    if ground is None:
        return target, tuple(points), ()
    found = clear_paths(target, ground)
    odd = _new_oddities(donor, found, pairs, muscle_sizes(donor, known))
    if odd:
        found = found.without(odd, ground)
    shifts = found.shifts
    places = {(one.name, at.name): at.location for one in found.model.muscles for at in _fixed(one.path)}
    moved = (
        replace(one, target=places[one.owner, one.name]) if (one.owner, one.name) in shifts else one for one in points
    )
    return found.model, tuple(moved), (*found.notes, *_beyond_interval(points, shifts))


def _beyond_interval(points: Iterable[TransferredPoint], shifts: Mapping[tuple[str, str], float]) -> list[str]:
    """A line where points were brought out of bone further than they may have been wrong by."""
    known = {(one.owner, one.name): one.within for one in points}
    far = {name: shift for name, shift in shifts.items() if shift > known.get(name, np.nan)}
    if not far:
        return []
    worst = max(far, key=lambda name: far[name])
    return [
        f"{len(far)} via points were brought out of bone further than their place is uncertain by: most "
        f"'{worst[0]}' ({worst[1]}), by {mm(far[worst])} where {mm(known[worst])} are likely"
    ]


def clear_paths(target: Model, ground: Ground) -> Clearance:
    """Bring out of the bones what does not run through them in the source.

    Where a path is deepest, the via point beside that place goes outward, or the wrap object around which the path runs
    there grows, whichever moves the place more; origins and insertions stay. What makes a path deeper is undone and
    tried again with smaller steps: a wrap object that grows past a path's points throws the path aside.
    """
    found = target
    before = left = ground.excess(target, target.muscle_names)
    watched = watched_with(target, before)
    steps: dict[str, float] = {}
    for _ in range(ROUNDS):
        moved = _round(found, target, ground, steps, watched) if left else None
        if moved is None:
            break
        after = ground.excess(moved, watched)
        found, worse = without_worse(found, moved, left, after)
        steps |= {name: 0.4 * steps.get(name, 1.0) for name in worse}
        left = ground.excess(found, watched) if worse else after
    vain = {name for name, _ in _shifts(target, found) if left.get(name, 0.0) > IN_VAIN * before.get(name, 0.0)}
    if vain:
        found = _put_back(found, target, vain)
        left = ground.excess(found, watched)
    return Clearance(target, found, before, left)


def without_worse(
    before: Model, after: Model, left: Mapping[str, float], now: Mapping[str, float]
) -> tuple[Model, frozenset[str]]:
    """What was done less what made a path deeper, and the names of the wrap objects and muscles this concerns."""
    deeper = {name for name in now if now[name] > left.get(name, 0.0) + SAME}
    worse = _wraps_of(*map(after.muscle, deeper)) & _growth(before, after).keys()
    # A path that only a wrap object has thrown aside comes back with it.
    worse |= {name for name in deeper if not _wraps_of(after.muscle(name)) & worse}
    if not worse:
        return after, frozenset()
    return _put_back(after, before, worse), frozenset(worse)


def _put_back(after: Model, before: Model, names: Collection[str]) -> Model:
    """A model with muscles and wrap objects of these names as they were before."""
    muscles = (old if old.name in names else new for old, new in zip(before.muscles, after.muscles, strict=True))
    wraps = (
        old if old.name in names else new for old, new in zip(before.wrap_objects, after.wrap_objects, strict=True)
    )
    return replace(after, muscles=tuple(muscles), wrap_objects=tuple(wraps))


def _new_oddities(
    source: Model, cleared: Clearance, pairs: Sequence[CoordinatePair], sizes: Mapping[str, float]
) -> frozenset[str]:
    """Muscles whose moment arms turned to another sign than the source's, or jump, because paths were moved."""
    grown = cleared.grown.keys()
    around = {one.name for one in cleared.model.muscles if grown & _wraps_of(one)}
    moved = around | {muscle for muscle, _ in cleared.shifts}
    few = replace(source, muscles=tuple(one for one in source.muscles if one.name in moved))

    def odd(model: Model) -> frozenset[tuple[str, str]]:
        same = replace(model, muscles=tuple(model.muscle(one.name) for one in few.muscles))
        warnings = arm_warnings(few, compare_moment_arms(few, same, pairs), sizes, CheckOptions())
        return frozenset((one.kind, one.name) for one in warnings if one.kind in ("sign", "jump"))

    return frozenset(name for _, name in odd(cleared.model) - odd(cleared.start)) if moved else frozenset()


def watched_with(model: Model, names: Collection[str]) -> tuple[str, ...]:
    """Names of muscles, and of those that run around the same wrap objects."""
    wraps = _wraps_of(*map(model.muscle, names))
    return tuple(one.name for one in model.muscles if one.name in names or wraps & _wraps_of(one))


def _wraps_of(*muscles: Muscle) -> set[str]:
    return {wrap.wrap_object for one in muscles for wrap in one.path.wraps}


def _round(
    model: Model, start: Model, ground: Ground, steps: Mapping[str, float], muscles: Sequence[str]
) -> Model | None:
    """The model with every path that is too deep moved once, by its share of the way; None where nothing can be."""
    poses, paths = ground.poses, compile_paths(model)
    pushes: dict[tuple[str, int], Array] = {}
    swollen: dict[str, float] = {}
    for name, place, over in ground.too_deep(model, muscles):
        if steps.get(name, 1.0) < SMALLEST:
            continue
        ends = [
            one
            for one in part_at(paths, model, model.muscle(name), poses.coordinates[place.pose], place.place)
            if one.movable and one.lever >= LEVER and steps.get(one.wrap, 1.0) >= SMALLEST
        ]
        if not ends:
            continue
        chosen = max(ends, key=lambda one: one.lever)
        way = OVER * steps.get(chosen.wrap or name, 1.0) * over / chosen.lever
        if chosen.wrap:
            swollen[chosen.wrap] = max(swollen.get(chosen.wrap, 0.0), way)
        else:
            push = way * (place.outward @ chosen.rotation)
            known = pushes.get((name, chosen.point))
            pushes[name, chosen.point] = push if known is None or way > np.linalg.norm(known) else known
    if not pushes and not swollen:
        return None
    reach = {body: FURTHEST * solid.length for body, solid in ground.target.items()}
    return replace(
        model,
        muscles=tuple(_pushed(one, start.muscle(one.name), pushes, reach) for one in model.muscles),
        wrap_objects=tuple(
            _swollen(one, first, swollen.get(one.name, 0.0))
            for one, first in zip(model.wrap_objects, start.wrap_objects, strict=True)
        ),
    )


def _pushed(
    muscle: Muscle, start: Muscle, pushes: Mapping[tuple[str, int], Array], reach: Mapping[str, float]
) -> Muscle:
    points = list(muscle.path.points)
    for number, (point, first) in enumerate(zip(points, start.path.points, strict=True)):
        push = pushes.get((muscle.name, number))
        if push is None or not isinstance(point, PathPoint) or not isinstance(first, PathPoint):
            continue
        away = point.location + push - first.location
        size, most = float(np.linalg.norm(away)), reach.get(point.body, np.inf)
        points[number] = replace(point, location=first.location + away * min(1.0, most / size))
    return replace(muscle, path=replace(muscle.path, points=tuple(points)))


def _swollen(wrap: WrapObject, start: WrapObject, by: float) -> WrapObject:
    if by <= 0.0:
        return wrap
    grows = slice(0, 1) if wrap.kind == "cylinder" else slice(None)
    sizes = list(wrap.size)
    sizes[grows] = [
        min(one + by, LARGEST * most) for one, most in zip(wrap.size[grows], start.size[grows], strict=True)
    ]
    return replace(wrap, size=tuple(sizes))


def _shifts(before: Model, after: Model) -> dict[tuple[str, str], float]:
    found = {}
    for old, new in zip(before.muscles, after.muscles, strict=True):
        for a, b in zip(_fixed(old.path), _fixed(new.path), strict=True):
            away = float(np.linalg.norm(b.location - a.location))
            if away > 0.0:
                found[old.name, a.name] = away
    return found


def _fixed(path: Path) -> list[PathPoint]:
    return [one for one in path.points if isinstance(one, PathPoint)]


def _growth(before: Model, after: Model) -> dict[str, float]:
    pairs = zip(before.wrap_objects, after.wrap_objects, strict=True)
    return {old.name: new.size[0] / old.size[0] for old, new in pairs if new.size[0] > old.size[0]}
