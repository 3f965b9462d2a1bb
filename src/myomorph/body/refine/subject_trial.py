"""A recording of a subject, as `refine` takes it."""

from __future__ import annotations

from dataclasses import dataclass, field

from myomorph.core.model.series import Markers, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.motion.ik import InverseKinematicsOptions


@shown
@dataclass(frozen=True, eq=False)
class SubjectTrial:
    """One recording of a subject.

    Attributes
    ----------
    name : of the recording
    markers : positions over time [m]
    time : start and end of what is used [s], None for all
    wrenches : external forces as recorded, each with its body
    tracking : options of its inverse kinematics; weights of markers count here too
    """

    name: str
    markers: Markers
    wrenches: Wrenches
    tracking: InverseKinematicsOptions = field(default_factory=InverseKinematicsOptions)
    time: tuple[float, float] | None = None
