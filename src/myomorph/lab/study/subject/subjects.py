"""Steps on a subject rather than a trial.

The model that they make for its trials is written whole or not at all.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from myomorph.core.io.carried_meshes import carry_meshes
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.lab.study.step.folder_steps import result_folder

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class Made(Generic[Found]):
    """What a step on a subject found, and what it was derived from.

    Notes on its files are one line each.
    """

    found: Found
    provenance: Provenance
    warnings: tuple[Message, ...] = ()


def tables_folder(out: Path, tables: str, read: Iterable[Path | None] = ()) -> Path:
    """Return the folder of the tables and the report of a model that a command makes: beside it.

    Raises `BadFile` as `check_out_model`.
    """
    folder = out.with_name(f"{out.stem}_{tables}")
    check_out_model(out, folder, read)
    return folder


def write_rows(rows: Sequence[Mapping[str, object]], path: Path) -> None:
    """Write a table of rows that name their columns, which are those of the first."""
    head = list(rows[0]) if rows else []
    write_csv(path, head, ([row[name] for name in head] for row in rows))


def check_out_model(out: Path, tables: Path, read: Iterable[Path | None] = ()) -> None:
    """Check where a model is to be written.

    Raises `BadFile` where it cannot be written so, or it or its folder would replace what is
    `read`.
    """
    if out.suffix.lower() != ".osim":
        raise BadFile(
            out,
            f"is no name for a model: it ends in '{out.suffix}'",
            "give a name that ends in .osim",
        )
    if out.is_dir():
        raise BadFile(
            out, "is a folder, but the result is a file", "give a name that ends in .osim"
        )
    if not out.parent.is_dir():
        raise BadFile(
            out, f"cannot be written: folder '{out.parent}' does not exist", "make it first"
        )
    for path in read:
        if path is not None and path.resolve() in (out.resolve(), tables.resolve()):
            raise BadFile(
                out,
                f"would be written over '{path}', which it is made from",
                "give --out another name",
            )


@dataclass(frozen=True)
class ModelOutput:
    """Where a model goes that a step or a command makes.

    Attributes
    ----------
    file : of the model (.osim)
    tables : folder of its tables and its report
    """

    file: Path
    tables: Path


def write_made_model(
    model: Model,
    made: Provenance,
    output: ModelOutput,
    fill: Callable[[Path], None],
    notes: Sequence[Message] = (),
) -> tuple[str, ...]:
    """Write a model, and a folder with provenance, notes and what `fill` writes.

    What is lost in the model's file is returned.
    """
    out = output.file
    check_out_model(out, output.tables)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as temporary:
        path = Path(temporary) / out.name
        lost = write_osim(model, path)
        with result_folder(output.tables, made, notes) as folder:
            fill(folder)
        os.replace(path, out)
    carry_meshes(model, out.parent)
    return lost
