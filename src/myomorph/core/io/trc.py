"""TRC files: marker positions, to and from `Trial` and `Markers`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import (
    TableBody,
    file_text,
    find_delimiter,
    line_from,
    number,
    number_or_nan,
    quick_numbers,
    rising,
    split_cells,
    unique_names,
    whole_number,
    without_far_away,
    written,
)
from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import HIDDEN, READING, UNITS
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Markers, Trial

HINT = (
    "give a TRC file: 'DataRate ... Units' and its values, 'Frame# Time' and marker names, numbers"
)
METERS = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "mm": 1e-3,
    "millimeters": 1e-3,
    "cm": 1e-2,
    "dm": 1e-1,
    "in": 0.0254,
}
FIELDS = (
    "DataRate",
    "CameraRate",
    "NumFrames",
    "NumMarkers",
    "Units",
    "OrigDataRate",
    "OrigDataStartFrame",
    "OrigNumFrames",
)
AXIS = re.compile(r"\b[xyz]\d*\b", re.IGNORECASE)
HEADER_LINES = 30
MAX_METERS = 20.0  # Median of positions, above which a unit without a name is taken as mm.


def read_trc(path: str | os.PathLike[str]) -> Trial:
    """Read a TRC file: markers in meters, with the header's values and warnings.

    Takes header values that are shifted by extra tabs, blanks and every spelling of NaN for hidden
    markers, exact (0, 0, 0) for hidden markers, rows that end early, names without columns and
    columns without names, commas for tabs, and counts that do not hold.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    markers (frames, markers, 3) [m] in the file's axes, NaN where one is hidden; `facts` has the
    header, `warnings` says what was assumed or left out

    Raises
    ------
    BadFile : it is not such a file, or has no frame of numbers
    """
    path = Path(path)
    text = file_text(path, HINT)
    notes: list[Message] = []
    header = _header(text, path, notes)
    facts = header.facts
    labels = _labels(header.cells, facts)
    body = TableBody(text=text[header.end :], delimiter=header.delimiter, path=path, hint=HINT)
    table = _table(body, len(labels), notes)
    names = _names(labels, (table.shape[1] - 2) // 3, notes)
    time, table = _clock(table, facts, path, notes)
    values = table[:, 2 : 2 + 3 * len(names)].reshape(len(table), len(names), 3)
    positions = _hidden(values, names, notes)
    positions = without_far_away(positions * _unit(facts, values, notes), notes)
    counts = {"NumFrames": (len(time), "frames"), "NumMarkers": (len(names), "markers")}
    for key, (count, what) in counts.items():
        stated = whole_number(facts.get(key, ""))
        if stated is not None and stated != count:
            notes.append(READING.message(f"the header says {stated} {what}, the file has {count}"))
    markers = Markers(time, unique_names(names, "marker", notes), positions)
    return Trial(markers=markers, facts=FrozenMap(facts), warnings=tuple(notes), source=str(path))


def trc_head(text: str, path: Path) -> tuple[dict[str, str], int]:
    """Read the header of a TRC file.

    Parameters
    ----------
    text : of the file, or of its first lines
    path : of the file, for messages

    Returns
    -------
    values of the header by key, and the index of the character at which its numbers begin

    Raises
    ------
    BadFile : there is no line 'Frame#  Time  marker names'
    """
    header = _header(text, path, [])
    return header.facts, header.end


@dataclass(frozen=True, kw_only=True)
class _Header:
    """Lines above the numbers.

    Attributes
    ----------
    facts : values by key
    cells : of the line of names, behind 'Frame#' and 'Time'
    delimiter : of these cells, None for white space
    end : index of the character at which the numbers begin
    """

    facts: dict[str, str]
    cells: list[str]
    delimiter: str | None
    end: int


def _header(text: str, path: Path, notes: list[Message]) -> _Header:
    """Read the lines above the numbers.

    Parameters
    ----------
    text : of the file
    path : of the file, for messages
    notes : gets a warning where no line 'DataRate ...' states the units

    Raises
    ------
    BadFile : there is no line 'Frame#  Time  marker names'
    """
    facts: dict[str, str] = {}
    start = 0
    for _ in range(HEADER_LINES):
        line, start = line_from(text, start)
        word = _first_word(line).lower().strip('"')
        if word == "datarate":
            values, start = line_from(text, start)
            facts.update(_header_values(line, values))
        elif word.startswith("frame") or word == "time":
            break
    else:
        raise BadFile(path, "has no line 'Frame#  Time  marker names'", HINT)
    if not facts:
        notes.append(
            UNITS.message(
                "the header has no line 'DataRate ...': units were guessed from the values"
            )
        )
    if word == "time":
        raise BadFile(path, "has no column 'Frame#'", HINT)
    delimiter = find_delimiter(line)
    cells = [cell.strip().strip('"') for cell in split_cells(line, delimiter)]
    # The line of X1 Y1 Z1 may be missing; it never begins with a number.
    below, after = line_from(text, start)
    if AXIS.search(below) and not np.isfinite(number_or_nan(_first_word(below))):
        start = after
    return _Header(facts=facts, cells=cells[2:], delimiter=delimiter, end=start)


def _first_word(line: str) -> str:
    """Return the text up to a blank or a comma, "" where there is none."""
    words = line.replace(",", " ").split()
    return words[0] if words else ""


def _header_values(keys: str, values: str) -> dict[str, str]:
    """Match keys of the header with values by order and not by column: extra tabs are common."""
    names = keys.replace(",", " ").split() or list(FIELDS)
    cells = values.replace(",", " ").split()
    facts = dict(zip(names, cells, strict=False))
    unit = next((text for text in cells if text.lower() in METERS), None)
    if unit is not None and facts.get("Units", "").lower() not in METERS:
        facts["Units"] = unit
    return facts


def _table(body: TableBody, named: int, notes: list[Message]) -> Array:
    """Read the rows of numbers.

    Parameters
    ----------
    body : text below the names
    named : count of markers with a name; 0 takes as many as there are columns
    notes : gets a warning for what was left out

    Returns
    -------
    (frames, columns) with frame number and time first, then three per marker, NaN where a cell is
    blank

    Raises
    ------
    BadFile : there is no row of numbers
    """
    columns = 2 + 3 * named
    quick = quick_numbers(body.text, body.delimiter, columns) if named else None
    if quick is not None:
        return quick
    first, _ = line_from(body.text, 0)
    if body.delimiter and body.delimiter not in first:
        body = replace(body, delimiter=None)
    lines = [line for line in body.text.split("\n") if line.strip(" \t,")]
    if not lines:
        raise BadFile(
            body.path,
            "has marker names, but no frame",
            "the recording may have stopped before it began",
        )
    rows = [split_cells(line.rstrip(" \t,"), body.delimiter) for line in lines]
    width = max(len(row) for row in rows)
    if _is_cut_off(body, lines, rows):
        rows.pop()
        notes.append(
            READING.message(
                "the last row ends too early and was left out: the file may have been cut off"
            )
        )
    if not named:
        columns = 2 + 3 * ((max(columns, width) - 2) // 3)
    elif width > columns:
        notes.append(
            READING.message(f"{width - columns} columns behind the last marker were left out")
        )
    return _values(rows, columns, body.path, notes)


def _is_cut_off(body: TableBody, lines: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the last of several rows has no end of a line, and fewer cells than before.

    Parameters
    ----------
    body : of the table
    lines : of each row
    rows : cells of each row, without blank ones at its end
    """
    if body.text.endswith("\n") or len(rows) < 2:
        return False
    return len(rows[-1]) < len(split_cells(lines[-2], body.delimiter))


def _values(rows: Sequence[Sequence[str]], columns: int, path: Path, notes: list[Message]) -> Array:
    """Convert cells to numbers; rows with texts are left out.

    Parameters
    ----------
    rows : cells of each row
    columns : count of columns; further cells of a row are ignored
    path : of the file, for messages
    notes : gets a warning for rows that were left out

    Returns
    -------
    (rows, columns), NaN where a cell is blank or missing

    Raises
    ------
    BadFile : no row is of numbers
    """
    table = np.full((len(rows), columns), np.nan)
    is_text = np.zeros(len(rows), dtype=bool)
    for index, row in enumerate(within_time(rows, path)):
        cells = row[:columns]
        try:
            table[index, : len(cells)] = [number(cell) for cell in cells]
        except ValueError:
            is_text[index] = True
    if is_text.any():
        notes.append(
            READING.message(
                f"{np.count_nonzero(is_text)} rows were left out because they hold text instead of"
                " numbers"
            )
        )
    if is_text.all():
        raise BadFile(path, "has marker names, but no frame of numbers", HINT)
    return table[~is_text]


def _labels(cells: list[str], facts: Mapping[str, str]) -> list[str]:
    """Find the name of each marker in the line of names.

    Parameters
    ----------
    cells : of the line of names, behind 'Frame#' and 'Time'
    facts : values of the header; `NumMarkers` says whether a blank name is a marker's

    Returns
    -------
    one name per marker, "" for a marker without one
    """
    columns = [column for column, cell in enumerate(cells) if cell]
    names = [cells[column] for column in columns]
    stated = whole_number(facts.get("NumMarkers", ""))
    if not names or stated is None or len(names) >= stated:
        return names
    if any(column % 3 for column in columns):
        return names
    # A blank name amid the others: the columns say which marker it is.
    return cells[: columns[-1] + 1 : 3]


def _names(labels: Sequence[str], count: int, notes: list[Message]) -> list[str]:
    """Name as many markers as there are columns for.

    Parameters
    ----------
    labels : one per marker, "" for one without a name
    count : of markers with columns
    notes : gets a warning where markers have no name
    """
    padded = [*labels, *[""] * (count - len(labels))]
    nameless = padded.count("")
    if nameless:
        notes.append(READING.message(f"{nameless} markers have no name"))
    return [label or f"unnamed_{index + 1}" for index, label in enumerate(padded[:count])]


def _clock(
    table: Array, facts: Mapping[str, str], path: Path, notes: list[Message]
) -> tuple[Array, Array]:
    """Find the times of the frames, by frame numbers and rate where the time column repeats.

    Parameters
    ----------
    table : (rows, columns) with frame number and time [s] first
    facts : values of the header; `DataRate` [Hz] is used
    path : of the file, for messages
    notes : gets a warning for what was assumed or left out

    Returns
    -------
    time (frames,) [s], which rises, and the rows (frames, columns) that belong to it

    Raises
    ------
    BadFile : no time is a number, and frame numbers do not give them
    """
    time = table[:, 1]
    keep = rising(time)
    if keep.all():
        return time, table
    counted = _counted_time(table[:, 0], time, number_or_nan(facts.get("DataRate", "")))
    if counted is not None:
        notes.append(
            READING.message(
                "the time column repeats or is blank: time was counted from frame numbers and"
                " DataRate"
            )
        )
        return counted, table
    if not keep.any():
        raise BadFile(path, "its time column holds no number", HINT)
    notes.append(
        READING.message(
            f"{np.count_nonzero(~keep)} frames were left out because their time does not increase"
        )
    )
    return time[keep], table[keep]


def _counted_time(frame: Array, time: Array, rate: float) -> Array | None:
    """Count times by frame numbers, from the first time that is a number.

    Parameters
    ----------
    frame : (rows,) number of each
    time : (rows,) [s], NaN where it is blank
    rate : frames per second [Hz], NaN for unknown

    Returns
    -------
    (rows,) [s]; None where the rate is unknown, numbers do not rise or do not agree with the times
    """
    if not rate > 0 or not np.all(np.diff(frame) > 0):
        return None
    seconds = (frame - frame[0]) / rate
    known = np.isfinite(time)
    if not known.any():
        return 0.0 + seconds
    start = time[known][0] - seconds[known][0]
    counted = start + seconds
    agree = np.all(np.abs(counted - time)[known] <= 1.0 / rate + 1e-3)
    return counted if agree else None


def _hidden(values: Array, names: list[str], notes: list[Message]) -> Array:
    """Mark hidden markers: NaN for infinite, partly blank and exactly zero positions.

    Parameters
    ----------
    values : (frames, markers, 3) in the file's unit
    names : one per marker
    notes : gets a warning where positions are exactly (0, 0, 0)

    Returns
    -------
    (frames, markers, 3) in the file's unit
    """
    values = np.where(np.isinf(values), np.nan, values)
    zero = np.all(values == 0.0, axis=2)
    if zero.any():
        worst = names[int(np.argmax(zero.sum(axis=0)))]
        notes.append(
            HIDDEN.message(
                f"{np.count_nonzero(zero)} positions are exactly (0, 0, 0): taken as hidden (most"
                f" of '{worst}')",
                severity="good to know",
            )
        )
    hidden = zero | np.isnan(values).any(axis=2)
    return np.where(hidden[:, :, None], np.nan, values)


def _unit(facts: dict[str, str], values: Array, notes: list[Message]) -> float:
    """Find the length of the file's unit, by its header or by the median of the positions.

    Parameters
    ----------
    facts : values of the header
    values : (frames, markers, 3) in the file's unit
    notes : gets a warning where the unit was guessed

    Returns
    -------
    the unit [m]
    """
    stated = facts.get("Units", "").strip('"').lower()
    if stated in METERS:
        return METERS[stated]
    median = float(np.nanmedian(np.abs(values))) if np.isfinite(values).any() else 0.0
    guess = "mm" if median > MAX_METERS else "m"
    notes.append(
        UNITS.message(
            f"the header names no unit that is known ('{facts.get('Units', '')}'): taken as {guess}"
        )
    )
    return METERS[guess]


def write_trc(markers: Markers, path: str | os.PathLike[str], units: str = "mm") -> None:
    """Write markers as a TRC file that OpenSim opens (nan where hidden), whole or not at all.

    Source: Seth et al. 2018, OpenSim's marker files.

    Parameters
    ----------
    markers : (frames, markers, 3) [m]
    path : of the new file, replaced where it exists
    units : of length in the file: "mm", "m", ...

    Raises
    ------
    BadData : `units` is not a unit of length that TRC files use
    BadFile : the file cannot be written

    Examples
    --------
    >>> import myomorph as mm
    >>> markers = mm.read_recording("reach.trc").markers
    >>> mm.write_trc(markers, "copy.trc")
    >>> mm.read_recording("copy.trc").markers.names
    ('UA1', 'UA2', 'FA1', 'FA2')
    """
    check_argument("markers", markers, Markers)
    if units not in METERS:
        raise BadData(f"unknown unit '{units}' for a TRC file: there are 'mm', 'cm', 'm'")
    frames, count = markers.values.shape[:2]
    rate = f"{markers.rate:.6f}" if frames > 1 else "1"
    keys = "\t".join(FIELDS)
    names = "".join(f"{name}\t\t\t" for name in markers.names).rstrip("\t")
    axes = "".join(f"\tX{index}\tY{index}\tZ{index}" for index in range(1, count + 1))
    coordinates = (markers.values / METERS[units]).reshape(frames, 3 * count)
    with written(path) as stream:
        stream.write(f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}\n{keys}\n")
        stream.write(f"{rate}\t{rate}\t{frames}\t{count}\t{units}\t{rate}\t1\t{frames}\n")
        stream.write(f"Frame#\tTime\t{names}\n")
        stream.write(f"\t{axes}\n\n")
        for frame in range(frames):
            numbers = [markers.time[frame], *coordinates[frame].tolist()]
            cells = "\t".join(f"{value:.10g}" for value in numbers)
            stream.write(f"{frame + 1}\t{cells}\n")
