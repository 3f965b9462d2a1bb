"""A task of inverse kinematics from outside the package: bodies turned as inertial sensors say. See docs/adding.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from myomorph.motion.tasks.task import Task, TaskKernels, add_row, angle_slope, per_frame
from myomorph.rigid.kernels import bare
from myomorph.rigid.tree import Tree


class OrientationArrays(NamedTuple):
    """Bodies of the sensors, their rotations (frames, sensors, 3, 3), weights, and angles that remain."""

    body: NDArray[np.int64]
    rotation: NDArray[np.float64]
    weight: NDArray[np.float64]
    errors: NDArray[np.float64]


@bare
def _shown(sensors, frame):
    known = 0
    for s in range(sensors.body.shape[0]):
        known += np.isfinite(sensors.rotation[frame, s, 0, 0])
    return known > 0


@bare
def _residual(sensors, frame, s, work):
    """Rotation vector in ground that turns the body from where the sensor says to where it is [rad]."""
    R, S = work.R[sensors.body[s]], sensors.rotation[frame, s]
    # Skew part and trace of R S^T: sine and cosine of the angle.
    x = y = z = trace = 0.0
    for j in range(3):
        x += 0.5 * (R[2, j] * S[1, j] - R[1, j] * S[2, j])
        y += 0.5 * (R[0, j] * S[2, j] - R[2, j] * S[0, j])
        z += 0.5 * (R[1, j] * S[0, j] - R[0, j] * S[1, j])
        trace += R[0, j] * S[0, j] + R[1, j] * S[1, j] + R[2, j] * S[2, j]
    sine = np.sqrt(x * x + y * y + z * z)
    stretch = np.arctan2(sine, 0.5 * (trace - 1.0)) / sine if sine > 1e-12 else 1.0
    return x * stretch, y * stretch, z * stretch


@bare
def _cost(sensors, c, frame, work):
    total = 0.0
    for s in range(sensors.body.shape[0]):
        if np.isfinite(sensors.rotation[frame, s, 0, 0]):
            x, y, z = _residual(sensors, frame, s, work)
            total += sensors.weight[s] * (x * x + y * y + z * z)
    return total


@bare
def _add(sensors, c, frame, work):
    cost = 0.0
    for s in range(sensors.body.shape[0]):
        if np.isfinite(sensors.rotation[frame, s, 0, 0]):
            x, y, z = _residual(sensors, frame, s, work)
            body, weight = sensors.body[s], sensors.weight[s]
            # A small rotation of the body adds to the vector: its slope is 1 up to terms of the residual.
            cost += add_row(work, body, angle_slope((1.0, 0.0, 0.0)), x, weight)
            cost += add_row(work, body, angle_slope((0.0, 1.0, 0.0)), y, weight)
            cost += add_row(work, body, angle_slope((0.0, 0.0, 1.0)), z, weight)
    return cost


@bare
def _keep(sensors, c, frame, work):
    for s in range(sensors.body.shape[0]):
        x, y, z = _residual(sensors, frame, s, work)
        sensors.errors[frame, s] = np.sqrt(x * x + y * y + z * z)


@dataclass(frozen=True, eq=False)
class OrientationTask(Task):
    """weight angle^2 between a body and rotations (frames, 3, 3) to ground, NaN where unknown [weight in m^2/rad^2]."""

    body: str
    rotations: NDArray[np.float64]
    weight: float = 1e-2

    kernels = TaskKernels(OrientationArrays, _shown, _cost, _add, _keep)

    @classmethod
    def together(cls, tasks: Sequence[Self], tree: Tree, targets: NDArray[np.float64]) -> OrientationArrays:
        rotations = [per_frame(task.rotations, len(targets), f"orientation of '{task.body}'") for task in tasks]
        return OrientationArrays(
            np.array([tree.body_number(task.body) for task in tasks], np.int64),
            np.stack(rotations, axis=1) if rotations else np.empty((len(targets), 0, 3, 3)),
            np.array([task.weight for task in tasks], np.float64),
            np.full((len(targets), len(tasks)), np.nan),
        )
