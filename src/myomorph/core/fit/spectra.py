"""Power spectra of recorded columns, without what travels or drifts in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only

MAX_FRAMES = 8192  # Of all segments together: of a longer recording some are enough
SEGMENT = 2.5
"""Longest segment [s]: strides of a longer one are lines in its spectrum, not one motion that
falls.
"""

MIN_SEGMENT = 1.0  # Of movements that are fast [s]
PERIODS = 6.0  # Of the frequency of a movement in a segment
WHOLE = 1.5  # Segments up to which a recording is not divided
SPEED_SHARE = 0.85  # Share of the power of velocities that lies below that frequency
BINS = 72  # Even in the logarithm of frequency
SPAN = 400.0  # Highest frequency over the lowest of all bins but the first ones
FEW_FRAMES = 60  # Below so many frames two tapers
SOME_FRAMES = 150  # Below so many three, else four


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Spectra:
    """One-sided power spectra of columns.

    Attributes
    ----------
    frequency : (bins,) means of the frequencies in each bin [Hz]
    width : (bins,) [Hz]
    power : (bins, columns) [unit^2/Hz]
    """

    frequency: Array
    width: Array
    power: Array

    def columns(self, which: slice) -> Spectra:
        """Take some of the columns."""
        return Spectra(frequency=self.frequency, width=self.width, power=self.power[:, which])

    def only(self, bins: np.ndarray) -> Spectra:
        """Take some bins.

        Parameters
        ----------
        bins : (bins,) True for those that are taken

        Returns
        -------
        spectra in these
        """
        return Spectra(
            frequency=self.frequency[bins], width=self.width[bins], power=self.power[bins]
        )


def spectra_of(values: Array, rate: float, beside: Array | None = None) -> Spectra:
    """Estimate the power spectra of columns.

    Second differences y_i - 2 y_(i-1) + y_(i-2) remove offset and travel, and are small enough at
    low frequencies not to leak into high ones. They multiply power by

        (2 - 2 cos(2 pi f / rate))^2

    which is undone. Power is the mean over sine tapers and over segments of six periods of the
    movement, spread over the recording.

    Source: Riedel and Sidorenko 1995 (sine tapers).

    Parameters
    ----------
    values : (frames, columns) without gaps, at least eight frames
    rate : of the frames [Hz]
    beside : (frames, others) further columns, which do not choose the segments

    Returns
    -------
    spectra of all columns in bins that are even in log f
    """
    columns = values if beside is None else np.hstack([values, beside])
    spectra = _spectra_of_segments(columns, rate, SEGMENT)
    duration = max(PERIODS / _speed(spectra.columns(slice(values.shape[1]))), MIN_SEGMENT)
    if duration >= SEGMENT or len(values) <= WHOLE * duration * rate:
        return spectra
    return _spectra_of_segments(columns, rate, duration)


def _speed(spectra: Spectra) -> float:
    """Find the frequency below which most of the velocities' power lies, of the median column."""
    weight = (spectra.frequency**2 * spectra.width)[:, None]
    passed = np.cumsum(spectra.power * weight, axis=0)
    moving = passed[:, passed[-1] > 0.0]
    if not moving.shape[1]:
        return float(spectra.frequency[-1])
    reached = (moving >= SPEED_SHARE * moving[-1]).argmax(axis=0)
    return float(np.median(spectra.frequency[reached]))


def _spectra_of_segments(values: Array, rate: float, duration: float) -> Spectra:
    """Average the spectra of segments of a duration [s], spread over values (frames, columns)."""
    frames = len(values)
    length = frames
    if frames > WHOLE * duration * rate:
        length = min(int(duration * rate), frames)
    count = max(1, min(frames // length, MAX_FRAMES // length))
    starts = np.linspace(0.0, frames - length, count).astype(int)
    tapers = sine_tapers(length - 2)
    power = np.zeros(((length - 2) // 2 + 1, values.shape[1]))
    for start in starts:
        bent = _without_line(np.diff(values[start : start + length], 2, axis=0))
        for taper in tapers:
            power += np.square(np.abs(np.fft.rfft(taper[:, None] * bent, axis=0)))
    turn = np.fft.rfftfreq(length - 2)[1:]
    bending = np.square(2.0 - 2.0 * np.cos(2.0 * np.pi * turn))
    density = 2.0 / (len(tapers) * count * rate) * power[1:] / bending[:, None]
    return _binned(np.asarray(turn * rate, np.float64), np.asarray(density, np.float64))


def _without_line(values: Array) -> Array:
    """Take the line of least squares off each column (frames, columns)."""
    across = np.arange(len(values)) - 0.5 * (len(values) - 1)
    slope = across @ values / np.square(across).sum()
    return values - values.mean(axis=0) - across[:, None] * slope


def sine_tapers(length: int) -> Array:
    """Make sine tapers of unit energy.

        v_k(n) = sqrt(2 / (N + 1)) sin(pi k n / (N + 1)),  k = 1, 2, ...

    Source: Riedel and Sidorenko 1995.

    Parameters
    ----------
    length : N [frames]

    Returns
    -------
    (tapers, length), more of a longer recording
    """
    count = 2 + (length >= FEW_FRAMES) + (length >= SOME_FRAMES)
    order = np.arange(1, count + 1)[:, None]
    sample = np.arange(1, length + 1)
    return np.asarray(np.sqrt(2.0 / (length + 1)) * np.sin(np.pi * order * sample / (length + 1)))


def _binned(frequency: Array, density: Array) -> Spectra:
    """Average power within bins that are even in log f.

    Parameters
    ----------
    frequency : (n,) evenly spaced [Hz]
    density : (n, columns) [unit^2/Hz]
    """
    lowest = max(frequency[0], frequency[-1] / SPAN)
    limits = np.geomspace(0.999 * lowest, 1.001 * frequency[-1], BINS)
    number = np.digitize(frequency, limits)
    inside = number > 0
    starts = np.flatnonzero(np.diff(number[inside], prepend=0))
    counts = np.diff(starts, append=int(inside.sum()))
    return Spectra(
        frequency=np.add.reduceat(frequency[inside], starts) / counts,
        width=counts * frequency[0],
        power=np.add.reduceat(density[inside], starts, axis=0) / counts[:, None],
    )
