"""Muscles as spindles: a belly with the muscle's volume between its tendons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.paths import Muscle
from myomorph.lab.report.scene.scene import MusclePath
from myomorph.lab.report.scene.shapes import quads

SPECIFIC_TENSION = 3e5
"""Force of muscle per cross section [N/m^2], 30 N/cm^2 (Zajac 1989)."""
BELLY = 0.62
"""Share of a muscle's length that is its belly."""
THINNED = 0.8
"""Of the radius that holds the muscle's volume: neighbours stay apart."""
THICKEST = 0.1
"""Largest radius as a share of the length: short muscles are no balls."""
TENDON = 0.0016
"""Radius of a tendon [m]."""
RINGS = 18
SIDES = 10
"""Corners of a spindle along and around it."""
FACES = quads(RINGS, SIDES)
PROFILE = np.sin(np.pi * np.linspace(0.0, 1.0, RINGS)) ** 1.2
# Not along any axis of the body, so that it is across every muscle.
ACROSS = np.array([0.31, 0.17, 0.93])
MIN_STEP = 1e-5
"""Points of a path that lie closer to each other are one [m]."""


@read_only
class Spindle:
    """The surface of a muscle in a frame, with the faces `FACES`.

    Attributes
    ----------
    muscle : its index
    vertices : (points, 3) in ground [m]
    normals : (points, 3) unit vectors
    """

    muscle: int
    vertices: Array
    normals: Array


def spindles(
    paths: Sequence[MusclePath], muscles: Sequence[Muscle], frame: int
) -> Iterator[Spindle]:
    """Yield a spindle along each path that is known in a frame.

    The volume of a muscle is the cross section of its maximum isometric force by its optimal fiber
    length.

    Parameters
    ----------
    paths, muscles : of a model, in one order
    frame : of the paths
    """
    lines = [_line(path.points[frame]) for path in paths]
    known = [index for index, line in enumerate(lines) if len(line) > 1]
    if not known:
        return
    centers = np.stack([_centers(lines[index]) for index in known])
    lengths = np.linalg.norm(np.diff(centers, axis=1), axis=2).sum(axis=1)
    radii = TENDON + _bellies([muscles[index] for index in known], lengths)[:, None] * PROFILE
    directions = _directions(centers)
    vertices = centers[:, :, None] + radii[:, :, None, None] * directions
    for number, index in enumerate(known):
        yield Spindle(
            muscle=index,
            vertices=vertices[number].reshape(-1, 3),
            normals=directions[number].reshape(-1, 3),
        )


def _line(points: Array) -> Array:
    """Drop points (n, 3) of a path that are not known or repeat the one before."""
    points = points[np.isfinite(points).all(axis=1)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return points[np.concatenate([[True], steps > MIN_STEP])] if len(points) else points


def _centers(line: Array) -> Array:
    """Place rings at equal distances along a line (n, 3).

    Returns
    -------
    (rings, 3)
    """
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    rings = np.linspace(0.0, along[-1], RINGS)
    return np.stack([np.interp(rings, along, line[:, axis]) for axis in range(3)], axis=1)


def _bellies(muscles: Sequence[Muscle], lengths: Array) -> Array:
    """Radii of bellies that hold the muscles' volumes.

    Parameters
    ----------
    muscles : as many as there are lengths
    lengths : (muscles,) of their paths [m]

    Returns
    -------
    (muscles,) [m]
    """
    volumes = [
        max(muscle.max_isometric_force / SPECIFIC_TENSION * muscle.optimal_fiber_length, 0.0)
        for muscle in muscles
    ]
    radii = THINNED * np.sqrt(np.array(volumes) / (np.pi * BELLY * lengths))
    return np.minimum(radii, THICKEST * lengths)


def _directions(centers: Array) -> Array:
    """Make unit vectors away from lines, all around each of their points.

    Parameters
    ----------
    centers : (muscles, rings, 3)

    Returns
    -------
    (muscles, rings, sides, 3)
    """
    along = _unit(np.gradient(centers, axis=1))
    across = _unit(np.cross(along, ACROSS))
    aside = np.cross(along, across)
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
    return np.cos(angle) * across[:, :, None] + np.sin(angle) * aside[:, :, None]


def _unit(vectors: Array) -> Array:
    """Scale vectors (..., 3) to length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
