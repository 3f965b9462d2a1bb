"""Scale of the ten inertial parameters in equations, the same in all axes of the limb.

A hinge shows its limb in a plane: what lies along its axis has columns of rounding alone, or none
of its own. Scaled one by one these would become as large as the columns that swings show, and
rounding would be solved for. Scaled by kind (mass, first moment, inertia) they stay what they are.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array

KINDS = (slice(0, 1), slice(1, 4), slice(4, 10))
"""Mass, first moment and inertia in [D] order."""
ROUNDING = 1e-9
"""A column below this share of the largest of its kind is rounding."""


def parameter_scale(sizes: Array) -> Array:
    """Find the scale of the parameters' columns.

    Parameters
    ----------
    sizes : (10,) root sum of squares of each parameter's column

    Returns
    -------
    (10,) root mean square of the sizes of each kind; 1 where a kind has none
    """
    scale = np.ones(len(sizes))
    for kind in KINDS:
        size = float(np.sqrt(np.mean(np.square(sizes[kind]))))
        scale[kind] = size if size > 0.0 else 1.0
    return scale


def shown_columns(sizes: Array) -> np.ndarray:
    """Find which columns are more than rounding.

    Parameters
    ----------
    sizes : (columns,) root sum of squares of each

    Returns
    -------
    (columns,) whether it is above `ROUNDING` of the largest
    """
    return np.asarray(sizes > ROUNDING * sizes.max(initial=0.0))
