"""Tables of inertial sensors: OpenSim's orientations, and CSV files of Movella DOT and Delsys."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.inertial.xsens import COLUMNS, HEAD_LINES, read_dot
from myomorph.core.io.parsing.text import file_text, number
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors

HINT = (
    "expected a CSV export of Movella DOT, or of Delsys with a column of times before the channels"
)
TIME = re.compile(r"^(x\s*\[s\]|x\s*\(s\)|time.*)$", re.IGNORECASE)
UNIT = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")
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
    if table.facts.get("DataType", "").lower() != "quaternion" or len(table.names) % 4:
        raise BadFile(
            path,
            f"holds no orientations: its DataType is '{table.facts.get('DataType', '')}'",
            "expected DataType=Quaternion, as OpenSim's readers of Xsens and APDM data write it",
        )
    names = tuple(name.rsplit("_", 1)[0] for name in table.names[::4])
    values = table.values.reshape(len(table), -1, 4).copy()
    sizes = np.linalg.norm(values, axis=2)
    values[~(sizes > 0.5)] = np.nan
    notes = list(table.warnings)
    if (off := int((np.abs(sizes - 1.0) > 0.01).sum())) > 0:
        notes.append(f"{off} quaternions are not of length 1: made so, those near 0 left out")
    return InertialSensors(table.time, names, values, warnings=tuple(notes), source=str(path))


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
        mark = next((delimiter for delimiter in ";\t" if delimiter in line), ",")
        cells = [cell.strip().strip('"') for cell in line.split(mark)]
        if any(TIME.match(cell) for cell in cells) and len(cells) > 3:
            return _delsys(path, cells, mark, lines[start + 1 :])
    raise BadFile(path, "has no line of column names with a time", HINT)


def _delsys(path: Path, cells: list[str], mark: str, lines: list[str]) -> InertialSensors:
    """Bring the channels of Delsys to the clock of the fastest inertial channel.

    Parameters
    ----------
    path : of the file
    cells : names of the columns; a column of times stands before its channels
    mark : between cells; with ";" a comma is a decimal point
    lines : of numbers

    Returns
    -------
    the sensors, NaN where a channel was not recorded

    Raises
    ------
    BadFile : a cell is no number, or no sensor has all axes
    """
    decimal = mark == ";"
    lines = [line.replace(",", ".") if decimal else line for line in lines if line.strip(" ,;\t")]
    rows = [line.split(mark) for line in lines]
    values = np.full((len(rows), len(cells)), np.nan)
    for index, row in enumerate(rows):
        for column, cell in enumerate(row[: len(cells)]):
            try:
                values[index, column] = number(cell)
            except ValueError:
                text = f"row {index + 1} holds '{cell.strip()}' in column '{cells[column]}'"
                raise BadFile(path, text, HINT) from None
    clock = -1
    names = list[str]()
    units = list[str]()
    parts = list[tuple[Array, Array]]()
    for column, cell in enumerate(cells):
        if TIME.match(cell):
            clock = column
        elif cell and clock >= 0:
            unit = UNIT.search(cell)
            title = cell[: unit.start()].strip() if unit else cell
            known = np.isfinite(values[:, clock]) & np.isfinite(values[:, column])
            names.append(title)
            units.append(unit.group(1) if unit else "")
            parts.append((values[known, clock], values[known, column]))
    inertial = [
        i for i, name in enumerate(names) if SENSOR_LIKE.search(name) and len(parts[i][0]) > 1
    ]
    if not inertial:
        raise BadFile(path, "has no channels of accelerometers and gyroscopes", HINT)
    time = max((parts[i][0] for i in inertial), key=len)
    table = np.column_stack([np.interp(time, *parts[i], np.nan, np.nan) for i in inertial])
    sensors = sensors_of_channels(
        time, [names[i] for i in inertial], table, [units[i] for i in inertial]
    )
    if sensors is None:
        raise BadFile(path, "has no sensor with all axes of an accelerometer and a gyroscope", HINT)
    return replace(sensors, source=str(path))


CHANNEL = re.compile(
    r"^(?P<before>.*?)[\s._:-]*(?P<kind>acc|accel|accelerometer|gyr|gyro|gyroscope|mag|magnetometer|quat|quaternion|or|"
    r"orientation)[\s._:-]*(?P<axis>[xyzw])(?P<after>[\s._:-]*\d*)\s*$",
    re.IGNORECASE,
)
"""Name of a channel: sensor, what it measures, axis, and a number."""
KINDS = {"a": "accelerations", "g": "angular_velocities", "m": "magnetic_fields"} | dict.fromkeys(
    "qo", "orientations"
)
"""What is measured, by the first letter of its word."""
JOINTS = " ._:-"  # What stands between the words of a name.
# What a sensor must have, one or the other.
ENOUGH = ({"accelerations", "angular_velocities"}, {"orientations"})
GRAVITY = 9.80665
ACCELERATION_UNITS = {"g": GRAVITY, "gs": GRAVITY, "mg": 1e-3 * GRAVITY}
ACCELERATION_UNITS |= dict.fromkeys(("m/s^2", "m/s2", "m/s²"), 1.0) | dict.fromkeys(
    ("mm/s^2", "mm/s2", "mm/s²"), 1e-3
)
RATE_UNITS = {"rad/s": 1.0} | dict.fromkeys(("deg/s", "°/s", "dps", "deg/sec"), np.pi / 180.0)
MIN_RATIO = 0.3
# Median of accelerations, in units of gravity, between which their unit is believed.
MAX_RATIO = 3.0
MAX_RADIANS = 20.0
MIN_DEGREES = 40.0
"""Largest speed of rotation up to which numbers without a unit are rad/s, and from which on they
are deg/s.
"""


def sensors_of_channels(
    time: Array, names: Sequence[str], values: Array, units: Sequence[str]
) -> InertialSensors | None:
    """Find inertial sensors among channels, by their names.

    A sensor has all axes of an accelerometer and a gyroscope, or an orientation.

    Parameters
    ----------
    time : (samples,) [s]
    names : one per channel, as "shank.ACC.X"
    values : (samples, channels)
    units : one per channel, "" for unknown, then guessed from their size

    Returns
    -------
    signals (samples, sensors, 3 or 4) that all sensors have, in the units of `InertialSensors`;
    None where there are no sensors
    """
    columns: dict[str, dict[tuple[str, str], int]] = {}
    for index, name in enumerate(names):
        match = CHANNEL.match(name)
        if match is None:
            continue
        parts = (match["before"].strip(JOINTS), match["after"].strip(JOINTS))
        sensor = "_".join(part for part in parts if part)
        kind = KINDS[match["kind"][0].lower()]
        columns.setdefault(sensor or "imu", {})[kind, match["axis"].lower()] = index
    if "imu" in columns and any(name.isdigit() for name in columns):
        columns = {
            f"imu_{name}" if name.isdigit() else name: axes for name, axes in columns.items()
        }
    whole = {
        sensor: {kind for kind, _ in axes if all((kind, axis) in axes for axis in _axes(kind))}
        for sensor, axes in columns.items()
    }
    found = [name for name, kinds in whole.items() if any(needed <= kinds for needed in ENOUGH)]
    if not found:
        return None
    signals = dict[str, Any]()
    notes = list[str]()
    for kind in dict.fromkeys(KINDS.values()):
        if not all(kind in whole[name] for name in found):
            continue
        picked = [[columns[name][kind, axis] for axis in _axes(kind)] for name in found]
        scale = _scale(
            kind,
            [units[index] for row in picked for index in row],
            values[:, np.ravel(picked)],
            notes,
        )
        signals[kind] = scale * values[:, picked]
    return sensors_of_signals(time, tuple(found), signals, warnings=tuple(notes))


def _axes(kind: str) -> str:
    """Return the axes of a signal, w before x, y and z for orientations."""
    return "wxyz" if kind == "orientations" else "xyz"


def _scale(kind: str, units: Sequence[str], values: Array, notes: list[str]) -> float:
    """Find the factor of a signal to the units of `InertialSensors`.

    Parameters
    ----------
    kind : of signal
    units : one per channel
    values : (samples, channels), three channels per sensor
    notes : gets a warning where the unit follows from the size of the values

    Returns
    -------
    the factor, 1 for orientations and magnetic fields
    """
    if kind not in ("accelerations", "angular_velocities"):
        return 1.0
    known = ACCELERATION_UNITS if kind == "accelerations" else RATE_UNITS
    unit = units[0].strip().lower() if len(set(units)) == 1 else ""
    sizes = np.linalg.norm(np.nan_to_num(values.reshape(len(values), -1, 3)), axis=2)
    usual = float(np.median(sizes))
    largest = float(sizes.max(initial=0.0))
    if unit in known and (
        kind != "accelerations" or MIN_RATIO < known[unit] * usual / GRAVITY < MAX_RATIO
    ):
        return known[unit]
    if kind == "accelerations":
        name = min(
            ("m/s^2", "mm/s^2", "g"),
            key=lambda name: abs(np.log(max(usual * known[name], 1e-9) / GRAVITY)),
        )
    else:
        name = "rad/s" if largest < MAX_RADIANS else "deg/s"
        if MAX_RADIANS <= largest < MIN_DEGREES:
            notes.append(
                f"speeds of rotation reach {largest:.0f}: it is unsure whether they are rad/s or"
                " deg/s"
            )
    notes.append(
        f"unit of {kind.replace('_', ' ')} is '{units[0]}' in the file: taken as {name} by their"
        " size"
    )
    return known[name]
