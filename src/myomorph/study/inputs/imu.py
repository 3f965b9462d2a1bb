"""Inertial sensors of a trial, and what tells how they are mounted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.series import Trial
from myomorph.study.inputs.beside import companion
from myomorph.study.inputs.input import Input, later
from myomorph.study.inputs.keys import Files, Pairs, Span


@dataclass(frozen=True)
class ImuFiles:
    """Inertial sensors.

    Attributes
    ----------
    imu : inertial sensors, one file or one of each sensor: orientations of OpenSim (.sto), Xsens (.mvnx, .txt), Movella
        DOT or Delsys (.csv), APDM (.h5), channels of a recording (.c3d)
    imu_pose : the same sensors while the body stands in the model's default pose; by default the start of the recording
        where the body stands still, or markers
    imu_pose_time : START END [s]: of the calibration pose, in its own recording or in that of the sensors
    imu_bodies : SENSOR=BODY ...: bodies of sensors that are not named like them; - leaves a sensor out
    imu_heading : SENSOR=AXIS ...: axis (x, -x, y, ...) of a sensor that points forward in the calibration pose; one
        gives the heading of all, by default the recording tells it
    """

    imu: Annotated[tuple[Path, ...], Files(per="trial")] = ()
    imu_pose: Annotated[tuple[Path, ...], Files()] = ()
    imu_pose_time: Annotated[tuple[float, float] | None, Span()] = None
    imu_bodies: Annotated[Mapping[str, str], Pairs(shown="SENSOR=BODY")] = field(default_factory=lambda: FrozenMap({}))
    imu_heading: Annotated[Mapping[str, str], Pairs(shown="SENSOR=AXIS")] = field(default_factory=lambda: FrozenMap({}))


WORDS = ("imu", "IMU", "sensors", "orientations")
"""In the name of a file of sensors that belongs to a recording."""
ENDINGS = (".sto", ".mvnx", ".h5", ".csv", ".txt")


def _near(recording: Path, trial: Trial) -> Path | None:
    """The recording itself where it has channels of sensors, else a file of its name."""
    # Reads tables: most commands look for none.
    from myomorph.io.inertial.read import sensor_files, sensors_of_trial

    if sensors_of_trial(trial) is not None:
        return recording
    path = companion(recording, WORDS, ENDINGS) or companion(recording, (), (".mvnx", ".sto", ".h5"), alone=True)
    return path if path is not None and path != recording and sensor_files(path) else None


INPUT = Input(
    name="imu",
    settings=ImuFiles,
    open=later("myomorph.study.inputs.imu_files:opened"),
    main="imu",
    near=_near,
)
