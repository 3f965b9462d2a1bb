"""Contacts that were marked, as on high-speed video: a CSV table of spans, or of events."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import file_text, write_csv
from myomorph.core.model.contacts import Contacts, Touch
from myomorph.core.model.errors import BadFile
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
MAX_SIGNS = 60  # Of a cell in a message.
SHAPES = (
    "columns site,start,stop or site,first_frame,last_frame or time,site,event or frame,site,event"
)


@dataclass(frozen=True)
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


def read_events(
    path: str | os.PathLike[str], rate: float | None = None, start: float = 0.0
) -> Contacts:
    """Read contacts from a CSV table, each row a span or an event.

    A span has the columns `site,start,stop` [s] or `site,first_frame,last_frame`; an event `time`
    [s] or `frame`, `site` and `event` ("touch" or "leave"). Columns `surface`, `confidence` (0 to
    1) and `source` may be added; lines that begin with # are remarks. A site that still touches at
    the end does so until the last event of the table.

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
    header, rows = _table(path)
    if {"frame", "first_frame"} & set(header) and not (rate is not None and rate > 0.0):
        raise BadFile(
            path, "counts frames, but the camera's rate is not known", "give the frames per second"
        )
    if "event" in header:
        marks = [_mark(path, number, row, rate, start) for number, row in rows]
        touches, warnings = _paired(path, marks)
        sites = [mark.site for mark in marks]
    else:
        touches = [_span(path, number, row, rate, start) for number, row in rows]
        warnings = _overlaps(path, touches)
        sites = [touch.site for touch in touches]
    return Contacts(tuple(dict.fromkeys(sites)), tuple(touches), tuple(warnings))


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


def _table(path: Path) -> tuple[tuple[str, ...], list[tuple[int, dict[str, str]]]]:
    """Read a table and check its columns.

    Parameters
    ----------
    path : of the table

    Returns
    -------
    names of the columns, and line number and cells by column of each row

    Raises
    ------
    BadFile : it is empty, has other columns, or a row has more or fewer cells than the first line
    """
    text = file_text(path, f"expected {SHAPES}")
    lines = [
        (row, line)
        for row, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if not lines:
        raise BadFile(path, "holds no table of contacts", f"expected {SHAPES}")
    header = tuple(
        name.strip().lower()
        for name in next(csv.reader([lines[0][1]], delimiter=_delimiter(lines[0][1])))
    )
    wanted = {"site", "event"} if "event" in header else {"site"}
    times = (
        [{"start", "stop"}, {"first_frame", "last_frame"}]
        if "event" not in header
        else [{"time"}, {"frame"}]
    )
    unknown = [name for name in header if name not in COLUMNS]
    if unknown or not wanted <= set(header) or sum(time <= set(header) for time in times) != 1:
        columns = ", ".join(name[:MAX_SIGNS] for name in header[: 2 * len(COLUMNS)])
        raise BadFile(
            path, f"has the columns {columns}", f"expected {SHAPES}, and surface, confidence"
        )
    rows = []
    for number, line in lines[1:]:
        cells = [
            cell.strip() for cell in next(csv.reader([line], delimiter=_delimiter(lines[0][1])))
        ]
        if len(cells) != len(header):
            raise BadFile(
                path, f"line {number} has {len(cells)} cells, the first line {len(header)}"
            )
        rows.append((number, dict(zip(header, cells, strict=True))))
    return header, rows


def _delimiter(line: str) -> str:
    """Return the mark that a line has most of: comma, semicolon or tab."""
    return max(",;\t", key=line.count)


def _number(path: Path, row: int, name: str, cells: Mapping[str, str]) -> float:
    """Read a finite number from a cell, with a decimal comma too; `BadFile` for another text."""
    try:
        value = float(cells[name].replace(",", "."))
    except ValueError:
        raise BadFile(
            path, f"line {row}: '{cells[name][:MAX_SIGNS]}' is no number for {name}"
        ) from None
    if not np.isfinite(value):
        raise BadFile(path, f"line {row}: {name} is {cells[name][:MAX_SIGNS]}")
    return value


def _site(path: Path, row: int, cells: Mapping[str, str]) -> tuple[str, str, float]:
    """Read a site's name, its surface (by default the ground) and its confidence (1).

    Raises
    ------
    BadFile : there is no name, or the confidence is not from 0 to 1
    """
    if not cells["site"]:
        raise BadFile(path, f"line {row} names no site")
    confidence = _number(path, row, "confidence", cells) if cells.get("confidence") else 1.0
    if not 0.0 <= confidence <= 1.0:
        raise BadFile(path, f"line {row}: confidence {confidence:g}", "expected 0 to 1")
    return cells["site"], cells.get("surface") or GROUND, confidence


def _span(
    path: Path, row: int, cells: Mapping[str, str], rate: float | None, start: float
) -> Touch:
    """Read an interval from a row.

    Parameters
    ----------
    path, row : for messages
    cells : by column
    rate : frames per second [Hz], used where the table counts frames
    start : added to all times [s]

    Raises
    ------
    BadFile : it ends before it begins, or a cell is not as it should be
    """
    site, surface, confidence = _site(path, row, cells)
    names, scale = (
        (("start", "stop"), 1.0)
        if "start" in cells
        else (("first_frame", "last_frame"), rate or 1.0)
    )
    begin_name, end_name = names
    begin = start + _number(path, row, begin_name, cells) / scale
    end = start + _number(path, row, end_name, cells) / scale
    if begin > end:
        raise BadFile(
            path, f"line {row}: site '{site}' touches from {begin:g} to {end:g} s", "swap the two"
        )
    return Touch(
        site=site,
        start=begin,
        stop=end,
        surface=surface,
        confidence=confidence,
        source=cells.get("source") or CAMERA,
    )


def _mark(
    path: Path, row: int, cells: Mapping[str, str], rate: float | None, start: float
) -> _Mark:
    """Read an event from a row.

    Parameters
    ----------
    path, row : for messages
    cells : by column
    rate : frames per second [Hz], used where the table counts frames
    start : added to all times [s]

    Raises
    ------
    BadFile : it is neither a touch nor a leave, or a cell is not as it should be
    """
    site, surface, confidence = _site(path, row, cells)
    word = cells["event"].lower()
    if word not in (*TOUCH, *LEAVE):
        raise BadFile(
            path, f"line {row}: event '{cells['event'][:MAX_SIGNS]}'", "expected touch or leave"
        )
    name, scale = ("time", 1.0) if "time" in cells else ("frame", rate or 1.0)
    return _Mark(
        row,
        start + _number(path, row, name, cells) / scale,
        site,
        word in TOUCH,
        surface,
        confidence,
    )


def _paired(path: Path, marks: Sequence[_Mark]) -> tuple[list[Touch], list[str]]:
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
    touches = []
    warnings = []
    last = max((mark.time for mark in marks), default=0.0)

    def add(begun: _Mark, stop: float) -> None:
        touches.append(
            Touch(
                site=begun.site,
                start=begun.time,
                stop=stop,
                surface=begun.surface,
                confidence=begun.confidence,
                source=CAMERA,
            )
        )

    for site in dict.fromkeys(mark.site for mark in marks):
        begun: _Mark | None = None
        for mark in sorted(
            (other for other in marks if other.site == site),
            key=lambda other: (other.time, other.touches),
        ):
            if mark.touches and begun is not None:
                raise BadFile(
                    path,
                    f"line {mark.row}: '{site}' touches again, but never left since line"
                    f" {begun.row}",
                )
            if not mark.touches and begun is None:
                raise BadFile(path, f"line {mark.row}: '{site}' leaves, but did not touch before")
            if begun is not None:
                add(begun, mark.time)
            begun = mark if mark.touches else None
        if begun is not None:
            add(begun, last)
            text = f"'{site}' touches at {begun.time:g} s and never leaves: taken until {last:g} s"
            warnings.append(f"{path.name}: {text}")
    return touches, warnings


def _overlaps(path: Path, touches: Iterable[Touch]) -> list[str]:
    """List a warning for each interval that begins before the last one of its site ends."""
    ordered = sorted(touches, key=lambda touch: (touch.site, touch.start))
    return [
        f"{path.name}: '{touch.site}' touches from {touch.start:g} to {touch.stop:g} s and again"
        f" from {other.start:g} s"
        for touch, other in pairwise(ordered)
        if touch.site == other.site and other.start < touch.stop
    ]
