"""Spells of a state over frames: where it lasts, and how short ones go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, runs

Bools = NDArray[np.bool_]


def hysteresis(begins: Bools, ends: Bools) -> Bools:
    """State that turns on where it begins, off where it ends, and stays as it was between.

    Parameters
    ----------
    begins, ends : (frames, ...)

    Returns
    -------
    (frames, ...)
    """
    marks = np.where(ends, -1, np.where(begins, 1, 0))
    frames = np.arange(len(marks)).reshape(-1, *[1] * (marks.ndim - 1))
    last = np.maximum.accumulate(np.where(marks != 0, frames, 0), axis=0)
    return np.take_along_axis(marks, last, axis=0) > 0


def steady(state: Bools, time: Array, shortest: float) -> Bools:
    """Close gaps and remove spells that are too short; those at the ends stay.

    Parameters
    ----------
    state : (frames,)
    time : (frames,) [s]
    shortest : duration of gaps and spells that stay [s]

    Returns
    -------
    (frames,)
    """
    state = state.copy()
    for value in (False, True):
        for start, stop in runs(state == value):
            inside = start > 0 and stop < len(state)
            if inside and time[stop] - time[start] < shortest - 1e-9:
                state[start:stop] = not value
    return state
