"""APDM's CSV files: orientations and raw signals of Opal sensors, in two layouts.

Format 7: a line of identifiers and names of the sensors, a line of signals, a line of axes; times
in microseconds. The older one: names such as `Lumbar/Acceleration/X` in one line, units in the
next; times in seconds. Source: OpenSim, APDMDataReader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.parsing.text import file_text, quick_numbers, rising, unique_names
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message

HINT = "expected a CSV export of APDM's Motion Studio"
FORMAT = "Format=7"
FIRST_SIGNAL = "Accelerometer"  # Of each sensor, in the line of signals.
NAME_AFTER = 3  # Columns from a sensor's identifier, above its first signal, to its name.
SIGNALS = {
    "accelerometer": "accelerations",
    "acceleration": "accelerations",
    "gyroscope": "angular_velocities",
    "angular velocity": "angular_velocities",
    "magnetometer": "magnetic_fields",
    "magnetic field": "magnetic_fields",
    "orientation": "orientations",
}
"""Names of signals in either layout; in m/s^2, rad/s, microtesla, and quaternions."""
AXES = {"orientations": ("s", "x", "y", "z")}
"""Names of components, s for the real part of a quaternion; x, y, z of other signals."""
MICROSECOND = 1e-6

Columns = dict[tuple[str, str], int]
"""Column of each signal and axis."""


def is_apdm_csv(lines: Sequence[str]) -> bool:
    """Return whether lines are those of such a file.

    Parameters
    ----------
    lines : of the file, in order
    """
    first = lines[0].lstrip("\ufeff") if lines else ""
    older = len(lines) > 2 and "/Acceleration/X" in lines[2]
    return first.startswith(FORMAT) or (first.startswith("Test Name") and older)


def read_apdm_csv(path: Path) -> InertialSensors:
    """Read the sensors of a CSV file of APDM.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    orientations (frames, sensors, 4) as w, x, y, z, angular velocities [rad/s], accelerations
    [m/s^2] and magnetic fields [microtesla] (frames, sensors, 3), those that all sensors have; over
    times from the first [s]

    Raises
    ------
    BadFile : it has no sensor, a row that is not of numbers, or times that do not rise
    """
    lines = file_text(path, HINT).splitlines()
    if len(lines) < 3:
        raise BadFile(path, "ends within its lines of names", HINT)
    if lines[0].lstrip("\ufeff").startswith(FORMAT):
        columns = _columns_of_format_7(lines[:3])
        head = 3
        unit = MICROSECOND
    else:
        columns = _columns_of_older_format(lines[2])
        head = 4
        unit = 1.0
    rows = [line for line in lines[head:] if line.strip(" ,")]
    width = max((len(line.split(",")) for line in rows[:1]), default=0)
    values = quick_numbers("\n".join(rows), ",", width)
    if values is None:
        raise BadFile(path, f"holds a row that is not of {width} numbers", HINT)
    signals = _signals(columns, values)
    if not columns or not signals:
        raise BadFile(path, "holds no sensor with a whole signal", HINT)
    time = (values[:, 0] - values[0, 0]) * unit
    if not rising(time).all():
        raise BadFile(path, "its times do not rise from row to row", HINT)
    notes: list[Message] = []
    names = unique_names(list(columns), "sensor", notes)
    return sensors_of_signals(time, names, signals, warnings=tuple(notes), source=str(path))


def _columns_of_format_7(lines: Sequence[str]) -> dict[str, Columns]:
    """Find the columns of each sensor by its three lines of names."""
    above = _cells(lines[0])
    kinds = _cells(lines[1])
    axes = _cells(lines[2])
    starts = [column for column, kind in enumerate(kinds) if kind == FIRST_SIGNAL]
    columns: dict[str, Columns] = {}
    for start, stop in pairwise([*starts, len(kinds)]):
        identifier = above[start] if start < len(above) else ""
        named = above[start + NAME_AFTER] if start + NAME_AFTER < len(above) else ""
        own: Columns = {}
        kind = ""
        for column in range(start, min(stop, len(axes))):
            kind = kinds[column] or kind
            if kind.lower() in SIGNALS:
                own[SIGNALS[kind.lower()], axes[column].lower()] = column
        columns[named or identifier or f"sensor_{len(columns) + 1}"] = own
    return columns


def _cells(line: str) -> list[str]:
    """Split a line into cells without blanks around."""
    return [cell.strip() for cell in line.split(",")]


def _columns_of_older_format(line: str) -> dict[str, Columns]:
    """Find the columns of each sensor by names such as `Lumbar/Acceleration/X`."""
    columns: dict[str, Columns] = {}
    for column, title in enumerate(line.split(",")):
        sensor, _, rest = title.strip().partition("/")
        kind, _, axis = rest.partition("/")
        if kind.lower() in SIGNALS:
            letter = "s" if axis.lower() == "scalar" else axis.lower()
            columns.setdefault(sensor, {})[SIGNALS[kind.lower()], letter] = column
    return columns


def _signals(columns: Mapping[str, Columns], values: Array) -> dict[str, Array]:
    """Collect the signals of which all sensors have all axes.

    Parameters
    ----------
    columns : of each sensor
    values : (rows, columns)

    Returns
    -------
    (rows, sensors, 3 or 4) by signal
    """
    signals = {}
    for kind in dict.fromkeys(SIGNALS.values()):
        axes = AXES.get(kind, ("x", "y", "z"))
        places = [[own.get((kind, axis), -1) for axis in axes] for own in columns.values()]
        flat = np.array(places)
        if flat.size and (flat >= 0).all() and flat.max() < values.shape[1]:
            signals[kind] = values[:, flat]
    return signals
