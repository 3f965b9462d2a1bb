"""Tables of inertial sensors: OpenSim's orientations, and CSV files of Movella DOT and Delsys."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.inertial.channels import sensors_of_channels
from myomorph.core.io.inertial.xsens import COLUMNS, HEAD_LINES, read_dot
from myomorph.core.io.parsing.text import file_text, number
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import SENSORS
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors

HINT = (
    "expected a CSV export of Movella DOT, or of Delsys with a column of times before the channels"
)
TIME = re.compile(r"^(x\s*\[s\]|x\s*\(s\)|time.*)$", re.IGNORECASE)
UNIT = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")
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
                f"{off} quaternions are not of length 1: made so, those near 0 left out"
            )
        )
    return InertialSensors(table.time, names, quaternions, warnings=tuple(notes), source=str(path))


def read_sensor_csv(path: Path) -> InertialSensors:
    """Read a CSV file of Movella DOT (one sensor) or of Delsys (several sensors).

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
    for start, line in enumerate(lines[:HEAD_LINES]):
        delimiter = _delimiter(line)
        titles = [cell.strip().strip('"') for cell in line.split(delimiter)]
        if len(titles) > 3 and any(TIME.match(title) for title in titles):
            values = _values(path, titles, delimiter, lines[start + 1 :])
            return _delsys(path, _channels(titles, values))
    raise BadFile(path, "has no line of column names with a time", HINT)


def _delimiter(line: str) -> str:
    """Find what stands between the cells of a line: a semicolon, a tab, or else a comma."""
    for delimiter in ";\t":
        if delimiter in line:
            return delimiter
    return ","


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Channel:
    """A channel with a clock of its own.

    Attributes
    ----------
    name, unit : by its title; "" for no unit
    time : (samples,) [s]
    values : (samples,) in that unit
    """

    name: str
    unit: str
    time: Array
    values: Array


def _values(path: Path, titles: Sequence[str], delimiter: str, lines: Iterable[str]) -> Array:
    """Read the numbers of a table.

    Parameters
    ----------
    path : of the file, for messages
    titles : of the columns
    delimiter : between cells; with ";" a comma is a decimal point
    lines : below the titles

    Returns
    -------
    (rows, columns), NaN where a cell is missing

    Raises
    ------
    BadFile : a cell is no number
    """
    lines = [line for line in lines if line.strip(" ,;\t")]
    if delimiter == ";":
        lines = [line.replace(",", ".") for line in lines]
    values = np.full((len(lines), len(titles)), np.nan)
    for index, line in enumerate(lines):
        for column, cell in enumerate(line.split(delimiter)[: len(titles)]):
            try:
                values[index, column] = number(cell)
            except ValueError:
                text = f"row {index + 1} holds '{cell.strip()}' in column '{titles[column]}'"
                raise BadFile(path, text, HINT) from None
    return values


def _channels(titles: Sequence[str], values: Array) -> list[_Channel]:
    """Read the channels, each at the times that stand before it.

    Parameters
    ----------
    titles : of the columns; a column of times stands before its channels
    values : (rows, columns)
    """
    channels = []
    clock: int | None = None
    for column, title in enumerate(titles):
        if TIME.match(title):
            clock = column
            continue
        if not title or clock is None:
            continue
        unit = UNIT.search(title)
        known = np.isfinite(values[:, clock]) & np.isfinite(values[:, column])
        channels.append(
            _Channel(
                name=title[: unit.start()].strip() if unit else title,
                unit=unit.group(1) if unit else "",
                time=values[known, clock],
                values=values[known, column],
            )
        )
    return channels


def _delsys(path: Path, channels: Sequence[_Channel]) -> InertialSensors:
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
        values=np.column_stack([_at_times(channel, time) for channel in inertial]),
        units=[channel.unit for channel in inertial],
    )
    if sensors is None:
        raise BadFile(path, "has no sensor with all axes of an accelerometer and a gyroscope", HINT)
    return replace(sensors, source=str(path))


def _at_times(channel: _Channel, time: Array) -> Array:
    """Interpolate a channel at times (samples,) [s], NaN beyond its first and last."""
    return np.interp(time, channel.time, channel.values, left=np.nan, right=np.nan)
