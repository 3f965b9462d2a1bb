"""CSV files of Delsys: channels that each have a clock of their own.

EMGworks writes a column `X [s]` before each channel; Trigno Discover a line with the names of the
sensors, then `EMG 1 Time Series (s)` before `EMG 1 (mV)`, then a line of rates. Other languages
write `Zeit [s]`, semicolons and decimal commas.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import file_text, number, unique_names
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Table

HINT = "expected a CSV export of Delsys, with a column of times before the channels"
HEAD_LINES = 60  # Lines in which that of the column names is looked for.
TIME = re.compile(
    r"^(x|zeit|temps|tiempo|tempo|tijd)\s*[\[(]s[\])]$|^time.*|^.*time series\s*[\[(]s[\])]$",
    re.IGNORECASE,
)
UNIT = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")
SAME = 1e-6  # Times of two clocks that differ by less are the same [s].
AFTER_NAMES = 3  # Lines of rates and units below the names, at most.


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """A channel with a clock of its own.

    Attributes
    ----------
    name, unit : by its title; "" for no unit
    time : (samples,) [s]
    values : (samples,) in that unit
    """

    name: str
    unit: str
    time: Array
    values: Array

    def at_times(self, time: Array) -> Array:
        """Interpolate the channel at other times.

        Parameters
        ----------
        time : (samples,) [s]

        Returns
        -------
        (samples,) NaN beyond the first and last of its own; its samples where the times are the
        same
        """
        if len(time) == len(self.time) and np.abs(time - self.time).max(initial=0.0) < SAME:
            return self.values
        return np.interp(time, self.time, self.values, left=np.nan, right=np.nan)


def is_delsys(text: str) -> bool:
    """Return whether a text has at least two columns of times, before channels.

    Parameters
    ----------
    text : of the file
    """
    return any(
        sum(bool(TIME.match(title)) for title in _cells(line, delimiter_of(line))) > 1
        for line in text.splitlines()[:HEAD_LINES]
    )


def read_delsys_emg(path: Path) -> Table:
    """Read the channels of a CSV file of Delsys at the times of the fastest one.

    Channels with the same times keep their samples, others are interpolated.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    values (samples, channels) in the file's units, NaN where a channel was not recorded; over
    times [s]

    Raises
    ------
    BadFile : it has no line of names with times, a cell that is no number, or no samples
    """
    channels = [channel for channel in read_delsys(path) if len(channel.time) > 1]
    if not channels:
        raise BadFile(path, "has no row of numbers", HINT)
    time = max((channel.time for channel in channels), key=len)
    if not (np.diff(time) > 0.0).all():
        raise BadFile(path, "its times do not rise from row to row", HINT)
    notes: list[Message] = []
    names = unique_names([channel.name for channel in channels], "channel", notes)
    values = np.column_stack([channel.at_times(time) for channel in channels])
    facts = {f"unit of {name}": item.unit for name, item in zip(names, channels, strict=True)}
    return Table(
        time, names, values, facts=FrozenMap(facts), warnings=tuple(notes), source=str(path)
    )


def read_delsys(path: Path) -> list[Channel]:
    """Read the channels of a CSV file of Delsys, each at its own times.

    Parameters
    ----------
    path : of the file

    Raises
    ------
    BadFile : it has no line of names with times, or a cell that is no number
    """
    lines = file_text(path, HINT).splitlines()
    for start, line in enumerate(lines[:HEAD_LINES]):
        delimiter = delimiter_of(line)
        titles = _cells(line, delimiter)
        if len(titles) > 1 and any(TIME.match(title) for title in titles):
            below = lines[start + 1 :]
            skipped = _lines_of_units(below, delimiter)
            values = _values(path, titles, delimiter, below[skipped:])
            sensors = _sensors(lines[:start], len(titles))
            return _channels(titles, values, sensors)
    raise BadFile(path, "has no line of column names with a time", HINT)


def delimiter_of(line: str) -> str:
    """Find what stands between the cells of a line: a semicolon, a tab, or else a comma.

    Parameters
    ----------
    line : of the table
    """
    for delimiter in ";\t":
        if delimiter in line:
            return delimiter
    return ","


def _cells(line: str, delimiter: str) -> list[str]:
    """Split a line into cells without quotes."""
    return [cell.strip().strip('"\ufeff').strip() for cell in line.split(delimiter)]


def _lines_of_units(lines: Sequence[str], delimiter: str) -> int:
    """Count the lines below the names that hold rates and units instead of numbers."""
    for count, line in enumerate(lines[:AFTER_NAMES]):
        first = _cells(line, delimiter)[0]
        try:
            number(first.replace(",", "."))
        except ValueError:
            continue
        if first:
            return count
    return 0


def _sensors(lines: Sequence[str], width: int) -> list[str]:
    """Find the names of sensors above the names of channels, each carried on to the next.

    Parameters
    ----------
    lines : above those names
    width : count of columns

    Returns
    -------
    one per column, "" where the file names none
    """
    for line in reversed(lines):
        names = _cells(line, delimiter_of(line))
        named = [name for name in names if name]
        if len(names) < width or len(named) < 2 or any(":" in name for name in names[:1]):
            continue
        carried: list[str] = []
        for name in names[:width]:
            carried.append(name or (carried[-1] if carried else ""))
        return carried
    return [""] * width


def _values(path: Path, titles: Sequence[str], delimiter: str, lines: Iterable[str]) -> Array:
    """Read the numbers of a table.

    Parameters
    ----------
    path : of the file, for messages
    titles : of the columns
    delimiter : between cells; with ";" a comma is a decimal point
    lines : below the titles

    Returns
    -------
    (rows, columns), NaN where a cell is missing

    Raises
    ------
    BadFile : a cell is no number
    """
    lines = [line for line in lines if line.strip(" ,;\t")]
    if delimiter == ";":
        lines = [line.replace(",", ".") for line in lines]
    values = np.full((len(lines), len(titles)), np.nan)
    for index, line in enumerate(within_time(lines, path)):
        for column, cell in enumerate(line.split(delimiter)[: len(titles)]):
            try:
                values[index, column] = number(cell)
            except ValueError:
                text = f"row {index + 1} holds '{cell.strip()}' in column '{titles[column]}'"
                raise BadFile(path, text, HINT) from None
    return values


def _channels(titles: Sequence[str], values: Array, sensors: Sequence[str]) -> list[Channel]:
    """Read the channels, each at the times that stand before it.

    Parameters
    ----------
    titles : of the columns; a column of times stands before its channels
    values : (rows, columns)
    sensors : of the columns, "" where there is none
    """
    channels = []
    clock: int | None = None
    for column, title in enumerate(titles):
        if TIME.match(title):
            clock = column
            continue
        if not title or clock is None:
            continue
        unit = UNIT.search(title)
        name = title[: unit.start()].strip() if unit else title
        known = np.isfinite(values[:, clock]) & np.isfinite(values[:, column])
        channels.append(
            Channel(
                name=f"{sensors[column]}: {name}" if sensors[column] else name,
                unit=unit.group(1) if unit else "",
                time=values[known, clock],
                values=values[known, column],
            )
        )
    return channels
