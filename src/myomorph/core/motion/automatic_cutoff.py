"""The default cutoff of the low-pass filter: what accelerations lose and gain by it."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.series import Motion
from myomorph.core.motion.splines import natural_spline

CHANCE = 0.02  # Chance that noise alone is taken for motion at any frequency of a coordinate
ENOUGH = 0.01
"""Squared error of accelerations over their square, below which a coordinate gains little: a tenth
in amplitude.
"""

SPEED_SHARE = 0.85  # Share of the power of velocities that lies below the frequency of a movement
HARMONICS = 3.0
"""Times the frequency of the movement up to which markers follow bones; docs/decisions/0003 says
how it was chosen.
"""

# Cutoff of the slowest movement [Hz]: of a pose that is held, noise alone is left to judge by
SLOWEST = 2.0
# Coordinates that move less, by standard deviation over that of the one that moves most, do not
# count
MOVING = 0.05
# Accelerations above the cutoff over those below it, up to which the motion is taken as filtered
# before
SMOOTH = 0.2
NOISELESS = 0.002
"""Accelerations of white noise over those of the motion, below which somebody filtered or computed
the motion.
"""

TRIED = np.geomspace(0.001, 0.49, 240)  # Cutoffs that are compared, over the rate of frames
MIN_FRAMES = 30
MAX_FRAMES = 4096
"""Frames in a row without a gap: fewer have no spectrum, and of more the middle ones are enough."""

_KNOWN: WeakKeyDictionary[Motion, float | None] = WeakKeyDictionary()
"""Of motions that still exist: coordinates, external forces and what is printed ask for the same
one.
"""


def automatic_cutoff(motion: Motion) -> float | None:
    """Choose the cutoff that a motion needs before it is differentiated.

    White errors of coordinates are estimated from the upper half of the spectrum, where no body
    moves. A filter H(f) leaves in the accelerations of a coordinate the error

        sum_f S (1 - H)^2 + N H^2

    with the power N of their noise and S = P - N of what stands clearly above it. The cutoff is
    where the geometric mean of this over all coordinates that move is least, but not above three
    times the frequency below which 85 % of the power of their velocities lies: faster than that,
    skin moves on its own.

    Source: Winter 2009, section 3.4.4.3 (signal and noise by cutoff); Woltring 1986 (least expected
    error).

    Parameters
    ----------
    motion : coordinates over time (frames, coordinates) [rad or m], NaN in gaps

    Returns
    -------
    [Hz]; None where the motion is smooth already, or no run of frames is long enough
    """
    if motion not in _KNOWN:
        _KNOWN[motion] = _cutoff(motion)
    return _KNOWN[motion]


def _cutoff(motion: Motion) -> float | None:
    """Choose the cutoff from the longest run of frames without gaps; see `automatic_cutoff`."""
    part = _longest_part(motion)
    frames = part.stop - part.start
    if frames < MIN_FRAMES:
        return None
    frequency, power, noise = _acceleration_spectra(motion.time[part], motion.values[part])
    # Squared amplitudes of noise are distributed exponentially.
    signal = np.where(power > np.log(len(power) / CHANCE) * noise, power - noise, 0.0)
    moved = signal.sum(axis=0) > 0.0
    if not moved.any():
        return None
    signal = signal[:, moved]
    noise = noise[:, moved]
    power = power[:, moved]
    if np.median(np.sqrt(noise.sum(axis=0) / signal.sum(axis=0))) < NOISELESS:
        return None
    tried = TRIED * (frames - 1) / (motion.time[part][-1] - motion.time[part][0])
    gain = _gain(frequency[:, None], tried)
    errors = (signal.T @ (1.0 - gain) ** 2 + noise.T @ gain**2) / signal.sum(axis=0)[:, None]
    least = float(tried[np.log(errors + ENOUGH).mean(axis=0).argmin()])
    cutoff = max(min(least, HARMONICS * _speed(frequency, power - noise, least)), SLOWEST)
    gain = _gain(frequency, cutoff)[:, None]
    above = np.median(
        np.sqrt((power * (1.0 - gain) ** 2).sum(axis=0) / (power * gain**2).sum(axis=0))
    )
    return cutoff if above > SMOOTH else None


def _longest_part(motion: Motion) -> slice:
    """Find the longest run of frames without gaps, of a long one `MAX_FRAMES` in the middle."""
    seen = np.all(np.isfinite(motion.values), axis=1)
    part = max(
        (slice(*ends) for ends in runs(seen)),
        key=lambda share: share.stop - share.start,
        default=slice(0, 0),
    )
    start = max((part.start + part.stop - MAX_FRAMES) // 2, part.start)
    return slice(start, min(start + MAX_FRAMES, part.stop))


def _speed(frequency: Array, power: Array, cutoff: float) -> float:
    """Find the frequency below which most of the velocities' power lies, as the median coordinate.

    Parameters
    ----------
    frequency : (n,) [Hz]
    power : (n, coordinates) of accelerations, the noise's taken off
    cutoff : of the filter [Hz]

    Returns
    -------
    [Hz]
    """
    passed = np.maximum(power, 0.0) * _gain(frequency, cutoff)[:, None] ** 2
    share = np.cumsum(passed / frequency[:, None] ** 2, axis=0)
    speeds = [float(np.interp(SPEED_SHARE * column[-1], column, frequency)) for column in share.T]
    return float(np.median(speeds))


def _gain(frequency: Array, cutoff: Array | float) -> Array:
    """Return the share of an amplitude that `lowpass` leaves: a third-order Butterworth, twice.

        H = 1 / (1 + (f / cutoff)^6)

    Parameters
    ----------
    frequency, cutoff : that broadcast against each other [Hz]

    Returns
    -------
    of their common shape [-]
    """
    gain: Array = 1.0 / (1.0 + (frequency / cutoff) ** 6)
    return gain


def _acceleration_spectra(time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Compute the power of accelerations, and of white noise in them, for coordinates that move.

    Second differences of white noise at steps h have the spectrum (2 - 2 cos(2 pi f h))^2.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, coordinates) [rad or m], without gaps

    Returns
    -------
    frequencies (n,) above zero [Hz], then power of accelerations and power of noise, each (n,
    moving coordinates)
    """
    step = np.diff(time)
    if step.max() - step.min() >= 1e-3 * step.mean():
        even = np.linspace(time[0], time[-1], len(time))
        time, values = even, natural_spline(time, values)(even)
    size = values.std(axis=0)
    values = values[:, size > MOVING * size.max()] if size.max() > 0.0 else values[:, :0]
    bent = np.diff(values, 2, axis=0)
    bent = (bent - bent.mean(axis=0)) * np.hanning(len(bent) + 2)[1:-1, None]
    turn = np.fft.rfftfreq(len(bent))[1:]
    power = np.abs(np.fft.rfft(bent, axis=0)[1:]) ** 2
    shape = (2.0 - 2.0 * np.cos(2.0 * np.pi * turn)) ** 2
    half = len(turn) // 2
    # The median of a squared amplitude of noise is log 2 of its mean.
    level = np.median(power[half:] / shape[half:, None], axis=0) / np.log(2.0)
    return turn * (len(time) - 1) / (time[-1] - time[0]), power, shape[:, None] * level
