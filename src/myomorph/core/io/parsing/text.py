"""Parts of all readers of tables: bytes to text, cells to numbers, rising times, files."""

from __future__ import annotations

import csv
import io
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from myomorph.core.io.parsing.cells import spreadsheet_cell
from myomorph.core.io.parsing.door import content_of, within_time
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import HIDDEN, READING
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message

BINARY_SHARE = 0.02
MAX_DISTANCE = 1e5  # Of a position, along an axis [m].
LONGEST = 18  # Digits of a whole number: a crafted file may hold thousands
MISSING = ("na", "n/a", "-", "--", "none", "null", "missing", ".")
"""Cells in small letters that hold no number, besides blanks and spellings of NaN."""


def whole_number(text: str) -> int | None:
    """Read a whole number of at most 18 plain digits, None where the text is another one."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= LONGEST else None


def file_text(path: Path, hint: str, kind: str = "a table") -> str:
    """Read the text of a file in UTF-8, UTF-16 with a mark or, failing that, Latin-1.

    Parameters
    ----------
    path : of the file
    hint : what was expected, for the message
    kind : of content, which limits its size

    Returns
    -------
    the text, its lines ended by a line feed alone

    Raises
    ------
    BadFile : it is no regular file or too large, cannot be read, is empty or is not text
    """
    raw = content_of(path, kind)
    if not raw[:4096].strip() and not raw.strip():
        raise BadFile(path, "is empty", hint)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = raw.decode("utf-16", errors="replace")
    else:
        head = raw[:65536]
        odd = sum(
            head.count(bytes((code,)))
            for code in (0, 1, 2, 3, 4, 5, 6, 7, 8, 14, 15, 16, 17, 18, 19, 20)
        )
        if b"\0" in head or odd > BINARY_SHARE * len(head):
            raise BadFile(path, "is a binary file, not text", hint)
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def line_from(text: str, start: int) -> tuple[str, int]:
    """Find the next line that holds more than white space and commas.

    Parameters
    ----------
    text : of the file
    start : index of the character at which to begin

    Returns
    -------
    the line, "" where none follows, and the index at which the next one begins
    """
    while start < len(text):
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        line = text[start:end]
        if line.strip(" \t\r,"):
            return line, end + 1
        start = end + 1
    return "", len(text)


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells; no delimiter splits at any white space.

    Parameters
    ----------
    line : of the table
    delimiter : between cells, None for white space

    Returns
    -------
    the cells as they stand
    """
    return line.split() if delimiter is None else line.rstrip("\r\n").split(delimiter)


def find_delimiter(line: str) -> str | None:
    """Find what stands between the cells of a line: a tab, a comma, or None for white space.

    Parameters
    ----------
    line : of names
    """
    if "\t" in line:
        return "\t"
    return "," if "," in line else None


def number_or_nan(text: str) -> float:
    """Convert a text to a number, NaN where it is none.

    Parameters
    ----------
    text : may have blanks around
    """
    try:
        return float(text)
    except ValueError:
        return float("nan")


def number(cell: str) -> float:
    """Convert a cell to a number; blank cells and every spelling of NaN are NaN.

    Parameters
    ----------
    cell : may be in quotes; a D may mark the exponent, a comma the fraction

    Returns
    -------
    the number

    Raises
    ------
    ValueError : it is none
    """
    cell = cell.strip().strip('"')
    try:
        return float(cell)
    except ValueError:
        return _odd_number(cell.lower())


def _odd_number(cell: str) -> float:
    """Convert a cell in small letters that Python takes for no number; `ValueError` for a text."""
    if not cell or cell in MISSING or "nan" in cell or "#ind" in cell:
        return float("nan")
    if "#inf" in cell:
        return float("-inf") if cell.startswith("-") else float("inf")
    if "d" in cell:
        return float(cell.replace("d", "e"))
    return float(cell.replace(",", "."))


@dataclass(frozen=True, kw_only=True)
class TableBody:
    """Rows of a table, as text.

    Attributes
    ----------
    text : below the line of names
    delimiter : between cells, None for white space
    path : of the file, for messages
    hint : what was expected, for messages
    """

    text: str
    delimiter: str | None
    path: Path
    hint: str


def parse_cells(body: TableBody, columns: int, notes: list[Message]) -> Array:
    """Read the rows of a table cell by cell; rows that are too short or hold text are left out.

    Parameters
    ----------
    body : of the table
    columns : count of columns; further cells of a row are ignored
    notes : gets a warning for what was left out

    Returns
    -------
    (rows, columns), NaN where a cell is blank

    Raises
    ------
    BadFile : no row is of numbers, or their time is over
    """
    rows: list[list[float]] = []
    short_count = 0
    text_count = 0
    for line in within_time(body.text.splitlines(), body.path):
        if not line.strip(" \t,"):
            continue
        cells = _row_cells(line, body.delimiter, columns)
        if len(cells) < columns:
            short_count += 1
            continue
        try:
            rows.append([number(cell) for cell in cells[:columns]])
        except ValueError:
            text_count += 1
    if short_count:
        notes.append(
            READING.message(f"{short_count} rows were left out because they end too early")
        )
    if text_count:
        notes.append(
            READING.message(
                f"{text_count} rows were left out because they hold text instead of numbers"
            )
        )
    if not rows:
        raise BadFile(body.path, "has column names, but no row of numbers", body.hint)
    return np.array(rows, dtype=np.float64)


def _row_cells(line: str, delimiter: str | None, columns: int) -> list[str]:
    """Split a row into cells, at white space where only that gives one per column."""
    cells = split_cells(line, delimiter)
    if len(cells) < columns and delimiter is not None:
        words = line.split()
        if len(words) == columns:
            return words
    return cells


def quick_numbers(body: str, delimiter: str | None, columns: int) -> Array | None:
    """Read a table of numbers at once, where no cell is blank or odd.

    Parameters
    ----------
    body : text below the line of names
    delimiter : between cells; other than a comma it must be white space
    columns : count of columns

    Returns
    -------
    (rows, columns); None where it must be read cell by cell
    """
    if delimiter == ",":
        body = body.replace(",", " ")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            flat = np.fromstring(body, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    if columns == 0 or flat.size == 0 or flat.size % columns:
        return None
    rows = flat.size // columns
    lines = body.count("\n") + (not body.endswith("\n"))
    if lines != rows:
        # There may be empty ones.
        filled = sum(1 for line in body.splitlines() if line.strip())
        if filled != rows:
            return None
    return flat.reshape(rows, columns)


def rising(time: Array) -> np.ndarray:
    """Find the times that are finite and larger than every one before.

    Parameters
    ----------
    time : (frames,) [s]

    Returns
    -------
    (frames,) whether to keep each
    """
    finite = np.isfinite(time)
    highest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    before = np.concatenate(([-np.inf], highest[:-1]))
    return finite & (time > before)


def without_far_away(positions: Array, notes: list[Message]) -> Array:
    """Mark positions that no laboratory can hold as hidden.

    Parameters
    ----------
    positions : (..., 3) [m]
    notes : gets a warning with their count

    Returns
    -------
    (..., 3) [m], NaN for those farther than 100 km along an axis
    """
    far = np.abs(positions).max(axis=-1) > MAX_DISTANCE
    if far.any():
        notes.append(
            HIDDEN.message(
                f"{np.count_nonzero(far)} positions are farther than {MAX_DISTANCE / 1000:.0f} km:"
                " taken as hidden",
                severity="good to know",
            )
        )
        positions = np.where(far[..., None], np.nan, positions)
    return positions


def unique_names(names: Sequence[str], kind: str, notes: list[Message]) -> tuple[str, ...]:
    """Rename names that occur twice: a later one gets `_2`, `_3`, ...

    Parameters
    ----------
    names : as the file has them
    kind : what they name, for the warning
    notes : gets a warning where names were changed

    Returns
    -------
    the names in their order, each once
    """
    taken = set(names)
    next_numbers: dict[str, int] = {}
    unique: dict[str, None] = {}
    renamed: dict[str, str] = {}
    count = 0
    for name in names:
        new_name = name
        if name in unique:
            number = next_numbers.get(name, 2)
            while f"{name}_{number}" in taken:
                number += 1
            next_numbers[name] = number + 1
            new_name = f"{name}_{number}"
            taken.add(new_name)
            renamed.setdefault(name, new_name)
            count += 1
        unique[new_name] = None
    if count:
        notes.append(_renamed(renamed, kind, count))
    return tuple(unique)


def _renamed(renamed: Mapping[str, str], kind: str, count: int) -> Message:
    """Write the warning of names that occur twice.

    Parameters
    ----------
    renamed : first new name by each name that occurs again
    kind : what they name
    count : of names that were changed
    """
    example = next(iter(renamed.values()))
    if count == 1:
        name = next(iter(renamed))
        return READING.message(
            f"the {kind} '{name}' occurs twice: the second was named '{example}'"
        )
    twice = ", ".join(f"'{name}'" for name in renamed)
    return READING.message(
        f"{count} names of a {kind} occur again ({twice}): later ones are named like '{example}'"
    )


@contextmanager
def written(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Open a text file that appears under its name only when the block ends without an error.

    Parameters
    ----------
    path : of the new file, replaced where it exists

    Yields
    ------
    the stream to write to, in UTF-8

    Raises
    ------
    BadFile : no file can be made in its folder
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as error:
        raise BadFile(
            target, f"cannot be written ({error.strerror or error})", "does its folder exist?"
        ) from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            yield stream
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def csv_text(head: Iterable[object], rows: Iterable[Iterable[object]], digits: int = 6) -> str:
    """Write a table as comma-separated text.

    Parameters
    ----------
    head : names of the columns
    rows : cells of each row
    digits : significant ones of numbers with a fraction

    Returns
    -------
    the text, a line for the head and one per row
    """
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(map(spreadsheet_cell, head))
    for row in rows:
        table.writerow(
            f"{cell:.{digits}g}" if isinstance(cell, float) else spreadsheet_cell(cell)
            for cell in row
        )
    return text.getvalue()


def write_csv(
    path: str | os.PathLike[str],
    head: Iterable[object],
    rows: Iterable[Iterable[object]],
    digits: int = 6,
) -> None:
    """Write a table as a file of comma-separated text, whole or not at all.

    Parameters
    ----------
    path : of the new file, replaced where it exists
    head : names of the columns
    rows : cells of each row
    digits : significant ones of numbers with a fraction

    Raises
    ------
    BadFile : the file cannot be written
    """
    with written(path) as stream:
        stream.write(csv_text(head, rows, digits))
