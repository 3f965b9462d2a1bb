"""Paths of muscles and ligaments in other bones, with the wrap objects that they go around.

A wrap object is refitted to where the map brings its own surface, and made smaller where it would
swallow a point of a path: OpenSim does not wrap a path around what it begins in.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.morphed import TransferredPoint
from myomorph.bones.morph.transfer.body_transfer import Transfer, Transfers, nearest_rotation
from myomorph.bones.morph.transfer.points import Setting, transferred_paths
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Coordinate, Model
from myomorph.core.model.paths import Ligament, Muscle, PathWrap, WrapObject, surface_level
from myomorph.core.model.spatial import Transform

OUTSIDE = 1.001, 1.05
"""A point that was outside is left where the map puts it from the first of these levels on; one
nearer comes back to where it was, or to the second level.
"""

SAME = 1e-9  # Levels nearer than this are one.
# A wrap object shrinks no further than to this share of its size for the points of its paths.
SMALLEST = 0.5
Pairs = Mapping[str, tuple[WrapObject, WrapObject]]  # Wrap objects of source and target, by name.


def points_left_outside(
    muscles: Iterable[Muscle], points: Iterable[TransferredPoint], wraps: Pairs
) -> tuple[dict[str, tuple[WrapObject, WrapObject]], list[str]]:
    """Shrink wrap objects so far that they leave outside what was outside.

    Returns those that are smaller for it, and a line on each.
    """
    shrunk: dict[str, float] = {}
    queue = iter(points)
    for muscle in muscles:
        of_muscle = [next(queue) for _ in muscle.path.points]
        for wrap in muscle.path.wraps:
            if not isinstance(wrap, PathWrap):
                continue
            before, after = wraps[wrap.wrap_object]
            for point in of_muscle:
                if point.body == before.body and before.kind != "torus":
                    share = _share(_level(before, point.source), _level(after, point.target))
                    shrunk[before.name] = min(share, shrunk.get(before.name, 1.0))
    shrunk = {name: max(share, SMALLEST) for name, share in shrunk.items() if share < 1.0}
    shrunk_wraps = {
        name: (before, _times(after, shrunk.get(name, 1.0)))
        for name, (before, after) in wraps.items()
    }
    return shrunk_wraps, _of_shrunk(shrunk)


def _level(wrap: WrapObject, place: Array) -> float:
    """Return the level of a wrap object's surface at a point (3,) of its body; 1 on the surface."""
    return surface_level(wrap, wrap.pose.inverse().apply(place[None]))[0]


def _times(wrap: WrapObject, factor: float) -> WrapObject:
    """Scale the sizes of a wrap object."""
    return replace(wrap, size=tuple(size * factor for size in wrap.size))


def _of_shrunk(shares: Mapping[str, float]) -> list[str]:
    """Report wrap objects that are smaller, with the share of their size that is left."""
    if not shares:
        return []
    shown = ", ".join(
        f"'{name}' to {100.0 * share:.0f} %"
        for name, share in sorted(shares.items(), key=lambda item: item[1])[:4]
    )
    more = f" and {len(shares) - 4} more" if len(shares) > 4 else ""
    return [f"wrap objects are smaller than mapped, as path points would lie inside: {shown}{more}"]


def _share(before: float, after: float) -> float:
    """Return what is left of a size so that a point that was outside is so again."""
    if before < 1.0 or after >= (1.0 - SAME) * min(before, OUTSIDE[0]):
        return 1.0
    return after / min(before, OUTSIDE[1])


LONGEST = 0.25
"""A cylinder counts up to this share of the bone's length to either side of its middle: files have
some of a metre.
"""

_AROUND = 2.0 * np.pi * np.arange(8) / 8.0
_RING = np.column_stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(8)])
_LATITUDES = np.arcsin(np.linspace(-0.8, 0.8, 5))
_BALL = np.concatenate([np.cos(a) * _RING + [0.0, 0.0, np.sin(a)] for a in _LATITUDES])


def transferred_wrap(wrap: WrapObject, transfer: Transfer) -> WrapObject:
    """Transfer a wrap object, so that it lies in the target's bone as it did in the source's.

    Points of its surface go where the map sends them. The affine map nearest to that gives the
    middle and the rotation of the object (a cylinder's axis stays along the same line of the bone);
    radii are the mean distances of the points from the middle or the axis, so a similarity is met
    exactly. Sides that constrain the path rotate with the object.
    """
    points = surface_points(wrap, LONGEST * transfer.length)
    moved = transfer.points(wrap.pose.apply(points))
    middle = moved.mean(axis=0)
    matrix = np.linalg.lstsq(points, moved - middle, rcond=None)[0].T
    if np.linalg.det(matrix) <= 0.0:
        matrix = transfer.linear @ wrap.pose.rotation
    rotation = nearest_rotation(matrix)
    if wrap.kind == "cylinder":
        rotation = _axis_along(rotation, matrix[:, 2])
    local = (moved - middle) @ rotation
    return replace(
        wrap,
        body=transfer.body,
        pose=Transform(rotation, middle),
        size=_size(wrap, points, local, matrix),
    )


def surface_points(wrap: WrapObject, longest: float) -> Array:
    """Spread points evenly over a wrap object's surface.

    Parameters
    ----------
    wrap : object
    longest : how far a cylinder counts to either side of its middle [m]

    Returns
    -------
    (n, 3) points in the object's frame, the middle their mean [m]
    """
    if wrap.kind == "cylinder":
        radius, length = wrap.size
        half = min(0.5 * length, max(longest, radius))
        return np.concatenate(
            [radius * _RING + [0.0, 0.0, z * half] for z in np.linspace(-1.0, 1.0, 5)]
        )
    if wrap.kind == "torus":
        inner, outer = wrap.size
        tube = 0.5 * (outer - inner)
        middle = 0.5 * (outer + inner)
        angles = 2.0 * np.pi * np.arange(6) / 6.0
        return np.concatenate(
            [(middle + tube * np.cos(a)) * _RING + [0, 0, tube * np.sin(a)] for a in angles]
        )
    return _BALL * (wrap.size if wrap.kind == "ellipsoid" else wrap.size[0])


def _axis_along(rotation: Array, axis: Array) -> Array:
    """Swing a rotation as little as needed to have its z axis along a direction."""
    z = axis / np.linalg.norm(axis)
    x = rotation[:, 0] - (rotation[:, 0] @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _size(wrap: WrapObject, points: Array, moved: Array, matrix: Array) -> tuple[float, ...]:
    """Sizes from points of the surface before and after, both in the wrap object's frame."""
    if wrap.kind == "ellipsoid":
        return tuple(float(a) for a in np.asarray(wrap.size) * np.linalg.norm(matrix, axis=0))
    if wrap.kind == "sphere":
        return (wrap.size[0] * _growth(points, moved),)
    across = _growth(points[:, :2], moved[:, :2])
    if wrap.kind == "torus":
        return wrap.size[0] * across, wrap.size[1] * across
    return wrap.size[0] * across, wrap.size[1] * float(np.linalg.norm(matrix[:, 2]))


def _growth(points: Array, moved: Array) -> float:
    return float(np.linalg.norm(moved, axis=1).mean() / np.linalg.norm(points, axis=1).mean())


@dataclass(frozen=True, eq=False)
class LinesOfAction:
    """Paths of muscles and ligaments in the target's bones.

    Forces and fibers are still the source's.
    """

    muscles: tuple[Muscle, ...]
    ligaments: tuple[Ligament, ...]
    wrap_objects: tuple[WrapObject, ...]
    points: tuple[TransferredPoint, ...]  # of all of them, in order, muscles first
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class SourceLines:
    """Lines of action to be transferred.

    Attributes
    ----------
    muscles, ligaments : whose paths they are
    wrap_objects : that they may go around
    coordinates : that conditional and moving points may depend on
    """

    muscles: tuple[Muscle, ...]
    ligaments: tuple[Ligament, ...]
    wrap_objects: tuple[WrapObject, ...]
    coordinates: tuple[Coordinate, ...]

    @staticmethod
    def of(model: Model) -> SourceLines:
        """Return all lines of action of a model."""
        return SourceLines(
            muscles=model.muscles,
            ligaments=model.ligaments,
            wrap_objects=model.wrap_objects,
            coordinates=model.coordinates,
        )


def transferred_lines(
    source: SourceLines, transfers: Transfers, travel: Mapping[str, float], within: float
) -> LinesOfAction:
    """Transfer paths by the maps of the bodies that their points are fixed to.

    The source's wrap objects on those bodies go with them. `travel`: how much further a coordinate
    that slides goes in the target; `within`: distance from the surface up to which a point belongs
    to it, as a share of the bone's length.
    """
    wraps = {
        wrap.name: (wrap, transferred_wrap(wrap, transfers[wrap.body]))
        for wrap in source.wrap_objects
        if wrap.body in transfers
    }
    coordinates = {coordinate.name: coordinate for coordinate in source.coordinates}
    setting = Setting(coordinates, travel, wraps)
    strings: list[Muscle | Ligament] = [*source.muscles, *source.ligaments]
    owned = [(string.name, string.path) for string in strings]
    moved, points, notes = transferred_paths(owned, transfers, setting, within)
    wraps, smaller = points_left_outside(source.muscles, points, wraps)
    paths = iter(moved)
    return LinesOfAction(
        muscles=tuple(replace(muscle, path=next(paths)) for muscle in source.muscles),
        ligaments=tuple(replace(ligament, path=next(paths)) for ligament in source.ligaments),
        wrap_objects=tuple(after for _, after in wraps.values()),
        points=points,
        notes=(*notes, *smaller),
    )
