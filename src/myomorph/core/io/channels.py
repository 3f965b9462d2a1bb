"""Recorded channels as columns over time: C3D analog, MOT, STO, tables of spreadsheets."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from myomorph.core.io.delsys import is_delsys, read_delsys_emg
from myomorph.core.io.parsing.cells import plain_cell
from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import file_text, quick_numbers, rising, unique_names
from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Series, Table

HINT = (
    "expected a line of column names, 'time' among them, then rows of numbers between commas,"
    " semicolons or tabs"
)
TIMES = ("time", "t", "seconds", "second", "sec", "timestamp")
HEADING_LINES = 50  # Lines in which the one of the names is looked for.


def read_channels(path: str | os.PathLike[str]) -> Series:
    """Read all channels of a recording.

    Parameters
    ----------
    path : of the file (.c3d, .mot, .sto, .csv, .tsv or .txt)

    Returns
    -------
    values (samples, channels) in the file's units, over times (samples,) [s]

    Raises
    ------
    BadFile : it cannot be read, has another ending, or holds no channels
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".c3d":
        # Each kind of file brings its own reader.
        from myomorph.core.io.c3d.read import read_c3d

        analog = read_c3d(path).analog
        if analog is None:
            raise BadFile(
                path, "holds no analog channels", "export the load cells' channels with it"
            )
        return analog
    if ending in (".mot", ".sto"):
        return read_sto(path)
    if ending not in (".csv", ".tsv", ".txt"):
        raise BadFile(
            path,
            f"holds no channels: its name ends in '{ending}'",
            "expected .c3d, .csv, .mot or .sto",
        )
    return read_csv_table(path)


def read_csv_table(path: Path) -> Table:
    """Read a CSV file as a table; lines before the one of the names are passed over.

    With semicolons between cells a comma is a decimal point. Of Delsys' files, in which each
    channel has its own times, all channels come to those of the fastest.

    Parameters
    ----------
    path : of the file; its column of time is in seconds, or in ms where its name says so

    Returns
    -------
    columns (rows, columns) in the file's units, without the time [s], NaN where a cell is blank

    Raises
    ------
    BadFile : it has no line of names with the time, a row that is not of numbers, no row at all, or
        times that do not rise
    """
    text = file_text(path, HINT)
    if is_delsys(text):
        return read_delsys_emg(path)
    lines = [line for line in text.splitlines() if line.strip()]
    mark, names, start = _heading(lines, path)
    values = quick_numbers("\n".join(lines[start:]), mark, len(names))
    if values is None:
        rows = within_time(enumerate(lines[start:], start + 1), path)
        values = np.array([_row(line, mark, len(names), number, path) for number, line in rows])
    if not len(values):
        raise BadFile(path, "has no row of numbers", HINT)
    clock = next(index for index, name in enumerate(names) if _word(name) in TIMES)
    time = values[:, clock] * (
        1e-3 if re.search(r"[^a-z]ms([^a-z]|$)", names[clock].lower()) else 1.0
    )
    if not rising(time).all():
        raise BadFile(
            path,
            "its times do not rise from row to row",
            "sort the rows, and fill gaps in their column",
        )
    notes: list[Message] = []
    kept = [index for index, name in enumerate(names) if name and index != clock]
    titles = unique_names([names[index] for index in kept], "column", notes)
    return Table(
        time, titles, values[:, kept], facts=FrozenMap({}), warnings=tuple(notes), source=str(path)
    )


def _heading(lines: list[str], path: Path) -> tuple[str, list[str], int]:
    """Find the line of column names.

    Parameters
    ----------
    lines : of the file, without empty ones
    path : of the file, for messages

    Returns
    -------
    the mark between cells, the names of the columns, and the index of the first row below them

    Raises
    ------
    BadFile : none of the first lines names a column of time
    """
    for number, line in enumerate(lines[:HEADING_LINES]):
        mark = next((delimiter for delimiter in ";\t" if delimiter in line), ",")
        names = [plain_cell(cell.strip().strip('"')) for cell in line.split(mark)]
        if len(names) > 1 and any(_word(name) in TIMES for name in names):
            return mark, names, number + 1
    raise BadFile(path, "has no line of column names with the time", HINT)


def _row(line: str, mark: str, width: int, number: int, path: Path) -> list[float]:
    """Read the numbers of a row, NaN where a cell is blank or missing.

    Parameters
    ----------
    line : of the table
    mark : between cells; with ";" a comma is a decimal point
    width : count of columns; further cells are ignored
    number : of the line, for messages
    path : of the file, for messages

    Returns
    -------
    `width` numbers

    Raises
    ------
    BadFile : a cell is no number
    """
    text = line.replace(",", ".") if mark == ";" else line
    cells = [cell.strip().strip('"') for cell in text.split(mark)]
    try:
        row = [float(cell) if cell else np.nan for cell in cells[:width]]
    except ValueError:
        raise BadFile(path, f"line {number} is not of numbers", HINT) from None
    return row + [np.nan] * (width - len(row))


def _word(name: str) -> str:
    """Return a name in small letters without its unit."""
    return (
        name.lower()
        .split("[")[0]
        .split("(")[0]
        .strip()
        .removesuffix("_s")
        .removesuffix("_ms")
        .strip("_ \ufeff")
    )
