"""Cycles: curves over the cycle and their mean, and repetition of a signal.

Of a repetition the period is found, and how certain it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.cycle_samples import SAMPLES, over_spans
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Series
from myomorph.core.model.shown import shown

MAX_SAMPLES = 4096
MIN_KNOWN = 0.5


@dataclass(frozen=True)
class PeriodOptions:
    """What counts as a period.

    Attributes
    ----------
    confidence : a period is named from here on, 0 to 1
    likeness : and where the signal correlates so much with itself one period later
    cycles : and where at least so many are in the recording
    first : the first repetition within this share of the best one is the period, not a multiple of
        it (McLeod and Wyvill 2005)
    """

    confidence: float = 0.95
    likeness: float = 0.4
    cycles: float = 2.0
    first: float = 0.85

    def __post_init__(self) -> None:
        if self.cycles < 2.0:
            raise BadData(f"a period from {self.cycles:g} cycles: expected 2 or more")


@shown
@dataclass(frozen=True)
class Periodicity:
    """The best candidate for a period, and whether it is one.

    Attributes
    ----------
    period : [s], nan where the signal does not even rise again
    cycles : how many fit the recording
    likeness : correlation of the signal with itself one period later, -1 to 1
    confidence : one minus the chance that a signal which does not repeat looks so alike somewhere
    periodic : whether that passes the limits of `PeriodOptions`
    """

    period: float
    cycles: float
    likeness: float
    confidence: float
    periodic: bool


NONE = Periodicity(period=float("nan"), cycles=0.0, likeness=0.0, confidence=0.0, periodic=False)


def find_period(time: Array, values: Array, options: PeriodOptions | None = None) -> Periodicity:
    """Period of a signal by its autocorrelation, less its straight line.

    r(k) = 2 sum x_t x_(t+k) / sum (x_t^2 + x_(t+k)^2)  is 1 for k = 0 and for a multiple of a
    period (McLeod and Wyvill 2005). Its first high maximum after it left its first lobe is the
    candidate. A signal that forgets itself after that lobe has r(k) of variance (1 + 2 sum_(j <
    lobe) r(j)^2) / (n - k) there (Bartlett 1946); the chance that one of as many independent lags
    as were searched is so high gives the confidence.

    Parameters
    ----------
    time, values : (frames,) ascending [s]; values that are NaN are left out, up to half of them
    options : lengths that are searched [s] and what is asked of a period; see `PeriodOptions`

    Returns
    -------
    the period [s], whether there is one, and with what confidence

    Raises
    ------
    Nothing: too few values, or a signal that does not repeat, give `periodic` False

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> time = np.arange(0.0, 10.0, 0.02)
    >>> found = mm.find_period(time, np.sin(2.0 * np.pi * time / 1.25))
    >>> found.periodic, round(float(found.period), 2)
    (True, 1.25)
    """
    options = options or PeriodOptions()
    sampled = _evenly(time, values)
    if sampled is None:
        return NONE
    step, signal, seen = sampled
    count = len(signal)
    likeness, pairs = _autocorrelation(signal, seen)
    longest = int(count / options.cycles)
    lobe = int(np.argmax(likeness[:longest] <= 0.0))
    lag = _repetition(likeness, lobe, longest, options.first) if lobe else None
    if lag is None:
        return NONE
    confidence = _confidence(likeness, lag, lobe, longest, float(pairs[lag]))
    period = step * _refined(likeness, lag, longest)
    duration = step * (count - 1)
    high = float(likeness[lag])
    return Periodicity(
        period=period,
        cycles=duration / period,
        likeness=high,
        confidence=confidence,
        periodic=confidence >= options.confidence and high >= options.likeness,
    )


def _repetition(likeness: Array, lobe: int, longest: int, share: float) -> int | None:
    """Find the lag of the first maximum beyond the lobe that is high beside the highest.

    It is at least `share` of that. None where no maximum is above 0.
    """
    searched = likeness[lobe : longest + 1]
    inner = (
        np.flatnonzero((searched[1:-1] >= searched[:-2]) & (searched[1:-1] > searched[2:]))
        + 1
        + lobe
    )
    if not len(inner) or likeness[inner].max() <= 0.0:
        return None
    first = int(inner[np.argmax(likeness[inner] >= share * likeness[inner].max())])
    # Noise puts small maxima on the shoulder of a wide one.
    return first + int(np.argmax(likeness[first : min(int(1.25 * first), longest) + 1]))


def _confidence(likeness: Array, lag: int, lobe: int, longest: int, pairs: float) -> float:
    """Find the chance that no independent lag of a signal without a period is as high."""
    memory = 1.0 + 2.0 * float(np.sum(likeness[1:lobe] ** 2))
    score = float(likeness[lag]) / np.sqrt(memory / pairs)
    tries = max(1.0, (longest - lobe) / memory)
    return float(scipy.special.ndtr(score) ** tries)


def _evenly(time: Array, values: Array) -> tuple[float, Array, Array] | None:
    """Sample values at even times: step, detrended values and which are known.

    Values are 0 where they are unknown. The result is None where too few are known.
    """
    known = np.isfinite(values)
    if known.sum() < 8 or known.mean() < MIN_KNOWN:
        return None
    count = min(len(time), MAX_SAMPLES)
    even = np.linspace(time[0], time[-1], count)
    seen = np.interp(even, time, known.astype(np.float64)) > 0.5
    signal = np.interp(even, time[known], values[known])
    along = even - even[0]
    line = np.polynomial.polynomial.polyfit(along[seen], signal[seen], 1)
    scale = float(np.ptp(signal)) + float(np.abs(signal).max())
    signal = np.where(seen, signal - line[0] - line[1] * along, 0.0)
    if float(np.ptp(signal)) <= 1e-9 * scale:
        return None
    return float(even[1] - even[0]), signal, seen.astype(np.float64)


def _autocorrelation(signal: Array, seen: Array) -> tuple[Array, Array]:
    """r(k) of `find_period` for every lag, and how many pairs of values it compares."""
    size = 1 << (2 * len(signal) - 1).bit_length()  # A power of two needs no import of scipy.fft.
    wave, square, mask = np.fft.rfft(np.stack([signal, signal**2, seen]), size, axis=1)
    spectra = [np.abs(wave) ** 2, square * np.conj(mask), mask * np.conj(square), np.abs(mask) ** 2]
    products, later, earlier, pairs = np.fft.irfft(np.stack(spectra), size, axis=1)[
        :, : len(signal)
    ]
    return 2.0 * products / np.maximum(later + earlier, 1e-300), np.maximum(pairs, 1.0)


def _refined(likeness: Array, lag: int, longest: int) -> float:
    """Refine a lag to between samples, from the last repetition that still stands out.

    That repetition is m periods late: its lag is divided by m.
    """
    best = _vertex(likeness, lag)
    multiple = 2
    while (multiple + 0.5) * best < longest:
        middle = multiple * best
        reach = 0.25 * best
        low = int(middle - reach)
        high = int(middle + reach) + 1
        peak = low + int(np.argmax(likeness[low : high + 1]))
        if peak in (low, high) or likeness[peak] < 0.5 * likeness[lag]:
            break
        best = _vertex(likeness, peak) / multiple
        multiple += 1
    return best


def _vertex(values: Array, at: int) -> float:
    """Find the position of the maximum of a parabola through the neighborhood of k.

    The neighborhood is a twelfth of k to both sides.
    """
    reach = min(max(1, at // 12), at, len(values) - 1 - at)
    if reach < 1:
        return float(at)
    around = np.arange(-reach, reach + 1)
    _, slope, bend = np.polynomial.polynomial.polyfit(
        around, values[at - reach : at + reach + 1], 2
    )
    return float(at + np.clip(-0.5 * slope / bend, -reach, reach)) if bend < 0.0 else float(at)


@read_only
class Cycles:
    """Signals of many cycles, each from 0 to 100 %."""

    names: tuple[str, ...]  # of the signals
    values: Array  # (cycles, samples, names), NaN where not known

    def __post_init__(self) -> None:
        freeze(self, values=(-1, -1, len(self.names)))

    @property
    def percent(self) -> Array:
        """(samples,) of the cycle [%]."""
        return np.linspace(0.0, 100.0, self.values.shape[1])


@read_only
class Band:
    """A mean curve with its interval."""

    # mean, low, high: (samples, ...); the limits are NaN with fewer than two curves
    mean: Array
    low: Array
    high: Array
    spread: Array  # (samples, ...) population standard deviation of the curves
    count: Array  # (samples, ...) curves that are known there


def over_cycles(
    series: Series, spans: Sequence[tuple[float, float]], samples: int = SAMPLES
) -> Cycles:
    """Resample signals over cycles by straight lines between frames.

    Parameters
    ----------
    series : values (frames, names), NaN where not known
    spans : start and end of each cycle [s]; a part outside of the series is NaN
    samples : of each cycle
    """
    return Cycles(series.names, over_spans(series.time, series.values, spans, samples))


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
    half = np.where(
        count > 1, scipy.special.stdtrit(freedom, 0.5 + 0.5 * confidence) * error, np.nan
    )
    spread = np.where(count > 0, np.sqrt(squares / np.maximum(count, 1)), np.nan)
    return Band(
        mean=mean, low=mean - half, high=mean + half, spread=spread, count=count.astype(np.float64)
    )
