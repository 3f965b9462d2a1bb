"""Columns of a series in numbers: extremes, and an estimate beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.series import Series


@dataclass(frozen=True)
class Comparison:
    """An estimate beside what is known to be true."""

    name: str  # of the column
    # rmse, worst: root mean square and largest difference
    rmse: float
    worst: float
    span: float  # largest minus smallest true value
    correlation: float  # of the two, nan where one does not vary


def compared(estimate: Series, truth: Series) -> list[Comparison]:
    """Columns both have, at the estimate's times, in the truth's order."""
    inside = (estimate.time >= truth.time[0] - 1e-9) & (estimate.time <= truth.time[-1] + 1e-9)
    rows = []
    for name in truth.names:
        if name not in estimate.names or inside.sum() < 2:
            continue
        known = np.interp(estimate.time[inside], truth.time, truth[name])
        estimated = estimate[name][inside]
        both = np.isfinite(known) & np.isfinite(estimated)
        if not both.any():
            continue
        difference = estimated[both] - known[both]
        varies = np.ptp(known[both]) > 1e-12 and np.ptp(estimated[both]) > 1e-12
        correlation = (
            float(np.corrcoef(known[both], estimated[both])[0, 1]) if varies else float("nan")
        )
        rms = float(np.sqrt(np.mean(difference**2)))
        rows.append(
            Comparison(
                name=name,
                rmse=rms,
                worst=float(np.max(np.abs(difference))),
                span=float(np.ptp(known[both])),
                correlation=correlation,
            )
        )
    return rows


@dataclass(frozen=True)
class ExtremesRow:
    """Smallest and largest value of a column, with their times."""

    name: str
    low: float
    low_time: float
    high: float
    high_time: float


def extremes(series: Series, factors: Mapping[str, float] | None = None) -> list[ExtremesRow]:
    """Smallest and largest value of every column, times a factor each."""
    rows = []
    for i, name in enumerate(series.names):
        values = series.values[:, i] * (factors or {}).get(name, 1.0)
        if np.isfinite(values).any():
            low_at = int(np.nanargmin(values))
            high_at = int(np.nanargmax(values))
            rows.append(
                ExtremesRow(
                    name=name,
                    low=float(values[low_at]),
                    low_time=float(series.time[low_at]),
                    high=float(values[high_at]),
                    high_time=float(series.time[high_at]),
                )
            )
    return rows
