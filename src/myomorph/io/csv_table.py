"""Tables as spreadsheets write them: one line of names, then rows, between commas, semicolons or tabs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from myomorph.io.parsing.text import file_text, unique_names
from myomorph.model.errors import BadFile
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.series import Table

HINT = "expected a line of column names, 'time' first, then rows of numbers between commas, semicolons or tabs"
TIMES = ("time", "t", "seconds", "second", "sec", "timestamp")


def read_csv_table(path: Path) -> Table:
    """A CSV file as a table: the first column is the time [s], or [ms] where its name says so.

    With semicolons between cells a comma is a decimal point. Lines before the one of the names are passed over.

    Raises
    ------
    BadFile : no line of names, or a row that is not of numbers
    """
    lines = [line for line in file_text(path, HINT).splitlines() if line.strip()]
    mark, names, number = _heading(lines, path)
    rows = []
    for at, line in enumerate(lines[number + 1 :], number + 2):
        text = line.replace(",", ".") if mark == ";" else line
        cells = [cell.strip().strip('"') for cell in text.split(mark)]
        try:
            row = [float(cell) if cell else np.nan for cell in cells[: len(names)]]
        except ValueError:
            raise BadFile(path, f"line {at} is not of numbers", HINT) from None
        rows.append(row + [np.nan] * (len(names) - len(row)))
    if not rows:
        raise BadFile(path, "has no row of numbers", HINT)
    values = np.array(rows)
    unit = 1e-3 if re.search(r"[^a-z]ms([^a-z]|$)", names[0].lower()) else 1.0
    time = values[:, 0] * unit
    if not np.isfinite(time).all() or not np.all(np.diff(time) > 0.0):
        raise BadFile(path, "its times do not rise from row to row", "sort the rows, and fill gaps in the first column")
    notes: list[str] = []
    kept = [index for index in range(1, len(names)) if names[index]]
    titles = unique_names([names[index] for index in kept], "column", notes)
    return Table(time, titles, values[:, kept], facts=FrozenMap({}), warnings=tuple(notes), source=str(path))


def _heading(lines: list[str], path: Path) -> tuple[str, list[str], int]:
    """What stands between cells, the names of the columns, and the number of their line."""
    for number, line in enumerate(lines[:50]):
        mark = next((delimiter for delimiter in ";\t" if delimiter in line), ",")
        names = [cell.strip().strip('"') for cell in line.split(mark)]
        if len(names) > 1 and _word(names[0]) in TIMES:
            return mark, names, number
    raise BadFile(path, "has no line of column names that begins with the time", HINT)


def _word(name: str) -> str:
    """A name without its unit, in small letters."""
    return name.lower().split("[")[0].split("(")[0].strip().removesuffix("_s").removesuffix("_ms").strip("_ \ufeff")
