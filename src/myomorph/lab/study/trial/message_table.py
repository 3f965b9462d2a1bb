"""The table of a trial's messages: cause, severity, place, size, effect and remedy of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

from myomorph.core.io.parsing.cells import csv_records
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.message_groups import grouped_messages
from myomorph.core.model.message_quantities import QUANTITIES
from myomorph.core.model.messages import Cause, Message

HEAD = tuple(quantity.column for quantity in QUANTITIES)
"""Columns of the table."""
FORMER = {"severity": "gravity", "quantities": "touches"}
"""Names that columns had in tables of version 0.1."""


def write_messages(path: Path, messages: Iterable[str]) -> None:
    """Write a row for each message, the most severe cause first."""
    rows = (
        [_cell(quantity.of(message)) for quantity in QUANTITIES]
        for group in grouped_messages(messages)
        for message in group.messages
    )
    write_csv(path, HEAD, rows)


def _cell(value: object) -> object:
    """Write a number to six digits, nothing where it is not known, else the value itself."""
    if not isinstance(value, float):
        return "" if value is None else value
    return f"{value:.6g}" if math.isfinite(value) else ""


def read_messages(path: Path) -> tuple[Message, ...]:
    """Read what `write_messages` wrote; none where there is no such table."""
    if not path.is_file():
        return ()
    with path.open(newline="", encoding="utf-8") as stream:
        return tuple(map(_message, csv_records(stream)))


def _cell_of(row: Mapping[str, str], column: str) -> str:
    """Return a cell by its column, which tables of version 0.1 may call otherwise."""
    return row[column if column in row else FORMER[column]]


def _message(row: Mapping[str, str]) -> Message:
    """Make a message of its row; of its stretches the first and last time are known."""
    cause = Cause(
        key=row["cause_name"],
        title=row["cause_title"],
        severity=_cell_of(row, "severity"),  # type: ignore[arg-type]
        effect=row["effect"],
        remedy=row["remedy"],
        quantities=tuple(_cell_of(row, "quantities").split()),
    )
    known = row["start_s"] and row["stop_s"]
    return cause.message(
        row["text"],
        place=row["place"],
        times=((float(row["start_s"]), float(row["stop_s"])),) if known else (),
        size=float(row["size"]) if row["size"] else None,
        share=float(row["share"]) if row["share"] else None,
    )
