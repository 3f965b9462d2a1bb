"""A table of measures: one line a subject, units in the heading, checked."""

from __future__ import annotations

import csv
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
from myomorph.core.model.errors import BadFile, listing

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
    try:
        text = content_of(path, "settings").decode("utf-8-sig")
    except BadFile as error:
        problems.append(f"measures: {error}")
        return {}
    except UnicodeDecodeError:
        problems.append(f"{where}: is not text in UTF-8: save the table as 'CSV UTF-8'")
        return {}
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(";\t,", key=first.count)
    try:
        rows = list(csv_rows(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error as error:
        problems.append(f"{where}: is no table of text ({error}): save it as 'CSV UTF-8'")
        return {}
    filled = [
        (number, row) for number, row in enumerate(rows, 1) if any(cell.strip() for cell in row)
    ]
    if not filled:
        problems.append(
            f"{where}: is empty: expected a line of names ({', '.join(COLUMNS)}) and one line a"
            " subject"
        )
        return {}
    columns = _columns(filled[0][1], where, problems, remarks)
    result: dict[str, Measures] = {}
    if "subject" not in {name for name, _ in columns}:
        return result
    if len(filled) == 1:
        remarks.append(f"{where}: has a line of names, but no line of a subject")
    for number, row in filled[1:]:
        one = _line(
            row, columns, f"{where}, line {number}", path.parent, delimiter != ",", problems
        )
        if one is not None and one.subject in result:
            problems.append(f"{where}, line {number}: subject '{one.subject}' is there twice")
        elif one is not None:
            result[one.subject] = one
    return result


def _columns(
    headings: list[str], where: str, problems: list[str], remarks: list[str]
) -> list[tuple[str, float]]:
    """Name and factor to the unit used inside of every column; "" for those that are not used."""
    columns: list[tuple[str, float]] = []
    unused = []
    for heading in headings:
        parts = HEADING.match(heading)
        name, unit = (
            (parts["name"].lower(), parts["unit"]) if parts else (heading.strip().lower(), None)
        )
        factor = 1.0
        if name not in COLUMNS:
            meant = "mass" if name in ("weight", "bodymass", "body mass") else name
            if difflib.get_close_matches(meant, COLUMNS, 1, 0.75):
                problems.append(
                    f"{where}: unknown column '{heading.strip()}': there are"
                    f" {listing(meant, COLUMNS)}"
                )
            elif name:
                unused.append(heading.strip())
            name = ""
        elif name in (one for one, _ in columns):
            problems.append(f"{where}: has two columns '{name}'")
            name = ""
        elif unit is not None and name in UNITS and unit.lower() in UNITS[name]:
            factor = UNITS[name][unit.lower()]
        elif unit is not None:
            units = listing(unit, UNITS.get(name, ()))
            problems.append(
                f"{where}: column '{heading.strip()}': '{unit}' is no unit of {name}: there are"
                f" {units}"
            )
        columns.append((name, factor))
    if "subject" not in {name for name, _ in columns}:
        problems.append(
            f"{where}: has no column 'subject': there are {listing('subject', headings)}"
        )
    if unused:
        remarks.append(f"{where}: not used: {', '.join(unused)}")
    return columns


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
    if model and not is_named_file(folder / model):
        near = [
            path.name
            for path in (folder / model).parent.glob("*")
            if path.suffix.lower() in (".osim", ".xml")
        ]
        problems.append(
            f"{where}: model file '{model}' does not exist: there are"
            f" {listing(Path(model).name, near)}"
        )
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
            f"{where}: {name} of {value:g} {unit}: another unit goes into the heading, as {units}"
        )
        return None
    return value
