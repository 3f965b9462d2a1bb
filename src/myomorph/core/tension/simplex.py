"""Linear programs from a point that fulfils them: extremes of many functions over one polytope.

    minimise  c^T x   subject to  A x = b,  lower <= x <= upper,   from x0 with A x0 = b

by the primal simplex method for bounded variables on a dense tableau (Dantzig 1963, ch. 18; ratio
test of Harris 1973). It starts at any feasible point, such as the solution of the tension problem:
variables strictly inside their bounds that are not basic may move either way. One function after
the other begins where the last one ended, so that most take a few pivots.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import inner, kernel

FOUND = 0
UNBOUNDED = 1
STOPPED = 2
INSIDE = 1e-9
"""A variable nearer to a bound, as a share of its range or of 1, stands on it."""
FLAT = 1e-9
"""A reduced cost below this share of the largest cost is none."""
REFRESH = 150
"""Number of pivots after which the tableau is made anew from A."""


def extremes(A: Array, x: Array, lower: Array, upper: Array, costs: Array) -> tuple[Array, Array]:
    """Least value of each linear function over {y : A y = A x, lower <= y <= upper}.

    Parameters
    ----------
    A : (rows, n)
    x : (n,) inside the bounds
    lower, upper : (n,) may be infinite
    costs : (functions, n)

    Returns
    -------
    (functions,) least values, -inf where there is none, and (functions, n) points that take them
    """
    values = np.empty(len(costs))
    points = np.empty(costs.shape)
    arrays = [np.array(array, dtype=np.float64, order="C") for array in (A, x, lower, upper, costs)]
    least_values(*arrays, values, points)
    return values, points


@kernel
def least_values(A, x, lower, upper, costs, least, points):
    """Do `extremes` in place.

    Parameters
    ----------
    A, x, lower, upper, costs : as of `extremes`
    least : (functions,) filled with the least values; -inf where there is none, NaN where pivots
        ran out
    points : (functions, n) filled

    Returns
    -------
    the worst status: FOUND, or STOPPED where pivots ran out
    """
    m, n = A.shape
    scale = np.ones(n)
    for j in range(n):
        if upper[j] - lower[j] < np.inf and upper[j] > lower[j]:
            scale[j] = upper[j] - lower[j]
    low = lower / scale
    high = upper / scale
    y = x / scale
    T = np.empty((m, n))
    S = np.empty((m, n))
    for r in range(m):
        size = 0.0
        for j in range(n):
            S[r, j] = A[r, j] * scale[j]
            size = max(size, abs(S[r, j]))
        if size > 0.0:
            for j in range(n):
                S[r, j] /= size
    basis = np.full(m, -1)
    where = np.full(n, -1)
    preference = np.empty(n)
    for j in range(n):
        room = min(y[j] - low[j], high[j] - y[j])
        preference[j] = min(max(room, 1e-7), 1.0)
    _canonical(S, preference, T, basis, where)
    d = np.empty(n)
    worst = FOUND
    pivots = 0
    for f in range(costs.shape[0]):
        if pivots > REFRESH:
            for j in range(n):
                preference[j] = 1.0 if where[j] >= 0 else 1e-7
            _canonical(S, preference, T, basis, where)
            pivots = 0
        status, steps = _descend(T, costs[f] * scale, y, low, high, basis, where, d)
        pivots += steps
        worst = max(worst, STOPPED if status == STOPPED else FOUND)
        total = 0.0
        for j in range(n):
            points[f, j] = y[j] * scale[j]
            total += costs[f, j] * points[f, j]
        least[f] = total
        if status == UNBOUNDED:
            least[f] = -np.inf
        elif status == STOPPED:
            least[f] = np.nan
    return worst


@inner
def _canonical(S, preference, T, basis, where):
    """Fill T = B^-1 S for a basis B of well conditioned columns that are preferred.

    A row that depends on others gets no column.

    Parameters
    ----------
    S : (rows, n) scaled A
    preference : (n,) factor of a column's pivots when columns are chosen
    T : (rows, n) filled
    basis : (rows,) filled with the column of each row, -1 for none
    where : (n,) filled with the row of each column, -1 for none
    """
    m, n = S.shape
    for j in range(n):
        where[j] = -1
    for r in range(m):
        basis[r] = -1
        for j in range(n):
            T[r, j] = S[r, j]
    for _ in range(m):
        row, column = _largest(T, preference, basis, where)
        if row < 0:
            break
        _pivot(T, row, column)
        basis[row] = column
        where[column] = row


@inner
def _largest(T, preference, basis, where):
    """Row and column of the greatest preferred entry outside the basis, -1 for none."""
    m, n = T.shape
    best = 1e-11
    row = -1
    column = -1
    for r in range(m):
        if basis[r] >= 0:
            continue
        for j in range(n):
            size = abs(T[r, j]) * preference[j]
            if size > best and abs(T[r, j]) > 1e-9 and where[j] < 0:
                best = size
                row = r
                column = j
    return row, column


@inner(fastmath={"reassoc", "contract"})
def _pivot(T, row, column):
    """Bring a column into the basis in a row of the tableau."""
    m, n = T.shape
    inverse = 1.0 / T[row, column]
    for j in range(n):
        T[row, j] *= inverse
    for r in range(m):
        factor = T[r, column]
        if r != row and factor != 0.0:
            for j in range(n):
                T[r, j] -= factor * T[row, j]
            T[r, column] = 0.0
    T[row, column] = 1.0


@inner
def _descend(T, cost, y, low, high, basis, where, d):
    """Pivot until no variable can lower the cost.

    Parameters
    ----------
    T, basis, where : tableau and basis as of `_canonical`, changed
    cost : (n,)
    y : (n,) the point, changed
    low, high : (n,) bounds
    d : (n,) room for reduced costs

    Returns
    -------
    status and number of pivots
    """
    m = T.shape[0]
    flat = FLAT * _reduced_costs(T, cost, basis, d)
    without_progress = 0
    pivots = 0
    for _ in range(50 * (m + 20)):
        # Where steps have long been 0, the first that may enter does: no cycle then (Bland 1977).
        enter = _entering(d, y, low, high, where, flat, without_progress > 2 * m)
        if enter < 0:
            return FOUND, pivots
        way = 1.0 if d[enter] < 0.0 else -1.0
        leave, step = _leaving(T, way, enter, y, low, high, basis)
        own_range = high[enter] - y[enter] if way > 0.0 else y[enter] - low[enter]
        if own_range <= step:
            step = own_range
            leave = -1
        if step == np.inf:
            return UNBOUNDED, pivots
        without_progress = without_progress + 1 if step <= INSIDE else 0
        y[enter] += way * step
        for r in range(m):
            if basis[r] >= 0:
                y[basis[r]] -= way * step * T[r, enter]
        if leave < 0:
            y[enter] = high[enter] if way > 0.0 else low[enter]
            continue
        index = basis[leave]
        y[index] = high[index] if -way * T[leave, enter] > 0.0 else low[index]
        slope = d[enter]
        _pivot(T, leave, enter)
        for j in range(T.shape[1]):
            d[j] -= slope * T[leave, j]
        d[enter] = 0.0
        where[index] = -1
        where[enter] = leave
        basis[leave] = enter
        pivots += 1
    return STOPPED, pivots


@inner
def _reduced_costs(T, cost, basis, d):
    """Fill d with the reduced costs d = cost - T^T cost_basis; returns the largest cost."""
    m, n = T.shape
    largest = 0.0
    for j in range(n):
        d[j] = cost[j]
        largest = max(largest, abs(cost[j]))
    for r in range(m):
        index = basis[r]
        if index >= 0 and cost[index] != 0.0:
            for j in range(n):
                d[j] -= cost[index] * T[r, j]
    return largest


@inner
def _entering(d, y, low, high, where, flat, take_first):
    """Variable of the largest reduced cost that has room to move, or the first; -1 for none."""
    enter = -1
    best = flat
    for j in range(d.shape[0]):
        if where[j] >= 0 or abs(d[j]) <= best:
            continue
        room = high[j] - y[j] if d[j] < 0.0 else y[j] - low[j]
        if room > INSIDE:
            enter = j
            best = abs(d[j])
            if take_first:
                break
    return enter


@inner
def _leaving(T, way, enter, y, low, high, basis):
    """Row that bounds the step of the entering variable, -1 for none, and that step.

    Of the rows whose variables meet a bound within the tolerance, that of the largest pivot leaves
    (Harris 1973).
    """
    m = T.shape[0]
    max_step = np.inf
    for r in range(m):
        rate = -way * T[r, enter]
        if basis[r] >= 0 and abs(rate) > 1e-9:
            index = basis[r]
            room = (high[index] - y[index] if rate > 0.0 else y[index] - low[index]) + INSIDE
            max_step = min(max_step, room / abs(rate))
    leave = -1
    largest_rate = 0.0
    step = np.inf
    for r in range(m):
        rate = -way * T[r, enter]
        if basis[r] >= 0 and abs(rate) > 1e-9 and abs(rate) > largest_rate:
            index = basis[r]
            room = high[index] - y[index] if rate > 0.0 else y[index] - low[index]
            if room / abs(rate) <= max_step:
                largest_rate = abs(rate)
                leave = r
                step = max(room / abs(rate), 0.0)
    return leave, step
