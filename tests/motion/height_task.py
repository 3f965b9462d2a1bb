"""A task of inverse kinematics from outside the package.

Points of bodies are at measured heights. See docs/adding.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from myomorph.core.motion.tasks.task import Task, TaskKernels, add_row, per_frame, point_slope
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.tree import Tree
from myomorph.core.rigid.vectors import matrix, plus, turned, vector


class HeightArrays(NamedTuple):
    """Points of bodies at measured heights.

    Fields are the bodies of the points, positions on them, heights (frames, points), weights, the
    vertical, and the residuals.
    """

    body: NDArray[np.int64]
    location: NDArray[np.float64]
    height: NDArray[np.float64]
    weight: NDArray[np.float64]
    up: NDArray[np.float64]
    errors: NDArray[np.float64]


@bare
def _shown(points, frame):
    known = 0
    for i in range(points.body.shape[0]):
        known += np.isfinite(points.height[frame, i])
    return known > 0


@bare
def _place(points, i, work):
    b = points.body[i]
    return plus(vector(work.p, b), turned(matrix(work.R, b), vector(points.location, i)))


@bare
def _residual(points, frame, i, work):
    x = _place(points, i, work)
    up = points.up
    return x[0] * up[0] + x[1] * up[1] + x[2] * up[2] - points.height[frame, i]


@bare
def _cost(points, c, frame, work):
    total = 0.0
    for i in range(points.body.shape[0]):
        if np.isfinite(points.height[frame, i]):
            total += points.weight[i] * _residual(points, frame, i, work) ** 2
    return total


@bare
def _add(points, c, frame, work):
    cost = 0.0
    up = (points.up[0], points.up[1], points.up[2])
    for i in range(points.body.shape[0]):
        if np.isfinite(points.height[frame, i]):
            slope = point_slope(work, _place(points, i, work), up)
            cost += add_row(
                work, points.body[i], slope, _residual(points, frame, i, work), points.weight[i]
            )
    return cost


@bare
def _keep(points, c, frame, work):
    for i in range(points.body.shape[0]):
        points.errors[frame, i] = _residual(points, frame, i, work)


@dataclass(frozen=True, eq=False)
class HeightTask(Task):
    """weight (height - measured)^2 of a body's point, heights (frames,) [m], NaN if unknown."""

    body: str
    location: NDArray[np.float64]
    heights: NDArray[np.float64]
    weight: float = 1.0

    kernels = TaskKernels(arrays=HeightArrays, shown=_shown, cost=_cost, add=_add, keep=_keep)

    @classmethod
    def together(
        cls, tasks: Sequence[Self], tree: Tree, targets: NDArray[np.float64]
    ) -> HeightArrays:
        """Collect tasks into the arrays of their kernel.

        Parameters
        ----------
        tasks : of this kind
        tree : of the model
        targets : (frames, ...) of the problem, for the number of frames

        Returns
        -------
        HeightArrays, empty where there is no task
        """
        heights = [
            per_frame(task.heights, len(targets), f"heights of a point of '{task.body}'")
            for task in tasks
        ]
        return HeightArrays(
            body=np.array([tree.body_number(task.body) for task in tasks], np.int64),
            location=np.array([task.location for task in tasks]).reshape(-1, 3),
            height=np.stack(heights, axis=1) if heights else np.empty((len(targets), 0)),
            weight=np.array([task.weight for task in tasks], np.float64),
            up=np.array(tree.model.up, dtype=np.float64),
            errors=np.full((len(targets), len(tasks)), np.nan),
        )
