"""Curves over the cycle: what a signal does from strike to strike, its mean and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t as student

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.series import Series

SAMPLES = 101
LONGEST_GAP = 0.1
"""Of a signal within a cycle, as a share of it, that a line may cross."""


@dataclass(frozen=True, eq=False)
class Cycles:
    """Signals of many cycles, each from 0 to 100 %.

    Attributes
    ----------
    names : of the signals
    values : (cycles, samples, names), NaN where not known
    """

    names: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen_array(self.values, (-1, -1, len(self.names))))

    @property
    def percent(self) -> Array:
        """(samples,) of the cycle [%]."""
        return np.linspace(0.0, 100.0, self.values.shape[1])


@dataclass(frozen=True, eq=False)
class Band:
    """A mean curve with its interval.

    Attributes
    ----------
    mean, low, high : (samples, ...); the limits are NaN with fewer than two curves
    spread : (samples, ...) population standard deviation of the curves
    count : (samples, ...) curves that are known there
    """

    mean: Array
    low: Array
    high: Array
    spread: Array
    count: Array


def over_cycles(series: Series, spans: Sequence[tuple[float, float]], samples: int = SAMPLES) -> Cycles:
    """Signals resampled over cycles by straight lines between frames.

    Parameters
    ----------
    series : values (frames, names), NaN where not known
    spans : start and end of each cycle [s]; a part outside of the series is NaN

    Raises
    ------
    BadData : a span that does not go forward, or signals that are vectors
    """
    if series.values.ndim != 2:
        raise BadData(f"curves over the cycle are of single numbers, but these have shape {series.values.shape}")
    values = np.full((len(spans), samples, len(series.names)), np.nan)
    known = np.isfinite(series.values).all(axis=0)
    for k, (start, stop) in enumerate(spans):
        if not stop > start:
            raise BadData(f"a cycle from {start:g} to {stop:g} s does not go forward")
        at = np.linspace(start, stop, samples)
        # Columns without gaps share their places in time, and are done together.
        values[k][:, known] = _between(series.time, series.values[:, known], at)
        for j in np.flatnonzero(~known):
            values[k, :, j] = _resampled(series.time, series.values[:, j], at)
    return Cycles(series.names, values)


def _resampled(time: Array, values: Array, at: Array) -> Array:
    known = np.isfinite(values)
    return _between(time[known], values[known, None], at, float(np.median(np.diff(time))))[:, 0]


def _between(time: Array, values: Array, at: Array, step: float = np.nan) -> Array:
    """Values (frames, n), all known, by straight lines at other times (samples, n); NaN outside and in long gaps."""
    if len(time) < 2:
        return np.full((len(at), values.shape[1]), np.nan)
    step = step if np.isfinite(step) else float(np.median(np.diff(time)))
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    span = time[after] - time[after - 1]
    share = ((at - time[after - 1]) / span)[:, None]
    found: Array = values[after - 1] + share * (values[after] - values[after - 1])
    apart = np.where(time[after] == at, 0.0, span)
    hidden = (apart > max(LONGEST_GAP * (at[-1] - at[0]), 1.5 * step)) | (at < time[0]) | (at > time[-1])
    found[hidden] = np.nan
    return found


def band(curves: ArrayLike, confidence: float = 0.95) -> Band:
    """Mean of curves (curves, samples, ...) and its interval by Student's t, sample by sample."""
    curves = np.asarray(curves, dtype=np.float64)
    known = np.isfinite(curves)
    count = known.sum(axis=0)
    filled = np.where(known, curves, 0.0)
    mean = np.where(count > 0, filled.sum(axis=0) / np.maximum(count, 1), np.nan)
    squares = (np.where(known, curves - mean, 0.0) ** 2).sum(axis=0)
    freedom = np.maximum(count - 1, 1)
    error = np.sqrt(squares / freedom / np.maximum(count, 1))
    half = np.where(count > 1, student.ppf(0.5 + 0.5 * confidence, freedom) * error, np.nan)
    spread = np.where(count > 0, np.sqrt(squares / np.maximum(count, 1)), np.nan)
    return Band(mean, mean - half, mean + half, spread, count.astype(np.float64))
