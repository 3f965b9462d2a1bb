"""Bodies turned as inertial sensors report: squared angles between body and measurement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.tasks.task import Task, TaskKernels, add_row, angle_slope, per_frame
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.tree import Tree


class OrientationArrays(NamedTuple):
    """Bodies, and the rotations that were measured of them.

    Attributes
    ----------
    body : (sensors,) number of the body
    rotation : (frames, sensors, 3, 3) to ground, NaN where unknown
    weight : (frames, sensors) [m^2/rad^2]
    errors : (frames, sensors) filled by `solve_poses`, the angle between body and measurement [rad]
    """

    body: Ints
    rotation: Array
    weight: Array
    errors: Array


@bare
def _measured(sensors, frame, s):
    return sensors.weight[frame, s] > 0.0 and np.isfinite(sensors.rotation[frame, s, 0, 0])


@bare
def _shown(sensors, frame):
    known = 0
    for s in range(sensors.body.shape[0]):
        known += _measured(sensors, frame, s)
    return known > 0


@bare
def _residual(sensors, frame, s, work):
    """Rotation vector in ground from the measured orientation to that of the body [rad]."""
    R = work.R[sensors.body[s]]
    S = sensors.rotation[frame, s]
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
        if _measured(sensors, frame, s):
            x, y, z = _residual(sensors, frame, s, work)
            total += sensors.weight[frame, s] * (x * x + y * y + z * z)
    return total


@bare
def _add(sensors, c, frame, work):
    cost = 0.0
    for s in range(sensors.body.shape[0]):
        if _measured(sensors, frame, s):
            x, y, z = _residual(sensors, frame, s, work)
            body = sensors.body[s]
            weight = sensors.weight[frame, s]
            # A small rotation of the body adds to the vector: its slope is 1 up to terms of the
            # residual.
            cost += add_row(work, body, angle_slope((1.0, 0.0, 0.0)), x, weight)
            cost += add_row(work, body, angle_slope((0.0, 1.0, 0.0)), y, weight)
            cost += add_row(work, body, angle_slope((0.0, 0.0, 1.0)), z, weight)
    return cost


@bare
def _keep(sensors, c, frame, work):
    for s in range(sensors.body.shape[0]):
        if np.isfinite(sensors.rotation[frame, s, 0, 0]):
            x, y, z = _residual(sensors, frame, s, work)
            sensors.errors[frame, s] = np.sqrt(x * x + y * y + z * z)


@read_only
class OrientationTask(Task):
    """A body turned as a sensor reports: weight angle^2.

    Attributes
    ----------
    sensor : name of it
    body : that carries it
    rotations : (frames, 3, 3) of the body to ground, NaN where unknown
    weight : (frames,), or one for all frames, where the markers' mean square counts 1 [m^2/rad^2]
    """

    sensor: str
    body: str
    rotations: Array
    weight: Array | float = 1e-2

    kernels = TaskKernels(arrays=OrientationArrays, shown=_shown, cost=_cost, add=_add, keep=_keep)

    @classmethod
    def together(cls, tasks: Sequence[Self], tree: Tree, targets: Array) -> OrientationArrays:
        """Compile all sensors.

        Parameters
        ----------
        tasks : of sensors
        tree : of the model
        targets : (frames, coordinates), of which only the number of frames counts

        Returns
        -------
        arrays of all sensors, their errors NaN
        """
        frames = len(targets)
        shape = (frames, len(tasks))
        arrays = OrientationArrays(
            body=np.array([tree.body_number(task.body) for task in tasks], np.int64),
            rotation=np.empty((*shape, 3, 3)),
            weight=np.empty(shape),
            errors=np.full(shape, np.nan),
        )
        for index, task in enumerate(tasks):
            arrays.rotation[:, index] = per_frame(
                task.rotations, frames, f"orientations of '{task.sensor}'"
            )
            arrays.weight[:, index] = task.weight
        return arrays
