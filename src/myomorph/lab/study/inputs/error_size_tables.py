"""Sizes of a model's errors, as the steps that made it found them.

They are a table beside the model, and an input of a trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import BadFile
from myomorph.lab.study.inputs.input import Input, Opened
from myomorph.lab.uncertainty.sources import GROUPS, NOTHING, ErrorSizes, ItemSize


@dataclass(frozen=True)
class ErrorSizeTables:
    """Tables of sizes of errors.

    Attributes
    ----------
    paths : in the order of the steps that found them; () for those beside the model
    """

    paths: tuple[Path, ...] = ()


TABLE = "error_sizes.csv"
HEAD = ("step", "source", "item", "sd", "shared")
SOURCES = frozenset(name for names in GROUPS.values() for name in names)


def write_error_sizes(folder: Path, step: str, sizes: Iterable[ItemSize]) -> None:
    """Write what a step found into its folder of tables; nothing where it found nothing."""
    rows = [
        (step, size.source, size.item, f"{size.size:.6g}", size.shared)
        for size in sizes
        if math.isfinite(size.size) and size.size > 0.0
    ]
    if rows:
        write_csv(folder / TABLE, HEAD, rows)


def read_error_sizes(paths: Sequence[Path]) -> ErrorSizes:
    """Read the sizes that steps found, in the order of the steps.

    A file that does not exist found nothing. Raises `BadFile` where a file is no such table.
    """
    result = NOTHING
    for path in paths:
        if not path.is_file():
            continue
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv_rows(stream))
        if not rows or tuple(rows[0]) != HEAD:
            raise BadFile(
                path, "is no table of sizes of errors", f"expected the columns {', '.join(HEAD)}"
            )
        sizes = []
        for number, row in enumerate(rows[1:], 2):
            sizes.append(_item(path, number, row))
        result = result.with_step(rows[1][0] if len(rows) > 1 else "", sizes)
    return result


def _item(path: Path, number: int, row: Sequence[str]) -> ItemSize:
    try:
        _, source, item, text, shared = row
        size = float(text)
    except ValueError:
        raise BadFile(path, f"line {number} holds no size", f"expected {', '.join(HEAD)}") from None
    if source not in SOURCES:
        raise BadFile(
            path,
            f"line {number} names '{source}', which is no source of error",
            ", ".join(sorted(SOURCES)),
        )
    if not 0.0 <= size < math.inf:
        raise BadFile(path, f"line {number} gives '{item}' the size {text}", "expected 0 or more")
    return ItemSize(source=source, item=item, size=size, shared=shared)


def tables_beside(model: Path) -> tuple[Path, ...]:
    """Tables of sizes in the folders that a command left beside a model of its own."""
    return tuple(sorted(model.parent.glob(f"{escape(model.stem)}_*/{TABLE}")))


INPUT = Input(
    name="error sizes",
    settings=ErrorSizeTables,
    open=lambda settings, opening: Opened(
        (read_error_sizes(settings.paths or tables_beside(opening.model_file)),)
    ),
)
