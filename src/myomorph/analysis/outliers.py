"""Values that lie far from the others of their kind, by a rule that the outliers themselves do not soften."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array

FAR = 3.5
"""Modified z-score from which a value is called an outlier (Iglewicz and Hoaglin 1993)."""
FEWEST_VALUES = 5
"""Values of a kind from which on any is judged."""
ROUNDED = 1e-6
"""Values that differ by less, as a share of their median, are equal: what is left is rounding."""
TO_DEVIATION = 0.6745
"""Median absolute deviation of a normal distribution, in standard deviations."""


def modified_z(values: ArrayLike) -> Array:
    """0.6745 (x - median) / median absolute deviation of values (n,), NaN stays out.

    All NaN with fewer than five known values, or where more than half of them are equal but for rounding.
    """
    given = np.asarray(values, dtype=np.float64)
    known = given[np.isfinite(given)]
    if len(known) < FEWEST_VALUES:
        return np.full(given.shape, np.nan)
    middle = np.median(known)
    spread = float(np.median(np.abs(known - middle)))
    if not spread > ROUNDED * abs(float(middle)):
        return np.full(given.shape, np.nan)
    found: Array = TO_DEVIATION * (given - middle) / spread
    return found
