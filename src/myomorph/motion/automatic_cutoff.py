"""The cutoff of the low-pass filter where nobody gives one: what the motion itself needs."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.series import Motion
from myomorph.motion.filters import differentiate, natural_spline

SHARE = 0.998
"""Share of a coordinate's variance that is to pass; docs/decisions/0003 says by which measured forces it was chosen."""

MOVING = 0.05
"""Coordinates that move less, by standard deviation over that of the one that moves most, are not asked."""

NOISE = 1.0
"""Accelerations above the cutoff by those below it, over which the motion is taken as not filtered before."""

SHORTEST, LONGEST = 30, 4096
"""Frames in a row without a gap: fewer tell no spectrum, and of more the middle ones are enough."""

_FOUND: WeakKeyDictionary[Motion, float | None] = WeakKeyDictionary()
"""Of motions that still exist: coordinates, external forces and what is printed ask for the same one."""


def automatic_cutoff(motion: Motion) -> float | None:
    """The cutoff that a motion needs before it is differentiated, None where it is smooth already.

    It is the frequency below which 99.8 % of the variance of a coordinate lies, white noise taken off, the median over
    those that move. A motion whose accelerations lie below it for the most part is smooth, and filtering it again takes
    motion away.

    Source: Winter 2009, section 3.4.4.2, for the harmonics that hold 99.7 % of the power of walking.

    Parameters
    ----------
    motion : coordinates (frames, coordinates) [rad or m], NaN in gaps

    Returns
    -------
    cutoff [Hz], for `differentiate`; None where there is nothing to filter, or too little to tell
    """
    if motion not in _FOUND:
        _FOUND[motion] = _cutoff(motion)
    return _FOUND[motion]


def _cutoff(motion: Motion) -> float | None:
    seen = np.all(np.isfinite(motion.values), axis=1)
    part = max((slice(*ends) for ends in runs(seen)), key=lambda share: share.stop - share.start, default=slice(0, 0))
    if part.stop - part.start < SHORTEST:
        return None
    start = max((part.start + part.stop - LONGEST) // 2, part.start)
    part = slice(start, min(start + LONGEST, part.stop))
    frequency, spectra = _spectra(motion.time[part], motion.values[part])
    if not spectra.size:
        return None
    passed = np.cumsum(spectra, axis=0)
    cutoffs = [float(np.interp(SHARE, share, frequency)) for share in passed.T]
    cutoff = max(float(np.median(cutoffs)), float(frequency[1]))
    return cutoff if _noise(motion, part, cutoff) > NOISE else None


def _spectra(time: Array, values: Array) -> tuple[Array, Array]:
    """Frequencies (n,) [Hz], and the share of each in the variance (n, coordinates) of the coordinates that move."""
    step = np.diff(time)
    if step.max() - step.min() >= 1e-3 * step.mean():
        even = np.linspace(time[0], time[-1], len(time))
        time, values = even, natural_spline(time, values)(even)
    # The line between the ends would repeat as a jump.
    across = np.linspace(0.0, 1.0, len(time))[:, None]
    bent = values - (values[0] + across * (values[-1] - values[0]))
    size = bent.std(axis=0)
    bent = bent[:, size > MOVING * size.max()] if size.max() > 0.0 else bent[:, :0]
    power = np.abs(np.fft.rfft(bent, axis=0)[1:]) ** 2
    # White noise is as strong in the upper half, where no body moves, as elsewhere.
    power = np.maximum(power - power[len(power) // 2 :].mean(axis=0), 0.0)
    frequency = np.fft.rfftfreq(len(time), (time[-1] - time[0]) / (len(time) - 1))
    zero = np.zeros((1, bent.shape[1]))
    return frequency, np.concatenate([zero, power / power.sum(axis=0)])


def _noise(motion: Motion, part: slice, cutoff: float) -> float:
    """Accelerations above the cutoff by those below it, the median over coordinates that accelerate at all."""
    piece = Motion(motion.time[part], motion.names, motion.values[part])
    raw, kept = differentiate(piece).accelerations, differentiate(piece, cutoff).accelerations
    assert raw is not None
    assert kept is not None
    inner = slice(5, -5)  # ends of splines are not the motion's
    below = np.sqrt(np.mean(kept[inner] ** 2, axis=0))
    above = np.sqrt(np.mean((raw - kept)[inner] ** 2, axis=0))
    moving = below > 1e-6 * below.max(initial=0.0)
    return float(np.median(above[moving] / below[moving])) if moving.any() else 0.0
