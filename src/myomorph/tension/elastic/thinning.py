"""Fast recordings: some of the frames are solved, and those between follow them and balance their own torques.

A step of 1 ms is far shorter than a tendon takes to answer: equilibrium then hardly says anything about the force at
its end, the system is stiff and the solver does not end. What muscles do has no part that 200 frames a second miss.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from myomorph.model.arrays import Array
from myomorph.tension.elastic.program import MAX_FORCE, MIN_FORCE
from myomorph.tension.separable import Separable

FASTEST = 200.0
"""Frames a second that are solved at most."""

PROJECTIONS = 3
"""Steps towards balance; more than one only where a force meets its bound."""


def solved_every(time: Array) -> int:
    """How many frames apart those are that are solved; 1 where frames come no faster than `FASTEST`."""
    if len(time) < 3:
        return 1
    return max(1, int(np.ceil(1.0 / (FASTEST * float(np.median(np.diff(time)))) - 1e-3)))


def picked(frames: int, every: int) -> NDArray[np.int64]:
    """Numbers of the frames that are solved: the first, the last, and evenly between them at most `every` apart."""
    count = int(np.ceil((frames - 1) / every)) + 1
    return np.unique(np.round(np.linspace(0, frames - 1, count)).astype(np.int64))


def along(time: Array, known: NDArray[np.int64], values: Array) -> Array:
    """Values (frames, ...) at all times from those at some, by cubics that leave their range nowhere."""
    if len(known) < 2:
        return np.repeat(values, len(time), axis=0)
    return np.asarray(PchipInterpolator(time[known], values, axis=0)(time))


def balanced(shared: Separable, values: Array, right: Array, held: Array, muscles: NDArray[np.bool_]) -> Array:
    """Unknowns near `held` that balance the torques.

    The change is the least relative to what a muscle pulls with and to what the cost lets other unknowns have.

    `values`, `right` (frames, entries) and (frames, rows) of the balance; `held` (frames, unknowns) with normalized
    forces in the columns of muscles on elastic tendons; `muscles` (unknowns,) which columns those are.
    """
    low, high = np.where(muscles, MIN_FORCE, shared.lower), np.where(muscles, MAX_FORCE, shared.upper)
    A = shared.dense(values)
    result = held.copy()
    for _ in range(PROJECTIONS):
        left = right - np.matmul(A, result[:, :, None])[..., 0]
        room = np.where(muscles, result - MIN_FORCE, 1.0 / np.maximum(shared.weight, 1e-3))
        room = np.where((result > low) & (result < high), room, 0.0)
        scaled = A * room[:, None]
        matrix = np.matmul(scaled, A.transpose(0, 2, 1))
        size = np.trace(matrix, axis1=1, axis2=2)[:, None, None] / max(right.shape[1], 1)
        matrix += (1e-9 * size + 1e-12) * np.eye(right.shape[1])
        change = np.matmul(np.linalg.solve(matrix, left[:, :, None])[:, None, :, 0], scaled)[:, 0]
        result = np.clip(result + change, low, high)
    return result
