"""What moving a via point, or growing a wrap object, changes: lengths and moment arms over the ranges of motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Model
from myomorph.model.paths import Muscle, PathPoint, WrapObject
from myomorph.model.spatial import Transform
from myomorph.morph.checks.penetration import Poses, body_poses
from myomorph.muscles.path import Paths, compile_paths

STEP = 1e-3  # Of a difference, as a share of the muscle's path in the first pose.


@read_only
class PathChange:
    """How far a muscle's path is from that of another model, each the root mean square over the poses."""

    length: float  # its length [m]
    arm: float  # all its moment arms about turning coordinates together [m/rad]


def moved_poses(model: Model, muscle: Muscle, poses: Poses) -> Array:
    """Those poses (n, coordinates) whose coordinate moves a muscle, the default pose among them."""
    paths = compile_paths(model)
    coordinates = paths.arm_coordinate[paths.arm_muscle == model.muscle_names.index(muscle.name)]
    names = {"", *(model.coordinate_names[j] for j in coordinates)}
    return np.asarray(poses.coordinates[[name in names for name in poses.moved]])


def path_changes(before: Model, after: Model, poses: Poses) -> dict[str, PathChange]:
    """Of each muscle whose path, or wrap object, differs between two models that are alike but for these."""
    odd = {new.name for old, new in zip(before.wrap_objects, after.wrap_objects, strict=True) if old is not new}
    result = {}
    for old, new in zip(before.muscles, after.muscles, strict=True):
        if old.path is not new.path or wraps_of(old) & odd:
            where = moved_poses(before, old, poses)
            (l0, a0), (l1, a1) = (
                _lengths_and_arms(replace(model, muscles=(muscle,)), where)
                for model, muscle in ((before, old), (after, new))
            )
            arms = np.sqrt(np.mean(np.sum((a1 - a0)[0] ** 2, axis=1)))
            result[old.name] = PathChange(float(np.sqrt(np.mean((l1 - l0) ** 2))), float(arms))
    return result


def point_effect(model: Model, muscle: Muscle, number: int, poses: Poses) -> Array:
    """(n, 3) changes of lengths and moment arms with the place of a via point, so weighted that their sum of squares
    is the mean over the poses that move the muscle [m/m, and m/rad/m].
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
                replace(muscle, name=f"{muscle.name} {len(shifted)}", path=replace(muscle.path, points=changed))
            )
    rows = _rows(*_lengths_and_arms(replace(model, muscles=tuple(shifted)), where))
    return np.asarray((rows[0::2] - rows[1::2]).T / (2.0 * step))


def wrap_effect(model: Model, wrap: WrapObject, poses: Poses) -> Array:
    """(n,) the same with the radius of a wrap object, of all muscles that run around it."""
    effects = [np.zeros(0)]
    for muscle in model.muscles:
        if wrap.name in wraps_of(muscle):
            where = moved_poses(model, muscle, poses)
            step = _step(model, muscle, where)
            larger = replace(wrap, size=grown_sizes(wrap, step))
            grown = replace(
                model,
                muscles=(muscle,),
                wrap_objects=tuple(larger if item.name == wrap.name else item for item in model.wrap_objects),
            )
            both = [
                _rows(*_lengths_and_arms(variant, where))[0] for variant in (replace(model, muscles=(muscle,)), grown)
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
    """Lengths (muscles, poses), and moment arms (muscles, poses, arms) about turning coordinates of their own."""
    paths = compile_paths(model)
    lengths, _, arms = paths.evaluate(where)
    turning = np.array(
        [
            coordinate.motion == "rotational" and coordinate.name not in model.dependent_coordinates
            for coordinate in model.coordinates
        ]
    )
    chosen = turning[paths.arm_coordinate]
    of_muscles = [arms[:, (paths.arm_muscle == index) & chosen] for index in range(len(model.muscles))]
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
    rotation: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) of the via point's body in ground

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
    index = int(np.argmin(np.linalg.norm(starts + share[:, None] * along - place, axis=1)))
    arc = bool(nodes[index + 1, 3] > 0.0)
    levers = (1.0, 1.0) if arc else (1.0 - float(share[index]), float(share[index]))
    return [
        _end(model, muscle, where, nodes[i, :3], lever) for i, lever in zip((index, index + 1), levers, strict=True)
    ]


def _end(model: Model, muscle: Muscle, where: Mapping[str, Transform], node: Array, lever: float) -> PathEnd:
    points = muscle.path.points
    for number, point in enumerate(points):
        if isinstance(point, PathPoint) and np.linalg.norm(where[point.body].apply(point.location) - node) < SAME:
            inner = 0 < number < len(points) - 1
            return PathEnd(lever, number if inner else -1, rotation=where[point.body].rotation)
    around = [item for item in model.wrap_objects if item.name in wraps_of(muscle) and item.kind != "torus"]
    touched = [(abs(_height(item, where[item.body], node)), item.name) for item in around]
    return PathEnd(lever, wrap=min(touched)[1]) if touched else PathEnd(lever)


def _height(wrap: WrapObject, body: Transform, place: Array) -> float:
    """How far a place in ground lies from a wrap object's surface, about, as a share of its size."""
    local = (body @ wrap.pose).inverse().apply(place)
    if wrap.kind == "cylinder":
        return float(np.linalg.norm(local[:2]) / wrap.size[0] - 1.0)
    return float(np.linalg.norm(local / np.array(wrap.size)) - 1.0)


def wraps_of(*muscles: Muscle) -> set[str]:
    """Names of the wrap objects that muscles run around."""
    return {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
