"""How a number differs between strides: standard deviation, and interval of the mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.cycles import band

MIN_STRIDES = 5
"""From so many strides on their spread is drawn, and the mean has an interval; below, each stride
is drawn by itself.
"""
LEVEL = 0.9
"""Of the interval of the mean."""


@dataclass(frozen=True, kw_only=True)
class StrideSpread:
    """One number, of each stride of a recording.

    Attributes
    ----------
    mean : over the strides in which it is known
    sd : standard deviation between strides (ddof = 1), nan for fewer than two
    low, high : interval of the mean that holds it in 90 % of recordings, by Student's t for strides
        that do not depend on each other; nan for fewer than `MIN_STRIDES`
    count : strides in which it is known
    """

    mean: float
    sd: float
    low: float
    high: float
    count: int


def stride_spreads(values: Array) -> list[StrideSpread]:
    """Return how numbers differ between strides.

    With n strides, mean m and standard deviation s, the interval of the mean is

        m -+ t(n - 1, 95 %) s / sqrt(n)

    Parameters
    ----------
    values : (strides, numbers), NaN where not known

    Returns
    -------
    one for each number
    """
    limits = band(values, LEVEL)
    count = limits.count
    # The spread of `band` is that of a population.
    with np.errstate(invalid="ignore", divide="ignore"):
        sd = np.where(count > 1, limits.spread * np.sqrt(count / (count - 1.0)), np.nan)
    enough = count >= MIN_STRIDES
    low = np.where(enough, limits.low, np.nan)
    high = np.where(enough, limits.high, np.nan)
    return [
        StrideSpread(mean=mean, sd=deviation, low=lower, high=upper, count=int(number))
        for mean, deviation, lower, upper, number in zip(
            limits.mean.tolist(),
            sd.tolist(),
            low.tolist(),
            high.tolist(),
            count.tolist(),
            strict=True,
        )
    ]


def stride_spread(values: Array) -> StrideSpread:
    """Return how one number differs between strides.

    Parameters
    ----------
    values : (strides,) NaN where not known

    Returns
    -------
    mean, standard deviation and interval of the mean
    """
    return stride_spreads(np.asarray(values, dtype=np.float64)[:, None])[0]
