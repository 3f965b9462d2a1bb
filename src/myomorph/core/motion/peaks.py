"""Peaks of a curve that stand out from what is around them.

`scipy.signal.find_peaks` finds the same, but its module takes longer to import than all that a
command computes of a squat.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints


def prominent_peaks(values: Array, prominence: float, apart: float = 1.0) -> Ints:
    """Find maxima that a curve falls away from on both sides.

    A peak's prominence is its height above the higher one of two lows: the lowest value on the way
    to a higher one, or to the end, on its left and on its right. Of a flat top the middle sample is
    taken. A sample at an end of the curve is no peak.

    Parameters
    ----------
    values : (samples,) finite
    prominence : least one of a peak, in the units of the values
    apart : least distance of two peaks, of which the lower one goes otherwise [samples]

    Returns
    -------
    (peaks,) numbers of their samples, in order
    """
    peaks = _apart(_maxima(values), values, int(np.ceil(apart)))
    return np.array([peak for peak in peaks if _prominence(values, peak) >= prominence], np.int64)


def _maxima(values: Array) -> Ints:
    """(peaks,) middles of the tops, flat or of one sample, that are higher than both sides."""
    if len(values) < 3:
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(values) != 0.0)])
    ends = np.concatenate([starts[1:], [len(values)]]) - 1
    heights = values[starts]
    higher = (heights[1:-1] > heights[:-2]) & (heights[1:-1] > heights[2:])
    return np.asarray((starts[1:-1][higher] + ends[1:-1][higher]) // 2, np.int64)


def _apart(peaks: Ints, values: Array, distance: int) -> Ints:
    """Leave out peaks nearer than a distance to a higher one that stays."""
    stays = np.ones(len(peaks), dtype=np.bool_)
    for peak in np.argsort(values[peaks], kind="stable")[::-1]:
        if stays[peak]:
            near = np.abs(peaks - peaks[peak]) < distance
            near[peak] = False
            stays[near] = False
    return peaks[stays]


def _prominence(values: Array, peak: int) -> float:
    """Height of a peak above the higher low beside it."""
    higher = np.flatnonzero(values > values[peak])
    after = int(np.searchsorted(higher, peak))
    first = int(higher[after - 1]) if after > 0 else 0
    last = int(higher[after]) if after < len(higher) else len(values) - 1
    low_before = values[first : peak + 1].min()
    low_after = values[peak : last + 1].min()
    return float(values[peak] - max(low_before, low_after))
