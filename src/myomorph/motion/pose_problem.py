"""Inverse kinematics as the kernels read it: tasks, what may move, and loops that stay closed."""

from __future__ import annotations

from typing import Any, NamedTuple

from myomorph.model.arrays import Array
from myomorph.motion.tasks.coordinates import CoordinateArrays
from myomorph.motion.tasks.loops import Ties
from myomorph.motion.tasks.markers import MarkerArrays
from myomorph.rigid.coordinates import Ints


class PoseProblem(NamedTuple):
    """What is minimised, and what may move: coordinates that are solved for (`free`), their bounds [rad or m], the unit
    by which changes of each coordinate are measured (`coordinate_units`), values (frames, coordinates) of the others.

    `posture` is what coordinates that no task shows are pulled to, `tasks` arrays of each kind of task, markers and
    coordinates first, `ties` what closes the loops, None of an open model.
    """

    free: Ints
    lower: Array
    upper: Array
    unit: Array
    fixed: Array
    posture: Array
    tasks: tuple[Any, ...]
    ties: Ties | None

    @property
    def markers(self) -> MarkerArrays:
        """Markers and where they were seen."""
        return self.tasks[0]

    @property
    def coordinates(self) -> CoordinateArrays:
        """Values that coordinates are pulled to."""
        return self.tasks[1]

    def with_markers(self, **fields: Any) -> PoseProblem:
        """The problem with other fields of its markers."""
        return self._replace(tasks=(self.markers._replace(**fields), *self.tasks[1:]))

    def with_coordinates(self, **fields: Any) -> PoseProblem:
        """The problem with other fields of its coordinates' values."""
        return self._replace(tasks=(self.markers, self.coordinates._replace(**fields), *self.tasks[2:]))
