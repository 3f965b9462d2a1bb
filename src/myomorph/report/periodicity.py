"""Whether a signal repeats, after how long, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from myomorph.model.errors import BadData
from myomorph.model.spatial import Array

MOST_SAMPLES = 4096


@dataclass(frozen=True)
class PeriodOptions:
    """What counts as a period.

    Attributes
    ----------
    confidence : a period is named from here on, 0 to 1
    likeness : and where the signal correlates so much with itself one period later
    cycles : and where at least so many are in the recording
    first : the first repetition within this share of the best one is the period, not a multiple of it
        (McLeod and Wyvill 2005)
    """

    confidence: float = 0.95
    likeness: float = 0.4
    cycles: float = 2.0
    first: float = 0.85

    def __post_init__(self) -> None:
        if self.cycles < 2.0:
            raise BadData(f"a period from {self.cycles:g} cycles: expected 2 or more, or nothing is repeated")


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


NONE = Periodicity(float("nan"), 0.0, 0.0, 0.0, False)


def find_period(time: Array, values: Array, options: PeriodOptions | None = None) -> Periodicity:
    """Period of a signal by its autocorrelation, less its straight line.

    r(k) = 2 sum x_t x_(t+k) / sum (x_t^2 + x_(t+k)^2)  is 1 for k = 0 and for a multiple of a period (McLeod and
    Wyvill 2005). Its first high maximum after it left its first lobe is the candidate. A signal that forgets itself
    after that lobe has r(k) of variance (1 + 2 sum_(j < lobe) r(j)^2) / (n - k) there (Bartlett 1946); the chance that
    one of as many independent lags as were searched is so high gives the confidence.

    Parameters
    ----------
    time, values : (frames,) ascending [s]; up to a fifth of the values may be NaN and are filled by straight lines

    References
    ----------
    Bartlett MS (1946), J R Stat Soc Suppl 8:27-41. McLeod P, Wyvill G (2005), Proc Int Comput Music Conf, 138-141.
    """
    options = options or PeriodOptions()
    sampled = _evenly(time, values)
    if sampled is None:
        return NONE
    step, signal = sampled
    count = len(signal)
    likeness, pairs = _autocorrelation(signal)
    longest = int(count / options.cycles)
    lobe = int(np.argmax(likeness[:longest] <= 0.0))
    if lobe == 0:
        return NONE
    searched = likeness[lobe : longest + 1]
    inner = np.flatnonzero((searched[1:-1] >= searched[:-2]) & (searched[1:-1] > searched[2:])) + 1 + lobe
    if not len(inner) or likeness[inner].max() <= 0.0:
        return NONE
    lag = int(inner[np.argmax(likeness[inner] >= options.first * likeness[inner].max())])
    memory = 1.0 + 2.0 * float(np.sum(likeness[1:lobe] ** 2))
    score = float(likeness[lag]) / np.sqrt(memory / pairs[lag])
    tries = max(1.0, (longest - lobe) / memory)
    confidence = float(ndtr(score) ** tries)
    period = step * _refined(likeness, lag, longest)
    duration = step * (count - 1)
    high = float(likeness[lag])
    sure = confidence >= options.confidence and high >= options.likeness
    return Periodicity(period, duration / period, high, confidence, sure)


def _evenly(time: Array, values: Array) -> tuple[float, Array] | None:
    """Step and values at even times, straight line taken off; None where too few are known or none differs."""
    known = np.isfinite(values)
    if known.sum() < 8 or known.mean() < 0.8:
        return None
    time, values = time[known], values[known]
    count = min(len(time), MOST_SAMPLES)
    even = np.linspace(time[0], time[-1], count)
    signal = np.interp(even, time, values)
    line = np.polynomial.polynomial.polyfit(even - even[0], signal, 1)
    scale = float(np.ptp(signal)) + float(np.abs(signal).max())
    signal = signal - line[0] - line[1] * (even - even[0])
    if float(np.ptp(signal)) <= 1e-9 * scale:
        return None
    return float(even[1] - even[0]), signal


def _autocorrelation(signal: Array) -> tuple[Array, Array]:
    """r(k) of `find_period` for every lag, and how many pairs of values it compares."""
    count = len(signal)
    spectrum = np.fft.rfft(signal, 2 * count)
    products = np.fft.irfft(np.abs(spectrum) ** 2)[:count]
    squares = np.concatenate([[0.0], np.cumsum(signal**2)])
    lags = np.arange(count)
    energy = squares[count - lags] + squares[count] - squares[lags]
    return 2.0 * products / np.maximum(energy, 1e-300), (count - lags).astype(np.float64)


def _refined(likeness: Array, lag: int, longest: int) -> float:
    """A lag between samples, from the last repetition that still stands out: m periods divided by m."""
    best = _vertex(likeness, lag)
    multiple = 2
    while (multiple + 0.5) * best < longest:
        middle, reach = multiple * best, 0.25 * best
        low, high = int(middle - reach), int(middle + reach) + 1
        peak = low + int(np.argmax(likeness[low : high + 1]))
        if peak in (low, high) or likeness[peak] < 0.5 * likeness[lag]:
            break
        best = _vertex(likeness, peak) / multiple
        multiple += 1
    return best


def _vertex(values: Array, k: int) -> float:
    """Place of the maximum of the parabola through three neighbours."""
    if not 0 < k < len(values) - 1:
        return float(k)
    before, here, after = values[k - 1 : k + 2]
    bend = before - 2.0 * here + after
    return float(k + 0.5 * (before - after) / bend) if bend < 0.0 else float(k)
