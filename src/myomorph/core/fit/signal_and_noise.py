"""Motion and noise of a recording, apart, as their spectra show them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.noise_fit import BEYOND, NoiseFit, NoiseShape, fit_noise
from myomorph.core.fit.spectra import Spectra
from myomorph.core.model.arrays import Array, read_only

MIN_FRAMES = 8  # Fewer have no spectrum
CLEAR = 1.15  # Over f1: from there on a column is noise alone
BELOW_EDGE = 0.9  # Over the edge: up to there the filter leaves noise as it was
MIN_WIDTH = 1.25  # Edge over f1 from which a plateau is wide enough to see noise
NARROW = 2.5  # Edge over f1, in the median, below which a shelf may as well be motion
MANY = 0.5  # Share of the columns whose noise has to be seen
STILL = 1e-10  # Power over that of the column that moves most, below which a column stands still
EXTENDED = 12  # Bins below the lowest one of a short recording, to which the motion goes on
MIN_PASSED = 0.05  # Power that a filter left: what it took more of is not restored
LEAST = 1e-300


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class SignalAndNoise:
    """Spectra of motion and noise of columns.

    Attributes
    ----------
    frequency, width : (bins,) [Hz]
    motion : (bins, columns) S, what a filter took restored [unit^2/Hz]
    noise : (bins, columns) N g A^2, as it is in the recording [unit^2/Hz]
    recorded : (bins, columns) power as recorded, 0 beyond the recording's end [unit^2/Hz]
    passed : (bins,) A, share of amplitudes that the filter left
    shape : of noise and filter
    known : (columns,) whether noise was seen
    moves : (columns,) False for columns that stand still
    """

    frequency: Array
    width: Array
    motion: Array
    noise: Array
    recorded: Array
    passed: Array
    shape: NoiseShape
    known: np.ndarray
    moves: np.ndarray
    doubtful: bool
    """Whether the recording says too little about its noise to choose a filter by it."""

    def columns(self, which: slice) -> SignalAndNoise:
        """Take some of the columns."""
        return SignalAndNoise(
            frequency=self.frequency,
            width=self.width,
            motion=self.motion[:, which],
            noise=self.noise[:, which],
            recorded=self.recorded[:, which],
            passed=self.passed,
            shape=self.shape,
            known=self.known[which],
            moves=self.moves[which],
            doubtful=self.doubtful,
        )

    def with_noise(self, seen: Array) -> SignalAndNoise:
        """Take noise that something else shows, where the spectra show less.

        A recording whose own spectra are doubtful is its motion, but for that noise. It is never
        more than what was recorded.

        Parameters
        ----------
        seen : (bins, columns) power of the noise in the recording [unit^2/Hz]

        Returns
        -------
        motion and noise, no longer doubtful
        """
        fitted = np.zeros_like(self.noise) if self.doubtful else self.noise
        passed = np.ones_like(self.passed) if self.doubtful else self.passed
        inside = self.recorded > 0.0
        noise = np.maximum(fitted, np.where(inside, np.minimum(seen, self.recorded), seen))
        if self.doubtful:
            motion = np.where(inside, self.recorded - noise, self.motion * ~self._beyond)
        else:
            restored = np.maximum(passed**2, MIN_PASSED)[:, None]
            motion = np.maximum(self.motion - (noise - fitted) / restored, 0.0)
        return replace(
            self,
            motion=motion,
            noise=noise,
            passed=passed,
            known=self.known | (seen > 0.0).any(axis=0),
            doubtful=False,
        )

    @property
    def _beyond(self) -> np.ndarray:
        """Mark the bins (bins, 1) beyond the end of the recording."""
        return np.asarray(np.arange(len(self.frequency)) >= EXTENDED)[:, None]

    @property
    def sd(self) -> Array:
        """Standard deviation (columns,) of the noise in the recording."""
        return np.asarray(np.sqrt(self.width @ self.noise))

    @property
    def correlation_time(self) -> float:
        """Time over which noise is one independent sample [s]."""
        factor = self.shape.factor
        return (1.0 + factor) / (1.0 - factor) / (2.0 * self.shape.top)

    def expected_error(self, cutoffs: Array, order: int) -> Array:
        """Squared error of a derivative that low-pass filters leave.

            E(fc) = int (2 pi f)^(2 order) (S (1 - H A)^2 + N g A^2 H^2) df,
            H = 1 / (1 + (f / fc)^6)

        Parameters
        ----------
        cutoffs : (cutoffs,) fc [Hz]
        order : of the derivative

        Returns
        -------
        (cutoffs, columns) [unit^2/s^(2 order)]
        """
        gain = 1.0 / (1.0 + (self.frequency / cutoffs[:, None]) ** 6)
        weight = (2.0 * np.pi * self.frequency) ** (2 * order) * self.width
        lost = np.square(1.0 - gain * self.passed) * weight
        return np.asarray(lost @ self.motion + (np.square(gain) * weight) @ self.noise)


class _Bins(NamedTuple):
    """Bins with those below the recording's lowest.

    Attributes
    ----------
    frequency, width : (bins,) [Hz]
    colour, passed : (bins,) g and A
    """

    frequency: Array
    width: Array
    colour: Array
    passed: Array


def signal_and_noise(spectra: Spectra) -> SignalAndNoise | None:
    """Tell motion from noise.

    Parameters
    ----------
    spectra : of a recording

    Returns
    -------
    None where no column moves

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.signal_and_noise import signal_and_noise
    >>> from myomorph.core.fit.spectra import spectra_of
    >>> time = np.arange(2000)[:, None] / 100.0
    >>> noise = np.random.default_rng(0).normal(scale=0.002, size=(2000, 3))
    >>> found = signal_and_noise(spectra_of(np.sin(2.0 * np.pi * time) + noise, 100.0))
    >>> found.sd.round(3), found.shape.edge
    (array([0.002, 0.002, 0.002]), None)
    """
    largest = spectra.power.max(axis=0)
    moves = largest > STILL * largest.max(initial=0.0)
    if not moves.any():
        return None
    moving = Spectra(
        frequency=spectra.frequency,
        width=spectra.width,
        power=np.maximum(spectra.power[:, moves], LEAST),
    )
    fit = fit_noise(moving)
    return _whole(_told_apart(moving, fit), moves)


def _told_apart(spectra: Spectra, fit: NoiseFit) -> SignalAndNoise:
    """Divide the power of columns that move into motion and noise, given the fit."""
    shape = fit.shape
    plateau = _plateaus(spectra.frequency, fit)
    known = (shape.top > MIN_WIDTH * fit.meets) & (plateau.sum(axis=0) >= 2)
    narrow = shape.edge is not None and np.median(shape.top / fit.meets) < NARROW
    level = _levels(spectra, plateau, fit)
    bins = _extended(spectra, shape)
    f = bins.frequency[:, None]
    passed = bins.passed[:, None] ** 2
    noise = level * bins.colour[:, None] * passed

    power = np.concatenate([np.full((EXTENDED, len(level)), np.nan), spectra.power])
    restored = np.maximum(power - noise, 0.0) / np.maximum(passed, MIN_PASSED)
    seen = (f < fit.meets) & (f >= spectra.frequency[0])
    motion = np.where(seen, restored, _fall(bins, fit, level))
    # Beyond the edge, noise is whatever else is there.
    beyond = np.where(f > BEYOND * shape.top, power - motion * passed, 0.0)
    return SignalAndNoise(
        frequency=bins.frequency,
        width=bins.width,
        motion=motion,
        noise=np.fmax(noise, beyond),
        recorded=np.where(f <= fit.ended, np.nan_to_num(power), 0.0),
        passed=bins.passed,
        shape=shape,
        known=known,
        moves=np.ones(len(level), bool),
        doubtful=bool(narrow or known.mean() < MANY),
    )


def _fall(bins: _Bins, fit: NoiseFit, level: Array) -> Array:
    """Power of the motion as fitted.

    Parameters
    ----------
    bins : with those below the recording's lowest
    fit : of the spectra
    level : (columns,) N of the noise [unit^2/Hz]

    Returns
    -------
    (bins, columns) S [unit^2/Hz]
    """
    knee = fit.knee**2
    fall = (fit.meets**2 + knee) / (bins.frequency[:, None] ** 2 + knee)
    at_meeting = level * np.interp(fit.meets, bins.frequency, bins.colour)
    return np.asarray(at_meeting * fall ** (0.5 * fit.slope))


def _plateaus(frequency: Array, fit: NoiseFit) -> np.ndarray:
    """Mark the bins (bins, columns) in which a column is noise alone, left by the filter."""
    limit = fit.shape.top * (1.0 if fit.shape.edge is None else BELOW_EDGE)
    f = frequency[:, None]
    return np.asarray((f > CLEAR * fit.meets) & (f <= limit))


def _levels(spectra: Spectra, plateau: np.ndarray, fit: NoiseFit) -> Array:
    """Level N (columns,) of the noise: mean power of its plateau, else at f1 [unit^2/Hz]."""
    away = np.abs(spectra.frequency[:, None] - fit.meets)
    nearest = away == away.min(axis=0)
    used = np.where(plateau.any(axis=0), plateau, nearest)
    colour = fit.shape.colour(spectra.frequency)
    passed = fit.shape.passed(spectra.frequency)
    weight = used * spectra.width[:, None]
    expected = (weight * (colour * passed**2)[:, None]).sum(axis=0)
    return np.asarray((weight * spectra.power).sum(axis=0) / expected)


def _extended(spectra: Spectra, shape: NoiseShape) -> _Bins:
    """Add bins below the lowest frequency, where the motion of a short recording goes on."""
    low = spectra.frequency[0] * np.geomspace(0.1, 0.9, EXTENDED)
    frequency = np.concatenate([low, spectra.frequency])
    colour = shape.colour(frequency)
    passed = shape.passed(frequency)
    colour[:EXTENDED] = colour[EXTENDED]
    passed[:EXTENDED] = passed[EXTENDED]
    return _Bins(
        frequency=frequency,
        width=np.concatenate([np.gradient(low), spectra.width]),
        colour=colour,
        passed=passed,
    )


def _whole(found: SignalAndNoise, moves: np.ndarray) -> SignalAndNoise:
    """Put columns that stand still back, without power.

    Parameters
    ----------
    found : of the columns that move
    moves : (columns,) of all
    """

    def placed(power: Array) -> Array:
        result = np.zeros((len(power), len(moves)))
        result[:, moves] = power
        return result

    known = np.zeros(len(moves), bool)
    known[moves] = found.known
    return SignalAndNoise(
        frequency=found.frequency,
        width=found.width,
        motion=placed(found.motion),
        noise=placed(found.noise),
        recorded=placed(found.recorded),
        passed=found.passed,
        shape=found.shape,
        known=known,
        moves=moves,
        doubtful=found.doubtful,
    )
