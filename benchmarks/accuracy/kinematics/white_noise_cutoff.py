"""The default cutoff as it was before there was a noise model: noise white up to half the rate.

Written down here once more, so that tables can say what the change was worth.
"""

from __future__ import annotations

import numpy as np
import scipy

import myomorph as mm
from myomorph.core.model.arrays import Array, runs

CHANCE = 0.02  # Chance that noise alone is taken for motion at any frequency of a coordinate
ENOUGH = 0.01  # Squared error over square of accelerations that counts as none
HARMONICS = 3.0  # Highest cutoff over the frequency of the movement
SLOWEST = 2.0  # Lowest cutoff [Hz]
MOVING = 0.05  # Smallest movement that counts, over the largest
SMOOTH = 0.2  # Accelerations above the cutoff over those below it, up to which nothing is filtered
NOISELESS = 0.002  # Accelerations of noise over those of the motion, up to which neither
MIN_FRAMES = 30
MAX_FRAMES = 4096


def white_noise_cutoff(motion: mm.Motion) -> float | None:
    """Choose a cutoff from the longest run of frames without gaps.

    Returns
    -------
    [Hz], None for no filter
    """
    seen = np.isfinite(motion.values).all(axis=1)
    start, stop = max(runs(seen), key=lambda run: run[1] - run[0], default=(0, 0))
    start = max((start + stop - MAX_FRAMES) // 2, start)
    stop = min(start + MAX_FRAMES, stop)
    if stop - start < MIN_FRAMES:
        return None
    time = np.linspace(motion.time[start], motion.time[stop - 1], stop - start)
    spline = scipy.interpolate.CubicSpline(motion.time[start:stop], motion.values[start:stop])
    values = spline(time)
    size = values.std(axis=0)
    values = values[:, size > MOVING * size.max()] if size.max() > 0.0 else values[:, :0]
    rate = (len(time) - 1) / (time[-1] - time[0])
    frequency, power, noise = _spectra(values, rate)
    signal = np.where(power > np.log(len(power) / CHANCE) * noise, power - noise, 0.0)
    moved = signal.sum(axis=0) > 0.0
    if not moved.any():
        return None
    return _least(frequency, power[:, moved], signal[:, moved], noise[:, moved], rate)


def _spectra(values: Array, rate: float) -> tuple[Array, Array, Array]:
    """Frequencies (n,) [Hz]; power of accelerations and of white noise in them (n, columns)."""
    bent = np.diff(values, 2, axis=0)
    bent = (bent - bent.mean(axis=0)) * np.hanning(len(bent) + 2)[1:-1, None]
    turn = np.fft.rfftfreq(len(bent))[1:]
    power = np.abs(np.fft.rfft(bent, axis=0)[1:]) ** 2
    shape = (2.0 - 2.0 * np.cos(2.0 * np.pi * turn)) ** 2
    half = len(turn) // 2
    level = np.median(power[half:] / shape[half:, None], axis=0) / np.log(2.0)
    return turn * rate, power, shape[:, None] * level


def _least(
    frequency: Array, power: Array, signal: Array, noise: Array, rate: float
) -> float | None:
    """Cutoff of the least geometric mean of relative errors of accelerations [Hz]."""
    if np.median(np.sqrt(noise.sum(axis=0) / signal.sum(axis=0))) < NOISELESS:
        return None
    tried = np.geomspace(0.001, 0.49, 240) * rate
    gain = 1.0 / (1.0 + (frequency[:, None] / tried) ** 6)
    errors = (signal.T @ (1.0 - gain) ** 2 + noise.T @ gain**2) / signal.sum(axis=0)[:, None]
    least = float(tried[np.log(errors + ENOUGH).mean(axis=0).argmin()])
    passed = np.maximum(power - noise, 0.0) / (1.0 + (frequency[:, None] / least) ** 6) ** 2
    share = np.cumsum(passed / frequency[:, None] ** 2, axis=0)
    speed = np.median([np.interp(0.85 * column[-1], column, frequency) for column in share.T])
    cutoff = max(min(least, HARMONICS * float(speed)), SLOWEST)
    kept = 1.0 / (1.0 + (frequency[:, None] / cutoff) ** 6)
    above = (power * (1.0 - kept) ** 2).sum(axis=0) / (power * kept**2).sum(axis=0)
    return cutoff if float(np.median(np.sqrt(above))) > SMOOTH else None
