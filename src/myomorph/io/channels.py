"""Recorded channels as named columns over time: C3D analog, MOT and STO tables, and comma-separated text."""

from __future__ import annotations

import os
from pathlib import Path

from myomorph.io.parsing.text import file_text, line_from, parse_cells, quick_numbers, rising, split_cells
from myomorph.io.sto import read_sto
from myomorph.model.errors import BadFile
from myomorph.model.series import Series

TIMES = ("time", "t", "time_s", "time (s)", "time [s]")
MOST_SIGNS = 60
"""Of a column's name in a message."""

HINT = "expected a first line of names, one of them 'time' in seconds, and numbers below"


def read_channels(path: str | os.PathLike[str]) -> Series:
    """All channels of a recording (samples, channels), in the file's units.

    Raises
    ------
    BadFile : a file of another kind, or one without channels or time
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".c3d":
        # Each kind of file brings its own reader.
        from myomorph.io.c3d.read import read_c3d

        analog = read_c3d(path).analog
        if analog is None:
            raise BadFile(path, "holds no analog channels", "export the load cells' channels with it")
        return analog
    if ending in (".mot", ".sto"):
        return read_sto(path)
    if ending not in (".csv", ".tsv", ".txt"):
        raise BadFile(path, f"holds no channels: its name ends in '{ending}'", "expected .c3d, .csv, .mot or .sto")
    text = file_text(path, HINT)
    first, start = line_from(text, 0)
    delimiter = max(",;\t", key=first.count)
    names = [cell.strip().strip('"') for cell in split_cells(first, delimiter)]
    column = next((index for index, name in enumerate(names) if name.lower() in TIMES), -1)
    if column < 0 or len(names) < 2:
        raise BadFile(path, f"begins with the columns {', '.join(name[:MOST_SIGNS] for name in names[:6])}", HINT)
    values = quick_numbers(text[start:], delimiter, len(names))
    notes: list[str] = []
    if values is None:
        values = parse_cells(text[start:], len(names), delimiter, notes, path, HINT)
    if notes or not len(values) or not rising(values[:, column]).all():
        raise BadFile(path, notes[0] if notes else "has times that do not rise", HINT)
    others = [index for index in range(len(names)) if index != column]
    return Series(values[:, column], tuple(names[other] for other in others), values[:, others])
