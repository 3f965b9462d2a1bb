"""The parts of pages: sections of figures and tables, verdicts, notes, sources.

A verdict holds a quantity against its limit.
"""

from __future__ import annotations

import csv
import io
import math
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Literal

from myomorph import __version__
from myomorph.core.io.parsing.cells import spreadsheet_cell
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.provenance import Provenance
from myomorph.lab.report.charts.axis import number


@dataclass(frozen=True)
class Figure:
    """A drawing with its caption.

    `size` is "small", "medium", "wide" or "full", `folded` the words it hides behind.
    """

    svg: str
    size: str = "small"
    caption: str = ""
    folded: str = ""


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another page, at a place relative to this one."""

    text: str
    place: str

    def __len__(self) -> int:
        return len(self.text)


@dataclass(frozen=True)
class Grid:
    """A table: its heading, its rows of text, and whether it is folded away at first."""

    head: tuple[str, ...]
    rows: tuple[tuple[str | Link, ...], ...]
    title: str = ""
    folded: bool = False


Cell = str | float | int | None


@dataclass(frozen=True)
class Sheet:
    """A table of numbers: column names with their units, and rows; None is an empty cell."""

    head: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]

    def csv(self, digits: int | None = None) -> str:
        """Write the table as comma-separated text, a cell without a value empty.

        By default numbers have all their digits.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(map(spreadsheet_cell, self.head))
        for row in self.rows:
            writer.writerow(
                _written(cell, digits) if isinstance(cell, float) else spreadsheet_cell(cell)
                for cell in row
            )
        return text.getvalue()

    def grid(self, title: str, folded: bool = False, unit: str = "") -> Grid:
        """Format the table for print, to about three digits and in millimeters.

        `unit` is a unit that the title has.
        """

        def printed(name: str, cell: Cell) -> str:
            if isinstance(cell, float):
                return number(1e3 * cell if "[m]" in name else cell)
            return "–" if cell is None else str(cell)

        names = (name.removesuffix(unit).replace("[m]", "[mm]") for name in self.head)
        rows = tuple(tuple(map(printed, self.head, row)) for row in self.rows)
        return Grid(
            head=tuple(name[:1].upper() + name[1:] for name in names),
            rows=rows,
            title=title,
            folded=folded,
        )


def _written(value: float, digits: int | None) -> str:
    if not math.isfinite(value):
        return ""
    return repr(float(value)) if digits is None else f"{value:.{digits}g}"


@dataclass(frozen=True)
class Section:
    """A part of the page."""

    key: str  # anchor
    title: str
    lead: str = ""  # a sentence or two before the figures
    legend: tuple[tuple[str, str], ...] = ()  # styles and what they stand for
    # figures, grids: shown in this order; a grid without rows is not
    figures: tuple[Figure, ...] = ()
    grids: tuple[Grid, ...] = ()
    listed: bool = True  # whether the contents name it
    leads: bool = False  # whether it stands open below the first screen, before all others


SIDES_LEGEND: tuple[tuple[str, str], ...] = (("right", "right"), ("left", "left"))


State = Literal["over", "note", "ok"]


class Quantity(StrEnum):
    """What a verdict is about; its value is what tables and pages print."""

    MARKER_RMS = "Marker error, RMS of the worst frame"
    MARKER_LARGEST = "Marker error, largest"
    MARKER_GAPS = "Gaps in the markers"
    NOT_CONVERGED = "Frames whose inverse kinematics did not converge"
    LOOP_CLOSURE = "Loop-closure error"
    OUT_OF_RANGE = "Coordinates outside the model's range"
    RESIDUAL_FORCE_PEAK = "Residual force, peak"
    RESIDUAL_FORCE_RMS = "Residual force, RMS"
    RESIDUAL_MOMENT_PEAK = "Residual moment, peak"
    RESIDUAL_MOMENT_RMS = "Residual moment, RMS"
    CONTACT_FORCE_PEAK = "Residual force beside contacts, peak"
    CONTACT_FORCE_RMS = "Residual force beside contacts, RMS"
    CONTACT_MOMENT_PEAK = "Residual moment beside contacts, peak"
    CONTACT_MOMENT_RMS = "Residual moment beside contacts, RMS"
    INFEASIBLE_CONTACT = "Infeasible contact frames"
    NOT_OPTIMAL = "Frames without an optimal muscle solution"
    RESERVES = "Reserve actuators, largest"
    UNDRIVEN = "Coordinates that no muscle moves"
    OVERSTRETCHED = "Overstretched muscles"
    SATURATED = "Saturated muscles"

    @staticmethod
    def residual(what: str, statistic: str, contacts: bool = False) -> Quantity:
        """Make the quantity of a residual "force" or "moment", its "peak" or "RMS".

        With contacts, it is what is left beside estimated ones.
        """
        kind = "CONTACT" if contacts else "RESIDUAL"
        return Quantity[f"{kind}_{what.upper()}_{statistic.upper()}"]


@dataclass(frozen=True)
class Verdict:
    """One quantity against its limit."""

    quantity: Quantity  # what was looked at
    # value, unit: what was found
    value: float
    unit: str
    limit: float | None  # what it should stay under, None where there is no agreed limit
    worst: str = ""  # name of what was worst
    time: float | None = None  # when it was worst [s], None where it has no time
    source: str = ""  # key of the reference the limit comes from
    detail: str = ""  # a clause that explains the value

    @property
    def state(self) -> State:
        """Whether it is "ok" or "over" its limit; without a limit anything but 0 is a "note"."""
        if self.limit is None:
            return "note" if self.value else "ok"
        return "ok" if self.value <= self.limit else "over"


NoteKind = Literal["real", "assumed", "simulated", "warning"]


@dataclass(frozen=True)
class Note:
    """A sentence about where something in the report comes from: measured, assumed or simulated."""

    kind: NoteKind
    text: str


@dataclass(frozen=True)
class SourceFile:
    """A file the results were made from."""

    role: str  # "model", "markers", "forces", "EMG", ...
    name: str  # without folders
    sha256: str = ""  # of its content, in hexadecimal


@dataclass(frozen=True)
class Step:
    """A step of the chain as it was run."""

    name: str  # as users know it, e.g. "inverse kinematics"
    # name to value as text
    options: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    seconds: float | None = None  # it took, None if unknown [s]
    frames: int | None = None  # it worked on


def option_text(value: object, none: str = "none") -> str:
    """Write the value of an option for print."""
    if value is None or isinstance(value, bool):
        if value is None:
            return none
        if value:
            return "yes"
        return "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class PageHead:
    """What every page says of itself."""

    title: str  # of the page, e.g. "s01: walk2"
    date: str = ""  # when it was made, as the caller wants it printed
    version: str = ""  # of the software
    notes: tuple[Note, ...] = ()  # what is real, assumed or simulated, shown first
    sources: tuple[SourceFile, ...] = ()  # input files with their hashes
    steps: tuple[Step, ...] = ()  # how it was made
    warnings: tuple[Message, ...] = ()  # what the readers and steps reported, one line each

    @staticmethod
    def of(
        title: str, made: Provenance, notes: Iterable[Note] = (), warnings: Iterable[Message] = ()
    ) -> PageHead:
        """Make the head of a page on one result that this version made."""
        sources = tuple(
            SourceFile(source.role, Path(source.name).name, source.sha256)
            for source in made.sources
        )
        return PageHead(
            title=title,
            date=made.date,
            version=__version__,
            notes=tuple(notes),
            sources=sources,
            warnings=tuple(warnings),
        )


@dataclass(frozen=True)
class Reference:
    """A source: what it is cited for, authors and title, journal or publisher, address.

    The address is a digital object identifier or one of the web, "" if there is none.
    """

    key: str
    used: str
    text: str
    link: str = ""


@cache
def _known() -> Mapping[str, Reference]:
    text = (files("myomorph.lab.report") / "page" / "references.toml").read_text(encoding="utf-8")
    return {
        key: Reference(key=key, used=entry["used"], text=entry["text"], link=entry.get("link", ""))
        for key, entry in tomllib.loads(text).items()
    }


def listed(keys: Collection[str]) -> tuple[Reference, ...]:
    """Return sources in the order of the list."""
    return tuple(reference for key, reference in _known().items() if key in keys)


def cited(*keys: str) -> tuple[Reference, ...]:
    """Return sources in the order of their keys."""
    return tuple(_known()[key] for key in keys)
