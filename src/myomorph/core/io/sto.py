"""STO and MOT files: OpenSim's tables, and SIMM's older header, as `Table` and `Motion`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import (
    file_text,
    line_from,
    parse_cells,
    quick_numbers,
    rising,
    split_cells,
    unique_names,
    written,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Table

HINT = (
    "give a table that OpenSim writes (.sto or .mot): a header, a line 'endheader', column names,"
    " numbers"
)
HEADER_LINES = 300
KEYS = ("nRows", "nColumns", "inDegrees", "DataType", "version", "DataRate", "OpenSimVersion")
SUFFIXES = {"vec3": 3, "quaternion": 4, "spatialvec": 6, "vec6": 6}


def read_sto(path: str | os.PathLike[str]) -> Table:
    """Read an STO or MOT file as a table in the file's own units.

    Knows OpenSim's header (`nRows`, `nColumns`, `inDegrees`, `DataType`) and SIMM's (`datacolumns`,
    `datarows`), tabs, spaces or commas between cells, blank cells (NaN), names that occur twice,
    and row counts that do not hold. What had to be repaired is in `Table.warnings`.

    Source: Seth et al. 2018, OpenSim's storage files.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    columns (rows, columns) in the file's own units

    Raises
    ------
    BadFile : it is not such a table, or has no row of numbers

    Examples
    --------
    >>> import myomorph as mm
    >>> table = mm.read_sto("reach.mot")
    >>> table.names, len(table), table.in_degrees
    (('shoulder_flexion', 'elbow_flexion'), 61, False)
    """
    path = Path(path)
    text = file_text(path, HINT)
    facts, in_degrees, start, notes = _header(text, path)
    names_line, start = line_from(text, start)
    body = text[start:]
    del text
    delimiter: str | None
    if "\t" in names_line:
        delimiter = "\t"
    elif "," in names_line:
        delimiter = ","
    else:
        delimiter = None
    labels = [cell.strip().strip('"') for cell in split_cells(names_line, delimiter)]
    if not any(labels):
        raise BadFile(path, "there is no line of column names after 'endheader'", HINT)
    found_values, names = _numbers(
        body, labels, delimiter, facts.get("DataType", "double").lower(), notes, path
    )
    time, values = _rows(found_values, names, notes, path)
    _check_counts(facts, values.shape, notes)
    return Table(
        time,
        unique_names(names[1:], "column", notes),
        values,
        in_degrees=in_degrees,
        facts=FrozenMap(facts),
        warnings=tuple(notes),
        source=str(path),
    )


def _header(text: str, path: Path) -> tuple[dict[str, str], bool, int, list[str]]:
    """Read the header of a table.

    Parameters
    ----------
    text : of the whole file
    path : of the file, for messages

    Returns
    -------
    values of the header by key, whether angles are in degrees, the index of the first character
    behind the header, and warnings

    Raises
    ------
    BadFile : there is neither a line 'endheader' nor a line that begins with 'time'
    """
    notes: list[str] = []
    end = re.search(r'^[ \t"]*endheader[ \t",]*\r?$', text[: 1 << 20], re.IGNORECASE | re.MULTILINE)
    if end is not None:
        header = text[: end.start()]
        after = end.end()
    else:
        start = re.search(r'^[ \t"]*time\b.*$', text[: 1 << 16], re.IGNORECASE | re.MULTILINE)
        if start is None:
            raise BadFile(path, "has neither a line 'endheader' nor a column 'time'", HINT)
        header = text[: start.start()]
        after = start.start()
        notes.append(
            "the header has no line 'endheader': the line that begins with 'time' was taken for the"
            " columns"
        )
    facts: dict[str, str] = {}
    stated: bool | None = None
    for number, raw in enumerate(header.splitlines()[:HEADER_LINES]):
        line = raw.strip(' \t",\r')
        old = re.match(r"(name|datacolumns|datarows|otherdata|range)\s+(.*)", line, re.IGNORECASE)
        if "=" in line:
            key, _, value = line.partition("=")
            known = next(
                (name for name in KEYS if name.lower() == key.strip().lower()), key.strip()
            )
            facts[known] = value.strip()
            if known == "inDegrees":
                stated = value.strip().lower() in ("yes", "y", "true", "1")
        elif old is not None:
            facts[old.group(1).lower()] = old.group(2).strip()
        elif line.lower() == "angles are in degrees." and stated is None:
            stated = True
        elif number == 0 and line:
            facts["name"] = line
    # OpenSim takes an old motion, without a version, as SIMM's own format: angles in degrees.
    old_motion = path.suffix.lower() == ".mot" and "version" not in facts
    return facts, old_motion if stated is None else stated, after, notes


def _numbers(
    body: str, labels: list[str], delimiter: str | None, kind: str, notes: list[str], path: Path
) -> tuple[Array, list[str]]:
    """Read the rows of numbers below the line of column names.

    Parameters
    ----------
    body : text below the line of names
    labels : one per column, the index column included; blank ones at the end are dropped in place
    delimiter : between cells, None for white space
    kind : data type in small letters; each cell of "vec3", "quaternion", ... becomes several
        columns
    notes : gets a warning for what was left out
    path : of the file, for messages

    Returns
    -------
    values (rows, columns) with the index column, NaN where a cell is blank, and the name of every
    column

    Raises
    ------
    BadFile : the first row has another number of cells than there are names, or no row is of
        numbers
    """
    while len(labels) > 1 and not labels[-1]:
        labels.pop()
    first = line_from(body, 0)[0].rstrip()
    width = SUFFIXES.get(kind, 0)
    if width and "," in first and delimiter != ",":
        index, *columns = labels
        labels = [index] + [f"{name}_{part + 1}" for name in columns for part in range(width)]
        body = body.replace(",", "\t")
        delimiter = "\t"
    named = [label for label in labels if label]
    quick = quick_numbers(body, delimiter, len(named))
    if quick is not None:
        return quick, named
    cells = split_cells(first, delimiter)
    while len(cells) > len(labels) and not cells[-1].strip():
        cells.pop()
    if len(cells) == len(named) and len(named) < len(labels):
        labels = named
    elif len(cells) != len(labels) and first.strip():
        if len(first.split()) == len(named):
            labels = named
            delimiter = None
        elif len(cells) > len(labels) and len(cells) < len(labels) + 3:
            notes.append(f"{len(cells) - len(labels)} columns without a name were left out")
        else:
            raise BadFile(
                path,
                f"has {len(labels)} column names, but {len(cells)} numbers in its first row",
                HINT,
            )
    names = [label or f"unnamed_{column}" for column, label in enumerate(labels)]
    return parse_cells(body, len(names), delimiter, notes, path, HINT), names


def _rows(table: Array, names: Sequence[str], notes: list[str], path: Path) -> tuple[Array, Array]:
    """Take the time off a table and leave out rows whose time does not increase.

    Parameters
    ----------
    table : (rows, columns) with the time first [s]
    names : one per column
    notes : gets a warning for what was left out or made NaN
    path : of the file, for messages

    Returns
    -------
    time (kept rows,) [s] and values (kept rows, columns - 1), with NaN for infinite ones

    Raises
    ------
    BadFile : there is no row, or none with a time that is a number
    """
    if names[0].lower() not in ("time", "t", "times"):
        notes.append(f"the first column '{names[0]}' was taken for the time")
    if not len(table):
        raise BadFile(
            path,
            "has column names, but no row of numbers",
            "the recording may have stopped before it began",
        )
    keep = rising(table[:, 0])
    if not keep.any():
        raise BadFile(path, "its first column holds no time that is a number", HINT)
    if not keep.all():
        notes.append(
            f"{np.count_nonzero(~keep)} rows were left out because their time does not increase"
        )
    table = table[keep]
    values = table[:, 1:]
    if np.isinf(values).any():
        worst = names[1 + int(np.argmax(np.isinf(values).sum(axis=0)))]
        notes.append(
            f"{np.count_nonzero(np.isinf(values))} infinite values were made NaN (most in"
            f" '{worst}')"
        )
        values = np.where(np.isinf(values), np.nan, values)
    return table[:, 0], values


def _check_counts(facts: Mapping[str, str], shape: tuple[int, ...], notes: list[str]) -> None:
    """Warn where the header states other numbers of rows or columns than the file has.

    Parameters
    ----------
    facts : values of the header by key
    shape : (rows, columns) of the values, without the time
    notes : gets the warnings
    """
    for keys, have, what in (
        (("nRows", "datarows"), shape[0], "rows"),
        (("nColumns", "datacolumns"), shape[1] + 1, "columns"),
    ):
        for key in keys:
            stated = facts.get(key, "").split()
            if stated and stated[0].isdigit() and int(stated[0]) != have:
                notes.append(f"the header says {stated[0]} {what}, the file has {have}")
                break


def write_sto(table: Table, path: str | os.PathLike[str]) -> None:
    """Write a table as OpenSim's STO or MOT file (ten significant digits), whole or not at all.

    The header opens in OpenSim 3.x and 4.x: `Storage`, `TimeSeriesTable` and the tools take it.

    Source: Seth et al. 2018, OpenSim's storage files.

    Parameters
    ----------
    table : columns (rows, columns), in the units that the file is to have
    path : of the new file, replaced where it exists

    Raises
    ------
    BadFile
        where the file cannot be written

    Examples
    --------
    >>> import myomorph as mm
    >>> table = mm.Table([0.0, 0.1], ("elbow_flexion",), [[10.0], [12.0]], in_degrees=True)
    >>> mm.write_sto(table, "elbow.sto")
    >>> mm.read_sto("elbow.sto")["elbow_flexion"].tolist()
    [10.0, 12.0]
    """
    if table.values.ndim != 2:
        raise BadData(
            f"expected values (rows, columns) to write to {path}, but got {table.values.shape}"
        )
    rows, columns = table.values.shape
    title = table.facts.get("name") or Path(path).stem
    header = (
        f"{title}\nversion=1\nnRows={rows}\nnColumns={columns + 1}\nDataType=double\n"
        f"inDegrees={'yes' if table.in_degrees else 'no'}\nendheader\n"
        + "\t".join(("time", *table.names))
        + "\n"
    )
    line = "%.10g" + "\t%.10g" * columns + "\n"
    with written(path) as stream:
        stream.write(header)
        for start in range(0, rows, 512):
            block = np.column_stack(
                (table.time[start : start + 512], table.values[start : start + 512])
            )
            stream.write("".join([line % tuple(row) for row in block.tolist()]))


def motion_from_table(table: Table, model: Model) -> Motion:
    """Convert a table of angles to a motion of the coordinates of a model.

    Columns are found as `hip_flexion_r` or as a state, `/jointset/hip_r/hip_flexion_r/value`;
    speeds (`.../speed`, `hip_flexion_r_u`) and other columns are left out. Degrees become radians
    for rotational coordinates only, as OpenSim does.

    Parameters
    ----------
    table : columns (rows, columns), angles in degrees where it says so, lengths in meters
    model : its coordinates are looked for

    Returns
    -------
    values (rows, coordinates) [rad or m] of the coordinates that the table has, in the model's
    order

    Raises
    ------
    BadData : no column belongs to a coordinate of the model
    """
    columns = coordinate_columns(table.names, model)
    if not columns:
        raise BadData(
            f"{table.source or 'the table'}: no coordinate of '{model.name}' in its columns"
            f" {quoted(table.names)}; the model has {quoted(model.coordinate_names)}"
        )
    names = [name for name in model.coordinate_names if name in columns]
    factors = np.array([_factor(model, name, table.in_degrees) for name in names])
    values = table.values[:, [columns[name] for name in names]] * factors
    return Motion(table.time, tuple(names), values)


def coordinate_columns(names: Sequence[str], model: Model) -> dict[str, int]:
    """Find the column of each coordinate of a model in a table.

    Parameters
    ----------
    names : of the table's columns, as `hip_flexion_r` or `/jointset/hip_r/hip_flexion_r/value`
    model : its coordinates are looked for

    Returns
    -------
    index of the first column of each coordinate that has one, by the coordinate's name
    """
    wanted = set(model.coordinate_names)
    columns: dict[str, int] = {}
    for column, name in enumerate(names):
        parts = name.split("/")
        if len(parts) > 1 and parts[-1] != "value":
            continue
        short = parts[-2] if len(parts) > 1 else name
        if short in wanted and short not in columns:
            columns[short] = column
    return columns


def table_from_motion(motion: Motion, model: Model, degrees: bool = True) -> Table:
    """Convert a motion to a table of coordinates as OpenSim's inverse kinematics writes it.

    Parameters
    ----------
    motion : (frames, coordinates) [rad or m]
    model : says which coordinates are rotational
    degrees : whether rotational coordinates become degrees

    Returns
    -------
    columns (frames, coordinates) [deg or rad, and m]
    """
    factors = np.array([1.0 / _factor(model, name, degrees) for name in motion.names])
    facts = FrozenMap({"name": "Coordinates"})
    return Table(
        motion.time, motion.names, motion.values * factors, in_degrees=degrees, facts=facts
    )


def _factor(model: Model, name: str, degrees: bool) -> float:
    """Return what a column of the table is multiplied by to be in radians or meters."""
    return np.pi / 180.0 if degrees and model.coordinate(name).motion == "rotational" else 1.0
