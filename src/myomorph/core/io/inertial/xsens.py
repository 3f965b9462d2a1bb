"""Xsens and Movella: MVNX of MVN Analyze, text files of MT Manager, CSV files of DOT."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.parsing.door import MAX_NUMBERS
from myomorph.core.io.parsing.text import (
    TableBody,
    file_text,
    number_or_nan,
    parse_cells,
    quick_numbers,
    rising,
)
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message
from myomorph.core.model.spatial import quaternion_from_rotation

HINT = (
    "expected an export of MT Manager or of Movella DOT: columns such as PacketCounter, Quat_q0 or"
    " Mat[1][1], Acc_X"
)
PACKET_COUNTS = 1 << 16  # A counter of packets begins again at this number.
CLOCK_COUNTS = 2.0**32  # So does a clock of samples.
QUATERNIONS = (
    ("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"),
    ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z"),
)
MATRIX = tuple(f"Mat[{row}][{column}]" for row in (1, 2, 3) for column in (1, 2, 3))
# Beginning of the line of column names.
COLUMNS = re.compile(r'"?(PacketCounter|SampleTimeFine)\b')
HEAD_LINES = 60
VECTORS = {"accelerations": "Acc", "angular_velocities": "Gyr", "magnetic_fields": "Mag"}
"""Columns of MT Manager and DOT: beginning of their names, before the axis."""
SENSOR_TAGS = {
    "angular_velocities": "sensorAngularVelocity",
    "magnetic_fields": "sensorMagneticField",
    "accelerations": "sensorAcceleration",
}
"""Elements of MVNX."""
RATE = re.compile(r"Update\s*Rate:?[,\s]*(\d+\.?\d*)")
TAG = re.compile(r"DeviceTag:?[,\s]*(\S+)")


def read_mvnx(path: Path) -> InertialSensors:
    """Read the sensors of an MVNX file; where it has only segments, those.

    Frames of calibration poses are left out: their orientations are those of an avatar.

    Source: Movella, MVN User Manual, MVNX.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    orientations (frames, sensors, 4) as w, x, y, z, and signals (frames, sensors, 3) in the file's
    units

    Raises
    ------
    BadFile : it is no such file, or has no frame with orientations
    """
    subject = _first(read_xml(path).root, "subject")
    if subject is None:
        raise BadFile(path, "holds no subject", "expected an MVNX file of MVN Analyze")
    frames = [frame for frame in _all(subject, "frame") if frame.get("type", "normal") == "normal"]
    if not frames:
        raise _without_orientations(path)
    of_sensors = _first(frames[0], "sensorOrientation") is not None
    kind, tag = ("sensor", "sensorOrientation") if of_sensors else ("segment", "orientation")
    names = tuple(item.get("label", "") for item in _all(subject, kind))
    if not names or _first(frames[0], tag) is None:
        raise _without_orientations(path)
    time = _times(frames, number_or_nan(subject.get("frameRate") or ""), path)
    signals = {"orientations": _vectors(frames, tag, len(names), 4, path)}
    notes: tuple[Message, ...] = (
        READING.message("has no sensors: the orientations are those of MVN's segments"),
    )
    if of_sensors:
        notes = ()
        for signal, signal_tag in SENSOR_TAGS.items():
            if _first(frames[0], signal_tag) is not None:
                signals[signal] = _vectors(frames, signal_tag, len(names), 3, path)
    return sensors_of_signals(time, names, signals, warnings=notes, source=str(path))


def _without_orientations(path: Path) -> BadFile:
    """Make the error of a file without orientations."""
    return BadFile(
        path, "has no frame with orientations", "export sensorOrientation or orientation"
    )


def _times(frames: Sequence[etree._Element], rate: float, path: Path) -> Array:
    """Read the times of frames: their own, or by their indices where they state none.

    Parameters
    ----------
    frames : elements
    rate : frames per second [Hz], NaN where the file states none
    path : of the file, for messages

    Returns
    -------
    (frames,) [s]

    Raises
    ------
    BadFile : a time is no number, or they do not rise
    """
    own = np.array([number_or_nan(frame.get("time") or "") for frame in frames])
    stated = np.array([bool(frame.get("time")) for frame in frames])
    index = np.arange(len(frames), dtype=np.float64)
    by_rate = index / rate if rate > 0.0 else np.full(len(frames), np.nan)
    time = np.where(stated, 1e-3 * own, by_rate)
    if not rising(time).all():
        frame = int(np.flatnonzero(~rising(time))[0])
        problem = f"frame {frame} has no time that is later than those before"
        raise BadFile(path, problem, "export the recording again, with its frame rate")
    return time


def _all(element: etree._Element, tag: str) -> list[etree._Element]:
    """List the elements of a name, in any name space."""
    return [child for child in element.iter() if etree.QName(child).localname == tag]


def _first(element: etree._Element, tag: str) -> etree._Element | None:
    """Find the first element of a name in any name space, None without."""
    return next((child for child in element.iter() if etree.QName(child).localname == tag), None)


def _vectors(frames: list[etree._Element], tag: str, count: int, width: int, path: Path) -> Array:
    """Read a signal of all sensors.

    Parameters
    ----------
    frames : elements
    tag : of the signal in a frame
    count : of sensors
    width : numbers per sensor
    path : of the file, for messages

    Returns
    -------
    (frames, count, width), NaN where a frame lacks the signal

    Raises
    ------
    BadFile : a frame has another count of numbers, or a text
    """
    if len(frames) * count * width > MAX_NUMBERS:
        raise BadFile(path, f"has {len(frames)} frames of {count} sensors, too many to read")
    rows = np.full((len(frames), count, width), np.nan)
    for index, frame in enumerate(frames):
        element = _first(frame, tag)
        text = "" if element is None else element.text or ""
        try:
            numbers = np.array(text.split(), dtype=np.float64)
        except ValueError:
            raise BadFile(path, f"frame {index}: {tag} holds what is no number") from None
        if not len(numbers):
            continue
        if len(numbers) != count * width:
            raise BadFile(
                path,
                f"frame {index}: {len(numbers)} numbers in {tag}, where {count * width} are"
                " expected",
            )
        rows[index] = numbers.reshape(count, width)
    return rows


def read_xsens_text(path: Path) -> InertialSensors:
    """Read one sensor of an MT Manager export, named by the last part of the file's name.

    Parameters
    ----------
    path : of the file; its gyroscopes are in rad/s

    Returns
    -------
    signals (frames, 1, 3 or 4)

    Raises
    ------
    BadFile : it is no such file, or has no signal or no time
    """
    return _sensor(path, 1.0)


def read_dot(path: Path) -> InertialSensors:
    """Read one sensor of a Movella DOT export, named by its tag or its file.

    Parameters
    ----------
    path : of the file; its gyroscopes are in deg/s

    Returns
    -------
    signals (frames, 1, 3 or 4), angular velocities [rad/s]

    Raises
    ------
    BadFile : it is no such file, or has no signal or no time
    """
    return _sensor(path, np.pi / 180.0)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _SensorTable:
    """Columns of one sensor.

    Attributes
    ----------
    head : text above the line of names
    names : one per column
    values : (rows, columns), NaN where a cell is blank
    notes : what looked wrong in the rows
    """

    head: str
    names: tuple[str, ...]
    values: Array
    notes: tuple[Message, ...]

    @property
    def column_index(self) -> Mapping[str, int]:
        """Index by name; of columns with one name the last."""
        return {name: index for index, name in enumerate(self.names)}

    def has(self, *names: str) -> bool:
        """Return whether all these columns are there."""
        return set(names) <= set(self.names)

    def columns(self, names: Sequence[str]) -> Array:
        """Return the values of columns (rows, names)."""
        index = self.column_index
        return self.values[:, [index[name] for name in names]]

    def column(self, name: str) -> Array:
        """Return the values of one column (rows,)."""
        return self.values[:, self.column_index[name]]


def _sensor(path: Path, rate_unit: float) -> InertialSensors:
    """Read the columns of one sensor.

    Parameters
    ----------
    path : of the file
    rate_unit : unit of its gyroscopes [rad/s]
    """
    table = _sensor_table(path)
    signals: dict[str, Any] = {}
    orientations = _orientations(table)
    if orientations is not None:
        signals["orientations"] = orientations
    for kind, prefix in VECTORS.items():
        axes = tuple(f"{prefix}_{axis}" for axis in "XYZ")
        if table.has(*axes):
            unit = rate_unit if kind == "angular_velocities" else 1.0
            signals[kind] = unit * table.columns(axes)[:, None]
    if not signals:
        names = ", ".join(list(table.column_index)[:12])
        raise BadFile(
            path, f"has no orientation and no acceleration; its columns are {names}", HINT
        )
    tag = TAG.search(table.head)
    name = tag.group(1).strip(",;") if tag else path.stem.split("_")[-1]
    time = _clock(table, path)
    return sensors_of_signals(time, (name,), signals, warnings=table.notes, source=str(path))


def _sensor_table(path: Path) -> _SensorTable:
    """Read the numbers below the line of column names.

    Raises
    ------
    BadFile : it has no such line, or a row is not as long
    """
    lines = file_text(path, HINT).splitlines()
    start = next(
        (index for index, line in enumerate(lines[:HEAD_LINES]) if COLUMNS.match(line)), None
    )
    if start is None:
        raise BadFile(path, "has no line of column names that begins with PacketCounter", HINT)
    delimiter = next(mark for mark in "\t;," if mark in lines[start] or mark == ",")
    names = [cell.strip().strip('"') for cell in _without_end(lines[start]).split(delimiter)]
    text = "\n".join(_without_end(line) for line in lines[start + 1 :])
    notes = list[Message]()
    values = quick_numbers(text, delimiter, len(names))
    if values is None:
        body = TableBody(text=text, delimiter=delimiter, path=path, hint=HINT)
        values = parse_cells(body, len(names), notes)
    return _SensorTable(
        head="\n".join(lines[:start]),
        names=tuple(names),
        values=values,
        notes=tuple(notes),
    )


def _without_end(line: str) -> str:
    """Cut delimiters and blanks off the end of a line."""
    return line.rstrip(" \t,;")


def _orientations(table: _SensorTable) -> Array | None:
    """Find the orientations (rows, 1, 4), of quaternions or else of matrices; None without."""
    found = [columns for columns in QUATERNIONS if table.has(*columns)]
    if found:
        return table.columns(found[-1])[:, None]
    if table.has(*MATRIX):
        return quaternion_from_rotation(table.columns(MATRIX).reshape(-1, 1, 3, 3))
    return None


def _clock(table: _SensorTable, path: Path) -> Array:
    """Find the times of the rows, by the counter of packets or else by the clock of samples.

    Parameters
    ----------
    table : whose head may state the rate
    path : of the file, for messages

    Returns
    -------
    (rows,) [s]

    Raises
    ------
    BadFile : neither a rate with a counter nor a clock of samples is there
    """
    rate = RATE.search(table.head)
    if rate and float(rate.group(1)) > 0.0 and table.has("PacketCounter"):
        packets = _unwrapped(table.column("PacketCounter"), PACKET_COUNTS)
        return np.asarray(packets / float(rate.group(1)))
    if not table.has("SampleTimeFine") or not np.isfinite(table.column("SampleTimeFine")).all():
        raise BadFile(
            path, "has no time: neither 'Update Rate' in its head nor a column SampleTimeFine", HINT
        )
    ticks = _unwrapped(table.column("SampleTimeFine"), CLOCK_COUNTS)
    # MT Manager counts in 0.1 ms, DOT in microseconds: no sensor gives more than 2000 samples a
    # second.
    step = float(np.median(np.diff(ticks))) if len(ticks) > 1 else 1e4
    return np.asarray(ticks * (1e-6 if step >= 500.0 else 1e-4))


def _unwrapped(counter: Array, counts: float) -> Array:
    """Continue a counter (rows,) that begins again at 0 after so many counts."""
    restarts = (np.diff(counter) < -counts / 2).cumsum()
    return counter + counts * np.concatenate([[0], restarts])
