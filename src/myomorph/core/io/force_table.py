"""Tables of forces as laboratories write them: any heading or none, frames for times.

What was assumed is noted.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from myomorph.core.io.channels import TIMES
from myomorph.core.io.force_columns import UNIT, UNITS, force_columns, table_wrenches
from myomorph.core.io.guessed_force_columns import guessed_names
from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import file_text, number, number_or_nan, unique_names
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import FORCE_FILES, READING
from myomorph.core.model.errors import BadData, BadFile, MyomorphError, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Table, Wrenches

HINT = (
    "name its columns in order, as --force-columns time,Fx1,Fy1,Fz1,COPx1,COPy1,COPz1 (moments as"
    " Mx1; '-' for a column to leave out)"
)
FRAMES = ("frame", "frames", "field", "sample", "row", "index", "item")
SUB_FRAMES = ("sub frame", "subframe", "sub_frame", "sub-frame")
UNITS_OF_CELLS = frozenset(
    (*UNITS, "n", "m", "s", "ms", "nm", "n.m", "n*m", "n·m", "v", "hz", "deg", "-", "")
)
PART_OF_PLATE = re.compile(
    r"[\s_:-]*(forces?|moments?|torques?|cop|center of pressure)$", re.IGNORECASE
)
FORCE_PLATE = re.compile(r"force[\s_]*(plate|platform)", re.IGNORECASE)
RATE = re.compile(r"(rate|freq|hz)", re.IGNORECASE)
NUMBER = re.compile(r"\d+(?:\.\d+)?")
IN_MS = re.compile(r"[^a-z]ms([^a-z]|$)")
DELIMITERS = "\t;,"
MIN_WIDTH = 4  # Columns of the smallest table of a force: three of force and a moment.
MIN_NAMED_SHARE = 0.6  # Of the columns, in a line of names.
MAX_METERS = 20.0  # From a center of pressure to the origin, and of a moment's lever.
MIN_LOAD = 20.0  # Force from which on a point is one [N].


@dataclass(frozen=True, kw_only=True)
class ForceLayout:
    """Layout of a table of forces, where the user states it.

    Attributes
    ----------
    names : of its columns in order, as `time`, `Fx1`, `COPx1`; "-" for one to leave out; () to take
        its heading's
    rate : of its rows, where it has no times [Hz]; 0 to take its heading's
    origins : points that the moments of forces without a center of pressure are about, in the
        table's order and along its axes [m]; () for the origin
    """

    names: tuple[str, ...] = ()
    rate: float = 0.0
    origins: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if self.rate < 0.0 or not np.isfinite(self.rate):
            raise BadData(f"rate of the table of forces {self.rate:g} Hz: expected more than 0")


def force_layout(names: str = "", rate: float = 0.0, origins: str = "") -> ForceLayout:
    """Read a layout from texts, as the command line has them.

    Parameters
    ----------
    names : of the columns, between commas; "-" for one to leave out, "" to take the table's heading
    rate : of the rows [Hz], 0 to take the heading's
    origins : points of moments as "x,y,z; x,y,z" [m], "" for the origin

    Returns
    -------
    the layout

    Raises
    ------
    BadData : an origin is not of three numbers, or the rate is negative or not finite
    """
    columns = [name.strip() for name in names.split(",")] if names.strip() else []
    points = [_point(text) for text in origins.split(";")] if origins.strip() else []
    return ForceLayout(names=tuple(columns), rate=rate, origins=tuple(points))


def _point(text: str) -> tuple[float, float, float]:
    """Read a point from a text "x,y,z"; `BadData` for another."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise BadData(
            f"origin of moments '{text.strip()}': expected x,y,z in metres, forces between ';'"
        ) from None
    return x, y, z


def read_forces(
    path: Path, bodies: Mapping[str, str] | None = None, layout: ForceLayout | None = None
) -> Wrenches:
    """Read the forces of a table in its own axes.

    A table with the usual heading is read as it stands; of any other, notes say what was taken for
    what.

    Parameters
    ----------
    path : of the table
    bodies : body of each force by what names of its columns begin with; None takes all forces,
        whose bodies then are not known ("")
    layout : what the table does not state itself

    Returns
    -------
    forces [N], points [m] and torques [N m] (frames, forces, 3)

    Raises
    ------
    BadFile : it is no table of numbers, or has no times and no rate
    BadData : it has no forces, or another number of origins than forces without a center of
        pressure
    UnknownName : none or several forces begin with a name in `bodies`
    """
    layout = layout or ForceLayout()
    states_heading = layout.names or layout.rate
    usual = None if states_heading else _usual(path)
    table = usual or laboratory_table(path, layout)
    try:
        wrenches = table_wrenches(table, bodies)
    except BadData as error:
        if bodies:
            raise
        raise BadData(f"{error}; or {HINT}") from None
    if usual is None:
        notes = (*table.warnings, *wrenches.notes)
        wrenches = _in_meters(replace(wrenches, notes=notes), table)
    if layout.origins:
        wrenches = _about_origins(wrenches, layout.origins)
    return wrenches


def holds_forces(path: Path) -> bool:
    """Return whether a table has columns of forces, by its heading or by its numbers.

    Parameters
    ----------
    path : of the table; False where it cannot be read
    """
    try:
        return bool(read_forces(path).names)
    except (MyomorphError, OSError):
        return False


def _usual(path: Path) -> Table | None:
    """Read a table with OpenSim's heading, or with a line of names that begins with the time.

    Parameters
    ----------
    path : of the table

    Returns
    -------
    the table; None where it has another heading or no forces
    """
    try:
        table = read_sto(path)
    except BadFile:
        return None
    return table if force_columns(table.names) else None


def laboratory_table(path: Path, layout: ForceLayout | None = None) -> Table:
    """Read a table with any heading or none, between tabs, commas, semicolons or blanks.

    Knows names under names of plates and over units, frames and sub frames for times with the rate
    in the heading, decimal commas, and a second section below the first, which is passed over.
    Without a heading the columns are found by their numbers where only one reading is possible.

    Parameters
    ----------
    path : of the table
    layout : what the table does not state itself

    Returns
    -------
    columns (rows, columns) in the table's own units, without times and frames; `warnings` say what
    was taken for what

    Raises
    ------
    BadFile : it has no two rows of numbers, no names that are known or guessed, other columns than
        `layout` names, no times and no rate, or times that do not rise
    """
    layout = layout or ForceLayout()
    lines = [line for line in file_text(path, HINT).splitlines() if line.strip(" \t,;")]
    delimiter = _delimiter(lines[-1]) if lines else None
    start, values = _numbers(lines, delimiter, path)
    heading = [_cells(line, delimiter) for line in lines[:start]]
    notes: list[Message] = []
    if len(lines) > start + len(values):
        notes.append(
            READING.message(f"lines below row {len(values)} are not of the same table: left out")
        )
    names = _column_names(layout, heading, values, notes, path)
    time = _times(names, values, layout.rate or _rate(heading), notes, path)
    columns = [index for index, name in enumerate(names) if _is_quantity(name)]
    titles = unique_names([names[index] for index in columns], "column", notes)
    return Table(time, titles, values[:, columns], warnings=tuple(notes), source=str(path))


def _delimiter(line: str) -> str | None:
    """Find what stands between the cells of a line, None for white space."""
    for delimiter in DELIMITERS:
        if delimiter in line:
            return delimiter
    return None


def _is_quantity(name: str) -> bool:
    """Return whether a column holds more than times or numbers of frames, and is to be read."""
    return name not in ("", "-") and _plain(name) not in (*TIMES, *FRAMES, *SUB_FRAMES)


def _column_names(
    layout: ForceLayout,
    heading: Sequence[Sequence[str]],
    values: Array,
    notes: list[Message],
    path: Path,
) -> list[str]:
    """Find the names of all columns: those of the layout, of the heading, or guessed.

    Parameters
    ----------
    layout : its names count first
    heading : cells of each line above the numbers
    values : (rows, columns)
    notes : gets a note about names that the layout does not state
    path : of the file, for messages

    Raises
    ------
    BadFile : the layout names other columns, or there are no names that are known or guessed
    """
    width = values.shape[1]
    if layout.names:
        if len(layout.names) != width:
            raise BadFile(
                path, f"has {width} columns, and {len(layout.names)} names were given", HINT
            )
        return list(layout.names)
    names = _names(heading, width)
    if names:
        notes.append(
            FORCE_FILES.message(f"columns by its heading: {quoted(names)}", severity="good to know")
        )
        return names
    names = guessed_names(values) or []
    if not names:
        raise BadFile(path, f"has no line of names over its {width} columns", HINT)
    notes.append(
        FORCE_FILES.message(
            f"no names: {len(names)} columns were taken as {', '.join(names)} (--force-columns"
            " states them)"
        )
    )
    return names


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells without quotes and blanks around; None splits at white space."""
    return [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def _row(line: str, delimiter: str | None) -> list[float] | None:
    """Read the numbers of a line.

    Parameters
    ----------
    line : of the table
    delimiter : between cells, None for white space; others than a comma allow decimal commas

    Returns
    -------
    one number per cell, NaN for a blank one; None where a cell is no number or all are blank
    """
    cells = _cells(line, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    if delimiter != "," and "." not in line:
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        row = [number(cell) for cell in cells]
    except ValueError:
        return None
    return row if np.isfinite(row).any() else None


def _numbers(lines: Sequence[str], delimiter: str | None, path: Path) -> tuple[int, Array]:
    """Find the rows of numbers, up to the first line that is no row of the table.

    Parameters
    ----------
    lines : of the file, without empty ones
    delimiter : between cells, None for white space
    path : of the file, for messages

    Returns
    -------
    index of the line at which the numbers begin, and values (rows, columns), NaN where a cell is
    blank or missing

    Raises
    ------
    BadFile : no two rows of numbers follow each other
    """
    for start, (line, next_line) in enumerate(pairwise(lines)):
        row = _row(line, delimiter)
        next_row = _row(next_line, delimiter)
        if row is None or next_row is None:
            continue
        width = len(row)
        if len(next_row) == width >= MIN_WIDTH:
            return start, _values(within_time(lines[start:], path), delimiter, width)
    raise BadFile(path, f"has no two rows of {MIN_WIDTH} or more numbers", HINT)


def _values(lines: Iterable[str], delimiter: str | None, width: int) -> Array:
    """Read rows of numbers, up to the first line that is none or misses too many cells.

    Parameters
    ----------
    lines : the first is a row
    delimiter : between cells, None for white space
    width : count of columns

    Returns
    -------
    (rows, columns), NaN where a cell is blank or missing
    """
    rows = []
    for line in lines:
        row = _row(line, delimiter)
        if row is None:
            break
        missing = width - len(row)
        if not 0 <= missing < MIN_WIDTH - 1:
            break
        rows.append([*row, *[np.nan] * missing])
    return np.array(rows)


def _names(heading: Sequence[Sequence[str]], width: int) -> list[str]:
    """Read the names of the columns from a heading.

    They are a line of words, with the plates' names from the line above and units from that below.

    Parameters
    ----------
    heading : cells of each line above the numbers
    width : count of columns

    Returns
    -------
    one name per column; none where no line has a word for most columns
    """
    units = [""] * width
    for at in range(len(heading) - 1, -1, -1):
        cells = [*heading[at], *[""] * width][:width]
        words = [cell for cell in cells if cell and not np.isfinite(number_or_nan(cell))]
        if words and all(cell.lower() in UNITS_OF_CELLS for cell in cells):
            units = cells
            continue
        if len(words) < max(MIN_WIDTH, MIN_NAMED_SHARE * width):
            return []
        plates = _plates(heading[at - 1] if at else (), width)
        return [
            _title(plate, name, unit)
            for plate, name, unit in zip(plates, cells, units, strict=True)
        ]
    return []


def _plates(cells: Sequence[str], width: int) -> list[str]:
    """Find the name of each column's plate in the line above the names.

    Parameters
    ----------
    cells : of that line, () where there is none
    width : count of columns

    Returns
    -------
    one name per column, "" where the line names no groups of columns
    """
    # A line with one cell that is its first is a title.
    names_groups = sum(map(bool, cells)) > 1 or (cells and not cells[0])
    if not names_groups:
        return [""] * width
    return [_plate(group) for group in _spread(cells, width)]


def _title(plate: str, name: str, unit: str) -> str:
    """Join the texts of a column to its name, the unit in brackets unless it stands there."""
    title = f"{plate}_{name}".strip("_")
    return f"{title} [{unit}]" if unit and not UNIT.search(name) else title


def _plate(group: str) -> str:
    """Return a plate's name from a line of groups, without the quantity behind it."""
    plate = PART_OF_PLATE.sub("", group)
    return FORCE_PLATE.sub(r"\1", plate).strip()


def _spread(cells: Sequence[str], width: int) -> list[str]:
    """Repeat each group's name over its own column and the blank ones behind it.

    Parameters
    ----------
    cells : of the line of groups
    width : count of columns

    Returns
    -------
    one name per column, "" before the first group
    """
    result = []
    last = ""
    for index in range(width):
        last = (cells[index] if index < len(cells) else "") or last
        result.append(last)
    return result


def _rate(heading: Sequence[Sequence[str]]) -> float:
    """Find the rate in a heading: a number alone in its line, or behind a word for a rate.

    Parameters
    ----------
    heading : cells of each line above the numbers

    Returns
    -------
    samples per second [Hz], 0 where the heading states none
    """
    for line in heading:
        cells = [cell for cell in line if cell]
        texts = [text for cell in cells for text in NUMBER.findall(cell)]
        if len(texts) != 1:
            continue
        rate = float(texts[0])
        alone = len(cells) == 1 and np.isfinite(number_or_nan(cells[0]))
        if rate > 0.0 and (alone or RATE.search(" ".join(cells))):
            return rate
    return 0.0


def _plain(name: str) -> str:
    """Return a name in small letters without its unit and the characters around it."""
    without_unit, _, _ = UNIT.sub("", name).partition("[")
    return without_unit.strip("_ #.").lower().removesuffix("_s").removesuffix("_ms")


def _times(
    names: Sequence[str], values: Array, rate: float, notes: list[Message], path: Path
) -> Array:
    """Find the times of the rows, by a column of times or by frames or rows at the rate.

    Parameters
    ----------
    names : one per column
    values : (rows, columns)
    rate : of the rows [Hz], 0 for unknown
    notes : gets a note where times follow from the rate
    path : of the file, for messages

    Returns
    -------
    (rows,) [s]

    Raises
    ------
    BadFile : there is neither a column of times nor a rate, or times do not rise
    """
    plain = [_plain(name) for name in names]
    column = _index_of(TIMES, plain)
    if column is not None:
        time: Array = values[:, column] * (1e-3 if IN_MS.search(names[column].lower()) else 1.0)
    elif rate > 0.0:
        first = _first_sample(plain, values)
        time = np.array([(first + index) / rate for index in range(len(values))])
        notes.append(
            FORCE_FILES.message(
                f"no column of times: rows at {rate:g} Hz, the first at {time[0]:g} s"
            )
        )
    else:
        raise BadFile(
            path, "has neither a column of times nor a rate", "state its rate (--force-rate HZ)"
        )
    if not np.isfinite(time).all() or not np.all(np.diff(time) > 0.0):
        raise BadFile(
            path,
            "its times do not rise from row to row",
            "sort the rows, and fill gaps in their times",
        )
    return time


def _index_of(known: Sequence[str], names: Sequence[str]) -> int | None:
    """Find the first column that has one of the known names."""
    for index, name in enumerate(names):
        if name in known:
            return index
    return None


def _first_sample(names: Sequence[str], values: Array) -> float:
    """Find how many samples the first row is behind time 0, by columns of frames and sub frames.

    Frames count from 1, sub frames from 0.

    Parameters
    ----------
    names : plain, one per column
    values : (rows, columns)
    """
    frame = _index_of(FRAMES, names)
    if frame is None:
        return 0.0
    sub_frame = _index_of(SUB_FRAMES, names)
    if sub_frame is None:
        return values[0, frame] - 1.0
    samples_per_frame = float(np.nanmax(values[:, sub_frame])) + 1.0
    return (values[0, frame] - 1.0) * samples_per_frame + values[0, sub_frame]


def _in_meters(wrenches: Wrenches, table: Table) -> Wrenches:
    """Convert points in mm and moments in N mm that name no unit, by their size.

    Parameters
    ----------
    wrenches : (frames, forces, 3) as the table has them
    table : whose columns they are

    Returns
    -------
    points [m] and torques [N m], with a note for each that was converted
    """
    notes = list(wrenches.notes)
    points = wrenches.points.copy()
    torques = wrenches.torques.copy()
    columns = {force.name: force for force in force_columns(table.names)}
    for index, name in enumerate(wrenches.names):
        if name not in columns:
            continue
        norms = np.linalg.norm(wrenches.forces[:, index], axis=1)
        loaded = np.isfinite(norms) & (norms > MIN_LOAD)
        if not loaded.any():
            continue
        distances = np.linalg.norm(points[loaded, index], axis=1)
        if _in_millimeters(distances, columns[name].point):
            points[:, index] *= 1e-3
            notes.append(
                FORCE_FILES.message(f"force '{name}': no unit, points taken as mm by their size")
            )
        levers = np.linalg.norm(torques[loaded, index], axis=1) / norms[loaded]
        if _in_millimeters(levers, columns[name].torque):
            torques[:, index] *= 1e-3
            notes.append(
                FORCE_FILES.message(f"force '{name}': no unit, moments taken as N mm by their size")
            )
    return replace(wrenches, points=points, torques=torques, notes=tuple(notes))


def _in_millimeters(lengths: Array, columns: Sequence[str]) -> bool:
    """Return whether lengths (samples,) are too large for meters, and no column names a unit."""
    far = bool(np.nanmedian(lengths) > MAX_METERS)
    return far and not any(UNIT.search(column) for column in columns)


def _about_origins(wrenches: Wrenches, origins: Sequence[tuple[float, float, float]]) -> Wrenches:
    """Place moments of forces without a center of pressure at points of their own.

    Parameters
    ----------
    wrenches : (frames, forces, 3)
    origins : [m], one per force without a center of pressure, in their order

    Returns
    -------
    the wrenches, with the origins as points of those forces

    Raises
    ------
    BadData : there are more or fewer origins than such forces
    """
    without_center = [
        index for index in range(len(wrenches.names)) if not wrenches.points[:, index].any()
    ]
    if len(without_center) != len(origins):
        names = ", ".join(wrenches.names[index] for index in without_center) or "none"
        raise BadData(
            f"{len(origins)} origins of moments for {len(without_center)} forces without a center"
            f" of pressure ({names}): give one each (--force-origins 'x,y,z; x,y,z')"
        )
    points = wrenches.points.copy()
    points[:, without_center] = np.array(origins)
    notes = tuple(note for note in wrenches.notes if "has no center of pressure" not in note)
    return replace(wrenches, points=points, notes=notes)
