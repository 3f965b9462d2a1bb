"""Tables of forces as laboratories write them: any heading or none, frames for times.

What was assumed is noted.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.channels import TIMES
from myomorph.core.io.force_columns import UNIT, UNITS, force_columns, table_wrenches
from myomorph.core.io.guessed_force_columns import guessed_names
from myomorph.core.io.parsing.text import file_text, number, number_or_nan, unique_names
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, MyomorphError, quoted
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
RATE = re.compile(r"(rate|freq|hz)", re.IGNORECASE)
MIN_WIDTH = 4  # Columns of the smallest table of a force: three of force and a moment.
# A center of pressure is nearer to the laboratory's origin, and a moment's lever is shorter [m].
FAR = 20.0
LOADED = 20.0  # Force from which on a point is one [N].


@dataclass(frozen=True)
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
    points: list[tuple[float, float, float]] = []
    for text in origins.split(";") if origins.strip() else []:
        try:
            x, y, z = map(float, text.split(","))
        except ValueError:
            raise BadData(
                f"origin of moments '{text.strip()}': expected x,y,z in metres, forces between ';'"
            ) from None
        points.append((x, y, z))
    return ForceLayout(
        tuple(name.strip() for name in names.split(",")) if names.strip() else (),
        rate,
        tuple(points),
    )


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
    table = None if layout.names or layout.rate else _usual(path)
    usual = table is not None
    table = table or laboratory_table(path, layout)
    try:
        wrenches = table_wrenches(table, bodies)
    except BadData as error:
        if bodies:
            raise
        raise BadData(f"{error}; or {HINT}") from None
    if not usual:
        wrenches = _in_metres(replace(wrenches, notes=(*table.warnings, *wrenches.notes)), table)
    return _about_origins(wrenches, layout.origins) if layout.origins else wrenches


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
    mark = next((delimiter for delimiter in "\t;," if lines and delimiter in lines[-1]), None)
    start, values = _numbers(lines, mark, path)
    heading = [_cells(line, mark) for line in lines[:start]]
    notes: list[str] = []
    if len(lines) > start + len(values):
        notes.append(f"lines below row {len(values)} are not of the same table: left out")
    names = list(layout.names) or _names(heading, values.shape[1])
    if layout.names and len(layout.names) != values.shape[1]:
        raise BadFile(
            path, f"has {values.shape[1]} columns, and {len(layout.names)} names were given", HINT
        )
    if not names:
        names = guessed_names(values) or []
        if not names:
            raise BadFile(path, f"has no line of names over its {values.shape[1]} columns", HINT)
        notes.append(
            f"no names: {len(names)} columns were taken as {', '.join(names)} (--force-columns"
            " states them)"
        )
    elif not layout.names:
        notes.append(f"columns by its heading: {quoted(names)}")
    time = _times(names, values, layout.rate or _rate(heading), notes, path)
    left_out = (*TIMES, *FRAMES, *SUB_FRAMES)
    kept = [
        index
        for index, name in enumerate(names)
        if name not in ("", "-") and _plain(name) not in left_out
    ]
    titles = unique_names([names[index] for index in kept], "column", notes)
    return Table(time, titles, values[:, kept], warnings=tuple(notes), source=str(path))


def _cells(line: str, mark: str | None) -> list[str]:
    """Split a line into cells without quotes and blanks around; no mark splits at white space."""
    return [
        cell.strip().strip('"').strip() for cell in (line.split(mark) if mark else line.split())
    ]


def _row(line: str, mark: str | None) -> list[float] | None:
    """Read the numbers of a line.

    Parameters
    ----------
    line : of the table
    mark : between cells, None for white space; other marks than a comma allow decimal commas

    Returns
    -------
    one number per cell, NaN for a blank one; None where a cell is no number or all are blank
    """
    cells = _cells(line, mark)
    while cells and not cells[-1]:
        cells.pop()
    if mark != "," and "." not in line:
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        row = [number(cell) for cell in cells]
    except ValueError:
        return None
    return row if np.isfinite(row).any() else None


def _numbers(lines: Sequence[str], mark: str | None, path: Path) -> tuple[int, Array]:
    """Find the rows of numbers, up to the first line that is no row of the table.

    Parameters
    ----------
    lines : of the file, without empty ones
    mark : between cells, None for white space
    path : of the file, for messages

    Returns
    -------
    index of the line at which the numbers begin, and values (rows, columns), NaN where a cell is
    blank or missing

    Raises
    ------
    BadFile : no two rows of numbers follow each other
    """
    for start in range(max(len(lines) - 1, 0)):
        first = _row(lines[start], mark)
        second = _row(lines[start + 1], mark)
        if first is None or second is None or len(first) != len(second) or len(first) < MIN_WIDTH:
            continue
        rows = []
        for line in lines[start:]:
            row = _row(line, mark)
            if row is None or not 0 <= len(first) - len(row) < MIN_WIDTH - 1:
                break
            rows.append([*row, *[np.nan] * (len(first) - len(row))])
        return start, np.array(rows)
    raise BadFile(path, f"has no two rows of {MIN_WIDTH} or more numbers", HINT)


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
        if len(words) < max(MIN_WIDTH, 0.6 * width):
            return []
        above = heading[at - 1] if at else ()
        groups = (
            _spread(above, width)
            if sum(map(bool, above)) > 1 or (above and not above[0])
            else [""] * width
        )
        return [
            f"{_plate(group)}_{name}".strip("_")
            + (f" [{unit}]" if unit and not UNIT.search(name) else "")
            for group, name, unit in zip(groups, cells, units, strict=True)
        ]
    return []


def _plate(group: str) -> str:
    """Return a plate's name from a line of groups, without the quantity behind it."""
    return re.sub(
        r"force[\s_]*(plate|platform)", r"\1", PART_OF_PLATE.sub("", group), flags=re.IGNORECASE
    ).strip()


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
    for cells in heading:
        filled = [cell for cell in cells if cell]
        numbers = [
            float(element) for cell in filled for element in re.findall(r"\d+(?:\.\d+)?", cell)
        ]
        alone = len(filled) == 1 and np.isfinite(number_or_nan(filled[0]))
        if len(numbers) == 1 and numbers[0] > 0.0 and (alone or RATE.search(" ".join(filled))):
            return numbers[0]
    return 0.0


def _plain(name: str) -> str:
    """Return a name in small letters without its unit and the characters around it."""
    return (
        UNIT.sub("", name)
        .split("[")[0]
        .strip("_ #.")
        .lower()
        .removesuffix("_s")
        .removesuffix("_ms")
    )


def _times(names: Sequence[str], values: Array, rate: float, notes: list[str], path: Path) -> Array:
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
    column = next((index for index, name in enumerate(plain) if name in TIMES), None)
    if column is not None:
        time: Array = values[:, column] * (
            1e-3 if re.search(r"[^a-z]ms([^a-z]|$)", names[column].lower()) else 1.0
        )
    elif rate > 0.0:
        frame = next((index for index, name in enumerate(plain) if name in FRAMES), None)
        sub = next((index for index, name in enumerate(plain) if name in SUB_FRAMES), None)
        first = 0.0
        if frame is not None:
            each = 1.0 if sub is None else float(np.nanmax(values[:, sub])) + 1.0
            first = (values[0, frame] - 1.0) * each + (0.0 if sub is None else values[0, sub])
        time = np.array([(first + index) / rate for index in range(len(values))])
        notes.append(f"no column of times: rows at {rate:g} Hz, the first at {time[0]:g} s")
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


def _in_metres(wrenches: Wrenches, table: Table) -> Wrenches:
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
    stated = {column.name: column for column in force_columns(table.names)}
    for index, name in enumerate(wrenches.names):
        unit = stated.get(name)
        size = np.linalg.norm(wrenches.forces[:, index], axis=1)
        loaded = np.isfinite(size) & (size > LOADED)
        if unit is None or not loaded.any():
            continue
        for columns, parts, over, words in (
            (unit.point, points, np.ones(int(loaded.sum())), "points taken as mm"),
            (unit.torque, torques, size[loaded], "moments taken as N mm"),
        ):
            far = np.nanmedian(np.linalg.norm(parts[loaded, index], axis=1) / over) > FAR
            if far and not any(UNIT.search(column) for column in columns):
                parts[:, index] *= 1e-3
                notes.append(f"force '{name}': no unit, {words} by their size")
    return replace(wrenches, points=points, torques=torques, notes=tuple(notes))


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
    bare = [index for index in range(len(wrenches.names)) if not wrenches.points[:, index].any()]
    if len(bare) != len(origins):
        raise BadData(
            f"{len(origins)} origins of moments for {len(bare)} forces without a center of pressure"
            f" ({', '.join(wrenches.names[index] for index in bare) or 'none'}): give one each"
            " (--force-origins 'x,y,z; x,y,z')"
        )
    points = wrenches.points.copy()
    points[:, bare] = np.array(origins)
    notes = tuple(note for note in wrenches.notes if "has no center of pressure" not in note)
    return replace(wrenches, points=points, notes=notes)
