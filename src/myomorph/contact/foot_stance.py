"""Which feet stand, by their motion: they move as the ground does, on a treadmill a belt; when plates carry all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.force_inspection import Inspection
from myomorph.model.arrays import Array, runs

MOVES = 0.8
"""Speed against the ground of heel and tip of a human foot above which it does not stand [m/s]."""

BELT = 0.3
"""Speed from which on the ground under loaded feet is a belt [m/s]."""

PAUSE = 0.06
"""A foot that moves for a shorter time goes on standing [s]."""

CARRIED = 0.6
"""Share of a stance during which a plate has to carry its foot."""

EDGE = 0.05
"""Uncertainty of the time at which a foot is put down or lifted, by its motion [s]."""


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


def supported(inspection: Inspection) -> NDArray[np.bool_]:
    """Frames (frames,) in which every foot that stands does so on a plate, and one does.

    A stance counts as a whole, so that the frames hardly depend on the clock of the forces; where one begins or ends
    that no plate carries, frames around are left out.
    """
    feet = inspection.feet
    step = float(np.median(np.diff(feet.time)))
    edge, pause = max(1, round(EDGE / step)), max(1, round(PAUSE / step))
    stands = standing(inspection)
    carries = _carries(inspection)
    on_plate = np.zeros(len(feet.time), bool)
    elsewhere = np.zeros(len(feet.time), bool)
    for foot in range(len(feet.feet)):
        for start, stop in _joined(list(runs(stands[:, foot])), pause):
            if carries[start:stop, foot].mean() > CARRIED:
                on_plate[start:stop] = True
            elif stop - start > pause:
                elsewhere[max(0, start - edge) : stop + edge] = True
    return np.asarray(on_plate & ~elsewhere)


def _carries(inspection: Inspection) -> NDArray[np.bool_]:
    """(frames, feet) whether a plate carries each foot."""
    feet = inspection.feet
    result = np.zeros((len(feet.time), len(feet.feet)), bool)
    distances = feet.distances(inspection.samples.centers(feet.up)[:, inspection.numbers])
    nearest = np.argmin(np.nan_to_num(distances, nan=9.0), axis=2)
    for column, index in enumerate(inspection.numbers):
        owner = feet.owners.get(inspection.wrenches.bodies[index])
        loaded = inspection.samples.loaded[:, index]
        for foot in range(len(feet.feet)):
            result[:, foot] |= loaded & (nearest[:, column] == foot if owner is None else owner == foot)
    return result


def _joined(parts: list[tuple[int, int]], pause: int) -> list[tuple[int, int]]:
    """Runs with short gaps between them closed."""
    result: list[tuple[int, int]] = []
    for start, stop in parts:
        if result and start - result[-1][1] <= pause:
            result[-1] = (result[-1][0], stop)
        else:
            result.append((start, stop))
    return result
