"""Tables of inertial sensors: OpenSim's orientations, CSV files of Movella DOT, APDM and Delsys."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.delsys import Channel, read_delsys
from myomorph.core.io.inertial.apdm_csv import is_apdm_csv, read_apdm_csv
from myomorph.core.io.inertial.channels import sensors_of_channels
from myomorph.core.io.inertial.xsens import COLUMNS, HEAD_LINES, read_dot
from myomorph.core.io.parsing.text import file_text
from myomorph.core.io.sto import read_sto
from myomorph.core.model.causes import SENSORS
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors

HINT = (
    "expected a CSV export of Movella DOT, of APDM, or of Delsys with a column of times before the"
    " channels"
)
MIN_NORM = 0.5  # Of a quaternion.
MAX_NORM_ERROR = 0.01
# In the name of a channel.
SENSOR_LIKE = re.compile(r"(acc|gyr|mag|quat|orientation)", re.IGNORECASE)


def read_orientations(path: Path) -> InertialSensors:
    """Read orientations as OpenSim writes them: a column of quaternions for each sensor.

    Source: OpenSim, OpenSense: kinematics with IMU data.

    Parameters
    ----------
    path : of the file (.sto)

    Returns
    -------
    orientations (frames, sensors, 4) as w, x, y, z, NaN where a quaternion is near 0

    Raises
    ------
    BadFile : it is no table of quaternions
    """
    table = read_sto(path)
    data_type = table.facts.get("DataType", "")
    if data_type.lower() != "quaternion" or len(table.names) % 4:
        raise BadFile(
            path,
            f"holds no orientations: its DataType is '{data_type}'",
            "expected DataType=Quaternion, as OpenSim's readers of Xsens and APDM data write it",
        )
    names = tuple(name.rsplit("_", 1)[0] for name in table.names[::4])
    quaternions = table.values.reshape(len(table), -1, 4).copy()
    norms = np.linalg.norm(quaternions, axis=2)
    quaternions[~(norms > MIN_NORM)] = np.nan
    notes = list(table.warnings)
    off = int((np.abs(norms - 1.0) > MAX_NORM_ERROR).sum())
    if off > 0:
        notes.append(
            SENSORS.message(
                f"{off} quaternions are not of length 1: normalized, those near 0 left out"
            )
        )
    return InertialSensors(table.time, names, quaternions, warnings=tuple(notes), source=str(path))


def read_sensor_csv(path: Path) -> InertialSensors:
    """Read a CSV file of Movella DOT (one sensor), of APDM or of Delsys (several sensors).

    Parameters
    ----------
    path : of the file

    Returns
    -------
    signals (frames, sensors, 3 or 4); those of Delsys, whose channels have clocks of their own, at
    the times of the fastest inertial channel

    Raises
    ------
    BadFile : it is none of these, or has no sensor with all axes
    """
    lines = file_text(path, HINT).splitlines()
    if any(COLUMNS.match(line) for line in lines[:HEAD_LINES]):
        return read_dot(path)
    if is_apdm_csv(lines):
        return read_apdm_csv(path)
    try:
        channels = read_delsys(path)
    except BadFile as error:
        raise BadFile(path, error.problem, HINT) from None
    return _delsys(path, channels)


def _delsys(path: Path, channels: Sequence[Channel]) -> InertialSensors:
    """Bring the channels of Delsys to the clock of the fastest inertial channel.

    Parameters
    ----------
    path : of the file
    channels : of sensors, and others

    Returns
    -------
    the sensors, NaN where a channel was not recorded

    Raises
    ------
    BadFile : no sensor has all axes
    """
    inertial = [
        channel
        for channel in channels
        if SENSOR_LIKE.search(channel.name) and len(channel.time) > 1
    ]
    if not inertial:
        raise BadFile(path, "has no channels of accelerometers and gyroscopes", HINT)
    time = max((channel.time for channel in inertial), key=len)
    sensors = sensors_of_channels(
        time,
        names=[channel.name for channel in inertial],
        values=np.column_stack([channel.at_times(time) for channel in inertial]),
        units=[channel.unit for channel in inertial],
    )
    if sensors is None:
        raise BadFile(path, "has no sensor with all axes of an accelerometer and a gyroscope", HINT)
    return replace(sensors, source=str(path))
