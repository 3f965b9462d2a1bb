"""Which of many signals correlate, and whether that can be chance."""

from __future__ import annotations

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Series
from myomorph.lab.analysis.permutations import benjamini_hochberg

MAX_SAMPLES = 2048
MIN_SAMPLES = 16
MIN_KNOWN = 0.8  # Share of a signal's samples that must be known for a correlation
FALSE_DISCOVERIES = 0.05  # Share of the pairs called significant that may be so by chance


@read_only
class Correlations:
    """Every signal of one set with every signal of another.

    Attributes
    ----------
    rows, columns : names
    values : (rows, columns) correlation, NaN where one of the two does not vary
    freedom : (rows, columns) effective number of independent samples, the mean taken off
    chance : (rows, columns) probability of so high a correlation of unrelated signals
    significant : (rows, columns) whether that is small enough, all pairs taken together
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Array
    freedom: Array
    chance: Array
    significant: np.ndarray


def correlate(rows: Series, columns: Series) -> Correlations:
    """Correlation of every row with every column.

    Samples of a motion are not independent: two slow signals correlate by chance. Of two unrelated
    ones with the periodograms P_x(f), P_y(f) only d = 2 sum P_x sum P_y / sum P_x P_y dimensions
    count, which is Bartlett's (1935) effective number of samples written over frequencies, the mean
    taken off. Student's t with d - 1 degrees of freedom gives the chance.

    Parameters
    ----------
    rows, columns : signals (frames, n) on their own clocks; what both cover is compared

    Returns
    -------
    correlations (rows, columns), their effective degrees of freedom and chances

    Raises
    ------
    ValueError : a series has no frame

    References
    ----------
    Bartlett MS (1935), J R Stat Soc 98:536-543. Benjamini Y, Hochberg Y (1995), J R Stat Soc B
    57:289-300.

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> result = mm.correlate(motion, mm.inverse_dynamics(model, motion))
    >>> result.rows, result.values.shape
    (('shoulder_flexion', 'elbow_flexion'), (2, 2))
    """
    start = max(rows.time[0], columns.time[0])
    stop = min(rows.time[-1], columns.time[-1])
    count = min(MAX_SAMPLES, len(rows), len(columns))
    if stop <= start or count < MIN_SAMPLES:
        unknown = np.full((len(rows.names), len(columns.names)), np.nan)
        return Correlations(
            rows=rows.names,
            columns=columns.names,
            values=unknown,
            freedom=unknown,
            chance=unknown,
            significant=np.zeros(unknown.shape, np.bool_),
        )
    even = np.linspace(start, stop, count)
    x = _standard(rows, even)
    y = _standard(columns, even)
    values = x.T @ y / count
    freedom = _freedom(x, y)
    degrees = np.maximum(freedom - 1.0, 0.1)
    square = np.clip(np.nan_to_num(values) ** 2, 0.0, 1.0 - 1e-12)
    tails = scipy.special.stdtr(degrees, -np.sqrt(degrees * square / (1.0 - square)))
    chance = np.where(np.isnan(values), np.nan, 2.0 * tails)
    significant = benjamini_hochberg(chance.ravel()).reshape(chance.shape) <= FALSE_DISCOVERIES
    return Correlations(
        rows=rows.names,
        columns=columns.names,
        values=values,
        freedom=freedom,
        chance=chance,
        significant=np.asarray(significant),
    )


def _standard(series: Series, even: Array) -> Array:
    """Sample columns at even times and scale them to mean 0 and variance 1.

    A column that does not vary or is unknown too often is NaN.
    """
    result = np.full((len(even), len(series.names)), np.nan)
    for index, column in enumerate(series.values.T):
        known = np.isfinite(column)
        if known.mean() > MIN_KNOWN and known.sum() > 1:
            values = np.interp(even, series.time[known], column[known])
            spread = float(values.std())
            if spread > 1e-9 * float(np.abs(values).max()):
                result[:, index] = (values - values.mean()) / spread
    return result


def _freedom(x: Array, y: Array) -> Array:
    """Estimate the effective dimension of the pair (rows, columns).

    It lies between 1 and the number of samples less one.
    """
    count = len(x)
    powers = [np.abs(np.fft.rfft(np.nan_to_num(signals), axis=0)[1:]) ** 2 for signals in (x, y)]
    if count % 2 == 0:
        for power in powers:
            power[-1] *= 0.5
    totals = [power.sum(axis=0) for power in powers]
    shared = powers[0].T @ powers[1]
    return np.clip(2.0 * np.outer(*totals) / np.maximum(shared, 1e-300), 1.0, count - 1.0)
