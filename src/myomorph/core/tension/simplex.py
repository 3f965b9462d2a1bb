"""Linear programs from a point that fulfils them: extremes of many functions over one polytope.

    minimise  c^T x   subject to  A x = b,  lower <= x <= upper,   from x0 with A x0 = b

by the primal simplex method for bounded variables on a dense tableau (Dantzig 1963, ch. 18; ratio
test of Harris 1973). It starts at any feasible point, such as the solution of the tension problem:
variables strictly inside their bounds that are not basic may move either way. One function after
the other begins where the last one ended, so that most take a few pivots.

With a basis B of columns the tableau is B^-1 A, and reduced costs d = c - (B^-1 A)^T c_B say what
a variable outside the basis gains. The best of them enters (`_entering`) and moves until a basic
variable meets a bound (`_leaving`), which it leaves for (`_pivot`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import bare, inner, kernel

FOUND = 0
UNBOUNDED = 1
STOPPED = 2
INSIDE = 1e-9
"""A variable nearer to a bound, as a share of its range or of 1, stands on it."""
FLAT = 1e-9
"""A reduced cost below this share of the largest cost is none."""
REFRESH = 150
"""Number of pivots after which the tableau is made anew from A."""
MIN_PIVOT = 1e-9
"""Entry of the tableau, in scaled units, below which it is rounding."""
UNLIKELY = 1e-7
"""Preference of a column whose variable has no room, when columns are chosen."""


class Polytope(NamedTuple):
    """All y with A y = A x and lower <= y <= upper.

    Attributes
    ----------
    A : (rows, n)
    x : (n,) a point of it
    lower, upper : (n,) may be infinite
    """

    A: Array
    x: Array
    lower: Array
    upper: Array


class Scaled(NamedTuple):
    """The polytope with ranges of 1 and rows whose largest entry is 1.

    Attributes
    ----------
    A : (rows, n)
    x : (n,) the point, which moves
    lower, upper : (n,)
    scale : (n,) what one unit of each variable is
    """

    A: Array
    x: Array
    lower: Array
    upper: Array
    scale: Array


class Tableau(NamedTuple):
    """A basis and what it makes of the rows and costs.

    Attributes
    ----------
    entries : (rows, n) B^-1 A
    basis : (rows,) column of each row, -1 for none: the row depends on others
    row_of : (n,) row of each column, -1 for those outside the basis
    reduced : (n,) reduced costs d
    """

    entries: Array
    basis: NDArray[np.int64]
    row_of: NDArray[np.int64]
    reduced: Array


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
    polytope = Polytope(A=_array(A), x=_array(x), lower=_array(lower), upper=_array(upper))
    least_values(polytope, _array(costs), values, points)
    return values, points


def _array(values: Array) -> Array:
    """Copy values as the kernel reads them: writable, in C order."""
    return np.array(values, dtype=np.float64, order="C")


@kernel
def least_values(polytope, costs, least, points):
    """Do `extremes` in place.

    Parameters
    ----------
    polytope : `Polytope`
    costs : (functions, n)
    least : (functions,) filled with the least values; -inf where there is none, NaN where pivots
        ran out
    points : (functions, n) filled

    Returns
    -------
    the worst status: FOUND, or STOPPED where pivots ran out
    """
    m, n = polytope.A.shape
    scaled = _scaled(polytope)
    scale = scaled.scale
    tableau = Tableau(
        entries=np.empty((m, n)),
        basis=np.full(m, -1),
        row_of=np.full(n, -1),
        reduced=np.empty(n),
    )
    preference = _room_of(scaled)
    _canonical(scaled, preference, tableau)
    worst = FOUND
    pivots = 0
    for function in range(costs.shape[0]):
        if pivots > REFRESH:
            _prefer_basis(tableau, preference)
            _canonical(scaled, preference, tableau)
            pivots = 0
        status, steps = _descend(scaled, tableau, costs[function] * scale)
        pivots += steps
        total = 0.0
        for j in range(n):
            points[function, j] = scaled.x[j] * scale[j]
            total += costs[function, j] * points[function, j]
        least[function] = total
        if status == UNBOUNDED:
            least[function] = -np.inf
        elif status == STOPPED:
            least[function] = np.nan
            worst = STOPPED
    return worst


@inner
def _scaled(polytope):
    """Scale a polytope so that pivots and tolerances mean the same in all of it.

    Parameters
    ----------
    polytope : `Polytope`
    """
    m, n = polytope.A.shape
    lower = polytope.lower
    upper = polytope.upper
    scale = np.ones(n)
    for j in range(n):
        if upper[j] - lower[j] < np.inf and upper[j] > lower[j]:
            scale[j] = upper[j] - lower[j]
    A = np.empty((m, n))
    for r in range(m):
        largest = 0.0
        for j in range(n):
            A[r, j] = polytope.A[r, j] * scale[j]
            largest = max(largest, abs(A[r, j]))
        if largest > 0.0:
            for j in range(n):
                A[r, j] /= largest
    return Scaled(A=A, x=polytope.x / scale, lower=lower / scale, upper=upper / scale, scale=scale)


@inner
def _room_of(scaled):
    """Preference of each column (n,): how far its variable is from its bounds, at most 1.

    Parameters
    ----------
    scaled : `Scaled`
    """
    preference = np.empty(scaled.x.shape[0])
    for j in range(preference.shape[0]):
        room = min(scaled.x[j] - scaled.lower[j], scaled.upper[j] - scaled.x[j])
        preference[j] = min(max(room, UNLIKELY), 1.0)
    return preference


@bare
def _prefer_basis(tableau, preference):
    """Prefer the columns that are basic already.

    Parameters
    ----------
    tableau : `Tableau`
    preference : (n,) filled
    """
    for j in range(preference.shape[0]):
        preference[j] = 1.0 if tableau.row_of[j] >= 0 else UNLIKELY


@bare
def _canonical(scaled, preference, tableau):
    """Make the tableau B^-1 A for a basis B of well conditioned columns that are preferred.

    A row that depends on others gets no column.

    Parameters
    ----------
    scaled : `Scaled`
    preference : (n,) factor of a column's pivots when columns are chosen
    tableau : `Tableau`, filled but for its reduced costs
    """
    m, n = scaled.A.shape
    for j in range(n):
        tableau.row_of[j] = -1
    for r in range(m):
        tableau.basis[r] = -1
        for j in range(n):
            tableau.entries[r, j] = scaled.A[r, j]
    for _ in range(m):
        row, column = _largest(tableau, preference)
        if row < 0:
            break
        _pivot(tableau.entries, row, column)
        tableau.basis[row] = column
        tableau.row_of[column] = row


@bare
def _largest(tableau, preference):
    """Row and column of the greatest preferred entry outside the basis, -1 for none.

    Parameters
    ----------
    tableau : `Tableau`
    preference : (n,)
    """
    entries = tableau.entries
    basis = tableau.basis
    row_of = tableau.row_of
    m, n = entries.shape
    best = 1e-11
    row = -1
    column = -1
    for r in range(m):
        if basis[r] >= 0:
            continue
        for j in range(n):
            size = abs(entries[r, j]) * preference[j]
            if size > best and abs(entries[r, j]) > MIN_PIVOT and row_of[j] < 0:
                best = size
                row = r
                column = j
    return row, column


@inner(_nrt=False, fastmath={"reassoc", "contract"})
def _pivot(entries, row, column):
    """Bring a column into the basis in a row of the tableau.

    Parameters
    ----------
    entries : (rows, n)
    row, column : where the entry becomes 1, and 0 in all other rows
    """
    m, n = entries.shape
    inverse = 1.0 / entries[row, column]
    for j in range(n):
        entries[row, j] *= inverse
    for r in range(m):
        factor = entries[r, column]
        if r != row and factor != 0.0:
            for j in range(n):
                entries[r, j] -= factor * entries[row, j]
            entries[r, column] = 0.0
    entries[row, column] = 1.0


@bare
def _descend(scaled, tableau, cost):
    """Pivot until no variable can lower the cost.

    Parameters
    ----------
    scaled : `Scaled`, whose point moves
    tableau : `Tableau`, changed
    cost : (n,) of the scaled variables

    Returns
    -------
    status and number of pivots
    """
    m = tableau.entries.shape[0]
    flat = FLAT * _reduce_costs(tableau, cost)
    without_progress = 0
    pivots = 0
    for _ in range(50 * (m + 20)):
        # Where steps have long been 0, the first that may enter does: no cycle then (Bland 1977).
        enter = _entering(scaled, tableau, flat, without_progress > 2 * m)
        if enter < 0:
            return FOUND, pivots
        way = 1.0 if tableau.reduced[enter] < 0.0 else -1.0
        leave, step = _leaving(scaled, tableau, enter, way)
        own_range = _room(scaled, enter, way)
        if own_range <= step:
            step = own_range
            leave = -1
        if step == np.inf:
            return UNBOUNDED, pivots
        without_progress = without_progress + 1 if step <= INSIDE else 0
        _move(scaled, tableau, enter, way * step)
        if leave < 0:
            _put_on_bound(scaled, enter, way)
            continue
        _put_on_bound(scaled, tableau.basis[leave], -way * tableau.entries[leave, enter])
        _exchange(tableau, leave, enter)
        pivots += 1
    return STOPPED, pivots


@bare
def _reduce_costs(tableau, cost):
    """Fill the reduced costs d = c - (B^-1 A)^T c_B; returns the largest cost.

    Parameters
    ----------
    tableau : `Tableau`
    cost : (n,) c
    """
    entries = tableau.entries
    reduced = tableau.reduced
    m, n = entries.shape
    largest = 0.0
    for j in range(n):
        reduced[j] = cost[j]
        largest = max(largest, abs(cost[j]))
    for r in range(m):
        column = tableau.basis[r]
        if column >= 0 and cost[column] != 0.0:
            for j in range(n):
                reduced[j] -= cost[column] * entries[r, j]
    return largest


@bare
def _room(scaled, j, way):
    """How far a variable is from the bound that it moves to: up where `way` is above 0."""
    if way > 0.0:
        return scaled.upper[j] - scaled.x[j]
    return scaled.x[j] - scaled.lower[j]


@bare
def _put_on_bound(scaled, j, way):
    """Put a variable onto the bound that it has moved to, without rounding."""
    scaled.x[j] = scaled.upper[j] if way > 0.0 else scaled.lower[j]


@bare
def _entering(scaled, tableau, flat, take_first):
    """Variable of the largest reduced cost that has room to move, or the first; -1 for none.

    Parameters
    ----------
    scaled, tableau : `Scaled`, `Tableau`
    flat : a reduced cost up to this is none
    take_first : whether the first that may enter does
    """
    reduced = tableau.reduced
    row_of = tableau.row_of
    enter = -1
    best = flat
    for j in range(reduced.shape[0]):
        if row_of[j] >= 0 or abs(reduced[j]) <= best:
            continue
        if _room(scaled, j, -reduced[j]) > INSIDE:
            enter = j
            best = abs(reduced[j])
            if take_first:
                break
    return enter


@bare
def _leaving(scaled, tableau, enter, way):
    """Row that bounds the step of the entering variable, -1 for none, and that step.

    Of the rows whose variables meet a bound within the tolerance, that of the largest pivot leaves
    (Harris 1973).

    Parameters
    ----------
    scaled, tableau : `Scaled`, `Tableau`
    enter : the variable
    way : 1 where it grows, -1 where it falls
    """
    entries = tableau.entries
    basis = tableau.basis
    m = entries.shape[0]
    max_step = np.inf
    for r in range(m):
        rate = -way * entries[r, enter]
        if basis[r] >= 0 and abs(rate) > MIN_PIVOT:
            room = _room(scaled, basis[r], rate) + INSIDE
            max_step = min(max_step, room / abs(rate))
    leave = -1
    largest_rate = 0.0
    step = np.inf
    for r in range(m):
        rate = -way * entries[r, enter]
        if basis[r] >= 0 and abs(rate) > MIN_PIVOT and abs(rate) > largest_rate:
            room = _room(scaled, basis[r], rate)
            if room / abs(rate) <= max_step:
                largest_rate = abs(rate)
                leave = r
                step = max(room / abs(rate), 0.0)
    return leave, step


@bare
def _move(scaled, tableau, enter, step):
    """Move a variable from outside the basis, and with it the basic ones.

    Parameters
    ----------
    scaled, tableau : `Scaled`, `Tableau`
    enter : the variable
    step : by which it grows
    """
    x = scaled.x
    basis = tableau.basis
    x[enter] += step
    for r in range(basis.shape[0]):
        if basis[r] >= 0:
            x[basis[r]] -= step * tableau.entries[r, enter]


@bare
def _exchange(tableau, leave, enter):
    """Bring a variable into the basis in the place of another, costs included.

    Parameters
    ----------
    tableau : `Tableau`
    leave : row of the variable that leaves
    enter : the variable that enters
    """
    entries = tableau.entries
    reduced = tableau.reduced
    slope = reduced[enter]
    _pivot(entries, leave, enter)
    for j in range(reduced.shape[0]):
        reduced[j] -= slope * entries[leave, j]
    reduced[enter] = 0.0
    tableau.row_of[tableau.basis[leave]] = -1
    tableau.row_of[enter] = leave
    tableau.basis[leave] = enter
