"""The greatest activation as a cost: a common upper bound of the first variables, in closed form for given multipliers.

    minimise  peak beta + sum_i c_i(x_i)   subject to  A x = b,  lower <= x <= upper,  x_i <= beta for the capped ones

is the min/max criterion of muscle recruitment (Rasmussen, Damsgaard and Voigt 2001), made unique by the costs c_i. For
multipliers s = A^T y the bound is where what the capped variables would still gain by a higher one is worth its cost,

    sum_i max(0, s_i - c_i'(beta)) = peak ,

a falling function of beta. So the dual keeps the form it has without the bound, and its generalized Jacobian gains one
outer product: of the variables that lie on the bound, which move together.
"""

from __future__ import annotations

import numpy as np

from myomorph.rigid.kernels import inner


@inner
def marginal_cost(w, p, low, high, pull, target, x):
    """c'(x) and c''(x) of w |x - target|^p + pull dist(x, [low, high])^2."""
    apart = x - target
    if p == 2.0:
        slope, bend = 2.0 * w * apart, 2.0 * w
    else:
        size = abs(apart)
        slope = w * p * size ** (p - 1.0)
        slope = slope if apart > 0.0 else -slope
        bend = w * p * (p - 1.0) * max(size, 1e-9) ** (p - 2.0)
    if pull > 0.0 and not low <= x <= high:
        slope += 2.0 * pull * (x - (low if x < low else high))
        bend += 2.0 * pull
    return slope, bend


@inner
def gain(S, targets, penalty, s, ds, t, beta):
    """What the capped variables gain by a higher bound at s + t ds, and how fast that falls."""
    total, bend = 0.0, 0.0
    for i in range(S.capped):
        if S.upper[i] > beta:
            slope, curvature = marginal_cost(
                S.weight[i], S.exponent[i], penalty[0, i], penalty[1, i], penalty[2, i], targets[i], beta
            )
            more = s[i] + t * ds[i] - slope
            if more > 0.0:
                total += more
                bend += curvature
    return total, bend


@inner
def ceiling(S, targets, penalty, s, ds, t):
    """The common bound at the reduced multipliers s + t ds; infinite where it costs nothing."""
    if not S.peak > 0.0:
        return np.inf
    low, high = 0.0, 0.0
    for i in range(S.capped):
        low, high = max(low, S.lower[i]), max(high, S.upper[i])
    beta = low
    for _ in range(100):
        total, bend = gain(S, targets, penalty, s, ds, t, beta)
        if total > S.peak:
            low = beta
        else:
            high = beta
        if high - low <= 1e-15:
            break
        step = (total - S.peak) / bend if bend > 0.0 else np.inf
        if abs(step) <= 1e-16:
            break
        beta = beta + step if low < beta + step < high else 0.5 * (low + high)
    return beta


@inner
def add_common_motion(S, values, targets, penalty, s, roof, M):
    """Add to M what the variables on the bound do together: A_B 1 (A_B 1)^T / sum_B c''."""
    total, bend = gain(S, targets, penalty, s, s, 0.0, roof)
    # Where the bound lies on a bound of its own, it does not move.
    if not bend > 0.0 or abs(total - S.peak) > 1e-6 * S.peak:
        return
    n = M.shape[0]
    together = np.zeros(n)
    for i in range(S.capped):
        if S.upper[i] > roof:
            slope, _ = marginal_cost(
                S.weight[i], S.exponent[i], penalty[0, i], penalty[1, i], penalty[2, i], targets[i], roof
            )
            if s[i] > slope:
                for a in range(S.start[i], S.start[i + 1]):
                    together[S.row[a]] += values[a]
    for i in range(n):
        for j in range(S.first[i], i + 1):
            M[i, j] += together[i] * together[j] / bend
