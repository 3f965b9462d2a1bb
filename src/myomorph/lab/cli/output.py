"""What commands print, and the files they leave: whole, or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from myomorph.core.model.errors import BadFile, one_line
from myomorph.core.model.message_groups import grouped_messages
from myomorph.lab.store.results import STORED, ResultWriter, new_result, whole_folder

MAX_NOTES = 5
"""Messages of one cause that are printed where it is good to know."""
LISTED = "'myomorph info FILE' lists them"


def said(text: str) -> None:
    """Print a line of result."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def warn(warnings: Iterable[str], where: str = LISTED) -> None:
    """Print what looked wrong but did not stop the work, the most severe cause first.

    All that may change results is printed; of a cause that is good to know, with many messages, the
    largest, and where all are listed.
    """
    for group in grouped_messages(warnings):
        word = "warning" if group.is_warning else "note"
        shown = group.messages if group.is_warning else group.messages[:MAX_NOTES]
        for text in shown:
            sys.stderr.write(f"{word}: {one_line(' '.join(text.split()))}\n")
        rest = len(group.messages) - len(shown)
        if rest > 0:
            title = group.cause.title
            sys.stderr.write(f"{word}: and {rest} more of the same cause ({title}): {where}\n")


def made(
    out: Path, tables: Path, lines: Iterable[str], notes: Sequence[str], where: str = LISTED
) -> int:
    """Print what was found for a model that was written beside its tables, and warnings.

    The result is the exit status.
    """
    warn(notes, where)
    for line in lines:
        said(line)
    said(f"wrote {out} and {tables}")
    return 0


@contextmanager
def table_beside(out: Path, step: str, name: str) -> Iterator[tuple[Path, ResultWriter]]:
    """Yield a folder in which a step writes its table `name`, which then becomes `out`.

    `OUT_STEP.nc` stands beside it. The table's interval bounds, where there are any, become
    `OUT_low` and `OUT_high`.

    Raises
    ------
    BadFile : `out` is a folder, its folder does not exist, or its name ends otherwise
    """
    check_out_file(out, Path(name).suffix)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as temporary:
        folder = Path(temporary)
        with new_result(folder / f"result{STORED}", step) as writer:
            yield folder, writer
        os.replace(folder / f"result{STORED}", out.with_name(f"{out.stem}_{step}{STORED}"))
        table = Path(name)
        for path in folder.glob(f"{table.stem}_*{table.suffix}"):
            os.replace(path, out.with_name(f"{out.stem}{path.name.removeprefix(table.stem)}"))
        for path in folder.glob("uncertainty*.csv"):
            os.replace(path, out.with_name(f"{out.stem}_{path.name}"))
        os.replace(folder / name, out)


def check_out_file(out: Path, ending: str) -> None:
    """Raise `BadFile` where a table cannot be written under this name."""
    if out.is_dir():
        raise BadFile(
            out, "is a folder, but the result is a file", f"give a name that ends in {ending}"
        )
    if out.suffix.lower() not in (".sto", ".mot"):
        raise BadFile(
            out, f"is no name for the result: it ends in '{out.suffix}'", f"expected {ending}"
        )
    if not out.parent.is_dir():
        raise BadFile(
            out, f"cannot be written: folder '{out.parent}' does not exist", "make it first"
        )


@contextmanager
def folder_with(out: Path, name: str) -> Iterator[tuple[Path, ResultWriter]]:
    """Yield a folder of results that appears whole, and a NetCDF file `name` in it."""
    with whole_folder(out) as folder, new_result(folder / f"{name}{STORED}", name) as writer:
        yield folder, writer
