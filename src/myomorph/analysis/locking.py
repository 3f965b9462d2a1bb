"""Which signals keep the rhythm of another: their phase in every one of its periods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.analysis.lagged import discovered
from myomorph.model.arrays import Array
from myomorph.model.series import Series

FEWEST_CYCLES = 4


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
    found = np.empty((count, len(series.names)), dtype=np.complex128)
    for k in range(count):
        time = start + (k + phase) * period
        values = np.stack([np.interp(time, series.time, column) for column in series.values.T], axis=1)
        found[k] = turn @ off @ values
    return found
