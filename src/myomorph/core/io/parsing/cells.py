"""Cells of comma-separated tables that spreadsheets open: none begins like a formula.

What is written with an apostrophe before it is read without.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

from myomorph.core.model.errors import BadData

Row = TypeVar("Row")
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # How a spreadsheet's formulas begin.


def spreadsheet_cell(cell: object) -> object:
    """Return a cell that no spreadsheet takes for a formula.

    A text that begins like one gets an apostrophe before it, and so does one that would be read
    without its own; numbers stay as they are.

    Parameters
    ----------
    cell : of a table that is written

    Examples
    --------
    >>> from myomorph.core.io.parsing.cells import spreadsheet_cell
    >>> spreadsheet_cell("=HYPERLINK(1)"), spreadsheet_cell("-1.5e3"), spreadsheet_cell("-")
    ("'=HYPERLINK(1)", '-1.5e3', '-')
    """
    if not isinstance(cell, str) or not _is_formula(cell.lstrip("'")):
        return cell
    return f"'{cell}"


def plain_cell(cell: str) -> str:
    """Return a cell without the apostrophe that `spreadsheet_cell` put before it.

    Parameters
    ----------
    cell : of a table that is read

    Examples
    --------
    >>> from myomorph.core.io.parsing.cells import plain_cell
    >>> plain_cell("'=HYPERLINK(1)"), plain_cell("'t Hart")
    ('=HYPERLINK(1)', "'t Hart")
    """
    if cell.startswith("'") and _is_formula(cell.lstrip("'")):
        return cell[1:]
    return cell


def _is_formula(cell: str) -> bool:
    """Whether a spreadsheet may take a text for a formula."""
    if not cell.startswith(FORMULA) or len(cell.strip()) < 2:
        return False
    try:
        float(cell)
    except ValueError:
        return True
    return False


def csv_rows(lines: Iterable[str], delimiter: str = ",") -> Iterator[list[str]]:
    """Yield the cells of each row as they were before they were written.

    Parameters
    ----------
    lines : of the table, or a file opened with newline=""
    delimiter : between cells

    Raises
    ------
    BadData : its quotes are broken, or a cell is longer than any text
    """
    for row in _unbroken(csv.reader(lines, delimiter=delimiter)):
        yield [plain_cell(cell) for cell in row]


def csv_records(lines: Iterable[str], delimiter: str = ",") -> Iterator[dict[str, str]]:
    """Yield each row by the names of the first, as they were before they were written.

    Parameters
    ----------
    lines : of the table, or a file opened with newline=""
    delimiter : between cells

    Raises
    ------
    BadData : its quotes are broken, or a cell is longer than any text
    """
    for row in _unbroken(csv.DictReader(lines, delimiter=delimiter)):
        yield plain_record(row)


def _unbroken(rows: Iterator[Row]) -> Iterator[Row]:
    """Yield rows; an error of Python's reader becomes one of the package."""
    try:
        yield from rows
    except csv.Error as error:
        raise BadData(f"cells of a table cannot be told apart: {error}") from None


def plain_record(row: Mapping[str, str]) -> dict[str, str]:
    """Return the cells of a row by name, as they were before they were written.

    Parameters
    ----------
    row : by the names of the columns; a missing cell is None, further ones are left as they are
    """
    return {
        plain_cell(name) if name else name: plain_cell(cell) if isinstance(cell, str) else cell
        for name, cell in row.items()
    }
