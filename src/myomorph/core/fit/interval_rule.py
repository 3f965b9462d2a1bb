"""The one rule from a spread to an interval.

- A linear number whose standard deviation is known: `half_width` to either side.
- Draws of what is likely, given the data (a posterior, a bootstrap): the limits that hold a share
  of them, `drawn_limits`.
- Draws that add errors to data which hold errors already: `reflected_limits`. What a draw is off
  from the value is what the value is off from the truth.
"""

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

    Without it they are those of the draws.

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


def reflected_limits(
    value: ArrayLike,
    draws: Array,
    level: float = LEVEL,
    *,
    distance: bool = False,
    again: Array | None = None,
) -> tuple[Array, Array]:
    """Find limits from draws that add a further error to data which hold one.

        truth = value - (draw - value)

    so that quantiles of the draws are reflected at the value. Errors make a maximum larger and a
    range wider: the value is too large already, and each draw is so once more. A distance from
    something (root mean square) is reflected as its square, to which errors add.

    How much a draw is too large depends on the data that happened to be measured: a maximum that is
    one high sample gains less from further errors than a flat one. `again` tells how sure that is.
    With the mean m_d over errors that were added to a draw d once more, the reflected draw
    2 d - m_d is off from the value as the reflected value is from the truth,

        truth = (2 value - mean d) - (2 d - m_d - mean(2 d - m_d))

    less the scatter that m_d has because few errors were added.

    Source: Davison and Hinkley 1997, Bootstrap methods and their application, sections 3.9 and 5.2.

    Parameters
    ----------
    value : (...) of the data
    draws : (draws, ...) of it, finite
    level : share between the limits
    distance : whether the number is a distance, which is at least 0
    again : (times, draws, ...) of draws to which further errors were added, two times or more; None
        where nobody did

    Returns
    -------
    (...) lower and upper limits; the value may lie outside

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.interval_rule import reflected_limits
    >>> low, high = reflected_limits(5.0, np.linspace(5.0, 7.0, 11), 0.8)
    >>> round(float(low), 6), round(float(high), 6)
    (3.2, 4.8)
    """
    power = 2.0 if distance else 1.0
    known = np.asarray(value, np.float64) ** power
    powers = draws**power
    middle = known
    moved = powers
    if again is not None:
        middle = 2.0 * known - powers.mean(axis=0)
        moved = middle + _reflected(powers, again**power)
    lower, upper = drawn_limits(moved, level)
    low = 2.0 * middle - upper
    high = 2.0 * middle - lower
    if distance:
        low = np.sqrt(np.maximum(low, 0.0))
        high = np.sqrt(np.maximum(high, 0.0))
    return low, high


def _reflected(draws: Array, again: Array) -> Array:
    """Reflect each draw at the mean of those to which errors were added once more.

    Parameters
    ----------
    draws : (draws, ...)
    again : (times, draws, ...)

    Returns
    -------
    (draws, ...) less their mean, without the scatter of means of few
    """
    reflected = 2.0 * draws - again.mean(axis=0)
    reflected = reflected - reflected.mean(axis=0)
    variance = reflected.var(axis=0)
    of_few = again.var(axis=0, ddof=1).mean(axis=0) / len(again)
    share = np.divide(of_few, variance, out=np.zeros_like(variance), where=variance > 0.0)
    return np.asarray(reflected * np.sqrt(np.maximum(1.0 - share, 0.0)))


def interval_of_errors(
    value: float, draws: Array, level: float = LEVEL, *, distance: bool = False
) -> Interval:
    """Put the limits of a number whose data were drawn with further errors around it.

    Parameters
    ----------
    value : of the data
    draws : (draws,) of it; those that are not finite do not count
    level : share between the limits
    distance : see `reflected_limits`

    Returns
    -------
    the interval, NaN where no draw is finite
    """
    known = draws[np.isfinite(draws)]
    if not len(known):
        return Interval(value=float(value), low=float("nan"), high=float("nan"))
    low, high = reflected_limits(value, known, level, distance=distance)
    return Interval(value=float(value), low=float(low), high=float(high))


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
