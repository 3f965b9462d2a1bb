"""The table of results in the documentation, made of the declared quantities.

A line `<!-- quantities -->` of a page stands for the table when the site is built.
"""

from __future__ import annotations

import re

from myomorph.core.model.quantity import Quantity
from myomorph.lab.study.step.step import declared_quantities, trial_steps

PLACE = re.compile(r"^<!-- quantities -->$", re.MULTILINE)
HEAD = (
    "quantity",
    "axes",
    "unit",
    "what it is",
    "step",
    "table",
    "in `values.csv`",
    "draws",
    "attribute",
)


def with_quantities(markdown: str) -> str:
    """Return a page with the table of quantities in its place."""
    return PLACE.sub(lambda place: result_table(), markdown)


def result_table() -> str:
    """Return all quantities of results as a table of Markdown, one row each."""
    rows = ("| " + " | ".join(_row(quantity)) + " |" for quantity in declared_quantities())
    head = "| " + " | ".join(HEAD) + " |"
    return "\n".join((head, "| --- " * len(HEAD) + "|", *rows))


def _row(quantity: Quantity) -> tuple[str, ...]:
    return (
        f"`{quantity.name}`",
        ", ".join(quantity.dims),
        quantity.unit,
        quantity.meaning,
        ", ".join(step.name for step in trial_steps() if quantity in step.quantities),
        _file(quantity),
        _tidy(quantity),
        "yes" if quantity.drawn else "",
        "" if quantity.field == quantity.name else f"`{quantity.field}`",
    )


def _file(quantity: Quantity) -> str:
    """Return the name of its table, with what columns end in and the unit where it is another."""
    if not quantity.file:
        return "" if quantity.stored else "none"
    words = [f"`{quantity.file}`"]
    endings = [f"`NAME{ending}`" for ending in quantity.endings if ending]
    if endings:
        words.append(f"columns {' and '.join(endings)}")
    if quantity.file_unit:
        words.append(f"in {quantity.file_unit}")
    return ", ".join(words)


def _tidy(quantity: Quantity) -> str:
    """Return the endings of its rows in the table of values, with their statistics."""
    if quantity.tidy is None:
        return ""
    names = " and ".join(f"`NAME{ending}`" for ending in quantity.tidy.endings)
    return f"{names}: {', '.join(quantity.tidy.statistics)}"
