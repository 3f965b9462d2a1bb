"""Coordinates near values: a measured angle, a likely one, or the pose of another recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import index_of
from myomorph.core.motion.tasks.task import Task, TaskKernels, no_residual
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import Tree


class CoordinateArrays(NamedTuple):
    """Values that coordinates are pulled to.

    Attributes
    ----------
    weight : (coordinates,) 0 for none and for those not solved for [1/rad^2 or 1/m^2]
    value : (frames, coordinates) [rad or m]
    """

    weight: Array
    value: Array


@bare
def _shown(coordinates, frame):
    return False


@bare
def _cost(coordinates, c, frame, work):
    total = 0.0
    for j in range(c.shape[0]):
        total += coordinates.weight[j] * (c[j] - coordinates.value[frame, j]) ** 2
    return total


@bare
def _add(coordinates, c, frame, work):
    for j in range(c.shape[0]):
        work.direct[j] += coordinates.weight[j]
        work.g[j] += coordinates.weight[j] * (c[j] - coordinates.value[frame, j])
    return _cost(coordinates, c, frame, work)


@dataclass(frozen=True)
class CoordinateTask(Task):
    """Pull of a coordinate towards a value, in addition to the markers: weight (c - value)^2.

    Attributes
    ----------
    coordinate : name of it
    weight : [1/rad^2 or 1/m^2], where the markers' mean square counts 1 [1/m^2]
    value : [rad or m], or None for the value in `InverseKinematicsOptions.coordinates` (a motion),
        or the model's default where that has none
    """

    coordinate: str
    weight: float
    value: float | None = None

    kernels = TaskKernels(
        arrays=CoordinateArrays, shown=_shown, cost=_cost, add=_add, keep=no_residual
    )

    @classmethod
    def together(cls, tasks: Sequence[Self], tree: Tree, targets: Array) -> CoordinateArrays:
        """Compile the weights of all coordinates.

        Parameters
        ----------
        tasks : of coordinates
        tree : of the model
        targets : (frames, coordinates) the tasks' values already [rad or m]

        Returns
        -------
        arrays of all coordinates

        Raises
        ------
        UnknownName : the model has no such coordinate
        """
        weight = np.zeros(len(tree.defaults))
        free = set(free_coordinates(tree))
        for task in tasks:
            j = index_of("coordinate", task.coordinate, tree.model.coordinate_names)
            if j in free:
                weight[j] = task.weight
        return CoordinateArrays(weight, targets)
