"""Quantities of single strides: the columns of `strides.csv`, a row a sample of each stride."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.quantity import Quantity
from myomorph.lab.analysis.gait_curves import VARIABLES

ROW = ("stride_sample",)
STRIDE_TABLE = "strides.csv"
UNITS: Mapping[str, str] = FrozenMap(
    {"angle": "deg", "moment": "N m/kg", "power": "W/kg", "force": "1"}
)
"""Units of the kinds of curves; forces are in body weights."""
IN_COLUMNS: Mapping[str, str] = FrozenMap({"N m/kg": "Nm_per_kg", "W/kg": "W_per_kg"})
"""Units in names of columns, without blanks and slashes."""

STRIDES = (
    Quantity(
        name="stride_side",
        dims=ROW,
        unit="",
        meaning="side whose foot strikes at 0 %: right or left",
        attribute="side",
        kind="text",
        stored=False,
        file=STRIDE_TABLE,
    ),
    Quantity(
        name="stride_number",
        dims=ROW,
        unit="1",
        meaning="number of the stride, from 1 on each side in order of time",
        attribute="stride",
        kind="count",
        stored=False,
        file=STRIDE_TABLE,
    ),
    Quantity(
        name="stride_percent",
        dims=ROW,
        unit="1",
        meaning="percent of the stride, from strike to strike of the same foot",
        attribute="percent",
        stored=False,
        file=STRIDE_TABLE,
    ),
    Quantity(
        name="stride_time",
        dims=ROW,
        unit="s",
        meaning="time in the recording",
        attribute="time",
        stored=False,
        file=STRIDE_TABLE,
    ),
)
STRIDE_CURVES = tuple(
    Quantity(
        name=f"stride_{variable.key}",
        dims=ROW,
        unit=UNITS[variable.kind],
        meaning=f"{variable.title}, of a single stride",
        attribute=variable.key,
        stored=False,
        file=STRIDE_TABLE,
    )
    for variable in VARIABLES
)
QUANTITIES = (*STRIDES, *STRIDE_CURVES)


def stride_column(quantity: Quantity) -> str:
    """Return the name of a column: "hip_moment_Nm_per_kg"."""
    column = quantity.column
    for unit, words in IN_COLUMNS.items():
        column = column.replace(unit, words)
    return column
