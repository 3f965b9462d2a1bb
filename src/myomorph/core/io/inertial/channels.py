"""Inertial sensors among channels, found by the channels' names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import UNITS
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message

CHANNEL = re.compile(
    r"^(?P<before>.*?)[\s._:-]*"
    r"(?P<kind>acc|accel|accelerometer|gyr|gyro|gyroscope|mag|magnetometer|quat|quaternion|or|"
    r"orientation)[\s._:-]*(?P<axis>[xyzw])(?P<after>[\s._:-]*\d*)\s*$",
    re.IGNORECASE,
)
"""Name of a channel: sensor, what it measures, axis, and a number."""
KINDS = {
    "a": "accelerations",
    "g": "angular_velocities",
    "m": "magnetic_fields",
    "q": "orientations",
    "o": "orientations",
}
"""What is measured, by the first letter of its word."""
SEPARATORS = " ._:-"  # Between the words of a name.
UNNAMED = "imu"  # Sensor of channels that name none.
SUFFICIENT = ({"accelerations", "angular_velocities"}, {"orientations"})
"""What a sensor must have, one or the other."""

GRAVITY = 9.80665
ACCELERATION_UNITS = {
    "g": GRAVITY,
    "gs": GRAVITY,
    "mg": 1e-3 * GRAVITY,
    "m/s^2": 1.0,
    "m/s2": 1.0,
    "m/s²": 1.0,
    "mm/s^2": 1e-3,
    "mm/s2": 1e-3,
    "mm/s²": 1e-3,
}
GUESSED_ACCELERATION_UNITS = ("m/s^2", "mm/s^2", "g")
DEGREE = np.pi / 180.0
RATE_UNITS = {
    "rad/s": 1.0,
    "deg/s": DEGREE,
    "°/s": DEGREE,
    "dps": DEGREE,
    "deg/sec": DEGREE,
}
MIN_RATIO = 0.3
MAX_RATIO = 3.0
"""Median of accelerations, in units of gravity, between which their unit is believed."""
MAX_RADIANS = 20.0
MIN_DEGREES = 40.0
"""Largest speed of rotation up to which numbers without a unit are rad/s, and from which on they
are deg/s.
"""

Columns = dict[tuple[str, str], int]
"""Index of the channel by kind of signal and axis."""


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
    columns_by_sensor = _columns_by_sensor(names)
    kinds_by_sensor = {name: _whole_kinds(columns) for name, columns in columns_by_sensor.items()}
    sensors = [
        name
        for name, kinds in kinds_by_sensor.items()
        if any(sufficient <= kinds for sufficient in SUFFICIENT)
    ]
    if not sensors:
        return None
    signals = dict[str, Any]()
    notes = list[Message]()
    for kind in dict.fromkeys(KINDS.values()):
        if not all(kind in kinds_by_sensor[name] for name in sensors):
            continue
        columns = [_axis_columns(columns_by_sensor[name], kind) for name in sensors]
        flat = [index for of_sensor in columns for index in of_sensor]
        scale = _scale(kind, [units[index] for index in flat], values[:, flat], notes)
        signals[kind] = scale * values[:, columns]
    return sensors_of_signals(time, tuple(sensors), signals, warnings=tuple(notes))


def _columns_by_sensor(names: Iterable[str]) -> Mapping[str, Columns]:
    """Sort channels by sensor, in the order in which the sensors first occur."""
    columns: dict[str, Columns] = {}
    for index, name in enumerate(names):
        match = CHANNEL.match(name)
        if match is None:
            continue
        parts = (match["before"].strip(SEPARATORS), match["after"].strip(SEPARATORS))
        sensor = "_".join(part for part in parts if part) or UNNAMED
        kind = KINDS[match["kind"][0].lower()]
        columns.setdefault(sensor, {})[kind, match["axis"].lower()] = index
    if UNNAMED not in columns:
        return columns
    # Of several sensors without a name the first has no number.
    return {
        f"{UNNAMED}_{name}" if name.isdigit() else name: of_sensor
        for name, of_sensor in columns.items()
    }


def _whole_kinds(columns: Columns) -> set[str]:
    """Return the kinds of signals of which a sensor has all axes."""
    kinds = {kind for kind, _ in columns}
    return {kind for kind in kinds if all((kind, axis) in columns for axis in _axes(kind))}


def _axis_columns(columns: Columns, kind: str) -> list[int]:
    """Return the channels of a signal in the order of its axes."""
    return [columns[kind, axis] for axis in _axes(kind)]


def _axes(kind: str) -> str:
    """Return the axes of a signal, w before x, y and z for orientations."""
    return "wxyz" if kind == "orientations" else "xyz"


def _scale(kind: str, units: Sequence[str], values: Array, notes: list[Message]) -> float:
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
    norms = np.linalg.norm(np.nan_to_num(values.reshape(len(values), -1, 3)), axis=2)
    stated = units[0].strip().lower() if len(set(units)) == 1 else ""
    if kind == "accelerations":
        known = ACCELERATION_UNITS
        median = float(np.median(norms))
        if stated in known and MIN_RATIO < known[stated] * median / GRAVITY < MAX_RATIO:
            return known[stated]
        unit = _acceleration_unit(median)
    else:
        known = RATE_UNITS
        if stated in known:
            return known[stated]
        unit = _rate_unit(float(norms.max(initial=0.0)), notes)
    notes.append(
        UNITS.message(
            f"unit of {kind.replace('_', ' ')} is '{units[0]}' in the file: taken as {unit} by"
            " their size"
        )
    )
    return known[unit]


def _acceleration_unit(median: float) -> str:
    """Guess the unit in which the median of accelerations is nearest to gravity, by their ratio."""

    def deviation(unit: str) -> float:
        acceleration = max(median * ACCELERATION_UNITS[unit], 1e-9)
        return float(abs(np.log(acceleration / GRAVITY)))

    return min(GUESSED_ACCELERATION_UNITS, key=deviation)


def _rate_unit(largest: float, notes: list[Message]) -> str:
    """Guess the unit of speeds of rotation by the largest; `notes` says where that is not sure."""
    if largest < MAX_RADIANS:
        return "rad/s"
    if largest < MIN_DEGREES:
        notes.append(
            UNITS.message(
                f"speeds of rotation reach {largest:.0f}: whether they are in rad/s or deg/s is not"
                " certain"
            )
        )
    return "deg/s"
