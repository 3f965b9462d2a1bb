"""Inertial sensors of files, as inverse kinematics takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from myomorph.io.inertial.read import read_inertial
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.inertial_sensors import InertialSensors
from myomorph.motion.sensors.mounting import bodies_of_sensors
from myomorph.motion.sensors.sensor_kinematics import SensorRecording
from myomorph.store.results import file_source, value_source
from myomorph.study.inputs.imu import ImuFiles
from myomorph.study.inputs.input import Opened, Opening
from myomorph.study.inputs.markers import MarkersFile
from myomorph.study.inputs.reading import about

NONE = ("", "-", "none")
"""In the place of a body: the sensor is left out."""


@dataclass(frozen=True, eq=False)
class RecordedSensors:
    """Inertial sensors of a trial."""

    recording: SensorRecording


def opened(settings: ImuFiles, opening: Opening) -> Opened:
    """The sensors, each with a body of the model. Raises `BadFile` or `BadData` or `UnknownName` where a file cannot be
    read, or a sensor has no body.
    """
    if not settings.imu:
        return Opened()
    sensors = _read(settings.imu)
    pose = _read(settings.imu_pose) if settings.imu_pose else None
    bodies = {name: "" if body.lower() in NONE else body for name, body in settings.imu_bodies.items()}
    with about(settings.imu[0]):
        bodies_of_sensors(opening.model, sensors.names, bodies)
    recording = SensorRecording(
        sensors,
        FrozenMap(bodies),
        pose,
        settings.imu_pose_time,
        settings.imu_heading,
        opening.settings.or_default(MarkersFile).markers in settings.imu,
    )
    named = (sorted(settings.imu_bodies.items()), sorted(settings.imu_heading.items()), settings.imu_pose_time)
    sources = [file_source("imu", path) for path in (*settings.imu, *settings.imu_pose)]
    return Opened(
        (RecordedSensors(recording),),
        (*sources, value_source("imu", "bodies, headings and pose of sensors", *named)),
        tuple(f"{settings.imu[0].name}: {text}" for text in sensors.warnings),
        f"{len(sensors.names)} inertial sensors from {settings.imu[0].name}",
    )


def _read(paths: Sequence[Path]) -> InertialSensors:
    with about(paths[0]):
        return read_inertial(paths)
