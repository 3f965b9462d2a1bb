"""Tables I and II of [S] by our code.

The paper's own per-specimen figures go through the code that computes a cohort's mean and SD.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.optimize import minimize

from myomorph.core.model.arrays import Array
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.cohort import MEAN, QUANTITIES, SD, SPECIMENS, cohort

Row = dict[str, object]


def measure() -> Iterator[Row]:
    """Yield a row for each column of the tables.

    It has printed mean and SD, ours, and whether rounding of the inputs explains the rest.
    """
    known = [
        {name: Interval(one, np.nan, np.nan) for name, one in row.values.items()}
        for row in SPECIMENS
    ]
    lines = {one.quantity.name: one for one in cohort(known)}
    printed = SPECIMENS[0].values
    for quantity in (one for one in QUANTITIES if one.name in printed):
        line = lines[quantity.name]
        values = np.array([getattr(one, quantity.name) for one in SPECIMENS])
        means, sds = _reachable(values)
        sample = float(values.std(ddof=1))
        yield {
            "column": f"table {'I' * quantity.table}: {quantity.label} [{quantity.unit}]",
            "mean printed": _printed(getattr(MEAN, quantity.name)),
            "mean": f"{line.mean:.4E}",
            "mean agrees": _verdict(getattr(MEAN, quantity.name), line.mean, means),
            "SD printed": _printed(getattr(SD, quantity.name)),
            "SD": f"{line.sd:.4E}",
            "SD agrees": _verdict(getattr(SD, quantity.name), line.sd, sds),
            "SD by n - 1": f"{sample:.2E}",
        }


def _printed(value: float) -> str:
    return f"{value:.2E}"


def _half_unit(value: float) -> float:
    """Half a unit of the third digit, to which the tables are rounded."""
    return float(0.5 * 10.0 ** (np.floor(np.log10(abs(value))) - 2))


def _reachable(values: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Least and largest mean and SD of numbers that are printed as these."""
    halves = np.array([_half_unit(one) for one in values])
    means = float((values - halves).mean()), float((values + halves).mean())
    corners = [
        float(np.std(values + halves * signs)) for signs in product((-1.0, 1.0), repeat=len(values))
    ]
    bounds = list(zip(values - halves, values + halves, strict=True))
    # The SD is convex: its largest value is at a corner, its least where a local search ends.
    scale = float(values.std())
    least = minimize(lambda x: float(np.var(x) / scale**2), values, bounds=bounds, tol=1e-14)
    return means, (float(np.std(least.x)), max(corners))


def _verdict(printed: float, ours: float, reachable: tuple[float, float]) -> str:
    """To the printed digits, or whether inputs rounded to three digits explain the difference."""
    half = _half_unit(printed)
    off = abs(printed - ours) / half
    if abs(off - 1.0) < 1e-6:
        return "yes, at the tie between two digits"
    if off < 1.0:
        return "yes"
    explained = reachable[0] <= printed + half and printed - half <= reachable[1]
    reason = f"inputs so rounded give {reachable[0]:.3E} to {reachable[1]:.3E}"
    return (
        f"no: rounding of the inputs ({reason})" if explained else f"no: not by rounding ({reason})"
    )
