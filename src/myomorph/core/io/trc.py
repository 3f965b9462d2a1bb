"""TRC files: marker positions, to and from `Trial` and `Markers`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import (
    file_text,
    line_from,
    number,
    number_or_nan,
    quick_numbers,
    rising,
    split_cells,
    unique_names,
    without_far_away,
    written,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
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
HEADER_LINES = 30


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
    notes: list[str] = []
    facts, labels, start, delimiter = _header(text, path, notes)
    labels = _labels(labels, facts)
    table, columns = _table(text, start, len(labels), delimiter, path, notes)
    slots = (columns - 2) // 3
    labels = labels + [""] * (slots - len(labels))
    if "" in labels:
        notes.append(f"{labels.count('')} markers have no name")
    labels = [name or f"unnamed_{slot + 1}" for slot, name in enumerate(labels[:slots])]
    time, table = _clock(table, facts, path, notes)
    values = table[:, 2 : 2 + 3 * len(labels)].reshape(len(table), len(labels), 3)
    values = without_far_away(_hidden(values, labels, notes) * _unit(facts, values, notes), notes)
    for key, have, what in (
        ("NumFrames", len(time), "frames"),
        ("NumMarkers", len(labels), "markers"),
    ):
        stated = facts.get(key, "")
        if stated.isdigit() and int(stated) != have:
            notes.append(f"the header says {stated} {what}, the file has {have}")
    markers = Markers(time, unique_names(labels, "marker", notes), values)
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
    facts, _, start, _ = _header(text, path, [])
    return facts, start


def _header(
    text: str, path: Path, notes: list[str]
) -> tuple[dict[str, str], list[str], int, str | None]:
    """Read the lines above the numbers.

    Parameters
    ----------
    text : of the file
    path : of the file, for messages
    notes : gets a warning where no line 'DataRate ...' states the units

    Returns
    -------
    values of the header by key, cells of the line of names behind 'Frame#' and 'Time', the index of
    the character at which the numbers begin, and the delimiter of cells (None for white space)

    Raises
    ------
    BadFile : there is no line 'Frame#  Time  marker names'
    """
    facts: dict[str, str] = {}
    start = 0
    line = ""
    for _ in range(HEADER_LINES):
        line, start = line_from(text, start)
        first = line.replace(",", " ").split()[:1]
        word = first[0].lower().strip('"') if first else ""
        if word == "datarate":
            values, start = line_from(text, start)
            facts.update(_header_values(line, values))
        elif word.startswith("frame") or word == "time":
            break
    else:
        raise BadFile(path, "has no line 'Frame#  Time  marker names'", HINT)
    if not facts:
        notes.append("the header has no line 'DataRate ...': units were guessed from the values")
    delimiter: str | None
    if "\t" in line:
        delimiter = "\t"
    elif "," in line:
        delimiter = ","
    else:
        delimiter = None
    cells = [cell.strip().strip('"') for cell in split_cells(line, delimiter)]
    if word == "time":
        raise BadFile(path, "has no column 'Frame#'", HINT)
    # The line of X1 Y1 Z1 may be missing; it never begins with a number.
    below, after = line_from(text, start)
    begin = (below.replace(",", " ").split() or [""])[0]
    if re.search(r"\b[xyz]\d*\b", below, re.IGNORECASE) and not np.isfinite(number_or_nan(begin)):
        start = after
    return facts, cells[2:], start, delimiter


def _header_values(keys: str, values: str) -> dict[str, str]:
    """Match keys of the header with values by order and not by column: extra tabs are common."""
    names = keys.replace(",", " ").split() or list(FIELDS)
    cells = values.replace(",", " ").split()
    facts = dict(zip(names, cells, strict=False))
    unit = next((text for text in cells if text.lower() in METERS), None)
    if unit is not None and facts.get("Units", "").lower() not in METERS:
        facts["Units"] = unit
    return facts


def _table(
    text: str, start: int, named: int, delimiter: str | None, path: Path, notes: list[str]
) -> tuple[Array, int]:
    """Read the rows of numbers.

    Parameters
    ----------
    text : of the file
    start : index of the character at which the numbers begin
    named : count of markers with a name; 0 takes as many as there are columns
    delimiter : between cells, None for white space
    path : of the file, for messages
    notes : gets a warning for what was left out

    Returns
    -------
    values (frames, columns) with frame number and time first, NaN where a cell is blank; and the
    count of columns, 2 and three per marker

    Raises
    ------
    BadFile : there is no row of numbers
    """
    body = text[start:]
    columns = 2 + 3 * named
    quick = quick_numbers(body, delimiter, columns) if named else None
    if quick is not None:
        return quick, columns
    first = line_from(body, 0)[0]
    if delimiter and delimiter not in first:
        delimiter = None
    lines = [line for line in body.split("\n") if line.strip(" \t,")]
    if not lines:
        raise BadFile(
            path, "has marker names, but no frame", "the recording may have stopped before it began"
        )
    rows = [split_cells(line.rstrip(" \t,"), delimiter) for line in lines]
    width = max(len(row) for row in rows)
    if (
        not body.endswith("\n")
        and len(rows) > 1
        and len(rows[-1]) < len(split_cells(lines[-2], delimiter))
    ):
        rows.pop()
        notes.append("the last row ends too early and was left out: the file may have been cut off")
    columns = max(columns, width) if named == 0 else columns
    columns = 2 + 3 * ((columns - 2) // 3)
    if width > columns and named:
        notes.append(f"{width - columns} columns behind the last marker were left out")
    table = np.full((len(rows), columns), np.nan)
    bad = np.zeros(len(rows), dtype=bool)
    for index, row in enumerate(rows):
        try:
            table[index, : min(len(row), columns)] = [number(cell) for cell in row[:columns]]
        except ValueError:
            bad[index] = True
    if bad.any():
        notes.append(
            f"{np.count_nonzero(bad)} rows were left out because they hold text instead of numbers"
        )
    if bad.all():
        raise BadFile(path, "has marker names, but no frame of numbers", HINT)
    return table[~bad], columns


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
    names = [cell for cell in cells if cell]
    stated = facts.get("NumMarkers", "")
    places = [column // 3 for column, cell in enumerate(cells) if cell and column % 3 == 0]
    if len(places) < len(names) or not stated.isdigit() or len(names) >= int(stated) or not names:
        return names
    # A blank name amid the others: the columns say which marker it is.
    return [cells[3 * slot] for slot in range(places[-1] + 1)]


def _clock(
    table: Array, facts: Mapping[str, str], path: Path, notes: list[str]
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
    frame = table[:, 0]
    time = table[:, 1]
    rate = number_or_nan(facts.get("DataRate", ""))
    keep = rising(time)
    if keep.all():
        return time, table
    if rate > 0 and np.all(np.diff(frame) > 0):
        known = np.isfinite(time)
        zero = time[known][0] - (frame[known][0] - frame[0]) / rate if known.any() else 0.0
        counted = zero + (frame - frame[0]) / rate
        if not known.any() or np.all(np.abs(counted - time)[known] <= 1.0 / rate + 1e-3):
            notes.append(
                "the time column repeats or is blank: time was counted from frame numbers and"
                " DataRate"
            )
            return counted, table
    if not keep.any():
        raise BadFile(path, "its time column holds no number", HINT)
    notes.append(
        f"{np.count_nonzero(~keep)} frames were left out because their time does not increase"
    )
    return time[keep], table[keep]


def _hidden(values: Array, names: list[str], notes: list[str]) -> Array:
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
            f"{np.count_nonzero(zero)} positions are exactly (0, 0, 0): taken as hidden (most of"
            f" '{worst}')"
        )
    hidden = zero | np.isnan(values).any(axis=2)
    return np.where(hidden[:, :, None], np.nan, values)


def _unit(facts: dict[str, str], values: Array, notes: list[str]) -> float:
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
    size = float(np.nanmedian(np.abs(values))) if np.isfinite(values).any() else 0.0
    guess = "mm" if size > 20.0 else "m"
    notes.append(
        f"the header names no unit that is known ('{facts.get('Units', '')}'): taken as {guess}"
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
    if units not in METERS:
        raise BadData(f"unknown unit '{units}' for a TRC file: there are 'mm', 'cm', 'm'")
    frames, count = markers.values.shape[:2]
    rate = f"{markers.rate:.6f}" if frames > 1 else "1"
    labels = "".join(f"\tX{index}\tY{index}\tZ{index}" for index in range(1, count + 1))
    with written(path) as stream:
        stream.write(f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}\n" + "\t".join(FIELDS) + "\n")
        stream.write(f"{rate}\t{rate}\t{frames}\t{count}\t{units}\t{rate}\t1\t{frames}\n")
        stream.write(
            "Frame#\tTime\t"
            + "".join(f"{name}\t\t\t" for name in markers.names).rstrip("\t")
            + "\n"
        )
        stream.write(f"\t{labels}\n\n")
        flat = (markers.values / METERS[units]).reshape(frames, 3 * count)
        for frame in range(frames):
            cells = [f"{value:.10g}" for value in flat[frame].tolist()]
            stream.write("\t".join((str(frame + 1), f"{markers.time[frame]:.10g}", *cells)) + "\n")
