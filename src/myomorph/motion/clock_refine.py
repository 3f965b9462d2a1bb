"""Offset and drift by least squares, with the linear parameters solved for wherever they are (variable projection)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.motion.clock_lags import Compared, orthonormal

ITERATIONS = 30
FEWEST = 60
SMALLEST = 1e-6
"""Share of its spread below which a signal's residual counts as that: a made recording may leave nothing."""


@read_only
@dataclass(frozen=True, eq=False)
class Refined:
    """Where Gauss-Newton ended.

    Attributes
    ----------
    lag : (2,) a [s] and b of `Compared.places`
    covariance : (2, 2)
    misfit : geometric mean over the signals of what is left, in units of each signal's spread
    explained : share of the variance of the signal that is explained best
    length : seconds in common [s]
    """

    lag: Array
    covariance: Array
    misfit: float
    explained: float
    length: float

    @property
    def timing_sd(self) -> float:
        """Root mean square of the standard deviation of the lag over the recording [s]."""
        return float(np.sqrt(self.covariance[0, 0] + self.covariance[1, 1] * self.length**2 / 12.0))


def refine(compared: Compared, lag: Array, drift: bool, block: float) -> Refined:
    """Offset, and drift if wanted, from a start that is within a fraction of a swing.

    Each signal weighs what its residual says; Gauss-Newton after Kaufman 1975.

    Raises
    ------
    BadData : too few frames in common
    """
    inside = compared.within(lag)
    frames = int(np.count_nonzero(inside))
    if frames < FEWEST:
        raise BadData(f"the recordings share {frames} usable frames: too few to compare their clocks")
    time, rows = compared.time[inside], compared.rows[inside]
    away = (time - compared.middle)[:, None]
    weights = compared.weights
    for _ in range(ITERATIONS):
        places = np.clip(compared.places(lag)[inside], compared.start, compared.end)
        basis = orthonormal((rows * weights[:, None]).reshape(-1, rows.shape[2]))
        slopes = compared.slope(places) * weights
        columns = np.stack((compared.spline(places) * weights, slopes, slopes * away), axis=2).reshape(-1, 3)
        columns = columns - basis @ (basis.T @ columns)
        left, tangent = columns[:, 0], columns[:, 1 : 3 if drift else 2]
        step = -np.linalg.lstsq(tangent, left, rcond=None)[0]
        residual = left.reshape(frames, -1) * np.where(weights > 0, 1.0 / np.where(weights > 0, weights, 1.0), 0.0)
        size = np.sqrt(np.mean(residual**2, axis=0))
        if np.all(np.abs(step) < np.array([1e-9, 1e-11])[: len(step)]):
            break
        lag = lag + np.pad(step, (0, 2 - len(step)))
        weights = np.where(weights > 0, 1.0 / np.maximum(size, SMALLEST * compared.spread + 1e-300), 0.0)
    shares = (size / np.where(weights > 0, compared.spread, 1.0))[weights > 0]
    return Refined(
        lag=lag,
        covariance=_covariance(tangent, left, time, residual.shape[1], block),
        misfit=float(np.exp(np.mean(np.log(np.maximum(shares, SMALLEST))))),
        explained=1.0 - float(shares.min()) ** 2,
        length=float(time[-1] - time[0]),
    )


def _covariance(tangent: Array, left: Array, time: Array, signals: int, block: float) -> Array:
    """Sandwich of block sums (2, 2), which residuals that follow each other do not deceive."""
    count = tangent.shape[1]
    scores = (tangent * left[:, None]).reshape(len(time), signals, count).sum(axis=1)
    number = np.floor((time - time[0]) / block).astype(np.int64)
    sums = np.stack([np.bincount(number, weights=column) for column in scores.T], axis=1)
    blocks = len(np.unique(number))
    inverse = np.linalg.pinv(tangent.T @ tangent)
    covariance = np.zeros((2, 2))
    covariance[:count, :count] = inverse @ (sums.T @ sums) @ inverse * blocks / max(blocks - count, 1)
    return covariance
