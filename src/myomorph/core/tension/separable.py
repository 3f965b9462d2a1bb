"""The separable problem as arrays: pattern of A, shared data, links, and envelope factors.

What variables do at given multipliers, in closed form: alone, reached by the one number
s = (A^T y)_i (see `dual.py`),

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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.kernels import inner
from myomorph.core.tension.elimination_order import coupled_rows, elimination_order


class Separable(NamedTuple):
    """Pattern and data that all frames share.

    Attributes
    ----------
    start : (variables + 1,) entries of column i of A are start[i] ... start[i + 1] - 1
    row : (entries,) their rows, in the order of elimination, ascending in each column
    first : (rows,) in the envelope of A D A^T, the first column of each row
    weight, exponent : (variables,) w and p of the cost w |x|^p
    lower, upper : (variables,) bounds
    capped : number of leading variables that lie under a common bound besides
    peak : cost of one unit of that bound, 0 for no such bound
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    weight: Array
    exponent: Array
    lower: Array
    upper: Array
    capped: int = 0
    peak: float = 0.0

    @property
    def column(self) -> NDArray[np.int64]:
        """(entries,) the variable that each entry of A belongs to."""
        return np.repeat(np.arange(len(self.weight)), np.diff(self.start))

    def dense(self, values: Array) -> Array:
        """Write A out from its entries.

        Parameters
        ----------
        values : (frames, entries)

        Returns
        -------
        (frames, rows, variables)
        """
        A = np.zeros((len(values), len(self.first), len(self.weight)))
        A[:, self.row, self.column] = values
        return A


class FrameLinks(NamedTuple):
    """Variables that should change little from one frame to the next.

    The cost gains stiffness_j w_i (amount_j - amount_(j-1))^2 for each linked variable i and each
    pair of neighbouring frames.

    Attributes
    ----------
    first : the variables first ... first + linked - 1 are linked
    scale : (frames, linked) amount of one unit of the variable, 0 where it takes no part
    amount : (frames, linked) room for the amounts as other frames see them
    stiffness : (frames - 1,) between a frame and the next, in units of the variables' weights
    over : factor of over-relaxation, 1 to 2
    sweeps : maximum number of passes over the frames
    tolerance : change of an amount at which passes end
    """

    first: int
    scale: Array
    amount: Array
    stiffness: Array
    over: float
    sweeps: int
    tolerance: float


def no_links() -> FrameLinks:
    """Links of frames that do not know of each other."""
    return FrameLinks(
        first=0,
        scale=np.zeros((0, 0)),
        amount=np.zeros((0, 0)),
        stiffness=np.zeros(0),
        over=1.0,
        sweeps=0,
        tolerance=0.0,
    )


@read_only
class Pattern:
    """Where A (rows, variables) may differ from 0, and an order of its rows with a small envelope.

    Attributes
    ----------
    start, row, first : as of `Separable`
    order : (rows,) the rows in the order of elimination
    place : (entries,) position of each of the caller's entries in the kernel's order
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    order: NDArray[np.int64]
    place: NDArray[np.int64]


def pattern(rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Pattern:
    """Pattern of a matrix A, its rows in an order that keeps the envelope of A A^T small.

    It is the reverse order of Cuthill and McKee.

    Parameters
    ----------
    rows, columns : (entries,) where the matrix may differ from 0, each position at most once
    shape : (rows, variables) of the matrix

    Returns
    -------
    pattern whose rows are in the order of elimination
    """
    n, variables = shape
    neighbors = coupled_rows(rows, columns, n)
    order = elimination_order(neighbors)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)

    first = np.arange(n, dtype=np.int64)
    for row, coupled in enumerate(neighbors):
        # A row without entries is coupled to none.
        first[rank[row]] = rank[[row, *coupled]].min()

    sorted_entries = np.lexsort((rank[rows], columns))
    place = np.empty(len(rows), np.int64)
    place[sorted_entries] = np.arange(len(rows))
    counts = np.bincount(columns, minlength=variables)
    return Pattern(
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        row=rank[rows][sorted_entries],
        first=first,
        order=order,
        place=place,
    )


@inner(fastmath={"reassoc", "contract"})
def factorize(M, first, floor):
    """Factorize M = L L^T inside its envelope, in place; pivots below `floor` are raised to it.

    Parameters
    ----------
    M : (rows, rows) symmetric, of which the lower triangle is read and becomes L
    first : (rows,) first column of each row inside the envelope
    floor : (rows,) least pivots
    """
    n = M.shape[0]
    for i in range(n):
        for j in range(first[i], i):
            total = M[i, j]
            for index in range(max(first[i], first[j]), j):
                total -= M[i, index] * M[j, index]
            M[i, j] = total / M[j, j]
        total = M[i, i]
        for index in range(first[i], i):
            total -= M[i, index] * M[i, index]
        M[i, i] = np.sqrt(max(total, floor[i]))


@inner
def back_substitute(M, first, z):
    """Solve L L^T z = right-hand side, in place.

    Parameters
    ----------
    M : (rows, rows) the factor L of `factorize`
    first : (rows,) first column of each row inside the envelope
    z : (rows,) the right-hand side, then the solution
    """
    n = M.shape[0]
    for i in range(n):
        total = z[i]
        for index in range(first[i], i):
            total -= M[i, index] * z[index]
        z[i] = total / M[i, i]
    for i in range(n - 1, -1, -1):
        z[i] /= M[i, i]
        for index in range(first[i], i):
            z[index] -= M[i, index] * z[i]


@inner
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


@inner
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


@inner
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


@inner
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


@inner
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


@inner
def _gain(S, targets, penalty, s, ds, t, beta):
    """Gain of the capped variables by a higher bound, and how fast it falls with the bound.

    Parameters
    ----------
    S : `Separable`
    targets : (variables,) t
    penalty : (3, variables) l, h and k
    s, ds : (variables,) reduced multipliers and their direction
    t : step along ds
    beta : the common bound

    Returns
    -------
    sum_i max(0, s_i + t ds_i - c_i'(beta)) and the sum of c_i'' over its terms above 0
    """
    total = 0.0
    fall = 0.0
    for i in range(S.capped):
        if S.upper[i] > beta:
            slope, curvature = _marginal_cost(
                S.weight[i],
                S.exponent[i],
                penalty[0, i],
                penalty[1, i],
                penalty[2, i],
                targets[i],
                beta,
            )
            more = s[i] + t * ds[i] - slope
            if more > 0.0:
                total += more
                fall += curvature
    return total, fall


@inner
def ceiling(S, targets, penalty, s, ds, t):
    """Find the common bound at the reduced multipliers s + t ds; infinite where it costs nothing.

    It is the beta at which the gain of the capped variables is the cost `peak` of a higher bound,
    by Newton steps, each bisected where it leaves the bracket.

    Parameters
    ----------
    S, targets, penalty, s, ds, t : as of `_gain`
    """
    if not S.peak > 0.0:
        return np.inf
    low = 0.0
    high = 0.0
    for i in range(S.capped):
        low = max(low, S.lower[i])
        high = max(high, S.upper[i])
    beta = low
    for _ in range(100):
        total, fall = _gain(S, targets, penalty, s, ds, t, beta)
        if total > S.peak:
            low = beta
        else:
            high = beta
        if high - low <= 1e-15:
            break
        step = (total - S.peak) / fall if fall > 0.0 else np.inf
        if abs(step) <= 1e-16:
            break
        beta = beta + step if low < beta + step < high else 0.5 * (low + high)
    return beta


@inner
def add_common_motion(S, values, targets, penalty, s, roof, M):
    """Add to M what the variables B on the common bound do together.

        M += (A_B 1) (A_B 1)^T / sum_B c''

    Parameters
    ----------
    S, targets, penalty, s : as of `_gain`
    values : (entries,) of A
    roof : the common bound
    M : (rows, rows) of which the envelope is filled
    """
    total, fall = _gain(S, targets, penalty, s, s, 0.0, roof)
    # Where the bound lies on a bound of its own, it does not move.
    if not fall > 0.0 or abs(total - S.peak) > 1e-6 * S.peak:
        return
    n = M.shape[0]
    together = np.zeros(n)
    for i in range(S.capped):
        if S.upper[i] > roof:
            slope, _ = _marginal_cost(
                S.weight[i],
                S.exponent[i],
                penalty[0, i],
                penalty[1, i],
                penalty[2, i],
                targets[i],
                roof,
            )
            if s[i] > slope:
                for a in range(S.start[i], S.start[i + 1]):
                    together[S.row[a]] += values[a]
    for i in range(n):
        for j in range(S.first[i], i + 1):
            M[i, j] += together[i] * together[j] / fall
