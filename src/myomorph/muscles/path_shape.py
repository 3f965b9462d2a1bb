"""Muscle paths as lines to be drawn: their points, and curves where they lie on surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.muscles.path import Paths
from myomorph.muscles.path_arrays import POINTS, WRAPS

ARC_PARTS = 4
"""Straight parts that an arc on a surface is drawn from."""


@read_only
@dataclass(frozen=True, eq=False)
class DrawnPaths:
    """All paths of a model as one list of points."""

    muscle: np.ndarray  # (points,) index of the muscle that each belongs to
    places: Array  # (frames, points, 3) in ground, NaN beyond a path's last point [m]


def drawn_paths(paths: Paths, coordinates: Array) -> DrawnPaths:
    """Every path as points to draw lines between, as many at any frame.

    An arc becomes `ARC_PARTS` chords of the cubic that leaves both ends along the straight parts beside them, as a
    taut string does, with the arc's length as the size of its tangents.

    `coordinates` (frames, coordinates) in the model's order [rad or m].
    """
    nodes = paths.nodes(coordinates)
    start = paths.arrays.start
    rooms = np.diff(start[:, POINTS]) + np.diff(start[:, WRAPS]) * (ARC_PARTS + 1)
    most = int(rooms.max(initial=0))
    drawn = np.full((len(nodes), len(paths.muscles), most + 1, 3), np.nan)
    real = np.isfinite(nodes[..., 0])
    arcs = real & (nodes[..., 3] > 0.0)
    # Each arc puts points before the node at which it ends.
    slots = np.arange(nodes.shape[2]) + (ARC_PARTS - 1) * np.cumsum(arcs, axis=2)
    f, m, n = np.nonzero(real)
    drawn[f, m, slots[f, m, n]] = nodes[f, m, n, :3]
    f, m, n = np.nonzero(arcs)
    first, last = nodes[f, m, n - 1, :3], nodes[f, m, n, :3]
    chord = last - first
    after = np.minimum(n + 1, nodes.shape[2] - 1)
    into = _tangent(first - nodes[f, m, np.maximum(n - 2, 0), :3], chord)
    out = _tangent(nodes[f, m, after, :3] - last, chord)
    length = nodes[f, m, n, 3][:, None]
    for index in range(1, ARC_PARTS):
        s = index / ARC_PARTS
        place = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * last
        place = place + length * ((s**3 - 2 * s**2 + s) * into + (s**3 - s**2) * out)
        drawn[f, m, slots[f, m, n] - ARC_PARTS + index] = place
    kept = np.arange(most + 1) < rooms[:, None]
    return DrawnPaths(np.repeat(np.arange(len(rooms)), rooms), drawn[:, kept])


def _tangent(along: Array, chord: Array) -> Array:
    """Unit vectors along the straight parts, or the chords where there is none."""
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    usable = np.isfinite(lengths) & (lengths > 1e-9)
    return np.where(usable, along / np.where(usable, lengths, 1.0), chord / np.linalg.norm(chord, axis=1)[:, None])
