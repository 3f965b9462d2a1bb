"""Contacts that were marked, as on high-speed video: a CSV table of spans, or of events."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import file_text, write_csv
from myomorph.core.model.causes import CONTACT_TIMES
from myomorph.core.model.contacts import FOREVER, Contacts, Touch
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND

CAMERA = "camera"  # Source of touches that were marked on video.
TOUCH = ("touch", "on", "down", "start", "contact")
LEAVE = ("leave", "off", "up", "stop", "release")
COLUMNS = (
    "site",
    "start",
    "stop",
    "time",
    "frame",
    "event",
    "surface",
    "confidence",
    "source",
    "first_frame",
    "last_frame",
)
MAX_CHARACTERS = 60  # Of a cell in a message.
SHAPES = (
    "columns site,start,stop or site,first_frame,last_frame or time,site,event or frame,site,event"
)


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A row of the table.

    Attributes
    ----------
    path : of the table, for messages
    number : of its line, from 1
    cells : text by column
    rate : frames per second [Hz], used where the table counts frames
    start : time of the camera's zero on the motion's clock [s]
    """

    path: Path
    number: int
    cells: Mapping[str, str]
    rate: float
    start: float

    def bad(self, what: str, hint: str = "") -> BadFile:
        """Make the error for this row."""
        return BadFile(self.path, f"line {self.number}{what}", hint)

    def value(self, column: str) -> float:
        """Read a finite number, with a decimal comma too.

        Raises
        ------
        BadFile : the cell holds another text
        """
        text = self.cells[column]
        try:
            value = float(text.replace(",", "."))
        except ValueError:
            raise self.bad(f": '{text[:MAX_CHARACTERS]}' is no number for {column}") from None
        if not np.isfinite(value):
            raise self.bad(f": {column} is {text[:MAX_CHARACTERS]}")
        return value

    def time(self, seconds: str, frames: str) -> float:
        """Read a time on the motion's clock [s], from a column of seconds or else one of frames."""
        if seconds in self.cells:
            return self.start + self.value(seconds)
        return self.start + self.value(frames) / self.rate

    def is_open(self) -> bool:
        """Return whether the row has no end of its contact."""
        return not (self.cells.get("stop") or self.cells.get("last_frame"))

    def site(self) -> str:
        """Read the name of the site.

        Raises
        ------
        BadFile : it is empty
        """
        if not self.cells["site"]:
            raise self.bad(" names no site")
        return self.cells["site"]

    def surface(self) -> str:
        """Read the name of the body that the site touches, by default the ground."""
        return self.cells.get("surface") or GROUND

    def confidence(self) -> float:
        """Read how sure the contact is, by default 1.

        Raises
        ------
        BadFile : it is not from 0 to 1
        """
        confidence = self.value("confidence") if self.cells.get("confidence") else 1.0
        if not 0.0 <= confidence <= 1.0:
            raise self.bad(f": confidence {confidence:g}", "expected 0 to 1")
        return confidence


@dataclass(frozen=True, kw_only=True)
class _Mark:
    """One event of a table: a site touches, or leaves.

    Attributes
    ----------
    row : number of its line
    time : on the motion's clock [s]
    site : its name
    touches : whether it touches, or leaves
    surface : that it touches
    confidence : 0 to 1
    """

    row: int
    time: float
    site: str
    touches: bool
    surface: str
    confidence: float

    def until(self, stop: float) -> Touch:
        """Make the contact that begins here and ends then [s]."""
        return Touch(
            site=self.site,
            start=self.time,
            stop=stop,
            surface=self.surface,
            confidence=self.confidence,
            source=CAMERA,
        )


def read_events(
    path: str | os.PathLike[str], rate: float | None = None, start: float = 0.0
) -> Contacts:
    """Read contacts from a CSV table, each row a span or an event.

    A span has the columns `site,start,stop` [s] or `site,first_frame,last_frame`; an event `time`
    [s] or `frame`, `site` and `event` ("touch" or "leave"). Columns `surface`, `confidence` (0 to
    1) and `source` may be added; lines that begin with # are remarks. A contact whose end is empty,
    or that has no `leave`, goes on to the end of the recording.

    Parameters
    ----------
    path : of the table
    rate : frames per second of the camera, needed where the table counts frames [Hz]
    start : time of the camera's zero on the motion's clock [s]

    Returns
    -------
    contact intervals on the motion's clock [s]; `warnings` name those that overlap or never end

    Raises
    ------
    BadFile : it is no such table, a cell is not as it should be, touch and leave do not alternate,
        or it counts frames and there is no rate
    """
    path = Path(path)
    table = _table(path)
    rate_is_known = rate is not None and rate > 0.0
    if not rate_is_known and not {"frame", "first_frame"}.isdisjoint(table.columns):
        raise BadFile(
            path, "counts frames, but the camera's rate is not known", "give the frames per second"
        )
    rows = [
        _Row(path=path, number=number, cells=cells, rate=rate or 1.0, start=start)
        for number, cells in table.rows
    ]
    if "event" in table.columns:
        marks = [_mark(row) for row in within_time(rows, path)]
        intervals, warnings = _paired(path, marks)
        sites = [mark.site for mark in marks]
    else:
        intervals = [_span(row) for row in within_time(rows, path)]
        warnings = _overlaps(path, intervals)
        sites = [interval.site for interval in intervals]
    return Contacts(tuple(dict.fromkeys(sites)), tuple(intervals), tuple(warnings))


def write_events(contacts: Contacts, path: str | os.PathLike[str]) -> None:
    """Write contacts as a table of spans, which `read_events` takes back; whole or not at all.

    Parameters
    ----------
    contacts : intervals [s], written to the microsecond
    path : of the new table, replaced where it exists

    Raises
    ------
    BadFile : the table cannot be written
    """
    rows = (
        (
            touch.site,
            f"{touch.start:.6f}",
            f"{touch.stop:.6f}",
            touch.surface,
            touch.confidence,
            touch.source,
        )
        for touch in contacts.intervals
    )
    write_csv(path, ("site", "start", "stop", "surface", "confidence", "source"), rows, 3)


@dataclass(frozen=True, kw_only=True)
class _ContactTable:
    """Texts of a table.

    Attributes
    ----------
    columns : names, in small letters
    rows : line number from 1, and cells by column
    """

    columns: tuple[str, ...]
    rows: list[tuple[int, dict[str, str]]]


def _table(path: Path) -> _ContactTable:
    """Read a table and check its columns.

    Parameters
    ----------
    path : of the table

    Raises
    ------
    BadFile : it is empty, has other columns, or a row has more or fewer cells than the first line
    """
    text = file_text(path, f"expected {SHAPES}", "contacts")
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if not lines:
        raise BadFile(path, "holds no table of contacts", f"expected {SHAPES}")
    _, first_line = lines[0]
    delimiter = _delimiter(first_line)
    columns = tuple(name.lower() for name in _cells(path, first_line, delimiter))
    if not _is_known_table(columns):
        names = ", ".join(name[:MAX_CHARACTERS] for name in columns[: 2 * len(COLUMNS)])
        raise BadFile(
            path, f"has the columns {names}", f"expected {SHAPES}, and surface, confidence"
        )
    rows = []
    for number, line in within_time(lines[1:], path):
        cells = _cells(path, line, delimiter)
        if len(cells) != len(columns):
            raise BadFile(
                path, f"line {number} has {len(cells)} cells, the first line {len(columns)}"
            )
        rows.append((number, dict(zip(columns, cells, strict=True))))
    return _ContactTable(columns=columns, rows=rows)


def _is_known_table(columns: Sequence[str]) -> bool:
    """Return whether all columns are known, with those of spans or of events in one unit."""
    names = set(columns)
    if not names <= set(COLUMNS) or "site" not in names:
        return False
    if "event" in names:
        return len(names & {"time", "frame"}) == 1
    in_seconds = {"start", "stop"} <= names
    in_frames = {"first_frame", "last_frame"} <= names
    return in_seconds != in_frames


def _cells(path: Path, line: str, delimiter: str) -> list[str]:
    """Split a line into cells without blanks around; quotes may hold the delimiter."""
    try:
        return [cell.strip() for cell in next(csv_rows([line], delimiter=delimiter), [])]
    except BadData as error:
        raise BadFile(path, f"is no table of contacts: {error}") from None


def _delimiter(line: str) -> str:
    """Return the mark that a line has most of: comma, semicolon or tab."""
    return max(",;\t", key=line.count)


def _span(row: _Row) -> Touch:
    """Read an interval from a row.

    Raises
    ------
    BadFile : it ends before it begins, or a cell is not as it should be
    """
    site = row.site()
    confidence = row.confidence()
    start = row.time("start", "first_frame")
    stop = FOREVER if row.is_open() else row.time("stop", "last_frame")
    if start > stop:
        raise row.bad(f": site '{site}' touches from {start:g} to {stop:g} s", "swap the two")
    return Touch(
        site=site,
        start=start,
        stop=stop,
        surface=row.surface(),
        confidence=confidence,
        source=row.cells.get("source") or CAMERA,
    )


def _mark(row: _Row) -> _Mark:
    """Read an event from a row.

    Raises
    ------
    BadFile : it is neither a touch nor a leave, or a cell is not as it should be
    """
    site = row.site()
    confidence = row.confidence()
    event = row.cells["event"]
    word = event.lower()
    if word not in (*TOUCH, *LEAVE):
        raise row.bad(f": unknown event '{event[:MAX_CHARACTERS]}'", "expected touch or leave")
    return _Mark(
        row=row.number,
        time=row.time("time", "frame"),
        site=site,
        touches=word in TOUCH,
        surface=row.surface(),
        confidence=confidence,
    )


def _paired(path: Path, marks: Sequence[_Mark]) -> tuple[list[Touch], list[Message]]:
    """Pair each touch with the leave that follows it at the same site.

    Parameters
    ----------
    path : of the table, for messages
    marks : in any order

    Returns
    -------
    intervals site by site, and a warning for each that never ends

    Raises
    ------
    BadFile : touch and leave do not alternate at a site
    """
    intervals = []
    warnings = []
    for site, of_site in grouped((mark.site, mark) for mark in marks).items():
        begun: _Mark | None = None
        for mark in _in_order(of_site):
            _check_alternation(path, begun, mark)
            if begun is not None:
                intervals.append(begun.until(mark.time))
            begun = mark if mark.touches else None
        if begun is None:
            continue
        intervals.append(begun.until(FOREVER))
        warnings.append(
            CONTACT_TIMES.message(
                f"{path.name}: '{site}' touches at {begun.time:g} s and never leaves: taken to the"
                " end of the recording",
                severity="good to know",
            )
        )
    return intervals, warnings


def _in_order(of_site: Iterable[_Mark]) -> list[_Mark]:
    """Sort the events of a site by time; of two at one time, the leave is first."""
    return sorted(of_site, key=lambda mark: (mark.time, mark.touches))


def _check_alternation(path: Path, begun: _Mark | None, mark: _Mark) -> None:
    """Refuse a touch of a site that touches already, and a leave of one that does not."""
    if mark.touches and begun is not None:
        raise BadFile(
            path,
            f"line {mark.row}: '{mark.site}' touches again, but never left since line {begun.row}",
        )
    if not mark.touches and begun is None:
        raise BadFile(path, f"line {mark.row}: '{mark.site}' leaves, but did not touch before")


def _overlaps(path: Path, touches: Iterable[Touch]) -> list[Message]:
    """List a warning for each interval that begins before the last one of its site ends."""
    ordered = sorted(touches, key=lambda touch: (touch.site, touch.start))
    return [
        CONTACT_TIMES.message(
            f"{path.name}: '{touch.site}' touches from {touch.start:g} to {touch.stop:g} s and"
            f" again from {other.start:g} s"
        )
        for touch, other in pairwise(ordered)
        if touch.site == other.site and other.start < touch.stop
    ]
