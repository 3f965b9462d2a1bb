"""The step of a quadratic model that keeps every unknown within its bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array

MAX_UNIMPROVED = 3  # Exchanges of all unknowns at once that may leave as many on the wrong side


def bounded_step(H: Array, g: Array, low: Array, high: Array) -> Array:
    """Minimum of d . H d + 2 g . d with low <= d <= high, exactly.

    Where the free minimum -H^-1 g is within the bounds, it is the answer. Else unknowns at a bound
    and free ones change places until every free one is within its bounds and the slope H d + g
    pushes every other one against its bound: all on the wrong side at once as long as their number
    falls, then the last one alone, which ends after finitely many exchanges.

    Source: Portugal, Judice and Vicente 1994, A comparison of block pivoting and interior-point
    algorithms for linear least squares problems with nonnegative variables, Mathematics of
    Computation 63(208):625; Murty 1974 for the last.

    Parameters
    ----------
    H : (n, n) positive definite
    g : (n,)
    low, high : (n,) of the step, 0 or less and 0 or more

    Returns
    -------
    (n,)

    Raises
    ------
    LinAlgError : H is not positive definite
    """
    step = np.asarray(-np.linalg.solve(H, g), dtype=np.float64)
    side = np.zeros(len(g), np.int64)  # -1 at the lower bound, 1 at the upper one, 0 free
    fewest = len(g) + 1
    unimproved = 0
    while True:
        to = _sides(step, H @ step + g, side, low, high)
        wrong = np.flatnonzero(to != side)
        if not len(wrong):
            return step
        unimproved = 0 if len(wrong) < fewest else unimproved + 1
        fewest = min(len(wrong), fewest)
        chosen = wrong if unimproved <= MAX_UNIMPROVED else wrong[-1:]
        side[chosen] = to[chosen]
        free = side == 0
        step = np.where(side < 0, low, np.where(side > 0, high, 0.0))
        right = g[free] + H[np.ix_(free, ~free)] @ step[~free]
        step[free] = -np.linalg.solve(H[np.ix_(free, free)], right)


def _sides(
    step: Array, slope: Array, side: NDArray[np.int64], low: Array, high: Array
) -> NDArray[np.int64]:
    """Where each unknown (n,) belongs, by a step and the slope there: -1, 0 or 1 as in `side`."""
    to = side.copy()
    to[(side == 0) & (step < low)] = -1
    to[(side == 0) & (step > high)] = 1
    # One whose bounds leave no room stays, whatever the slope.
    room = low < high
    to[room & (side < 0) & (slope < 0.0)] = 0
    to[room & (side > 0) & (slope > 0.0)] = 0
    return to
