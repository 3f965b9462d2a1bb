"""Xsens and Movella: MVNX of MVN Analyze, text files of MT Manager, CSV files of DOT."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.parsing.text import file_text, parse_cells, quick_numbers
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.spatial import quaternion_from_rotation

HINT = (
    "expected an export of MT Manager or of Movella DOT: columns such as PacketCounter, Quat_q0 or"
    " Mat[1][1], Acc_X"
)
COUNTER = 1 << 16  # A counter of packets begins again at this number.
QUATERNIONS = (
    ("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"),
    ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z"),
)
MATRIX = tuple(f"Mat[{row}][{column}]" for row in (1, 2, 3) for column in (1, 2, 3))
# Beginning of the line of column names.
COLUMNS = re.compile(r'"?(PacketCounter|SampleTimeFine)\b')
HEAD_LINES = 60
VECTORS = {"accelerations": "Acc", "angular_velocities": "Gyr", "magnetic_fields": "Mag"}


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
    root = read_xml(path).root
    subject = _first(root, "subject")
    if subject is None:
        raise BadFile(path, "holds no subject", "expected an MVNX file of MVN Analyze")
    frames = [frame for frame in _all(subject, "frame") if frame.get("type", "normal") == "normal"]
    kind = "sensor"
    tag = "sensorOrientation"
    if frames and _first(frames[0], tag) is None:
        kind = "segment"
        tag = "orientation"
    names = tuple(item.get("label", "") for item in _all(subject, kind))
    if not frames or not names or _first(frames[0], tag) is None:
        raise BadFile(
            path, "has no frame with orientations", "export sensorOrientation or orientation"
        )
    rate = float(subject.get("frameRate") or "nan")
    clock = [frame.get("time") for frame in frames]
    time = np.array(
        [
            float(milliseconds) * 1e-3 if milliseconds else i / rate
            for i, milliseconds in enumerate(clock)
        ]
    )
    signals: dict[str, Any] = {"orientations": _vectors(frames, tag, len(names), 4, path)}
    if kind == "sensor":
        fields = {
            "angular_velocities": "sensorAngularVelocity",
            "magnetic_fields": "sensorMagneticField",
        }
        for name, part in {**fields, "accelerations": "sensorAcceleration"}.items():
            if _first(frames[0], part) is not None:
                signals[name] = _vectors(frames, part, len(names), 3, path)
    notes = (
        ()
        if kind == "sensor"
        else ("has no sensors: the orientations are those of MVN's segments",)
    )
    return sensors_of_signals(time, names, signals, warnings=notes, source=str(path))


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
    rows = np.full((len(frames), count, width), np.nan)
    for index, frame in enumerate(frames):
        element = _first(frame, tag)
        try:
            numbers = (
                np.array((element.text or "").split(), dtype=np.float64)
                if element is not None
                else np.empty(0)
            )
        except ValueError:
            raise BadFile(path, f"frame {index}: {tag} holds what is no number") from None
        if len(numbers) == count * width:
            rows[index] = numbers.reshape(count, width)
        elif len(numbers):
            raise BadFile(
                path,
                f"frame {index}: {len(numbers)} numbers in {tag}, where {count * width} are"
                " expected",
            )
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
    return _table(path, 1.0)


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
    return _table(path, np.pi / 180.0)


def _table(path: Path, rate_unit: float) -> InertialSensors:
    """Read the columns of one sensor.

    Parameters
    ----------
    path : of the file
    rate_unit : unit of its gyroscopes [rad/s]
    """
    text = file_text(path, HINT)
    lines = text.splitlines()
    start = next(
        (index for index, line in enumerate(lines[:HEAD_LINES]) if COLUMNS.match(line)), None
    )
    if start is None:
        raise BadFile(path, "has no line of column names that begins with PacketCounter", HINT)
    mark = next(delimiter for delimiter in "\t;," if delimiter in lines[start] or delimiter == ",")
    labels = [cell.strip().strip('"') for cell in lines[start].rstrip(" \t,;").split(mark)]
    body = "\n".join(line.rstrip(" \t,;") for line in lines[start + 1 :])
    notes = list[str]()
    values = quick_numbers(body, mark, len(labels))
    if values is None:
        values = parse_cells(body, len(labels), mark, notes, path, HINT)
    where = {label: index for index, label in enumerate(labels)}
    head = "\n".join(lines[:start])
    signals: dict[str, Any] = {}
    for columns in QUATERNIONS:
        if all(name in where for name in columns):
            signals["orientations"] = values[:, [where[name] for name in columns]][:, None]
    if not signals and all(name in where for name in MATRIX):
        matrices = values[:, [where[name] for name in MATRIX]].reshape(-1, 1, 3, 3)
        signals["orientations"] = quaternion_from_rotation(matrices)
    for kind, prefix in VECTORS.items():
        axes = tuple(f"{prefix}_{axis}" for axis in "XYZ")
        if all(name in where for name in axes):
            scale = rate_unit if kind == "angular_velocities" else 1.0
            signals[kind] = scale * values[:, [where[name] for name in axes]][:, None]
    if not signals:
        raise BadFile(
            path,
            f"has no orientation and no acceleration; its columns are {', '.join(labels[:12])}",
            HINT,
        )
    tag = re.search(r"DeviceTag:?[,\s]*(\S+)", head)
    name = tag.group(1).strip(",;") if tag else path.stem.split("_")[-1]
    return sensors_of_signals(
        _clock(values, where, head, path),
        (name,),
        signals,
        warnings=tuple(notes),
        source=str(path),
    )


def _clock(values: Array, where: dict[str, int], head: str, path: Path) -> Array:
    """Find the times of the rows, by the counter of packets or else by the clock of samples.

    Parameters
    ----------
    values : (rows, columns)
    where : index by name of column
    head : text above the columns, which may state the rate
    path : of the file, for messages

    Returns
    -------
    (rows,) [s]

    Raises
    ------
    BadFile : neither a rate with a counter nor a clock of samples is there
    """
    rate = re.search(r"Update\s*Rate:?[,\s]*([\d.]+)", head)
    if rate and "PacketCounter" in where:
        counter = values[:, where["PacketCounter"]]
        counter = counter + COUNTER * np.concatenate(
            [[0], (np.diff(counter) < -COUNTER / 2).cumsum()]
        )
        return np.asarray(counter / float(rate.group(1)))
    if "SampleTimeFine" not in where or not np.isfinite(values[:, where["SampleTimeFine"]]).all():
        raise BadFile(
            path, "has no time: neither 'Update Rate' in its head nor a column SampleTimeFine", HINT
        )
    ticks = values[:, where["SampleTimeFine"]]
    ticks = ticks + 2.0**32 * np.concatenate([[0], (np.diff(ticks) < -(2.0**31)).cumsum()])
    # MT Manager counts in 0.1 ms, DOT in microseconds: no sensor gives more than 2000 samples a
    # second.
    step = float(np.median(np.diff(ticks))) if len(ticks) > 1 else 1e4
    return np.asarray(ticks * (1e-6 if step >= 500.0 else 1e-4))
