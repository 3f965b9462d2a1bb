"""What the readers of text tables share: bytes to text, cells to numbers, times that rise, whole
files.
"""

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
    """`BadFile` where the system refuses to read a file."""
    try:
        yield
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None


def check_size(path: Path, largest: int, what: str) -> None:
    """Raise `BadFile` where a file is absent, or larger than what is allowed [bytes] for a kind of
    content.
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
    """The bytes of a file, mapped into memory; raises `BadFile` where it cannot be read."""
    with readable(path):
        return (
            np.memmap(path, dtype=np.uint8, mode="r")
            if path.stat().st_size
            else np.zeros(0, np.uint8)
        )


def file_text(path: Path, hint: str) -> str:
    """Text of a file, in UTF-8 or, failing that, Latin-1; raises `BadFile` on what is not text."""
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
    """First line at or after `start` that holds more than white space and commas, and where the
    next begins.
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
    """Cells of a line; None splits at any white space."""
    return line.split() if delimiter is None else line.rstrip("\r\n").split(delimiter)


def number_or_nan(text: str) -> float:
    """A text as a number, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def number(cell: str) -> float:
    """A cell as a number: blank and every spelling of NaN is nan; raises `ValueError` otherwise."""
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
    """Values (rows, columns) read cell by cell: blanks are NaN, rows that are too short are left
    out.
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
    """Values (rows, columns) of a body without blanks or odd numbers, or None."""
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
    """Which entries (frames,) are finite and larger than every one kept before."""
    finite = np.isfinite(time)
    highest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    before = np.concatenate(([-np.inf], highest[:-1]))
    return finite & (time > before)


def without_far_away(positions: Array, notes: list[str]) -> Array:
    """The same positions (..., 3) [m] with NaN for those that no laboratory can hold, which `notes`
    lists.
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
    """Names of which none occurs twice: a later one gets `_2`, `_3`, ..., which `notes` lists."""
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
    """A text file that appears under its name only when it is whole; `BadFile` where it cannot be
    made.
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
    """A table as comma-separated text; numbers with a fraction to so many digits."""
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
    """The same as a file that is whole or not there."""
    with written(path) as stream:
        stream.write(csv_text(head, rows, digits))
