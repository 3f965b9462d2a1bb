"""The slow part of samples: a straight line through all, a mean over a window.

`scipy.signal.detrend` and `scipy.ndimage.uniform_filter1d` give the same, but their modules take
longer to import than inverse dynamics of a walk to compute.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array


def detrended(values: Array) -> Array:
    """Take off the straight line of least squares.

    Parameters
    ----------
    values : (samples, ...) finite

    Returns
    -------
    (samples, ...) what is left, in the units of the values
    """
    time = np.arange(len(values)) - 0.5 * (len(values) - 1)
    rest = values - values.mean(axis=0)
    if len(values) < 2:
        return np.asarray(rest)
    slope = np.tensordot(time, rest, axes=1) / np.square(time).sum()
    return np.asarray(rest - np.multiply.outer(time, slope))


def running_mean(values: Array, window: int) -> Array:
    """Mean over a window around each sample, with the samples mirrored beyond both ends.

    Parameters
    ----------
    values : (samples, ...) finite
    window : its length [samples]; of an even one, the longer half lies before the sample

    Returns
    -------
    (samples, ...) in the units of the values
    """
    if window < 2 or not len(values):
        return np.array(values)
    margins = [(window // 2, window - window // 2 - 1)] + [(0, 0)] * (values.ndim - 1)
    middle = values.mean(axis=0)
    sums = np.cumsum(np.pad(values - middle, margins, mode="symmetric"), axis=0)
    before = np.concatenate([np.zeros_like(sums[:1]), sums[:-window]])
    return np.asarray((sums[window - 1 :] - before) / window + middle)
