"""What variables do at given multipliers, in closed form.

Alone, reached by the one number s = (A^T y)_i (see `dual.py`),

    minimise  w |x - t|^p + k dist(x, [l, h])^2 - s x   subject to  lower <= x <= upper,

and below a common bound of the first variables, the greatest activation as a cost,

    minimise    peak beta + sum_i c_i(x_i)
    subject to  A x = b,  lower <= x <= upper,  x_i <= beta for the capped ones,

the min/max criterion of muscle recruitment (Rasmussen, Damsgaard and Voigt 2001), made unique by
the costs c_i. For multipliers s = A^T y the bound is where what the capped variables would still
gain by a higher one is worth its cost,

    sum_i max(0, s_i - c_i'(beta)) = peak ,

a falling function of beta. So the dual keeps the form it has without the bound, and its generalized
Jacobian gains one outer product: of the variables that lie on the bound, which move together.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.kernels import bare


@bare
def _pulled(w, p, target, near, pull, x, s):
    """Value of a variable that an interval penalty pulls, of any exponent.

    It is the zero v, between `near` and x, of

        p w |v - target|^(p - 1) sign(v - target) + 2 pull (v - near) - s

    by Newton steps, each bisected where it leaves the bracket.
    """
    low = min(near, x)
    high = max(near, x)
    v = 0.5 * (low + high)
    for _ in range(60):
        size = abs(v - target)
        power = w * p * size ** (p - 1.0)
        excess = (power if v > target else -power) + 2.0 * pull * (v - near) - s
        if excess > 0.0:
            high = v
        else:
            low = v
        step = excess / (2.0 * pull + w * p * (p - 1.0) * max(size, 1e-9) ** (p - 2.0))
        if abs(step) <= 1e-15:
            break
        v = v - step if low < v - step < high else 0.5 * (low + high)
    return v


@bare
def _cubic(w, low, high, pull, target, s):
    """Do as `_bent` of the exponent 3, by roots: it is common, and powers take long."""
    size = np.sqrt(abs(s) / (3.0 * w))
    x = target + (size if s > 0.0 else -size)
    slope = min((1.0 if size < 1e-3 else 0.5) / (3.0 * w * max(size, 1e-30)), 1e8 / w)
    if pull > 0.0 and not low <= x <= high:
        left = s - 2.0 * pull * (target - (low if x < low else high))
        size = abs(left) / (pull + np.sqrt(pull * pull + 3.0 * w * abs(left)))
        x = target + (size if left > 0.0 else -size)
        slope = 0.5 / (3.0 * w * max(size, 1e-9) + pull)
    return x, slope


@bare
def _bent(w, p, low, high, pull, target, s):
    """Value of a variable, and its slope over s, where it is pulled or its exponent is not 2.

    Parameters
    ----------
    w, p : weight and exponent of the cost w |x - target|^p
    low, high, pull : l, h and k of its interval penalty
    target : t
    s : the reduced multiplier (A^T y)_i
    """
    if p == 2.0:
        x = target + 0.5 * s / w
        slope = 0.5 / w
        if not low <= x <= high:
            near = low if x < low else high
            x = (w * target + pull * near + 0.5 * s) / (w + pull)
            slope = 0.5 / (w + pull)
        return x, slope
    if p == 3.0:
        return _cubic(w, low, high, pull, target, s)
    size = (abs(s) / (p * w)) ** (1.0 / (p - 1.0))
    x = target + (size if s > 0.0 else -size)
    slope = 1.0 / (p * (p - 1.0) * w * max(size, 1e-9 if p < 2.0 else 1e-30) ** (p - 2.0))
    # Near 0 the slope of a root (p > 2) would throw the iteration to the other side: the secant
    # does not.
    if p > 2.0 and size < 1e-3:
        slope *= p - 1.0
    slope = min(slope, 1e8 / w)
    if pull > 0.0 and not low <= x <= high:
        x = _pulled(w, p, target, low if x < low else high, pull, x, s)
        if p > 2.0:
            slope = 1.0 / (p * (p - 1.0) * w * max(abs(x - target), 1e-9) ** (p - 2.0))
        slope = 1.0 / (1.0 / slope + 2.0 * pull)
    return x, slope


@bare
def response(  # page: numbers of one variable, which stay in registers
    w, p, least, greatest, low, high, pull, target, s
):
    """Value x of a variable at the reduced multiplier s, and dx/ds there (0 on a bound).

    It is small and has scalars only, so that the compiler makes it a part of loops that call it.

    Parameters
    ----------
    w, p : weight and exponent of the cost w |x - target|^p
    least, greatest : bounds of x
    low, high, pull : l, h and k of its interval penalty
    target : t
    s : the reduced multiplier (A^T y)_i
    """
    if p == 2.0 and pull == 0.0:
        x = target + 0.5 * s / w
        slope = 0.5 / w
    else:
        x, slope = _bent(w, p, low, high, pull, target, s)
    if x <= least:
        return least, 0.0
    if x >= greatest:
        return greatest, 0.0
    return x, slope


@bare
def _marginal_cost(w, p, low, high, pull, target, x):
    """First and second derivative of the cost w |x - target|^p + pull dist(x, [low, high])^2.

    Parameters
    ----------
    w, p, low, high, pull, target : as of `response`
    x : where they are taken
    """
    distance = x - target
    if p == 2.0:
        slope = 2.0 * w * distance
        curvature = 2.0 * w
    else:
        size = abs(distance)
        slope = w * p * size ** (p - 1.0)
        slope = slope if distance > 0.0 else -slope
        curvature = w * p * (p - 1.0) * max(size, 1e-9) ** (p - 2.0)
    if pull > 0.0 and not low <= x <= high:
        slope += 2.0 * pull * (x - (low if x < low else high))
        curvature += 2.0 * pull
    return slope, curvature


@bare
def _gain(shared, frame, s, ds, t, beta):
    """Gain of the capped variables by a higher bound, and how fast it falls with the bound.

    Parameters
    ----------
    shared, frame : `Separable`, `SeparableFrame`
    s, ds : (variables,) reduced multipliers and their direction
    t : step along ds
    beta : the common bound

    Returns
    -------
    sum_i max(0, s_i + t ds_i - c_i'(beta)) and the sum of c_i'' over its terms above 0
    """
    total = 0.0
    fall = 0.0
    for i in range(shared.capped):
        if shared.upper[i] > beta:
            slope, curvature = _marginal_cost(
                shared.weight[i],
                shared.exponent[i],
                frame.low[i],
                frame.high[i],
                frame.pull[i],
                frame.targets[i],
                beta,
            )
            more = s[i] + t * ds[i] - slope
            if more > 0.0:
                total += more
                fall += curvature
    return total, fall


@bare
def ceiling(shared, frame, s, ds, t):
    """Find the common bound at the reduced multipliers s + t ds; infinite where it costs nothing.

    It is the beta at which the gain of the capped variables is the cost `peak` of a higher bound,
    by Newton steps, each bisected where it leaves the bracket.

    Parameters
    ----------
    shared, frame, s, ds, t : as of `_gain`
    """
    if not shared.peak > 0.0:
        return np.inf
    low = 0.0
    high = 0.0
    for i in range(shared.capped):
        low = max(low, shared.lower[i])
        high = max(high, shared.upper[i])
    beta = low
    for _ in range(100):
        total, fall = _gain(shared, frame, s, ds, t, beta)
        if total > shared.peak:
            low = beta
        else:
            high = beta
        if high - low <= 1e-15:
            break
        step = (total - shared.peak) / fall if fall > 0.0 else np.inf
        if abs(step) <= 1e-16:
            break
        beta = beta + step if low < beta + step < high else 0.5 * (low + high)
    return beta


@bare
def common_motion(shared, frame, s, roof, together):
    """Find what the variables B on the common bound do together: A_B 1, and sum_B c''.

    Parameters
    ----------
    shared, frame, s : as of `_gain`
    roof : the common bound
    together : (rows,) filled with A_B 1 where the bound moves

    Returns
    -------
    the sum, 0 where the bound does not move
    """
    total, fall = _gain(shared, frame, s, s, 0.0, roof)
    # Where the bound lies on a bound of its own, it does not move.
    if not fall > 0.0 or abs(total - shared.peak) > 1e-6 * shared.peak:
        return 0.0
    for j in range(together.shape[0]):
        together[j] = 0.0
    for i in range(shared.capped):
        if shared.upper[i] <= roof:
            continue
        slope, _ = _marginal_cost(
            shared.weight[i],
            shared.exponent[i],
            frame.low[i],
            frame.high[i],
            frame.pull[i],
            frame.targets[i],
            roof,
        )
        if s[i] > slope:
            for a in range(shared.start[i], shared.start[i + 1]):
                together[shared.row[a]] += frame.values[a]
    return fall
