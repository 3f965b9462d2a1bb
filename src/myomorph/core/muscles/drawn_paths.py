"""Muscle paths as points to draw lines between."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.shapes import Coordinates, Points
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.model_paths import Paths
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import Flags

ARC_PARTS = 4  # Straight parts that an arc on a surface is drawn from
MIN_LENGTH = 1e-9  # Of a straight part that has a direction [m]


@read_only
class DrawnPaths:
    """All paths of a model as one list of points.

    Attributes
    ----------
    muscle : (points,) index of the muscle that each belongs to
    places : (frames, points, 3) in ground, NaN beyond a path's last point [m]
    """

    muscle: np.ndarray
    places: Points


def drawn_paths(paths: Paths, coordinates: Coordinates) -> DrawnPaths:
    """Every path as points to draw lines between, as many at any frame.

    An arc becomes `ARC_PARTS` chords of the cubic that leaves both ends along the straight parts
    beside them, as a taut string does, with the arc's length as the norm of its tangents.

    Parameters
    ----------
    paths : of a model's muscles
    coordinates : (frames, coordinates) in the model's order [rad or m]

    Returns
    -------
    points of all paths in as many frames
    """
    nodes = paths.nodes(coordinates)
    start = paths.arrays.start
    points = np.diff(start[:, columns.POINTS]) + np.diff(start[:, columns.WRAPS]) * (ARC_PARTS + 1)
    most_points = int(points.max(initial=0))
    drawn = np.full((len(nodes), len(paths.muscles), most_points + 1, 3), np.nan)
    is_node = np.isfinite(nodes[..., 0])
    ends_arc = is_node & (nodes[..., 3] > 0.0)
    # Each arc puts points before the node at which it ends.
    slots = np.arange(nodes.shape[2]) + (ARC_PARTS - 1) * np.cumsum(ends_arc, axis=2)
    frame, muscle, node = np.nonzero(is_node)
    drawn[frame, muscle, slots[frame, muscle, node]] = nodes[frame, muscle, node, :3]
    _put_arcs(drawn, nodes, ends_arc, slots)
    is_drawn = np.arange(most_points + 1) < points[:, None]
    return DrawnPaths(muscle=np.repeat(np.arange(len(points)), points), places=drawn[:, is_drawn])


def _put_arcs(drawn: Array, nodes: Array, ends_arc: Flags, slots: Ints) -> None:
    """Put the inner points of arcs before the nodes at which they end.

    With s from 0 to 1 between the ends p and q, unit tangents t and u and the arc's length L, the
    cubic Hermite curve is

        (2 s^3 - 3 s^2 + 1) p + (3 s^2 - 2 s^3) q + L ((s^3 - 2 s^2 + s) t + (s^3 - s^2) u)

    Parameters
    ----------
    drawn : (frames, muscles, points, 3) changed in place
    nodes : (frames, muscles, nodes, 4) of `Paths.nodes`
    ends_arc : (frames, muscles, nodes) whether an arc ends in each
    slots : (frames, muscles, nodes) positions of the nodes in `drawn`
    """
    frame, muscle, node = np.nonzero(ends_arc)
    first = nodes[frame, muscle, node - 1, :3]
    last = nodes[frame, muscle, node, :3]
    chord = last - first
    before = nodes[frame, muscle, np.maximum(node - 2, 0), :3]
    after = nodes[frame, muscle, np.minimum(node + 1, nodes.shape[2] - 1), :3]
    into = _tangent(first - before, chord)
    out = _tangent(after - last, chord)
    length = nodes[frame, muscle, node, 3][:, None]
    for part in range(1, ARC_PARTS):
        s = part / ARC_PARTS
        point = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * last
        point = point + length * ((s**3 - 2 * s**2 + s) * into + (s**3 - s**2) * out)
        drawn[frame, muscle, slots[frame, muscle, node] - ARC_PARTS + part] = point


def _tangent(along: Array, chord: Array) -> Array:
    """Make unit vectors along straight parts, or along the chords where there is none.

    Parameters
    ----------
    along, chord : (arcs, 3) [m]

    Returns
    -------
    (arcs, 3)
    """
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    usable = np.isfinite(lengths) & (lengths > MIN_LENGTH)
    along_part = along / np.where(usable, lengths, 1.0)
    along_chord = chord / np.linalg.norm(chord, axis=1)[:, None]
    return np.where(usable, along_part, along_chord)
