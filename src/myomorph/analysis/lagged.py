"""Which of many signals go together, how far one follows the other, and whether that can be chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from myomorph.analysis.permutations import benjamini_hochberg
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.series import Series

MOST_SAMPLES = 2048


@dataclass(frozen=True)
class LagOptions:
    """How signals are compared.

    Attributes
    ----------
    lag : searched to both sides [s]; a shorter one in recordings under eight times that
    discoveries : share of the pairs called related that may be so by chance (Benjamini and Hochberg 1995)
    """

    lag: float = 0.5
    discoveries: float = 0.05

    def __post_init__(self) -> None:
        if not (self.lag >= 0.0 and 0.0 < self.discoveries < 1.0):
            raise BadData(f"lag {self.lag:g} s, discoveries {self.discoveries:g}: expected 0 or more, and 0 to 1")


@read_only
@dataclass(frozen=True, eq=False)
class Correlations:
    """Every signal of one set with every signal of another.

    Attributes
    ----------
    rows, columns : names
    values : (rows, columns) correlation at the best lag, nan where one of the two does not vary
    lags : (rows, columns) by which the row's signal comes after the column's [s]
    freedom : (rows, columns) effective number of independent samples, the mean taken off
    chance : (rows, columns) probability of so high a correlation somewhere among the lags without relation
    related : (rows, columns) whether chance is small enough, all pairs taken together
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Array
    lags: Array
    freedom: Array
    chance: Array
    related: np.ndarray


def correlate(rows: Series, columns: Series, options: LagOptions | None = None) -> Correlations:
    """Correlation of every row with every column at the lag where it is strongest.

    Samples of a motion are not independent: two slow signals correlate by chance. Of two unrelated ones with the
    periodograms P_x(f), P_y(f) only d = 2 sum P_x sum P_y / sum P_x P_y dimensions count, which is Bartlett's (1935)
    effective number of samples written over frequencies, the mean taken off. Student's t with d - 1 degrees of freedom
    gives the chance at one lag; the best one is the best of 1 + 4 d lag / duration, as made signals show.

    Parameters
    ----------
    rows, columns : signals (frames, n) on their own clocks; what both cover is compared

    References
    ----------
    Bartlett MS (1935), J R Stat Soc 98:536-543. Benjamini Y, Hochberg Y (1995), J R Stat Soc B 57:289-300.
    """
    options = options or LagOptions()
    shape = (len(rows.names), len(columns.names))
    start, stop = max(rows.time[0], columns.time[0]), min(rows.time[-1], columns.time[-1])
    count = min(MOST_SAMPLES, len(rows), len(columns))
    if stop <= start or count < 16:
        unknown = np.full(shape, np.nan)
        return Correlations(
            rows.names, columns.names, unknown, unknown, unknown, unknown, np.zeros(shape, dtype=np.bool_)
        )
    even = np.linspace(start, stop, count)
    x, y = _standard(rows, even), _standard(columns, even)
    step = float(even[1] - even[0])
    reach = int(min(options.lag, (stop - start) / 8.0) / step)
    values, best = _strongest(x, y, reach)
    freedom = _freedom(x, y)
    single = _chance(values, freedom)
    tries = 1.0 + 4.0 * reach / count * freedom
    chance = -np.expm1(tries * np.log1p(-np.minimum(single, 1.0 - 1e-12)))
    chance[np.isnan(values)] = np.nan
    related = discovered(chance, options.discoveries)
    return Correlations(rows.names, columns.names, values, best * step, freedom, chance, related)


def _standard(series: Series, even: Array) -> Array:
    """Columns at even times, of mean 0 and variance 1; NaN where one does not vary or is unknown somewhere."""
    result = np.full((len(even), len(series.names)), np.nan)
    for index, column in enumerate(series.values.T):
        known = np.isfinite(column)
        if known.mean() > 0.8 and known.sum() > 1:
            values = np.interp(even, series.time[known], column[known])
            spread = float(values.std())
            if spread > 1e-9 * float(np.abs(values).max()):
                result[:, index] = (values - values.mean()) / spread
    return result


def _strongest(x: Array, y: Array, reach: int) -> tuple[Array, Array]:
    """Correlation of greatest size (rows, columns) and its lag [samples]; of two alike the smaller lag."""
    shape = (x.shape[1], y.shape[1])
    values, best = np.zeros(shape), np.zeros(shape)
    values[np.isnan(x[0])], values[:, np.isnan(y[0])] = np.nan, np.nan
    for lag in sorted(range(-reach, reach + 1), key=abs):
        a, b = (x[lag:], y[: len(y) - lag]) if lag >= 0 else (x[:lag], y[-lag:])
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        size = np.sqrt(np.outer((a**2).sum(axis=0), (b**2).sum(axis=0)))
        found = a.T @ b / np.maximum(size, 1e-12)
        better = np.abs(found) > np.abs(values) + 1e-12
        values[better], best[better] = found[better], lag
    return values, best


def _freedom(x: Array, y: Array) -> Array:
    """Effective dimension of the pair (rows, columns), between 1 and the number of samples less one."""
    count = len(x)
    powers = [np.abs(np.fft.rfft(np.nan_to_num(one), axis=0)[1:]) ** 2 for one in (x, y)]
    if count % 2 == 0:
        for power in powers:
            power[-1] *= 0.5
    totals = [one.sum(axis=0) for one in powers]
    shared = powers[0].T @ powers[1]
    return np.clip(2.0 * np.outer(*totals) / np.maximum(shared, 1e-300), 1.0, count - 1.0)


def _chance(values: Array, freedom: Array) -> Array:
    """Two-sided probability of a correlation of that size at one lag."""
    degrees = np.maximum(freedom - 1.0, 0.1)
    square = np.clip(np.nan_to_num(values) ** 2, 0.0, 1.0 - 1e-12)
    return 2.0 * stdtr(degrees, -np.sqrt(degrees * square / (1.0 - square)))


def discovered(chance: Array, share: float) -> np.ndarray:
    """Pairs that stay within the share of false discoveries, by Benjamini and Hochberg's step."""
    return np.asarray(benjamini_hochberg(chance.ravel()).reshape(chance.shape) <= share)


FEWEST_CYCLES = 4


@read_only
@dataclass(frozen=True, eq=False)
class Locking:
    """Signals against the periods of a reference.

    Attributes
    ----------
    names : of the signals
    cycles : how many whole periods there are
    strength : (names,) 1 where a signal's wave stands at the same phase in every period, near 0 where anywhere;
        nan where it does not vary
    delay : (names,) by which its wave comes after the reference's, as a share of the period, 0 to 1
    chance : (names,) probability of such strength for phases that are anywhere
    locked : (names,) whether chance is small enough, all signals taken together
    """

    names: tuple[str, ...]
    cycles: int
    strength: Array
    delay: Array
    chance: Array
    locked: np.ndarray


def lock(signals: Series, reference: Series, period: float, share: float = 0.05) -> Locking | None:
    """Phase of the wave of one period in every period of the recording, relative to that of the reference.

    c = sum (x - line) exp(-2 pi i t / period) over one period; strength R = |sum_k exp(i theta_k)| / n of the n
    differences theta_k of phase. Phases that are anywhere reach R with the probability
    exp(sqrt(1 + 4 n + 4 n^2 (1 - R^2)) - 1 - 2 n) (Rayleigh's test as Zar 1999 gives it).

    Parameters
    ----------
    signals : (frames, names)
    reference : one column, which repeats
    share : of the signals called locked that may be so by chance

    Returns
    -------
    None with fewer than `FEWEST_CYCLES` periods

    References
    ----------
    Zar JH (1999), Biostatistical Analysis, 4th ed., equation 27.4.
    """
    start = max(signals.time[0], reference.time[0])
    stop = min(signals.time[-1], reference.time[-1])
    count = int((stop - start) / period + 1e-6) if period > 0.0 and np.isfinite(period) else 0
    if count < FEWEST_CYCLES:
        return None
    waves = _waves(signals, start, period, count)
    against = _waves(reference, start, period, count)[:, :1]
    turns = waves * np.conj(against)
    size = np.abs(turns)
    known = (size > 1e-12 * np.nanmax(size, initial=1e-300)).all(axis=0) & np.isfinite(size).all(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known, (turns / size).mean(axis=0), np.nan)
    strength = np.abs(mean)
    inner = 1.0 + 4.0 * count + 4.0 * count**2 * (1.0 - np.minimum(strength, 1.0) ** 2)
    chance = np.minimum(1.0, np.exp(np.sqrt(inner) - 1.0 - 2.0 * count))
    delay = np.mod(-np.angle(mean) / (2.0 * np.pi), 1.0)
    return Locking(signals.names, count, strength, delay, chance, discovered(chance, share))


def _waves(series: Series, start: float, period: float, count: int) -> NDArray[np.complex128]:
    """Amplitude of the wave of one period (count, names), complex, every period less its own straight line."""
    samples = 64
    phase = (np.arange(samples) + 0.5) / samples
    turn = np.exp(-2.0j * np.pi * phase) * 2.0 / samples
    line = np.stack([np.ones(samples), phase], axis=1)
    off = np.eye(samples) - line @ np.linalg.pinv(line)
    result = np.empty((count, len(series.names)), dtype=np.complex128)
    for index in range(count):
        time = start + (index + phase) * period
        values = np.stack([np.interp(time, series.time, column) for column in series.values.T], axis=1)
        result[index] = turn @ off @ values
    return result
