"""What is recorded by sensors and by markers beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.sensors.mounting import SensorOptions


@dataclass(frozen=True, eq=False)
class SensorRecording:
    """Sensors of a trial, and what is known of them.

    Attributes
    ----------
    sensors : recording
    bodies : of sensors that are not named like theirs, "" for one left out
    pose : the calibration pose where it was recorded apart
    pose_time : its start and end, in its own recording or in the trial [s]
    headings : each sensor's axis that points forward in the pose
    same_clock : whether the clock is that of the markers
    sizes : noise of sensors and markers, and how the mounting is found
    """

    sensors: InertialSensors
    bodies: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    pose: InertialSensors | None = None
    pose_time: tuple[float, float] | None = None
    headings: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    same_clock: bool = False
    sizes: SensorOptions = field(default_factory=SensorOptions)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackedMarkers:
    """Markers of a trial, and the motion that they show.

    Attributes
    ----------
    markers : of the trial; without any, their times are those of the motion
    fit : inverse kinematics of these markers alone; None where there are none
    """

    markers: Markers
    fit: KinematicsFit | None
