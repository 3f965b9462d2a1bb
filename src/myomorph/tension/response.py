"""What one variable of the separable problem does at given multipliers: its value in closed form, and its slope.

    minimise  w |x - t|^p + k dist(x, [l, h])^2 - s x   subject to  lower <= x <= upper

The multipliers reach it as the one number s = (A^T y)_i; see `dual.py`.
"""

from __future__ import annotations

import numpy as np

from myomorph.rigid.kernels import inner


@inner
def _pulled(w, p, target, near, pull, x, s):
    """Zero of p w |v - target|^(p - 1) sign + 2 pull (v - near) - s, which lies between `near` and x."""
    low, high = min(near, x), max(near, x)
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


@inner
def _cubic(w, low, high, pull, target, s):
    """`_bent` of the exponent 3, by roots: it is common, and general powers would take most of its time."""
    size = np.sqrt(abs(s) / (3.0 * w))
    x = target + (size if s > 0.0 else -size)
    slope = min((1.0 if size < 1e-3 else 0.5) / (3.0 * w * max(size, 1e-30)), 1e8 / w)
    if pull > 0.0 and not low <= x <= high:
        left = s - 2.0 * pull * (target - (low if x < low else high))
        size = abs(left) / (pull + np.sqrt(pull * pull + 3.0 * w * abs(left)))
        x = target + (size if left > 0.0 else -size)
        slope = 0.5 / (3.0 * w * max(size, 1e-9) + pull)
    return x, slope


@inner
def _bent(w, p, low, high, pull, target, s):
    """Value at the reduced multiplier s, and its slope, of a variable that is pulled or whose exponent is not 2."""
    if p == 2.0:
        x, slope = target + 0.5 * s / w, 0.5 / w
        if not low <= x <= high:
            near = low if x < low else high
            x, slope = (w * target + pull * near + 0.5 * s) / (w + pull), 0.5 / (w + pull)
        return x, slope
    if p == 3.0:
        return _cubic(w, low, high, pull, target, s)
    size = (abs(s) / (p * w)) ** (1.0 / (p - 1.0))
    x = target + (size if s > 0.0 else -size)
    slope = 1.0 / (p * (p - 1.0) * w * max(size, 1e-9 if p < 2.0 else 1e-30) ** (p - 2.0))
    # Near 0 the slope of a root (p > 2) would throw the iteration to the other side: the secant does not.
    if p > 2.0 and size < 1e-3:
        slope *= p - 1.0
    slope = min(slope, 1e8 / w)
    if pull > 0.0 and not low <= x <= high:
        x = _pulled(w, p, target, low if x < low else high, pull, x, s)
        if p > 2.0:
            slope = 1.0 / (p * (p - 1.0) * w * max(abs(x - target), 1e-9) ** (p - 2.0))
        slope = 1.0 / (1.0 / slope + 2.0 * pull)
    return x, slope


@inner
def response(w, p, least, greatest, low, high, pull, target, s):
    """Value x at the reduced multiplier s, and dx/ds there (0 on a bound).
    Scalars, and little of its own, so that the compiler makes it a part of the loops that call it.
    """
    if p == 2.0 and pull == 0.0:
        x, slope = target + 0.5 * s / w, 0.5 / w
    else:
        x, slope = _bent(w, p, low, high, pull, target, s)
    if x <= least:
        return least, 0.0
    if x >= greatest:
        return greatest, 0.0
    return x, slope
