"""Files of inertial sensors, recognized by names and heads: orientations, or raw signals."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.inertial.channels import sensors_of_channels
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadData, BadFile, MyomorphError
from myomorph.core.model.extension import Format
from myomorph.core.model.inertial_sensors import InertialSensors, beside
from myomorph.core.model.registry import extensions
from myomorph.core.model.segment_poses import SegmentPoses
from myomorph.core.model.series import Trial
from myomorph.core.model.spatial import quaternion_from_rotation

SENSORS: tuple[Format, ...] = (
    Format("OpenSim orientations", (".sto",), "myomorph.core.io.inertial.tables:read_orientations"),
    Format("Xsens MVN", (".mvnx",), "myomorph.core.io.inertial.xsens:read_mvnx"),
    Format("Xsens MT Manager", (".txt",), "myomorph.core.io.inertial.xsens:read_xsens_text"),
    Format(
        "Movella DOT, APDM or Delsys", (".csv",), "myomorph.core.io.inertial.tables:read_sensor_csv"
    ),
    Format("APDM", (".h5", ".hdf5"), "myomorph.core.io.inertial.apdm:read_apdm"),
    Format("C3D channels", (".c3d",), "myomorph.core.io.inertial.read:read_c3d_sensors"),
    *(kind for extension in extensions() for kind in extension.sensors),
)
"""Each reader gives `InertialSensors`."""
SETS = (".txt", ".csv")
"""Endings of files of one sensor each; those of one recording share their names up to the last
underscore.
"""
HEAD = 4096  # Bytes in which a table states that it holds orientations.


def sensor_files(path: Path) -> tuple[Path, ...]:
    """List the files of the recording of inertial sensors that a file belongs to.

    Parameters
    ----------
    path : of one of the files

    Returns
    -------
    the file, and those of the other sensors where each has a file; () where it is no such recording
    """
    ending = path.suffix.lower()
    known = ending != ".c3d" and any(ending in kind.endings for kind in SENSORS)
    if not known or not is_named_file(path):
        return ()
    if ending == ".sto":
        with path.open("rb") as stream:
            return (path,) if b"quaternion" in stream.read(HEAD).lower() else ()
    if not _holds_sensors(path):
        return ()
    return _files_alike(path)


def _files_alike(path: Path) -> tuple[Path, ...]:
    """List the files of sensors whose names share their beginning with that of one."""
    stem = path.stem.rpartition("_")[0]
    if path.suffix.lower() not in SETS or not stem:
        return (path,)
    alike = re.compile(re.escape(stem) + r"_[^_]+" + re.escape(path.suffix))
    beside = [other for other in sorted(path.parent.iterdir()) if alike.fullmatch(other.name)]
    return tuple(other for other in beside if other == path or _holds_sensors(other))


def _holds_sensors(path: Path) -> bool:
    """Return whether a file can be read and holds a frame of a sensor."""
    try:
        return len(_read(path)) > 0
    except MyomorphError:
        return False


def read_inertial(
    paths: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
) -> InertialSensors:
    """Read the inertial sensors of a recording, of one file or of one file for each sensor.

    Knows OpenSim's tables of orientations (.sto), Xsens (.mvnx, .txt), Movella DOT and Delsys
    (.csv), APDM (.h5, .csv) and C3D files with channels of accelerometers and gyroscopes, or with
    segments of Theia3D (.c3d).

    Source: see docs/inertial-sensors.md for what each format means.

    Parameters
    ----------
    paths : of files of the `SENSORS`

    Returns
    -------
    orientations (frames, sensors, 4) to an earth whose z points up, or angular velocities [rad/s],
    accelerations [m/s^2] and magnetic fields

    Raises
    ------
    BadFile : a file is none of these, or holds no frame of a sensor
    BadData : files do not belong together, or there is none

    Examples
    --------
    >>> import myomorph as mm
    >>> sensors = mm.read_inertial("reach_orientations.sto")
    >>> sensors.names, len(sensors)
    (('upper_arm_imu', 'forearm_imu'), 61)
    """
    several = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    if not several:
        raise BadData("no file of inertial sensors")
    parts = [_read(Path(path)) for path in several]
    merged = beside(parts)
    # Clocks of packets count from when the sensors were switched on.
    counted = all(Path(path).suffix.lower() in (".txt", ".csv") for path in several)
    return replace(merged, time=merged.time - merged.time[0]) if counted else merged


def _read(path: Path) -> InertialSensors:
    """Read one file by its ending; `BadFile` where it holds no frame of a sensor."""
    kind = next((kind for kind in SENSORS if path.suffix.lower() in kind.endings), None)
    if kind is None:
        expected = ", ".join(ending for kind in SENSORS for ending in kind.endings)
        raise BadFile(
            path,
            f"holds no inertial sensors: its name ends in '{path.suffix}'",
            f"expected {expected}",
        )
    sensors: InertialSensors = kind.read(path)
    if not len(sensors) or not sensors.names:
        raise BadFile(path, "holds no frame of any inertial sensor")
    return sensors


def read_c3d_sensors(path: Path) -> InertialSensors:
    """Read the inertial sensors among the analog channels of a C3D file.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    accelerations [m/s^2], angular velocities [rad/s] and other signals (frames, sensors, 3 or 4)

    Raises
    ------
    BadFile : it cannot be read, or has no such channels
    """
    sensors = sensors_of_trial(read_c3d(path))
    if sensors is None:
        raise BadFile(
            path,
            "has no channels of accelerometers and gyroscopes",
            "expected names such as 'shank.ACC.X', 'shank.GYRO.X'",
        )
    return sensors


def sensors_of_trial(trial: Trial) -> InertialSensors | None:
    """Find the inertial sensors among the analog channels of a recording.

    Segments with poses (Theia3D) count as sensors of orientation.

    Parameters
    ----------
    trial : its segments and analog channels are read

    Returns
    -------
    accelerations [m/s^2], angular velocities [rad/s] and other signals (frames, sensors, 3 or 4);
    None where there are none
    """
    if trial.segments is not None:
        return _sensors_of_segments(trial.segments, trial.source)
    analog = trial.analog
    sensors = (
        None
        if analog is None
        else sensors_of_channels(analog.time, analog.names, analog.values, analog.units)
    )
    return None if sensors is None else replace(sensors, source=trial.source)


def _sensors_of_segments(segments: SegmentPoses, source: str) -> InertialSensors:
    """Take the rotations of segments for orientations of sensors; the laboratory's z points up."""
    known = np.asarray(np.isfinite(segments.rotations).all(axis=(2, 3)))
    rotations = np.where(known[:, :, None, None], segments.rotations, np.eye(3))
    orientations = quaternion_from_rotation(rotations)
    return InertialSensors(
        time=segments.time,
        names=segments.names,
        orientations=np.where(known[:, :, None], orientations, np.nan),
        source=source,
    )
