"""Inverse kinematics with sensors, as it was solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.series import Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.core.motion.sensors.mounting import SensorMounting
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.tasks.orientations import OrientationTask


@dataclass(frozen=True, eq=False)
class SensorFit:
    """Inverse kinematics with sensors, with the orientations and mounting that were used.

    Attributes
    ----------
    fit : of markers and sensors
    mounting : of the sensors
    sensors : with their orientations
    bridges : pulls of coordinates in gaps: of the root's position without markers, and of joints
        whose sensor is lost
    places : coordinates to which the bridges pull, None without gaps
    spreads : standard deviation of such a joint about there [rad]
    """

    fit: KinematicsFit
    mounting: SensorMounting
    sensors: InertialSensors
    bridges: tuple[CoordinateTask, ...] = ()
    places: Motion | None = None
    spreads: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))

    def added(
        self, options: InverseKinematicsOptions, tasks: Sequence[OrientationTask]
    ) -> InverseKinematicsOptions:
        """Add tasks of sensors, and what bridges gaps, to options of inverse kinematics.

        Parameters
        ----------
        options : of markers alone
        tasks : orientations of sensors

        Returns
        -------
        the options with both
        """
        return with_tasks(options, tasks, self.bridges, self.places)


def with_tasks(
    options: InverseKinematicsOptions,
    tasks: Sequence[OrientationTask],
    bridges: Sequence[CoordinateTask],
    places: Motion | None,
) -> InverseKinematicsOptions:
    """Add tasks of sensors and pulls in gaps to options of inverse kinematics.

    Parameters
    ----------
    options : of markers alone
    tasks : orientations of sensors
    bridges : pulls of coordinates in gaps
    places : coordinates that the pulls draw to, None without gaps

    Returns
    -------
    the options with both
    """
    whole = replace(options, tasks=(*options.tasks, *tasks, *bridges))
    return whole if places is None else replace(whole, coordinates=places)
