"""Inertial sensors of a trial, and what tells how they are mounted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import located
from myomorph.core.model.series import Trial
from myomorph.lab.store.results import file_source, value_source
from myomorph.lab.study.inputs.beside import companion
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import Files, Pairs, Span
from myomorph.lab.study.inputs.markers import MarkersFile
from myomorph.lab.study.inputs.reading import about

if TYPE_CHECKING:
    from myomorph.core.model.inertial_sensors import InertialSensors


@dataclass(frozen=True)
class ImuFiles:
    """Inertial sensors.

    Attributes
    ----------
    imu : inertial sensors, in one file or one file per sensor: orientations of OpenSim (.sto),
        Xsens (.mvnx, .txt), Movella DOT or Delsys (.csv), APDM (.h5), or channels of a recording
        (.c3d)
    imu_pose : calibration pose: recording of the same sensors while the body stands in the model's
        default pose; by default the quiet standing at the start of the recording, or markers
    imu_pose_time : START END [s]: time of the calibration pose, in its own recording or in that of
        the sensors
    imu_bodies : SENSOR=BODY ...: bodies of sensors whose names differ from the body's; - leaves a
        sensor out
    imu_heading : SENSOR=AXIS ...: axis (x, -x, y, ...) of a sensor that points forward in the
        calibration pose; one sensor determines the heading of all; by default it is found from the
        recording
    """

    imu: Annotated[tuple[Path, ...], Files(per="trial")] = ()
    imu_pose: Annotated[tuple[Path, ...], Files()] = ()
    imu_pose_time: Annotated[tuple[float, float] | None, Span()] = None
    imu_bodies: Annotated[Mapping[str, str], Pairs(shown="SENSOR=BODY")] = field(
        default_factory=lambda: FrozenMap({})
    )
    imu_heading: Annotated[Mapping[str, str], Pairs(shown="SENSOR=AXIS")] = field(
        default_factory=lambda: FrozenMap({})
    )


# In the name of a file of sensors that belongs to a recording.
WORDS = ("imu", "IMU", "sensors", "orientations")
ENDINGS = (".sto", ".mvnx", ".h5", ".csv", ".txt")


def _near(recording: Path, trial: Trial) -> Path | None:
    """Return the recording itself where it has channels of sensors, else a file of its name."""
    # Reads tables: most commands look for none.
    from myomorph.core.io.inertial.read import sensor_files, sensors_of_trial

    if sensors_of_trial(trial) is not None:
        return recording
    path = companion(recording, WORDS, ENDINGS) or companion(
        recording, (), (".mvnx", ".sto", ".h5"), alone=True
    )
    return path if path is not None and path != recording and sensor_files(path) else None


NONE = ("", "-", "none")  # In the place of a body: the sensor is left out.


def _open(settings: ImuFiles, opening: Opening) -> Opened:
    """Read the sensors, each with a body of the model.

    Raises `BadFile` or `BadData` where a file cannot be read, `UnknownName` where a sensor has no
    body.
    """
    if not settings.imu:
        return Opened()
    from myomorph.body.sensors.sensor_recording import SensorRecording
    from myomorph.core.motion.sensors.mounting import bodies_of_sensors

    sensors = _read(settings.imu)
    pose = _read(settings.imu_pose) if settings.imu_pose else None
    bodies = {
        name: "" if body.lower() in NONE else body for name, body in settings.imu_bodies.items()
    }
    with about(settings.imu[0]):
        bodies_of_sensors(opening.model, sensors.names, bodies)
    recording = SensorRecording(
        sensors=sensors,
        bodies=FrozenMap(bodies),
        pose=pose,
        pose_time=settings.imu_pose_time,
        headings=settings.imu_heading,
        same_clock=opening.settings.or_default(MarkersFile).markers in settings.imu,
    )
    named = (
        sorted(settings.imu_bodies.items()),
        sorted(settings.imu_heading.items()),
        settings.imu_pose_time,
    )
    sources = [file_source("imu", path) for path in (*settings.imu, *settings.imu_pose)]
    return Opened(
        values=(recording,),
        sources=(*sources, value_source("imu", "bodies, headings and pose of sensors", *named)),
        warnings=located(settings.imu[0].name, sensors.warnings),
        real=f"{len(sensors.names)} inertial sensors from {settings.imu[0].name}",
    )


def _read(paths: Sequence[Path]) -> InertialSensors:
    from myomorph.core.io.inertial.read import read_inertial

    with about(paths[0]):
        return read_inertial(paths)


INPUT = Input(name="imu", settings=ImuFiles, open=_open, main="imu", near=_near)
