"""Moves of via points and wrap objects that bring paths out of bones, and change lengths and moment arms the least."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Model
from myomorph.model.paths import Muscle, PathPoint, WrapObject
from myomorph.morph.checks.moment_arms import CoordinatePair, paired_values
from myomorph.morph.checks.path_changes import PathEnd, grown_sizes, part_at, point_effect, wrap_effect
from myomorph.morph.checks.penetration import Depth, Poses, Solid, path_depths, range_poses
from myomorph.morph.checks.warnings import CheckOptions
from myomorph.morph.maps.fields import BoneMap
from myomorph.muscles.path import compile_paths

OVER = 1.2  # A path is moved by so many times what it is too deep: the deepest place changes as it moves.
LEVER = 0.25  # What moves the deepest place by less than this share of its own motion is not moved for it.
FURTHEST = 0.04  # A via point is moved by no more than this share of the bone's length.
LARGEST = 1.5  # A wrap object grows to no more than so many times its size.
SMALLEST = 0.1  # Share of a step below which it is not tried any more.


@read_only
class Move:
    """A way to bring a path out of a bone."""

    end: PathEnd  # the via point or wrap object that is moved
    by: Array  # (3,) of a via point in its body's frame, (1,) by how much a wrap object grows [m]
    cost: float  # square of what it moves, and `weight` times the square of what it changes


def least_move(
    model: Model, muscle: Muscle, ends: Sequence[PathEnd], outward: Array, over: float, poses: Poses, weight: float
) -> Move:
    """Of all moves of one end that bring the place out by `over` [m], the one of least cost. With E the changes of
    lengths and moment arms by the move d of a via point, and n the way out, the least of |d|^2 + weight |E d|^2 with n
    d = over / lever is d = over / lever M^-1 n / (n M^-1 n), M = 1 + weight E^T E.
    """
    moves = []
    for end in ends:
        way = over / end.lever
        if end.wrap:
            wrap = next(item for item in model.wrap_objects if item.name == end.wrap)
            effect = wrap_effect(model, wrap, poses) if weight else np.zeros(1)
            moves.append(Move(end, np.array([way]), way**2 * (1.0 + weight * float(effect @ effect))))
            continue
        normal = outward @ end.rotation
        effect = point_effect(model, muscle, end.point, poses) if weight else np.zeros((0, 3))
        stiffness = np.eye(3) + weight * effect.T @ effect
        least = np.linalg.solve(stiffness, normal)
        by = np.asarray(way * least / float(normal @ least), dtype=np.float64)
        moves.append(Move(end, by, float(by @ stiffness @ by)))
    return min(moves, key=lambda move: move.cost)


def moved_once(
    model: Model, start: Model, ground: Ground, steps: Mapping[str, float], muscles: Sequence[str], weight: float
) -> Model | None:
    """The model with every path that is too deep moved once, by its share of the way; None where nothing can be."""
    poses, paths = ground.poses, compile_paths(model)
    pushes: dict[tuple[str, int], Array] = {}
    swollen: dict[str, float] = {}
    for name, place, over in ground.too_deep(model, muscles):
        if steps.get(name, 1.0) < SMALLEST:
            continue
        muscle = model.muscle(name)
        ends = [
            path_end
            for path_end in part_at(paths, model, muscle, poses.coordinates[place.pose], place.place)
            if path_end.movable and path_end.lever >= LEVER and steps.get(path_end.wrap, 1.0) >= SMALLEST
        ]
        if not ends:
            continue
        move = least_move(model, muscle, ends, place.outward, over, poses, weight)
        end, by = move.end, OVER * steps.get(move.end.wrap or name, 1.0) * move.by
        if end.wrap:
            swollen[end.wrap] = max(swollen.get(end.wrap, 0.0), float(by[0]))
        else:
            known = pushes.get((name, end.point))
            further = known is None or np.linalg.norm(by) > np.linalg.norm(known)
            pushes[name, end.point] = by if known is None or further else known
    if not pushes and not swollen:
        return None
    reach = {body: FURTHEST * solid.length for body, solid in ground.target.items()}
    return replace(
        model,
        muscles=tuple(_pushed(item, start.muscle(item.name), pushes, reach) for item in model.muscles),
        wrap_objects=tuple(
            _swollen(item, first, swollen.get(item.name, 0.0))
            for item, first in zip(model.wrap_objects, start.wrap_objects, strict=True)
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
    sizes = [min(size, LARGEST * most) for size, most in zip(grown_sizes(wrap, by), start.size, strict=True)]
    return replace(wrap, size=tuple(sizes))


@dataclass(frozen=True, eq=False)
class Ground:
    """What paths are held against."""

    target: Mapping[str, Solid]  # bones, by body
    poses: Poses  # in which paths are looked at
    # how much deeper than the source's, in the target's size, a path may run, as a share of the bone's length
    deeper: float
    # by muscle and body of the target how deep its path may run [m]; the share for those that are not there
    allowed: Mapping[tuple[str, str], float]

    @staticmethod
    def of(
        source: Model, target: Model, bones: Iterable[BoneMap], pairs: Sequence[CoordinatePair], options: CheckOptions
    ) -> Ground | None:
        """The bones of which both surfaces are known; None where there is none."""
        known = {bone.body: bone for bone in bones if bone.source is not None and bone.target is not None}
        if not known:
            return None
        values, target_values = paired_values(source, target, pairs, options.poses)
        ours = {body: Solid(bone.source) for body, bone in known.items() if bone.source is not None}
        allowed: dict[tuple[str, str], float] = {}
        poses = range_poses(source, [pair.source for pair in pairs], values)
        for (muscle, body), depth in path_depths(source, ours, poses).items():
            key, size = (muscle, known[body].target_body), known[body].whole.scale
            allowed[key] = max(allowed.get(key, 0.0), size * depth.depth)
        return Ground(
            {bone.target_body: Solid(bone.target) for bone in known.values() if bone.target is not None},
            range_poses(target, [pair.target for pair in pairs], target_values),
            options.deeper,
            allowed,
        )

    def too_deep(self, model: Model, muscles: Sequence[str]) -> Iterator[tuple[str, Depth, float]]:
        """Muscles that run deeper through a bone than they may, where, and by how much [m]."""
        for (muscle, body), depth in path_depths(model, self.target, self.poses, muscles).items():
            over = depth.depth - self.allowed.get((muscle, body), 0.0) - self.deeper * self.target[body].length
            if over > 0.0:
                yield muscle, depth, over

    def excess(self, model: Model, muscles: Sequence[str]) -> dict[str, float]:
        """By muscle how much too deep it runs at most, where it does [m]."""
        result: dict[str, float] = {}
        for muscle, _, over in self.too_deep(model, muscles):
            result[muscle] = max(result.get(muscle, 0.0), over)
        return result
