"""Sizes of errors, as the tables of benchmarks give them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def rms(values: ArrayLike) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_known(values: ArrayLike) -> float:
    """Root of the mean square of what is known (not NaN)."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def rms_of_vectors(values: np.ndarray) -> float:
    """Return the root mean square of the norms of vectors.

    Parameters
    ----------
    values : (..., n) vectors along the last axis

    Returns
    -------
    in the unit of the values
    """
    return float(np.sqrt(np.mean(np.sum(values**2, axis=-1))))
