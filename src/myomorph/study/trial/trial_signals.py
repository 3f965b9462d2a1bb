"""What a result has over time, as columns with names and units that tables of values and curves use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.series import Series

EXTREMES = ("minimum", "maximum", "range", "mean")
LOADED = 0.05
"""Of body weight: a foot that never carries more in a cycle did not stand on a plate."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Columns of one kind.

    Attributes
    ----------
    step : that made them
    series : named as the model names coordinates, bodies and muscles, so that sides can be told
    endings : added to each name in tables of values
    units : of each column
    statistics : of each column that tables of values have, some of `EXTREMES`
    curve : what the curves over the cycle are called, with their unit; "" where none are drawn
    factor : from the columns to the curves (names,)
    drawn : columns of the curves
    """

    step: str
    series: Series
    endings: tuple[str, ...]
    units: tuple[str, ...]
    statistics: tuple[str, ...]
    curve: str
    factor: Array
    drawn: tuple[int, ...]


def all_drawn(
    step: str,
    series: Series,
    ending: str,
    unit: str,
    statistics: tuple[str, ...],
    curve: str,
    factor: float = 1.0,
) -> Signals:
    """Columns of one unit that are all drawn."""
    count = len(series.names)
    return Signals(
        step, series, (ending,) * count, (unit,) * count, statistics, curve, np.full(count, factor), tuple(range(count))
    )


def statistics_of(values: Array, axis: int = 0) -> dict[str, Array]:
    """`EXTREMES` of values along an axis, NaN where none is known."""
    known = np.isfinite(values)
    some = known.any(axis=axis)
    low = np.where(some, np.min(np.where(known, values, np.inf), axis=axis), np.nan)
    high = np.where(some, np.max(np.where(known, values, -np.inf), axis=axis), np.nan)
    count = np.maximum(known.sum(axis=axis), 1)
    mean = np.where(some, np.where(known, values, 0.0).sum(axis=axis) / count, np.nan)
    return {"minimum": low, "maximum": high, "range": high - low, "mean": mean}
