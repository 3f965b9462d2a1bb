"""A table of measures: one line a subject, units in the heading, checked."""

from __future__ import annotations

import difflib
import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.door import content_of
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadData, BadFile, listing

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
UNITS: Mapping[str, Mapping[str, float]] = {
    "mass": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237},
    "height": LENGTHS,
    "chest": LENGTHS,
    "age": {
        "years": 1.0,
        "year": 1.0,
        "y": 1.0,
        "a": 1.0,
        "months": 1 / 12,
        "weeks": 7 / 365.25,
        "days": 1 / 365.25,
    },
}
"""Units that a heading may name, the first of each meant where it names none."""

LARGEST = {"mass": 700.0, "height": 3.0, "chest": 3.0, "age": 130.0}
"""Beyond these [kg, m, m, years] a value is in another unit than its heading says."""

TEXTS = ("subject", "model", "sex", "group")
COLUMNS = ("subject", "model", "mass", "height", "chest", "sex", "age", "group")
SEXES: Mapping[str, Literal["female", "male"]] = {
    "female": "female",
    "f": "female",
    "male": "male",
    "m": "male",
}
HEADING = re.compile(r"^\s*(?P<name>[^\[(]*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])])?\s*$")


@dataclass(frozen=True)
class Measures:
    """What a table specifies of one subject; None and "" where its cell is empty.

    `model`: file, as a path that can be opened; `mass`: [kg]; `height`, `chest`: [m]; `age`:
    [years].
    """

    subject: str
    model: Path | None = None
    mass: float | None = None
    height: float | None = None
    chest: float | None = None
    sex: Literal["female", "male"] | None = None
    age: float | None = None
    group: str = ""


def read_measures(path: Path, problems: list[str], remarks: list[str]) -> dict[str, Measures]:
    """Read the lines of a table of measures by subject.

    It is CSV with commas, semicolons or tabs, in any order of columns; those beside `COLUMNS` are
    unused. Paths of models are relative to the table's folder.
    """
    where = path.name
    table = _read_table(path, problems)
    if table is None:
        return {}
    columns = _columns(table.headings, where, problems, remarks)
    result: dict[str, Measures] = {}
    if "subject" not in {name for name, _ in columns}:
        return result
    if not table.lines:
        remarks.append(f"{where}: has a line of names, but no line of a subject")
    for number, row in table.lines:
        measures = _line(
            row, columns, f"{where}, line {number}", path.parent, table.has_decimal_commas, problems
        )
        if measures is None:
            continue
        if measures.subject in result:
            problems.append(f"{where}, line {number}: subject '{measures.subject}' is given twice")
        else:
            result[measures.subject] = measures
    return result


@dataclass(frozen=True)
class _Table:
    """Cells of a table as text.

    Attributes
    ----------
    headings : line of names
    lines : number in the file and cells of each line that is not empty
    has_decimal_commas : commas do not separate cells, so that they are decimal points
    """

    headings: list[str]
    lines: list[tuple[int, list[str]]]
    has_decimal_commas: bool


def _read_table(path: Path, problems: list[str]) -> _Table | None:
    """Read the cells of a table, None where it cannot be read or is empty."""
    where = path.name
    try:
        text = content_of(path, "settings").decode("utf-8-sig")
    except BadFile as error:
        problems.append(f"measures: {error}")
        return None
    except UnicodeDecodeError:
        problems.append(f"{where}: is not text in UTF-8: save the table as 'CSV UTF-8'")
        return None
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(";\t,", key=first.count)
    try:
        rows = list(csv_rows(io.StringIO(text, newline=""), delimiter=delimiter))
    except BadData as error:
        problems.append(f"{where}: is no table of text ({error}): save it as 'CSV UTF-8'")
        return None
    filled = [
        (number, row) for number, row in enumerate(rows, 1) if any(cell.strip() for cell in row)
    ]
    if not filled:
        problems.append(
            f"{where}: is empty: expected a line of names ({', '.join(COLUMNS)}) and one line a"
            " subject"
        )
        return None
    (_, headings), *lines = filled
    return _Table(headings, lines, has_decimal_commas=delimiter != ",")


def _columns(
    headings: list[str], where: str, problems: list[str], remarks: list[str]
) -> list[tuple[str, float]]:
    """Name and factor to the unit used inside of every column; "" for those that are not used."""
    columns: list[tuple[str, float]] = []
    unused = []
    for heading in headings:
        name, unit = _name_and_unit(heading)
        factor = 1.0
        if name not in COLUMNS:
            if name and not _is_misspelt(name):
                unused.append(heading.strip())
            elif name:
                existing = listing(_usual_name(name), COLUMNS)
                problems.append(
                    f"{where}: unknown column '{heading.strip()}': there are {existing}"
                )
            name = ""
        elif name in [other for other, _ in columns]:
            problems.append(f"{where}: has two columns '{name}'")
            name = ""
        elif unit is not None:
            factor = _factor(name, unit, f"{where}: column '{heading.strip()}'", problems)
        columns.append((name, factor))
    if "subject" not in {name for name, _ in columns}:
        problems.append(
            f"{where}: has no column 'subject': there are {listing('subject', headings)}"
        )
    if unused:
        remarks.append(f"{where}: not used: {', '.join(unused)}")
    return columns


def _name_and_unit(heading: str) -> tuple[str, str | None]:
    """Split a heading such as "Mass [kg]" into the name in small letters and the unit."""
    parts = HEADING.match(heading)
    return (parts["name"].lower(), parts["unit"]) if parts else (heading.strip().lower(), None)


def _usual_name(name: str) -> str:
    return "mass" if name in ("weight", "bodymass", "body mass") else name


def _is_misspelt(name: str) -> bool:
    """Return whether the name of a column is close to one of `COLUMNS`."""
    return bool(difflib.get_close_matches(_usual_name(name), COLUMNS, 1, 0.75))


def _factor(name: str, unit: str, where: str, problems: list[str]) -> float:
    """Return the factor from a column's unit to the one used inside, 1 for an unknown unit."""
    units = UNITS.get(name, {})
    if unit.lower() not in units:
        problems.append(
            f"{where}: '{unit}' is not a unit of {name}: there are {listing(unit, tuple(units))}"
        )
    return units.get(unit.lower(), 1.0)


def _line(
    row: list[str],
    columns: list[tuple[str, float]],
    where: str,
    folder: Path,
    comma: bool,
    problems: list[str],
) -> Measures | None:
    if len(row) > len(columns) and any(cell.strip() for cell in row[len(columns) :]):
        problems.append(f"{where}: has {len(row)} cells, but there are {len(columns)} columns")
        return None
    cells = {
        name: (cell.strip(), factor)
        for (name, factor), cell in zip(columns, row, strict=False)
        if name
    }
    texts = {name: text for name, (text, _) in cells.items()}
    subject = texts.get("subject", "")
    sex = texts.get("sex", "")
    model = texts.get("model", "")
    if not subject:
        problems.append(f"{where}: names no subject")
        return None
    where = f"{where} ('{subject}')"
    numbers = {
        name: _number(text, name, factor, where, comma, problems)
        for name, (text, factor) in cells.items()
        if name not in TEXTS
    }
    if sex and sex.lower() not in SEXES:
        problems.append(f"{where}: sex '{sex}': expected female or male, or nothing")
    if model:
        _check_model_file(folder / model, model, where, problems)
    return Measures(
        subject=subject,
        model=folder / model if model else None,
        mass=numbers.get("mass"),
        height=numbers.get("height"),
        chest=numbers.get("chest"),
        sex=SEXES.get(sex.lower()),
        age=numbers.get("age"),
        group=texts.get("group", ""),
    )


def _check_model_file(path: Path, text: str, where: str, problems: list[str]) -> None:
    """Add to the problems a model that does not exist; `text`: its cell."""
    if is_named_file(path):
        return
    near = [
        beside.name
        for beside in path.parent.glob("*")
        if beside.suffix.lower() in (".osim", ".xml")
    ]
    problems.append(
        f"{where}: model file '{text}' does not exist: there are {listing(Path(text).name, near)}"
    )


def _number(
    text: str, name: str, factor: float, where: str, comma: bool, problems: list[str]
) -> float | None:
    """Read a cell as a number in the unit used inside.

    A comma is a decimal point where it separates no cells.
    """
    if not text:
        return None
    try:
        value = float(text.replace(",", ".") if comma else text) * factor
    except ValueError:
        problems.append(
            f"{where}: {name} '{text}': expected a number, the unit goes into the heading ('{name}"
            " [...]')"
        )
        return None
    unit = next(iter(UNITS[name]))
    if not math.isfinite(value) or value <= 0.0:
        problems.append(
            f"{where}: {name} '{text}': expected a number above 0, or nothing where it is not known"
        )
        return None
    if value > LARGEST[name]:
        units = " or ".join(f"'{name} [{one}]'" for one in list(UNITS[name])[1:3])
        problems.append(
            f"{where}: {name} of {value:g} {unit}: state another unit in the heading, as {units}"
        )
        return None
    return value
