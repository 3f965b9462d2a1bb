"""Which feet stand: they move as the ground does, which on a treadmill is a belt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.force_inspection import Inspection
from myomorph.model.arrays import Array

MOVES = 0.8
"""Speed against the ground of heel and tip of a human foot above which it does not stand [m/s]."""

BELT = 0.3
"""Speed from which on the ground under loaded feet is a belt [m/s]."""


def standing(inspection: Inspection) -> NDArray[np.bool_]:
    """(frames, feet) whether the heel or the tip of each sole moves as the ground does."""
    feet = inspection.feet
    moving = []
    for points in feet.soles:
        velocity = np.gradient(points, feet.time, axis=0)
        moving.append(np.linalg.norm(velocity - _belt(inspection, velocity), axis=2))
    return np.asarray(np.minimum(*moving) <= MOVES * np.sqrt(feet.unit))


def belt_velocity(inspection: Inspection) -> Array:
    """Velocity of the ground under loaded feet (3,), zero but on a treadmill [m/s]."""
    feet = inspection.feet
    velocities = np.concatenate([np.gradient(points, feet.time, axis=0) for points in feet.soles], axis=1)
    return _belt(inspection, velocities)


def _belt(inspection: Inspection, velocities: Array) -> Array:
    """The same by the slowest of some points (frames, points, 3) [m/s]."""
    loaded = inspection.samples.loaded[:, inspection.numbers].any(axis=1)
    if not loaded.any():
        return np.zeros(3)
    speeds = np.linalg.norm(velocities, axis=2)
    slow = velocities[np.arange(len(velocities)), np.argmin(speeds, axis=1)][loaded]
    middle = np.median(slow, axis=0)
    return np.asarray(middle if np.linalg.norm(middle) > BELT else np.zeros(3))
