"""Tables of results as CSV files under docs/results, and the log of the commands that wrote them.

A table is named by its folder and file without the ending, as `validation/models`. The pages of the
documentation show these files; nobody types them.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "results"
LOG = "commands"
"""The table of all others: what wrote them, when, of which commit, and on which machine."""
LOG_COLUMNS = ("table", "command", "date", "commit", "machine")

Row = dict[str, object]
Table = list[dict[str, str]]
"""Rows of a file: column to cell."""


def path_of(table: str) -> Path:
    """Return the file of a table."""
    return FOLDER / f"{table}.csv"


def load(table: str) -> Table:
    """Rows of a table.

    Raises FileNotFoundError where no command has written it.
    """
    with path_of(table).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def save(table: str, rows: Sequence[Mapping[str, object]], command: str) -> None:
    """Write a table, its columns in the order in which rows name them.

    The command that made it is logged.
    """
    columns = dict.fromkeys(column for row in rows for column in row)
    _write(
        table,
        list(columns),
        ({column: cell(row.get(column, "")) for column in columns} for row in rows),
    )
    log = {row["table"]: row for row in load(LOG)} if path_of(LOG).is_file() else {}
    log[table] = {"table": table, "command": command, **provenance()}
    _write(LOG, LOG_COLUMNS, (log[name] for name in sorted(log)))


def _write(table: str, columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> None:
    path_of(table).parent.mkdir(parents=True, exist_ok=True)
    with path_of(table).open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def cell(value: object) -> str:
    """Format a value for a table."""
    if isinstance(value, float):
        return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
    # Pages show cells in Markdown tables, whose columns a bar divides.
    return (json.dumps(value) if isinstance(value, dict) else str(value)).replace("|", "/")


def provenance() -> dict[str, str]:
    """Date, commit ("+" behind it where the checkout differs from it) and machine of this run."""
    git = ["git", "-C", str(FOLDER.parent)]
    commit = subprocess.run(
        [*git, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=False
    )
    sources = ["status", "--porcelain", "--", ":(top)src", ":(top)benchmarks"]
    changed = subprocess.run([*git, *sources], capture_output=True, text=True, check=False)
    machine = f"{os.cpu_count()} cores, {_processor()}, Python {platform.python_version()}"
    revision = commit.stdout.strip() + ("+" if changed.stdout.strip() else "")
    return {"date": datetime.now(UTC).date().isoformat(), "commit": revision, "machine": machine}


def _processor() -> str:
    """Name of the processor, or its kind where the system does not say."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
