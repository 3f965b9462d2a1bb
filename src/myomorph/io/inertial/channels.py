"""Channels by their names as inertial sensors: ACC, GYRO, MAG and orientation, each axis a channel."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.inertial_sensors import InertialSensors

CHANNEL = re.compile(
    r"^(?P<before>.*?)[\s._:-]*(?P<kind>acc|accel|accelerometer|gyr|gyro|gyroscope|mag|magnetometer|quat|quaternion|or|"
    r"orientation)[\s._:-]*(?P<axis>[xyzw])(?P<after>[\s._:-]*\d*)\s*$",
    re.IGNORECASE,
)
"""Name of a channel: sensor, what it measures, axis, and a number."""
KINDS = {"a": "accelerations", "g": "angular_velocities", "m": "magnetic_fields"} | dict.fromkeys("qo", "orientations")
"""What is measured, by the first letter of its word."""
JOINTS = " ._:-"  # What stands between the words of a name.
ENOUGH = ({"accelerations", "angular_velocities"}, {"orientations"})  # What a sensor must have, one or the other.
GRAVITY = 9.80665
ACCELERATION_UNITS = {"g": GRAVITY, "gs": GRAVITY, "mg": 1e-3 * GRAVITY}
ACCELERATION_UNITS |= dict.fromkeys(("m/s^2", "m/s2", "m/s²"), 1.0) | dict.fromkeys(("mm/s^2", "mm/s2", "mm/s²"), 1e-3)
RATE_UNITS = {"rad/s": 1.0} | dict.fromkeys(("deg/s", "°/s", "dps", "deg/sec"), np.pi / 180.0)
MIN_RATIO, MAX_RATIO = 0.3, 3.0  # Median of accelerations, in units of gravity, between which their unit is believed.
MAX_RADIANS, MIN_DEGREES = 20.0, 40.0
"""Largest speed of rotation up to which numbers without a unit are rad/s, and from which on they are deg/s."""


def sensors_of_channels(
    time: Array, names: Sequence[str], values: Array, units: Sequence[str]
) -> InertialSensors | None:
    """Inertial sensors among channels (samples, channels); None where there are none."""
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
        columns = {f"imu_{name}" if name.isdigit() else name: axes for name, axes in columns.items()}
    whole = {
        sensor: {kind for kind, _ in axes if all((kind, axis) in axes for axis in _axes(kind))}
        for sensor, axes in columns.items()
    }
    found = [name for name, kinds in whole.items() if any(needed <= kinds for needed in ENOUGH)]
    if not found:
        return None
    signals, notes = dict[str, Any](), list[str]()
    for kind in dict.fromkeys(KINDS.values()):
        if not all(kind in whole[name] for name in found):
            continue
        picked = [[columns[name][kind, axis] for axis in _axes(kind)] for name in found]
        scale = _scale(kind, [units[index] for row in picked for index in row], values[:, np.ravel(picked)], notes)
        signals[kind] = scale * values[:, picked]
    return InertialSensors(time, tuple(found), warnings=tuple(notes), **signals)


def _axes(kind: str) -> str:
    return "wxyz" if kind == "orientations" else "xyz"


def _scale(kind: str, units: Sequence[str], values: Array, notes: list[str]) -> float:
    """Factor to the units of `InertialSensors`; of what has no unit that fits it is judged by size."""
    if kind not in ("accelerations", "angular_velocities"):
        return 1.0
    known = ACCELERATION_UNITS if kind == "accelerations" else RATE_UNITS
    unit = units[0].strip().lower() if len(set(units)) == 1 else ""
    sizes = np.linalg.norm(np.nan_to_num(values.reshape(len(values), -1, 3)), axis=2)
    usual, largest = float(np.median(sizes)), float(sizes.max(initial=0.0))
    if unit in known and (kind != "accelerations" or MIN_RATIO < known[unit] * usual / GRAVITY < MAX_RATIO):
        return known[unit]
    if kind == "accelerations":
        name = min(("m/s^2", "mm/s^2", "g"), key=lambda name: abs(np.log(max(usual * known[name], 1e-9) / GRAVITY)))
    else:
        name = "rad/s" if largest < MAX_RADIANS else "deg/s"
        if MAX_RADIANS <= largest < MIN_DEGREES:
            notes.append(f"speeds of rotation reach {largest:.0f}: it is unsure whether they are rad/s or deg/s")
    notes.append(f"unit of {kind.replace('_', ' ')} is '{units[0]}' in the file: taken as {name} by their size")
    return known[name]
