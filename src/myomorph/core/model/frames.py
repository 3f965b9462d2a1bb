"""Variables over time as tables of pandas, with the unit of each column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from myomorph.core.model.curve_columns import CurveColumns, column_units
from myomorph.core.model.errors import from_extra
from myomorph.core.model.quantity import CLOCK
from myomorph.core.model.units import MotionKind

if TYPE_CHECKING:
    import pandas

UNITS = "units"
"""Attribute of a table: the unit of each column, by column."""


class Variable(NamedTuple):
    """Values over named dimensions, and their unit.

    Attributes
    ----------
    dimensions : a name for each axis of the values
    values : of any shape
    unit : "" for none
    """

    dimensions: tuple[str, ...]
    values: np.ndarray
    unit: str = ""

    @property
    def over_time(self) -> bool:
        """Whether the first dimension is a clock."""
        return bool(self.dimensions) and self.dimensions[0].endswith(CLOCK)


def columns_frame(columns: CurveColumns) -> pandas.DataFrame:
    """Put a quantity into a table, a row a frame and a column a name.

    Raises
    ------
    MissingPackage : pandas is not installed
    """
    pandas = from_extra("xarray", "pandas")
    index = pandas.Index(columns.time, name=CLOCK)
    frame = pandas.DataFrame(columns.values, index=index, columns=list(columns.names))
    frame.attrs[UNITS] = dict(zip(columns.names, columns.units, strict=True))
    return frame


def variables_frame(
    variables: Mapping[str, Variable],
    labels: Mapping[str, Sequence[object] | np.ndarray],
    motion_kinds: Mapping[str, MotionKind] | None,
) -> pandas.DataFrame:
    """Put variables into one table, a row a frame.

    Parameters
    ----------
    variables : over the same clock, by name
    labels : of each dimension
    motion_kinds : how coordinates move, by name, where it is known

    Returns
    -------
    columns are the names of a single variable, else variable, name, and axis of vectors

    Raises
    ------
    MissingPackage : pandas is not installed
    """
    pandas = from_extra("xarray", "pandas")
    clock = next((variable.dimensions[0] for variable in variables.values()), CLOCK)
    columns: dict[tuple[str, ...], np.ndarray] = {}
    units: list[str] = []
    for name, variable in variables.items():
        within = [labels[dimension] for dimension in variable.dimensions[1:]]
        for place in np.ndindex(*(len(part) for part in within)):
            words = [str(part[i]) for part, i in zip(within, place, strict=True)]
            units += column_units(variable.unit, words[:1] or [name], motion_kinds)
            key = (name, *words) if len(variables) > 1 else tuple(words) or (name,)
            columns[key] = variable.values[:, *place]
    depth = max((len(key) for key in columns), default=1)
    keys = [key + ("",) * (depth - len(key)) for key in columns]
    index = pandas.Index(np.asarray(labels[clock]), name=clock)
    frame = pandas.DataFrame(dict(enumerate(columns.values())), index=index)
    frame.columns = (
        pandas.MultiIndex.from_tuples(keys) if depth > 1 else pandas.Index([key[0] for key in keys])
    )
    frame.attrs[UNITS] = dict(zip(frame.columns, units, strict=True))
    return frame
