"""Every row of the two sources with its number, its truth and the command that measured it.

Numbers are cells of the tables of results; benchmarks/sources.toml names them. Nothing is measured
here and nothing is typed.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from docs_build.tables import number

from benchmarks.results import LOG, Row, load

LIST = Path(__file__).with_suffix(".toml")
NOT_MEASURED = "no table yet"


@dataclass(frozen=True, kw_only=True)
class SourceRow:
    """One thing that a source shows or asks for.

    Attributes
    ----------
    source : where it stands: "[S] table I", "[D] 3.2"
    what : is measured
    truth : it is compared with
    cells : "table | cells of the row | column" of each number; none where no table has one
    """

    source: str
    what: str
    truth: str
    cells: tuple[str, ...] = ()

    @property
    def tables(self) -> tuple[str, ...]:
        """Tables of the numbers, in order, as the log of commands names them."""
        names = (cell.split(" | ")[0] for cell in self.cells)
        return tuple(dict.fromkeys(name if "/" in name else f"validation/{name}" for name in names))


def source_rows(path: Path = LIST) -> tuple[SourceRow, ...]:
    """Read the list of rows.

    Raises
    ------
    KeyError
        where a row lacks a key
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return tuple(
        SourceRow(
            source=row["source"],
            what=row["what"],
            truth=row["truth"],
            cells=tuple(row["cells"]),
        )
        for row in table["row"]
    )


def run() -> list[Row]:
    """Rows of both sources, with numbers and commands from docs/results.

    Raises
    ------
    ValueError
        where a cell does not exist
    """
    commands = {row["table"]: row["command"] for row in load(LOG)}
    return [
        {
            "source": row.source,
            "what": row.what,
            "number": _numbers(row),
            "truth": row.truth,
            "command": "; ".join(commands[table] for table in row.tables),
        }
        for row in source_rows()
    ]


def _numbers(row: SourceRow) -> str:
    """Write the cells of a row, each behind its column, or its row where columns repeat."""
    if not row.cells:
        return NOT_MEASURED
    parts = []
    columns = [cell.split(" | ")[2] for cell in row.cells]
    for cell, column in zip(row.cells, columns, strict=True):
        where = cell.split(" | ")[1]
        name = where if columns.count(column) > 1 else column
        parts.append(f"{name}: {number(cell)}")
    return "; ".join(parts)
