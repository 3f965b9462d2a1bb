"""STO and MOT files: OpenSim's tables, and SIMM's older header, as `Table` and `Motion`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.angle_units import unit_of_angles
from myomorph.core.io.parsing.text import (
    TableBody,
    file_text,
    find_delimiter,
    line_from,
    parse_cells,
    quick_numbers,
    rising,
    split_cells,
    unique_names,
    whole_number,
    written,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadData, BadFile, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Table

HINT = (
    "give a table that OpenSim writes (.sto or .mot): a header, a line 'endheader', column names,"
    " numbers"
)
HEADER_LINES = 300
END_HEADER = re.compile(r'^[ \t"]*endheader[ \t",]*\r?$', re.IGNORECASE | re.MULTILINE)
TIME_LINE = re.compile(r'^[ \t"]*time\b.*$', re.IGNORECASE | re.MULTILINE)
SIMM_LINE = re.compile(r"(name|datacolumns|datarows|otherdata|range)\s+(.*)", re.IGNORECASE)
DEGREES_LINE = "angles are in degrees."
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
    notes: list[Message] = []
    header = _header(text, path, notes)
    names_line, start = line_from(text, header.end)
    delimiter = find_delimiter(names_line)
    body = TableBody(text=text[start:], delimiter=delimiter, path=path, hint=HINT)
    # Files may be large: only the rows are held on to.
    del text
    labels = [cell.strip().strip('"') for cell in split_cells(names_line, delimiter)]
    if not any(labels):
        raise BadFile(path, "there is no line of column names after 'endheader'", HINT)
    numbers = _numbers(body, labels, header.facts.get("DataType", "double").lower(), notes)
    time, values = _rows(numbers, notes, path)
    _check_counts(header.facts, values.shape, notes)
    return Table(
        time,
        unique_names(numbers.names[1:], "column", notes),
        values,
        in_degrees=header.in_degrees,
        facts=FrozenMap(header.facts),
        warnings=tuple(notes),
        source=str(path),
    )


@dataclass(frozen=True, kw_only=True)
class _Header:
    """Header of a table.

    Attributes
    ----------
    facts : values by key
    in_degrees : whether angles are in degrees
    end : index of the first character behind it
    """

    facts: dict[str, str]
    in_degrees: bool
    end: int


def _header(text: str, path: Path, notes: list[Message]) -> _Header:
    """Read the header of a table.

    Parameters
    ----------
    text : of the whole file
    path : of the file, for messages
    notes : gets a warning where no line ends the header

    Raises
    ------
    BadFile : there is neither a line 'endheader' nor a line that begins with 'time'
    """
    match = END_HEADER.search(text[: 1 << 20])
    if match is not None:
        header = text[: match.start()]
        end = match.end()
    else:
        match = TIME_LINE.search(text[: 1 << 16])
        if match is None:
            raise BadFile(path, "has neither a line 'endheader' nor a column 'time'", HINT)
        end = match.start()
        header = text[:end]
        notes.append(
            READING.message(
                "the header has no line 'endheader': the line that begins with 'time' was taken"
                " for the columns"
            )
        )
    lines = [line.strip(' \t",\r') for line in header.splitlines()[:HEADER_LINES]]
    facts = _facts(lines)
    in_degrees = _in_degrees(lines)
    if in_degrees is None:
        # OpenSim takes an old motion, without a version, as SIMM's own format: in degrees.
        in_degrees = path.suffix.lower() == ".mot" and "version" not in facts
    return _Header(facts=facts, in_degrees=in_degrees, end=end)


def _facts(lines: Sequence[str]) -> dict[str, str]:
    """Read the values of a header by key, of OpenSim's form or SIMM's."""
    facts: dict[str, str] = {}
    for index, line in enumerate(lines):
        simm = SIMM_LINE.match(line)
        if "=" in line:
            key, _, value = line.partition("=")
            facts[_key(key)] = value.strip()
        elif simm is not None:
            facts[simm.group(1).lower()] = simm.group(2).strip()
        elif index == 0 and line and line.lower() != DEGREES_LINE:
            facts["name"] = line
    return facts


def _key(text: str) -> str:
    """Return a key as OpenSim spells it."""
    text = text.strip()
    for key in KEYS:
        if key.lower() == text.lower():
            return key
    return text


def _in_degrees(lines: Sequence[str]) -> bool | None:
    """Return whether a header states that angles are in degrees; None where it does not say."""
    stated: bool | None = None
    for line in lines:
        if "=" in line:
            key, _, value = line.partition("=")
            if _key(key) == "inDegrees":
                stated = value.strip().lower() in ("yes", "y", "true", "1")
        elif line.lower() == DEGREES_LINE and stated is None:
            stated = True
    return stated


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Numbers:
    """Rows of a table.

    Attributes
    ----------
    names : one per column
    values : (rows, columns) with the time first [s], NaN where a cell is blank
    """

    names: list[str]
    values: Array


def _numbers(body: TableBody, labels: list[str], kind: str, notes: list[Message]) -> _Numbers:
    """Read the rows of numbers below the line of column names.

    Parameters
    ----------
    body : text below the line of names
    labels : one per column, that of the time included; there may be blank ones at the end
    kind : data type in small letters; each cell of "vec3", "quaternion", ... becomes several
        columns
    notes : gets a warning for what was left out

    Raises
    ------
    BadFile : the first row has another number of cells than there are names, or no row is of
        numbers
    """
    while len(labels) > 1 and not labels[-1]:
        labels = labels[:-1]
    first = line_from(body.text, 0)[0].rstrip()
    width = SUFFIXES.get(kind, 0)
    if width and "," in first and body.delimiter != ",":
        time, *columns = labels
        labels = [time, *(f"{name}_{part + 1}" for name in columns for part in range(width))]
        body = replace(body, text=body.text.replace(",", "\t"), delimiter="\t")
        first = first.replace(",", "\t")
    quick = _quickly(body, [label for label in labels if label])
    if quick is not None:
        return quick
    body, labels = _fitted(body, labels, first, notes)
    names = [label or f"unnamed_{column}" for column, label in enumerate(labels)]
    return _Numbers(names=names, values=parse_cells(body, len(names), notes))


def _quickly(body: TableBody, named: list[str]) -> _Numbers | None:
    """Read a table at once; None where cells are blank or odd.

    Where tabs and blanks are mixed, every word is a cell, as OpenSim's `Storage` has it.

    Parameters
    ----------
    body : text below the line of names
    named : names of the columns
    """
    values = quick_numbers(body.text, body.delimiter, len(named))
    if values is not None:
        return _Numbers(names=named, values=values)
    words = " ".join(named).split()
    values = quick_numbers(body.text, None, len(words)) if len(words) > len(named) else None
    return None if values is None else _Numbers(names=words, values=values)


def _fitted(
    body: TableBody, labels: list[str], first: str, notes: list[Message]
) -> tuple[TableBody, list[str]]:
    """Make names and cells fit each other, where one line has more delimiters than the other.

    Parameters
    ----------
    body : of the table
    labels : one per column, "" where there is none
    first : row of the table
    notes : gets a warning where columns are left out

    Returns
    -------
    the body with the delimiter that fits, and the labels with or without the blank ones

    Raises
    ------
    BadFile : the row has fewer cells, or many more
    """
    named = [label for label in labels if label]
    cells = split_cells(first, body.delimiter)
    while len(cells) > len(labels) and not cells[-1].strip():
        cells.pop()
    if len(cells) == len(named) < len(labels):
        return body, named
    if len(cells) == len(labels) or not first.strip():
        return body, labels
    if len(first.split()) == len(named):
        return replace(body, delimiter=None), named
    extra = len(cells) - len(labels)
    if not 0 < extra < 3:
        raise BadFile(
            body.path,
            f"has {len(labels)} column names, but {len(cells)} numbers in its first row",
            HINT,
        )
    notes.append(READING.message(f"{extra} columns without a name were left out"))
    return body, labels


def _rows(numbers: _Numbers, notes: list[Message], path: Path) -> tuple[Array, Array]:
    """Take the time off a table and leave out rows whose time does not increase.

    Parameters
    ----------
    numbers : names and values
    notes : gets a warning for what was left out or made NaN
    path : of the file, for messages

    Returns
    -------
    time (kept rows,) [s] and values (kept rows, columns - 1), with NaN for infinite ones

    Raises
    ------
    BadFile : there is no row, or none with a time that is a number
    """
    time_name, *names = numbers.names
    if time_name.lower() not in ("time", "t", "times"):
        notes.append(READING.message(f"the first column '{time_name}' was taken for the time"))
    if not len(numbers.values):
        raise BadFile(
            path,
            "has column names, but no row of numbers",
            "the recording may have stopped before it began",
        )
    keep = rising(numbers.values[:, 0])
    if not keep.any():
        raise BadFile(path, "its first column holds no time that is a number", HINT)
    left_out = np.count_nonzero(~keep)
    if left_out:
        notes.append(
            READING.message(f"{left_out} rows were left out because their time does not increase")
        )
    table = numbers.values[keep]
    values = table[:, 1:]
    infinite = np.isinf(values)
    if infinite.any():
        worst = names[int(np.argmax(infinite.sum(axis=0)))]
        notes.append(
            READING.message(
                f"{np.count_nonzero(infinite)} infinite values were made NaN (most in '{worst}')"
            )
        )
        values = np.where(infinite, np.nan, values)
    return table[:, 0], values


def _check_counts(facts: Mapping[str, str], shape: tuple[int, ...], notes: list[Message]) -> None:
    """Warn where the header states other numbers of rows or columns than the file has.

    Parameters
    ----------
    facts : values of the header by key
    shape : (rows, columns) of the values, without the time
    notes : gets the warnings
    """
    rows, columns = shape
    counts = {
        ("nRows", "datarows"): (rows, "rows"),
        ("nColumns", "datacolumns"): (columns + 1, "columns"),
    }
    for keys, (count, what) in counts.items():
        for key in keys:
            words = facts.get(key, "").split()
            stated = whole_number(words[0]) if words else None
            if stated is not None and stated != count:
                notes.append(
                    READING.message(f"the header says {stated} {what}, the file has {count}")
                )
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
    in_degrees = "yes" if table.in_degrees else "no"
    header = (
        f"{title}\nversion=1\nnRows={rows}\nnColumns={columns + 1}\nDataType=double\n"
        f"inDegrees={in_degrees}\nendheader\n" + "\t".join(("time", *table.names)) + "\n"
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
    for rotational coordinates only, as OpenSim does. Where the head of a file does not state the
    unit and the ranges of the coordinates do, it follows from these (`angle_units`).

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
    in_degrees = unit_of_angles(table, model, columns).in_degrees
    factors = np.array([_factor(model, name, in_degrees) for name in names])
    values = table.values[:, [columns[name] for name in names]] * factors
    return Motion(table.time, tuple(names), values, motion_kinds=model.motion_kinds)


def motion_notes(table: Table, model: Model) -> tuple[Message, ...]:
    """List what was assumed of a table of angles when it became a motion.

    Parameters
    ----------
    table, model : as of `motion_from_table`
    """
    return unit_of_angles(table, model, coordinate_columns(table.names, model)).notes


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
    coordinates = set(model.coordinate_names)
    owned = {joint.name: joint.coordinates for joint in model.joints}
    columns: dict[str, int] = {}
    for column, name in enumerate(names):
        *owners, last = name.split("/")
        if owners and last != "value":
            continue
        coordinate = owners[-1] if owners else name
        own = owned.get(owners[-2], ()) if len(owners) > 1 else ()
        if own and coordinate not in own:
            # Of two coordinates of one name the later one has a number.
            numbered = re.compile(re.escape(coordinate) + r"_\d+")
            coordinate = next(filter(numbered.fullmatch, own), coordinate)
        if coordinate in coordinates:
            columns.setdefault(coordinate, column)
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
