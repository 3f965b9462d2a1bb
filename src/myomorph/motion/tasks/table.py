"""The kinds of task that come with the package: their kernels are compiled, and kept on disk, with the Newton loop."""

from __future__ import annotations

from myomorph.motion.tasks.coordinates import CoordinateTask
from myomorph.motion.tasks.markers import MarkerTask
from myomorph.motion.tasks.orientations import OrientationTask
from myomorph.motion.tasks.task import Task

KINDS: tuple[type[Task], ...] = (
    MarkerTask,
    CoordinateTask,
    OrientationTask,
)
"""Every problem has arrays of these in this order, be they empty, so that one compiled loop serves all of them."""
