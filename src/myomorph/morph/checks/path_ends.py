"""What holds a part of a muscle's path at both ends: via points and wrap objects that could be moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Model
from myomorph.model.paths import Muscle, PathPoint, WrapObject
from myomorph.model.spatial import Transform
from myomorph.morph.checks.penetration import body_poses
from myomorph.muscles.path import Paths

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
