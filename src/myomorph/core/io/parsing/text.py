"""Parts of all readers of tables: bytes to text, cells to numbers, rising times, files."""

from __future__ import annotations

import csv
import io
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile

BINARY_SHARE = 0.02
FARTHEST = 1e5


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Raise `BadFile` where the system refuses to read a file within the block.

    Parameters
    ----------
    path : of the file, for the message

    Yields
    ------
    nothing

    Raises
    ------
    BadFile : an `OSError` occurs in the block
    """
    try:
        yield
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None


def check_size(path: Path, largest: int, what: str) -> None:
    """Check that a file exists and is not larger than allowed.

    Parameters
    ----------
    path : of the file
    largest : size allowed [bytes]
    what : kind of content, for the message

    Raises
    ------
    BadFile : it is absent or larger
    """
    with readable(path):
        size = path.stat().st_size
    if size > largest:
        raise BadFile(
            path,
            f"is {size / 2**20:.0f} MiB, more than the {largest / 2**20:.0f} MiB allowed for"
            f" {what}",
        )


def mapped_bytes(path: Path) -> np.ndarray:
    """Map the bytes of a file into memory.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    (bytes,) of type uint8, empty for an empty file

    Raises
    ------
    BadFile : it cannot be read
    """
    with readable(path):
        return (
            np.memmap(path, dtype=np.uint8, mode="r")
            if path.stat().st_size
            else np.zeros(0, np.uint8)
        )


def file_text(path: Path, hint: str) -> str:
    """Read the text of a file in UTF-8, UTF-16 with a mark or, failing that, Latin-1.

    Parameters
    ----------
    path : of the file
    hint : what was expected, for the message

    Returns
    -------
    the text, its lines ended by a line feed alone

    Raises
    ------
    BadFile : it cannot be read, is empty or is not text
    """
    with readable(path):
        raw = path.read_bytes()
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
        low = cell.lower()
        if (
            not cell
            or "nan" in low
            or "#ind" in low
            or low in ("na", "n/a", "-", "--", "none", "null", "missing", ".")
        ):
            return float("nan")
        if "#inf" in low:
            return float("-inf") if low.startswith("-") else float("inf")
        return float(low.replace("d", "e") if "d" in low else low.replace(",", "."))


def parse_cells(
    body: str, columns: int, delimiter: str | None, notes: list[str], path: Path, hint: str
) -> Array:
    """Read the rows of a table cell by cell; rows that are too short or hold text are left out.

    Parameters
    ----------
    body : text below the line of names
    columns : count of columns; further cells of a row are ignored
    delimiter : between cells, None for white space
    notes : gets a warning for what was left out
    path : of the file, for messages
    hint : what was expected, for the message

    Returns
    -------
    (rows, columns), NaN where a cell is blank

    Raises
    ------
    BadFile : no row is of numbers
    """
    rows: list[list[float]] = []
    short = odd = 0
    for line in body.splitlines():
        if not line.strip(" \t,"):
            continue
        cells = split_cells(line, delimiter)
        if len(cells) < columns and delimiter is not None and len(line.split()) == columns:
            cells = line.split()
        if len(cells) < columns:
            short += 1
            continue
        try:
            rows.append([number(cell) for cell in cells[:columns]])
        except ValueError:
            odd += 1
    if short:
        notes.append(f"{short} rows were left out because they end too early")
    if odd:
        notes.append(f"{odd} rows were left out because they hold text instead of numbers")
    if not rows:
        raise BadFile(path, "has column names, but no row of numbers", hint)
    return np.array(rows, dtype=np.float64)


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
    if lines != rows and sum(1 for line in body.splitlines() if line.strip()) != rows:
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


def without_far_away(positions: Array, notes: list[str]) -> Array:
    """Mark positions that no laboratory can hold as hidden.

    Parameters
    ----------
    positions : (..., 3) [m]
    notes : gets a warning with their count

    Returns
    -------
    (..., 3) [m], NaN for those farther than 100 km along an axis
    """
    far = np.abs(positions).max(axis=-1) > FARTHEST
    if far.any():
        notes.append(
            f"{np.count_nonzero(far)} positions are farther than {FARTHEST / 1000:.0f} km: taken as"
            " hidden"
        )
        positions = np.where(far[..., None], np.nan, positions)
    return positions


def unique_names(names: Sequence[str], kind: str, notes: list[str]) -> tuple[str, ...]:
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
    seen: set[str] = set()
    unique: list[str] = []
    renamed: list[tuple[str, str]] = []
    for name in names:
        if name in seen:
            copy = 2
            while f"{name}_{copy}" in taken:
                copy += 1
            renamed.append((name, f"{name}_{copy}"))
            name = f"{name}_{copy}"
            taken.add(name)
        seen.add(name)
        unique.append(name)
    if len(renamed) == 1:
        notes.append(
            f"the {kind} '{renamed[0][0]}' occurs twice: the second was named '{renamed[0][1]}'"
        )
    elif renamed:
        twice = ", ".join(dict.fromkeys(f"'{name}'" for name, _ in renamed))
        example = renamed[0][1]
        notes.append(
            f"{len(renamed)} names of a {kind} occur again ({twice}): later ones are named like"
            f" '{example}'"
        )
    return tuple(unique)


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
    table.writerow(head)
    table.writerows(
        [f"{cell:.{digits}g}" if isinstance(cell, float) else cell for cell in row] for row in rows
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
