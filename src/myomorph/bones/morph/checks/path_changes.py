"""Moves of via points and wrap objects that bring paths out of bones.

Of all moves, the one is chosen that changes lengths and moment arms the least.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.bones.morph.checks.moment_arms import CoordinatePair, paired_values
from myomorph.bones.morph.checks.penetration import Depth, Poses, Solid, path_depths, range_poses
from myomorph.bones.morph.checks.warnings import CheckOptions
from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, PathPoint, WrapObject, surface_level
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.rigid.kinematics import forward_kinematics

STEP = 1e-3  # Of a difference, as a share of the muscle's path in the first pose.


@read_only
class PathChange:
    """Difference of a muscle's path from another model's, root mean squares over the poses."""

    length: float  # its length [m]
    arm: float  # all its moment arms about turning coordinates together [m/rad]


def moved_poses(model: Model, muscle: Muscle, poses: Poses) -> Array:
    """Return the poses whose coordinate moves a muscle, the default pose among them.

    Parameters
    ----------
    model : with the muscle
    muscle : whose coordinates count
    poses : to choose from

    Returns
    -------
    (n, coordinates) poses [rad or m]
    """
    paths = compile_paths(model)
    coordinates = paths.arm_coordinate[paths.arm_muscle == model.muscle_names.index(muscle.name)]
    names = {"", *(model.coordinate_names[j] for j in coordinates)}
    return np.asarray(poses.coordinates[[name in names for name in poses.moved]])


def path_changes(before: Model, after: Model, poses: Poses) -> dict[str, PathChange]:
    """Compare the muscles whose path, or wrap object, differs between two models.

    Apart from these the models must be equal.
    """
    odd = {
        new.name
        for old, new in zip(before.wrap_objects, after.wrap_objects, strict=True)
        if old is not new
    }
    result = {}
    for old, new in zip(before.muscles, after.muscles, strict=True):
        if old.path is not new.path or wraps_of(old) & odd:
            where = moved_poses(before, old, poses)
            (l0, a0) = _lengths_and_arms(replace(before, muscles=(old,)), where)
            (l1, a1) = _lengths_and_arms(replace(after, muscles=(new,)), where)
            arms = np.sqrt(np.mean(np.sum((a1 - a0)[0] ** 2, axis=1)))
            result[old.name] = PathChange(float(np.sqrt(np.mean((l1 - l0) ** 2))), float(arms))
    return result


def point_effect(model: Model, muscle: Muscle, number: int, poses: Poses) -> Array:
    """Return changes of lengths and moment arms with the position of a via point.

    They are weighted so that their sum of squares is the mean over the poses that move the muscle.

    Parameters
    ----------
    model : with the muscle
    muscle : whose point moves
    number : of the point in the muscle's path
    poses : of which those that move the muscle count

    Returns
    -------
    (n, 3) changes with each component of the position [m/m, and m/rad/m]; no rows where the point
    is none that is fixed to one body
    """
    where = moved_poses(model, muscle, poses)
    points = muscle.path.points
    point = points[number]
    if not isinstance(point, PathPoint):
        return np.zeros((0, 3))
    step = _step(model, muscle, where)
    shifted: list[Muscle] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            place = point.location + sign * step * np.eye(3)[axis]
            changed = (*points[:number], replace(point, location=place), *points[number + 1 :])
            shifted.append(
                replace(
                    muscle,
                    name=f"{muscle.name} {len(shifted)}",
                    path=replace(muscle.path, points=changed),
                )
            )
    rows = _rows(*_lengths_and_arms(replace(model, muscles=tuple(shifted)), where))
    return np.asarray((rows[0::2] - rows[1::2]).T / (2.0 * step))


def wrap_effect(model: Model, wrap: WrapObject, poses: Poses) -> Array:
    """Return changes of lengths and moment arms with the radius of a wrap object.

    They are weighted as `point_effect` does, for all muscles that run around the object.

    Parameters
    ----------
    model : with the wrap object
    wrap : whose radius grows
    poses : of which those that move each muscle count

    Returns
    -------
    (n,) changes [m/m, and m/rad/m]
    """
    effects = [np.zeros(0)]
    for muscle in model.muscles:
        if wrap.name in wraps_of(muscle):
            where = moved_poses(model, muscle, poses)
            step = _step(model, muscle, where)
            larger = replace(wrap, size=grown_sizes(wrap, step))
            grown = replace(
                model,
                muscles=(muscle,),
                wrap_objects=tuple(
                    larger if item.name == wrap.name else item for item in model.wrap_objects
                ),
            )
            both = [
                _rows(*_lengths_and_arms(each, where))[0]
                for each in (replace(model, muscles=(muscle,)), grown)
            ]
            effects.append((both[1] - both[0]) / step)
    return np.concatenate(effects)


def grown_sizes(wrap: WrapObject, by: float) -> tuple[float, ...]:
    """Sizes of a wrap object that is so much larger [m]; a cylinder keeps its length."""
    grows = 1 if wrap.kind == "cylinder" else len(wrap.size)
    return tuple(size + by if index < grows else size for index, size in enumerate(wrap.size))


def _step(model: Model, muscle: Muscle, where: Array) -> float:
    lengths = compile_paths(model).evaluate(where[:1])[0]
    return STEP * float(lengths[0, model.muscle_names.index(muscle.name)])


def _lengths_and_arms(model: Model, where: Array) -> tuple[Array, Array]:
    """Return lengths (muscles, poses), and moment arms (muscles, poses, arms).

    The moment arms are those about independent rotational coordinates.
    """
    paths = compile_paths(model)
    lengths, _, arms = paths.evaluate(where)
    turning = np.array(
        [
            coordinate.motion == "rotational" and coordinate.name not in model.dependent_coordinates
            for coordinate in model.coordinates
        ]
    )
    chosen = turning[paths.arm_coordinate]
    of_muscles = [
        arms[:, (paths.arm_muscle == index) & chosen] for index in range(len(model.muscles))
    ]
    return lengths.T, np.array(of_muscles)


def _rows(lengths: Array, arms: Array) -> Array:
    """(muscles, n) in one row each."""
    flat: Sequence[Array] = (lengths, arms.reshape(len(arms), -1))
    return np.concatenate(flat, axis=1) / np.sqrt(lengths.shape[1])


SAME = 1e-7  # Points nearer than this are one [m].


@read_only
class PathEnd:
    """Where a straight part of a path, or an arc, ends."""

    lever: float  # share of its motion with which the place looked at moves
    point: int = -1  # number of the via point, -1 for none
    wrap: str = ""  # name of the wrap object, "" for none
    # (3, 3) of the via point's body in ground
    rotation: Array = field(default_factory=lambda: np.eye(3))

    @property
    def movable(self) -> bool:
        """Whether it is a via point or on a wrap object, and no origin or insertion."""
        return bool(self.wrap) or self.point >= 0


def part_at(
    paths: Paths, model: Model, muscle: Muscle, coordinates: Array, place: Array
) -> list[PathEnd]:
    """Return both ends of the straight part, or of the arc around a wrap object, at a point.

    Parameters
    ----------
    paths : compiled of the model
    model : with the muscle
    muscle : whose path it is
    coordinates : (coordinates,) the pose [rad or m]
    place : (3,) point on the path, in ground [m]

    Returns
    -------
    the part's first end and its last
    """
    where = forward_kinematics(paths.tree, coordinates[None]).transforms()
    nodes = paths.nodes(coordinates[None])[0, model.muscle_names.index(muscle.name)]
    nodes = nodes[np.isfinite(nodes[:, 0])]
    starts = nodes[:-1, :3]
    along = np.diff(nodes[:, :3], axis=0)
    share = np.einsum("ij,ij->i", place - starts, along) / np.maximum(
        np.einsum("ij,ij->i", along, along), SAME**2
    )
    share = np.clip(share, 0.0, 1.0)
    index = int(np.argmin(np.linalg.norm(starts + share[:, None] * along - place, axis=1)))
    arc = bool(nodes[index + 1, 3] > 0.0)
    levers = (1.0, 1.0) if arc else (1.0 - float(share[index]), float(share[index]))
    return [
        _end(model, muscle, where, nodes[i, :3], arm)
        for i, arm in zip((index, index + 1), levers, strict=True)
    ]


def _end(
    model: Model, muscle: Muscle, where: Mapping[str, Transform], node: Array, lever: float
) -> PathEnd:
    points = muscle.path.points
    for number, point in enumerate(points):
        if (
            isinstance(point, PathPoint)
            and np.linalg.norm(where[point.body].apply(point.location) - node) < SAME
        ):
            inner = 0 < number < len(points) - 1
            return PathEnd(lever, number if inner else -1, rotation=where[point.body].rotation)
    around = [
        item
        for item in model.wrap_objects
        if item.name in wraps_of(muscle) and item.kind != "torus"
    ]
    local = [(where[item.body] @ item.pose).inverse().apply(node[None]) for item in around]
    touched = [
        (abs(surface_level(item, at)[0] - 1.0), item.name)
        for item, at in zip(around, local, strict=True)
    ]
    return PathEnd(lever, wrap=min(touched)[1]) if touched else PathEnd(lever)


def wraps_of(*muscles: Muscle) -> set[str]:
    """Names of the wrap objects that muscles run around."""
    return {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}


# A path is moved by so many times what it is too deep: the deepest place changes as it moves.
OVER = 1.2
# What moves the deepest place by less than this share of its own motion is not moved for it.
LEVER = 0.25
FURTHEST = 0.04  # A via point is moved by no more than this share of the bone's length.
LARGEST = 1.5  # A wrap object grows to no more than so many times its size.
SMALLEST = 0.1  # Share of a step below which it is not tried any more.


@read_only
class Move:
    """A way to bring a path out of a bone."""

    end: PathEnd  # the via point or wrap object that is moved
    by: Array  # (3,) of a via point in its body's frame, (1,) by how much a wrap object grows [m]
    cost: float  # square of what it moves, and `weight` times the square of what it changes


@read_only
class WayOut:
    """Displacement that brings a point of a path out of a bone.

    Attributes
    ----------
    direction : (3,) unit vector, in ground
    distance : along it [m]
    """

    direction: Array
    distance: float


@dataclass(frozen=True, eq=False)
class ChangeCost:
    """Cost of changes of lengths and moment arms.

    Attributes
    ----------
    poses : at which they count
    weight : of their squares compared with that of the move; 0 for none
    """

    poses: Poses
    weight: float


def least_move(
    model: Model, muscle: Muscle, ends: Sequence[PathEnd], out: WayOut, cost: ChangeCost
) -> Move:
    """Return the move of least cost, of one end, that brings a point of a path out of a bone.

    With E the changes of lengths and moment arms by the move d of a via point, and n the way out,
    the least of |d|^2 + weight |E d|^2 with n d = distance / lever is

        d = distance / lever M^-1 n / (n M^-1 n),   M = 1 + weight E^T E

    Parameters
    ----------
    model : with the muscle
    muscle : whose path is too deep
    ends : of the part of the path that is too deep
    out : how the point has to move
    cost : of changes of lengths and moment arms

    Returns
    -------
    the move, with its end and its cost
    """
    poses = cost.poses
    weight = cost.weight
    moves = []
    for end in ends:
        way = out.distance / end.lever
        if end.wrap:
            wrap = next(item for item in model.wrap_objects if item.name == end.wrap)
            effect = wrap_effect(model, wrap, poses) if weight else np.zeros(1)
            moves.append(
                Move(end, np.array([way]), way**2 * (1.0 + weight * float(effect @ effect)))
            )
            continue
        normal = out.direction @ end.rotation
        effect = point_effect(model, muscle, end.point, poses) if weight else np.zeros((0, 3))
        stiffness = np.eye(3) + weight * effect.T @ effect
        least = np.linalg.solve(stiffness, normal)
        by = np.asarray(way * least / float(normal @ least), dtype=np.float64)
        moves.append(Move(end, by, float(by @ stiffness @ by)))
    return min(moves, key=lambda move: move.cost)


@dataclass(frozen=True, eq=False)
class PathMover:
    """What moves paths out of bones.

    Attributes
    ----------
    start : model before any move, from which no point goes too far
    ground : bones that paths are held against
    weight : of changes of lengths and moment arms compared with the moves
    """

    start: Model
    ground: Ground
    weight: float

    def moved_once(
        self, model: Model, steps: Mapping[str, float], muscles: Sequence[str]
    ) -> Model | None:
        """Move every path that is too deep once, by its share of the way.

        `steps`: shares by muscle or wrap object, 1 where there is none; `muscles`: to check.
        Returns the model; None where nothing can be moved.
        """
        paths = compile_paths(model)
        pushes: dict[tuple[str, int], Array] = {}
        swollen: dict[str, float] = {}
        for name, place, over in self.ground.too_deep(model, muscles):
            if steps.get(name, 1.0) < SMALLEST:
                continue
            muscle = model.muscle(name)
            ends = self._movable_ends(paths, model, muscle, place, steps)
            if not ends:
                continue
            out = WayOut(place.outward, over)
            move = least_move(model, muscle, ends, out, ChangeCost(self.ground.poses, self.weight))
            end = move.end
            by = OVER * steps.get(end.wrap or name, 1.0) * move.by
            if end.wrap:
                swollen[end.wrap] = max(swollen.get(end.wrap, 0.0), float(by[0]))
            else:
                pushes[name, end.point] = _longer(by, pushes.get((name, end.point)))
        return self._with_moves(model, pushes, swollen) if pushes or swollen else None

    def _movable_ends(
        self, paths: Paths, model: Model, muscle: Muscle, place: Depth, steps: Mapping[str, float]
    ) -> list[PathEnd]:
        """Return the ends beside a place that can be moved, and move it enough."""
        coordinates = self.ground.poses.coordinates[place.pose]
        return [
            end
            for end in part_at(paths, model, muscle, coordinates, place.place)
            if end.movable and end.lever >= LEVER and steps.get(end.wrap, 1.0) >= SMALLEST
        ]

    def _with_moves(
        self, model: Model, pushes: Mapping[tuple[str, int], Array], swollen: Mapping[str, float]
    ) -> Model:
        """Return the model with its via points displaced and its wrap objects grown [m]."""
        reach = {body: FURTHEST * solid.length for body, solid in self.ground.target.items()}
        return replace(
            model,
            muscles=tuple(
                _pushed(item, self.start.muscle(item.name), pushes, reach) for item in model.muscles
            ),
            wrap_objects=tuple(
                _swollen(item, first, swollen.get(item.name, 0.0))
                for item, first in zip(model.wrap_objects, self.start.wrap_objects, strict=True)
            ),
        )


def _longer(by: Array, known: Array | None) -> Array:
    """Return the longer of two displacements (3,), of which the second may be missing."""
    if known is None or np.linalg.norm(by) > np.linalg.norm(known):
        return by
    return known


def _pushed(
    muscle: Muscle,
    start: Muscle,
    pushes: Mapping[tuple[str, int], Array],
    reach: Mapping[str, float],
) -> Muscle:
    points = list(muscle.path.points)
    for number, (point, first) in enumerate(zip(points, start.path.points, strict=True)):
        push = pushes.get((muscle.name, number))
        if push is None or not isinstance(point, PathPoint) or not isinstance(first, PathPoint):
            continue
        away = point.location + push - first.location
        size = float(np.linalg.norm(away))
        most = reach.get(point.body, np.inf)
        points[number] = replace(point, location=first.location + away * min(1.0, most / size))
    return replace(muscle, path=replace(muscle.path, points=tuple(points)))


def _swollen(wrap: WrapObject, start: WrapObject, by: float) -> WrapObject:
    if by <= 0.0:
        return wrap
    sizes = [
        min(size, LARGEST * most)
        for size, most in zip(grown_sizes(wrap, by), start.size, strict=True)
    ]
    return replace(wrap, size=tuple(sizes))


@dataclass(frozen=True, eq=False)
class Ground:
    """What paths are held against."""

    target: Mapping[str, Solid]  # bones, by body
    poses: Poses  # in which paths are looked at
    # how much deeper than the source's, in the target's size, a path may run, as a share of the
    # bone's length
    deeper: float
    # by muscle and body of the target how deep its path may run [m]; the share for those that are
    # not there
    allowed: Mapping[tuple[str, str], float]

    @staticmethod
    def of(
        source: Model,
        target: Model,
        bones: Iterable[BoneMap],
        pairs: Sequence[CoordinatePair],
        options: CheckOptions,
    ) -> Ground | None:
        """Return the bones of which both surfaces are known; None where there is none."""
        known = {
            bone.body: bone for bone in bones if bone.source is not None and bone.target is not None
        }
        if not known:
            return None
        values, target_values = paired_values(source, target, pairs, options.poses)
        ours = {body: Solid(bone.source) for body, bone in known.items() if bone.source is not None}
        allowed: dict[tuple[str, str], float] = {}
        poses = range_poses(source, [pair.source for pair in pairs], values)
        for (muscle, body), depth in path_depths(source, ours, poses).items():
            key = (muscle, known[body].target_body)
            size = known[body].whole.scale
            allowed[key] = max(allowed.get(key, 0.0), size * depth.depth)
        return Ground(
            target={
                bone.target_body: Solid(bone.target)
                for bone in known.values()
                if bone.target is not None
            },
            poses=range_poses(target, [pair.target for pair in pairs], target_values),
            deeper=options.deeper,
            allowed=allowed,
        )

    def too_deep(self, model: Model, muscles: Sequence[str]) -> Iterator[tuple[str, Depth, float]]:
        """Muscles that run deeper through a bone than they may, where, and by how much [m]."""
        for (muscle, body), depth in path_depths(model, self.target, self.poses, muscles).items():
            over = (
                depth.depth
                - self.allowed.get((muscle, body), 0.0)
                - self.deeper * self.target[body].length
            )
            if over > 0.0:
                yield muscle, depth, over

    def excess(self, model: Model, muscles: Sequence[str]) -> dict[str, float]:
        """By muscle how much too deep it runs at most, where it does [m]."""
        result: dict[str, float] = {}
        for muscle, _, over in self.too_deep(model, muscles):
            result[muscle] = max(result.get(muscle, 0.0), over)
        return result
