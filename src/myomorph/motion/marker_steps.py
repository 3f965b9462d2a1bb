"""Faults of labels that show in time alone: a marker that jumps and returns, and two that exchange their labels.

A marker moves from frame to frame about as it does in the frames around. The step that does not is an edge: its excess
is the difference from the median of the neighboring steps. A marker that jumps leaves an edge and an opposite one when
it returns; two markers that exchange their labels have edges in the same frame that lead to each other's path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from myomorph.model.arrays import Array, read_only

LEAST = 0.03
"""Excess of a step below which it is no edge, on a body of human size [m]."""

OUTSTANDING = 6.0
"""An edge's excess is at least so many times what nine of ten steps of the marker have."""

RETURNS = 0.25
"""A marker that returns later did not jump for a few frames: it may have moved [s]."""

GAP = 0.1
"""Steps over longer gaps are not compared [s]."""

AROUND = 3
"""Steps either way that make the usual one."""

CLOSES = 0.35
"""What may be left of a jump after the marker has returned, or of two after their labels are exchanged."""


@dataclass(frozen=True)
class Excursion:
    """Frames [start, stop) in which a marker is off its path, by how much [m]."""

    marker: int
    start: int
    stop: int
    size: float


@dataclass(frozen=True)
class Exchange:
    """Frames [start, stop) whose labels of two markers are exchanged against those before or after."""

    first: int
    second: int
    start: int
    stop: int


@read_only
@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of one marker that stand out: the frames that each leads from and to, where the marker would be after it
    and what it is off (steps, 3) [m].
    """

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    predicted: Array
    excess: Array


NONE = Steps(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))


def edges_of(time: Array, values: Array, unit: float = 1.0) -> tuple[Steps, ...]:
    """For each marker of (frames, markers, 3) [m], NaN where unseen, the steps that stand out of those around."""
    return tuple(_edges(time, values[:, marker], unit) for marker in range(values.shape[1]))


def _edges(time: Array, path: Array, unit: float) -> Steps:
    seen = np.flatnonzero(np.isfinite(path).all(axis=1))
    if len(seen) < 2 * AROUND + 2:
        return NONE
    start, stop = seen[:-1], seen[1:]
    spans = (time[stop] - time[start])[:, None]
    near = spans[:, 0] <= GAP
    moved = path[stop] - path[start]
    speed = moved / spans
    # What changes less from step to step has no edge: most markers end here.
    if not (np.linalg.norm(np.diff(speed, axis=0) * spans[1:], axis=1) > 0.5 * LEAST * unit).any() or not near.any():
        return NONE
    # The median of the steps around, the step itself left out.
    count = len(speed)
    index = np.arange(count)[:, None] + np.array([shift for shift in range(-AROUND, AROUND + 1) if shift])
    predicted = path[start] + np.median(speed[np.clip(index, 0, count - 1)], axis=1) * spans
    excess = path[stop] - predicted
    size = np.linalg.norm(excess, axis=1)
    limit = max(LEAST * unit, OUTSTANDING * float(np.quantile(size[near], 0.9)))
    edges = np.flatnonzero((size > limit) & near).astype(np.int64)
    return Steps(start[edges], stop[edges], predicted[edges], excess[edges])


def excursions(time: Array, edges: Sequence[Steps]) -> tuple[Excursion, ...]:
    """Markers that leave their path from one frame to the next and return as suddenly, of the edges of every marker."""
    spans = []
    for marker, steps in enumerate(edges):
        place = 0
        while place + 1 < len(steps.start):
            out, back = steps.excess[place], steps.excess[place + 1]
            size = float(np.linalg.norm(out))
            soon = time[steps.start[place + 1]] - time[steps.stop[place]] <= RETURNS
            if soon and np.linalg.norm(out + back) < CLOSES * max(size, float(np.linalg.norm(back))):
                spans.append(Excursion(marker, int(steps.stop[place]), int(steps.start[place + 1]) + 1, size))
                place += 1
            place += 1
    return tuple(spans)


def exchanges(values: Array, edges: Sequence[Steps]) -> tuple[Exchange, ...]:
    """Pairs of markers whose paths go on in each other from some frame on, the last of an odd number to the end."""
    at: dict[int, list[tuple[int, int]]] = {}
    for marker, steps in enumerate(edges):
        for place, frame in enumerate(steps.stop):
            at.setdefault(int(frame), []).append((marker, place))
    changes: dict[tuple[int, int], list[int]] = {}
    for frame, group in sorted(at.items()):
        here = np.array([values[frame, marker] for marker, _ in group])
        ahead = np.array([edges[marker].predicted[before] for marker, before in group])
        apart = np.linalg.norm(here[:, None] - ahead, axis=2)
        taken = linear_sum_assignment(apart)[1]
        for i, j in enumerate(taken):
            stayed = apart[i, i] + apart[j, j]
            if i < j and taken[j] == i and apart[i, j] + apart[j, i] < CLOSES * stayed:
                changes.setdefault((group[i][0], group[j][0]), []).append(frame)
    swaps = []
    for (first, second), frames in changes.items():
        ends = [*frames, len(values)] if len(frames) % 2 else frames
        swaps += [Exchange(first, second, a, b) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return tuple(swaps)
