"""The one rule from a spread to an interval."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.interval import Interval

LEVEL = 0.9
"""Share of true values that intervals hold, where nothing else is said."""


def half_width(sd: ArrayLike, level: float = LEVEL, freedom: float = np.inf) -> Array:
    """Find how far an interval reaches to either side of a linear number.

        t sd,    t = F^-1(0.5 + 0.5 level)

    with F of Student's distribution at the degrees of freedom of the noise, normal where these are
    infinite.

    Parameters
    ----------
    sd : (...) standard deviations
    level : probability that the interval holds the number
    freedom : degrees of freedom, where the noise was taken from residuals

    Returns
    -------
    (...) in the unit of sd

    Examples
    --------
    >>> from myomorph.core.fit.interval_rule import half_width
    >>> round(float(half_width(1.0)), 4)
    1.6449
    """
    probability = 0.5 + 0.5 * level
    if np.isfinite(freedom):
        factor = scipy.special.stdtrit(freedom, probability)
    else:
        factor = scipy.special.ndtri(probability)
    return np.asarray(factor * np.asarray(sd, np.float64))


def drawn_limits(
    draws: Array, level: float = LEVEL, value: float | None = None
) -> tuple[Array, Array]:
    """Find the limits that hold a share of draws.

    With the value that was estimated, quantiles are corrected for the draws' bias:

        Phi(2 z_0 + z_p),   z_0 = Phi^-1(share of draws below the value),   z_p = Phi^-1(p)

    Without it they are those of the draws, as for results that are drawn from their inputs' errors.

    Source: Efron 1981, Nonparametric standard errors and confidence intervals, Canadian Journal of
    Statistics 9(2):139.

    Parameters
    ----------
    draws : (draws, ...) finite; (draws,) with a value
    level : share between the limits
    value : the estimate

    Returns
    -------
    (...) lower and upper limits
    """
    low = 0.5 - 0.5 * level
    high = 0.5 + 0.5 * level
    if value is not None:
        below = np.mean(draws < value) + 0.5 * np.mean(draws == value)
        # No share of finitely many draws is 0 or 1 for sure.
        share = np.clip(below, 0.5 / len(draws), 1.0 - 0.5 / len(draws))
        middle = scipy.special.ndtri(share)
        z = scipy.special.ndtri(high)
        low, high = scipy.special.ndtr([2.0 * middle - z, 2.0 * middle + z])
    lower, upper = np.quantile(draws, (low, high), axis=0)
    return np.asarray(lower), np.asarray(upper)


def interval_of_draws(value: float, draws: Array, level: float = LEVEL) -> Interval:
    """Put the limits that hold a share of draws around a value.

    Parameters
    ----------
    value : the estimate
    draws : (draws,) of it; those that are not finite do not count
    level : share of the draws between the limits

    Returns
    -------
    the interval, NaN where no draw is finite

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.interval_rule import interval_of_draws
    >>> interval = interval_of_draws(5.0, np.arange(11.0), 0.8)
    >>> interval.low, interval.high
    (1.0, 9.0)
    """
    known = draws[np.isfinite(draws)]
    if not len(known):
        return Interval(value=float(value), low=float("nan"), high=float("nan"))
    low, high = drawn_limits(known, level)
    return Interval(value=float(value), low=float(low), high=float(high))
