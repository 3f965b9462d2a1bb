"""Numbers of a movement as tables: means over its parts, and each part a row."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.quantity import Quantity
from myomorph.core.model.units import shown_unit
from myomorph.lab.movements.part import MovementNumbers, Part, Summary
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Grid

NOT_SHOWN = "not shown"
DIGITS = {
    "s": 3,
    "m": 3,
    "deg": 0,
    "%": 0,
    "steps/min": 0,
    "N s": 0,
    "N/s": 0,
    "kN/m": 1,
    "W/kg": 1,
    "body weight/s": 0,
}
"""After the point, by unit; two of others."""
PLURAL = {"body weight": "body weights", "body weight/s": "body weights/s", "deg": "°"}
FEW_ROWS = 12
"""More parts than these are folded."""


def printed(quantity: Quantity, value: float) -> str:
    """Return a value with the digits of its unit."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.{DIGITS.get(quantity.unit, 2)}f}".replace("-", "−")


def unit_words(quantity: Quantity) -> str:
    """Return the unit of a quantity in print, "" where it has none."""
    unit = PLURAL.get(quantity.unit, shown_unit(quantity.unit))
    return "" if unit == "1" else unit


def number_tables(numbers: MovementNumbers) -> tuple[Grid, ...]:
    """Return what was found in the mean, and each part where there are several."""
    whole = _summary_table(numbers)
    return (whole, _part_table(numbers)) if len(numbers.parts) > 1 else (whole,)


def _summary_table(numbers: MovementNumbers) -> Grid:
    """Return one row a quantity, with mean and deviation by side, and what it is."""
    sides = numbers.sides
    several = len(numbers.parts) > 1
    heads = {"right": "Right", "left": "Left", "": "Mean ± SD" if several else "Value"}
    rows = []
    for quantity in numbers.quantities:
        cells = [_cell(quantity, numbers.summary(quantity, side)) for side in sides]
        meaning = f"{quantity.meaning[:1].upper()}{quantity.meaning[1:]}."
        rows.append((quantity.words, *cells, meaning))
    counts = ", ".join(_counted(numbers, side) for side in sides)
    title = f"Mean ± standard deviation of {counts}" if several else ""
    return Grid(
        head=("", *(heads[side] for side in sides), "Definition"), rows=tuple(rows), title=title
    )


def _counted(numbers: MovementNumbers, side: str) -> str:
    """Return how many parts a side has, as "3 right steps"."""
    count = sum(part.side == side for part in numbers.parts)
    return " ".join(
        word for word in (str(count), side, numbers.one if count == 1 else numbers.many) if word
    )


def _cell(quantity: Quantity, summary: Summary | None) -> str:
    """Return a mean with its deviation and unit."""
    if summary is None:
        return NOT_SHOWN
    unit = unit_words(quantity)
    value = printed(quantity, summary.mean)
    if np.isfinite(summary.sd):
        value = f"{value} ± {printed(quantity, summary.sd)}"
    return f"{value}\u00a0{unit}" if unit and unit != "°" else f"{value}{unit}"


def _part_table(numbers: MovementNumbers) -> Grid:
    """Return one row a part, with the quantities that at least one has, then mean and deviation."""
    known = numbers.known
    head = (numbers.one.capitalize(), "From", *(_heading(quantity) for quantity in known))
    rows = [_row(numbers, index, part, known) for index, part in enumerate(numbers.parts, 1)]
    for side in numbers.sides:
        summaries = [numbers.summary(quantity, side) for quantity in known]
        means = [printed(q, s.mean) if s else "–" for q, s in zip(known, summaries, strict=True)]
        sds = [printed(q, s.sd) if s else "–" for q, s in zip(known, summaries, strict=True)]
        words = f", {side}" if side else ""
        rows += [(f"Mean{words}", "", *means), (f"SD{words}", "", *sds)]
    return Grid(
        head=head,
        rows=tuple(rows),
        title=f"Each {numbers.one}",
        folded=len(numbers.parts) > FEW_ROWS,
    )


def _heading(quantity: Quantity) -> str:
    """Return the name of a column with its unit."""
    unit = unit_words(quantity)
    return f"{quantity.words} [{unit}]" if unit else quantity.words


def _row(
    numbers: MovementNumbers, index: int, part: Part, known: tuple[Quantity, ...]
) -> tuple[str, ...]:
    """Return the row of a part."""
    name = " ".join(word for word in (str(index), part.side) if word)
    values = (printed(quantity, part.number(quantity)) for quantity in known)
    return (name, f"{number(part.start, 0.01)}\u00a0s", *values)
