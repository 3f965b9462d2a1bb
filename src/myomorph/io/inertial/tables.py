"""Tables of inertial sensors: OpenSim's orientations, and CSV files of Movella DOT and Delsys."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from myomorph.io.inertial.channels import sensors_of_channels
from myomorph.io.inertial.xsens import COLUMNS, HEAD_LINES, read_dot
from myomorph.io.parsing.text import file_text, number
from myomorph.io.sto import read_sto
from myomorph.model.arrays import Array
from myomorph.model.errors import BadFile
from myomorph.model.inertial_sensors import InertialSensors

HINT = "expected a CSV export of Movella DOT, or of Delsys with a column of times before the channels"
TIME = re.compile(r"^(x\s*\[s\]|x\s*\(s\)|time.*)$", re.IGNORECASE)
UNIT = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")


def read_orientations(path: Path) -> InertialSensors:
    """Orientations as OpenSim writes them: a column of quaternions w, x, y, z for each sensor. Source: OpenSim,
    OpenSense: kinematics with IMU data.
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
    """A CSV file of Movella DOT (one sensor) or of Delsys (several, each channel with its own clock)."""
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
    """Channels brought to the clock of the fastest inertial channel."""
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
    clock, names, units, parts = -1, list[str](), list[str](), list[tuple[Array, Array]]()
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
    inertial = [i for i, name in enumerate(names) if sensors_like(name) and len(parts[i][0]) > 1]
    if not inertial:
        raise BadFile(path, "has no channels of accelerometers and gyroscopes", HINT)
    time = max((parts[i][0] for i in inertial), key=len)
    table = np.column_stack([np.interp(time, *parts[i], np.nan, np.nan) for i in inertial])
    sensors = sensors_of_channels(time, [names[i] for i in inertial], table, [units[i] for i in inertial])
    if sensors is None:
        raise BadFile(path, "has no sensor with all axes of an accelerometer and a gyroscope", HINT)
    return InertialSensors(sensors.time, sensors.names, **sensors.signals, warnings=sensors.warnings, source=str(path))


def sensors_like(name: str) -> bool:
    """Whether a channel's name is one of an inertial sensor."""
    return re.search(r"(acc|gyr|mag|quat|orientation)", name, re.IGNORECASE) is not None
