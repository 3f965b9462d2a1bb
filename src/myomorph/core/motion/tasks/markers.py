"""Markers near where they were seen: the weighted mean of their squared distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.tasks.task import (
    EX,
    WEIGHT,
    X_EX,
    XX,
    Task,
    TaskKernels,
    X,
    per_frame,
)
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.tree import Tree
from myomorph.core.rigid.vectors import dot, matrix, minus, plus, times, turned, vector


class MarkerArrays(NamedTuple):
    """Markers on bodies, and where they were seen.

    Attributes
    ----------
    body : (markers,) number of the body
    location : (markers, 3) in the body [m]
    weight : (markers,)
    observed : (frames, markers, 3) in ground [m], NaN where unseen
    errors : (frames, markers) filled by `solve_poses`, the distance between model and recording [m]
    """

    body: Ints
    location: Array
    weight: Array
    observed: Array
    errors: Array


@bare
def seen_weight(markers, frame):
    """Sum of the weights of the markers seen in a frame."""
    total = 0.0
    for m in range(markers.body.shape[0]):
        y = markers.observed[frame, m]
        if np.isfinite(y[0] + y[1] + y[2]):
            total += markers.weight[m]
    return total


@bare
def marker_place(markers, m, R, p):
    """Position of a marker of the model in ground [m]."""
    b = markers.body[m]
    return plus(vector(p, b), turned(matrix(R, b), vector(markers.location, m)))


@bare
def _shown(markers, frame):
    return seen_weight(markers, frame) > 0.0


@bare
def _cost(markers, c, frame, work):
    R = work.R
    p = work.p
    total = 0.0
    weights = seen_weight(markers, frame)
    for m in range(markers.body.shape[0]):
        y = markers.observed[frame, m]
        if markers.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2]):
            b = markers.body[m]
            x = markers.location[m]
            for i in range(3):
                e = p[b, i] + R[b, i, 0] * x[0] + R[b, i, 1] * x[1] + R[b, i, 2] * x[2] - y[i]
                total += markers.weight[m] / weights * e * e
    return total


@bare
def _add(markers, c, frame, work):
    cost = 0.0
    weights = seen_weight(markers, frame)
    points = work.points
    z = work.origin
    for m in range(markers.body.shape[0]):
        y = markers.observed[frame, m]
        if not (markers.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2])):
            continue
        b = markers.body[m]
        at = markers.location[m]
        weight = markers.weight[m] / weights
        R = work.R[b]
        p = work.p[b]
        S = points[b]
        x = (
            p[0] + R[0, 0] * at[0] + R[0, 1] * at[1] + R[0, 2] * at[2],
            p[1] + R[1, 0] * at[0] + R[1, 1] * at[1] + R[1, 2] * at[2],
            p[2] + R[2, 0] * at[0] + R[2, 1] * at[1] + R[2, 2] * at[2],
        )
        e = times(weight, minus(x, y))
        cost += dot(e, e) / weight
        x = minus(x, z)
        S[WEIGHT] += weight
        square = XX
        for i in range(3):
            S[X + i] += weight * x[i]
            S[EX + i] += e[i]
            for j in range(3):
                S[X_EX + 3 * i + j] += x[i] * e[j]
            for j in range(i, 3):
                S[square] += weight * x[i] * x[j]
                square += 1
    return cost


@bare
def _keep(markers, c, frame, work):
    for m in range(markers.body.shape[0]):
        x = marker_place(markers, m, work.R, work.p)
        total = 0.0
        for i in range(3):
            e = x[i] - markers.observed[frame, m, i]
            total += e * e
        markers.errors[frame, m] = np.sqrt(total)


@read_only
class MarkerTask(Task):
    """A marker near where it was seen: weight |x - position|^2, over the weights of all seen.

    Attributes
    ----------
    marker : name of it
    positions : (frames, 3) in ground [m], NaN where unseen
    weight : 0 leaves it out
    """

    marker: str
    positions: Array
    weight: float = 1.0

    kernels = TaskKernels(arrays=MarkerArrays, shown=_shown, cost=_cost, add=_add, keep=_keep)

    @classmethod
    def together(cls, tasks: Sequence[Self], tree: Tree, targets: Array) -> MarkerArrays:
        """Compile all markers.

        Parameters
        ----------
        tasks : of markers
        tree : of the model
        targets : (frames, coordinates), of which only the number of frames counts

        Returns
        -------
        arrays of all markers, their errors NaN
        """
        marked = [tree.model.marker(task.marker) for task in tasks]
        frames = len(targets)
        positions = [
            per_frame(task.positions, frames, f"positions of marker {task.marker!r}")
            for task in tasks
        ]
        return MarkerArrays(
            body=np.array([tree.body_index[marker.body] for marker in marked], np.int64),
            location=np.array([marker.location for marker in marked]).reshape(-1, 3),
            weight=np.array([task.weight for task in tasks], np.float64),
            observed=np.stack(positions, axis=1) if positions else np.empty((frames, 0, 3)),
            errors=np.full((frames, len(marked)), np.nan),
        )
