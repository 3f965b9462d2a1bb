"""Wrap objects that would swallow a point of a path: OpenSim does not wrap a path around what it begins in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.paths import Muscle, PathWrap, WrapObject
from myomorph.morph.morphed import CarriedPoint

OUTSIDE = 1.001, 1.05
"""A point that was outside is left where the map puts it from the first of these levels on; one nearer comes back to
where it was, or to the second level."""

SAME = 1e-9
"""Levels nearer than this are one."""

SMALLEST = 0.5
"""A wrap object shrinks no further than to this share of its size for the points of its paths."""

Pairs = Mapping[str, tuple[WrapObject, WrapObject]]
"""Wrap objects of source and target, by name."""


def points_left_outside(
    muscles: Iterable[Muscle], points: Iterable[CarriedPoint], wraps: Pairs
) -> tuple[dict[str, tuple[WrapObject, WrapObject]], list[str]]:
    """Wrap objects small enough to leave outside what was outside, and a line on those that are smaller for it.

    Parameters
    ----------
    muscles : of the source
    points : all points of their paths, in order
    """
    shrunk: dict[str, float] = {}
    queue = iter(points)
    for muscle in muscles:
        own = [next(queue) for _ in muscle.path.points]
        for wrap in muscle.path.wraps:
            if not isinstance(wrap, PathWrap):
                continue
            before, after = wraps[wrap.wrap_object]
            for point in own:
                if point.body == before.body:
                    share = _share(level(before, point.source), level(after, point.target))
                    shrunk[before.name] = min(share, shrunk.get(before.name, 1.0))
    shrunk = {name: max(share, SMALLEST) for name, share in shrunk.items() if share < 1.0}
    found = {
        name: (before, replace(after, size=tuple(one * shrunk.get(name, 1.0) for one in after.size)))
        for name, (before, after) in wraps.items()
    }
    if not shrunk:
        return found, []
    shown = ", ".join(
        f"'{name}' to {100.0 * share:.0f} %" for name, share in sorted(shrunk.items(), key=lambda a: a[1])[:4]
    )
    more = f" and {len(shrunk) - 4} more" if len(shrunk) > 4 else ""
    return found, [
        f"wrap objects were made smaller than mapped, as points of their paths would lie inside: {shown}{more}"
    ]


def level(wrap: WrapObject, place: Array) -> float:
    """Distance of a point (3,) from a wrap object's middle or axis in its sizes: less than 1 is inside."""
    local = wrap.pose.inverse().apply(place)
    if wrap.kind == "cylinder":
        return float(np.linalg.norm(local[:2]) / wrap.size[0])
    if wrap.kind == "sphere":
        return float(np.linalg.norm(local) / wrap.size[0])
    if wrap.kind == "ellipsoid":
        return float(np.linalg.norm(local / np.asarray(wrap.size)))
    return np.inf


def _share(before: float, after: float) -> float:
    """What is left of a size so that a point that was outside is so again."""
    if before < 1.0 or after >= (1.0 - SAME) * min(before, OUTSIDE[0]):
        return 1.0
    return after / min(before, OUTSIDE[1])
