"""Natural splines through samples, as sums of B-splines.

`scipy.interpolate` has them too, but takes longer to import than a motion of one second to
differentiate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.motion.banded import solve_banded
from myomorph.core.rigid.kernels import kernel

# Orders of the derivatives that vanish at both ends, by degree
NATURAL_ORDERS = {3: (2,), 5: (3, 4)}


@read_only
class Spline:
    """A piecewise polynomial of one variable, s(x) = sum_i c_i B_i(x).

    Attributes
    ----------
    knots : (coefficients + degree + 1,) t of the B-splines
    coefficients : (coefficients, ...) c, a curve for each of the further axes
    degree : of the polynomials
    """

    knots: Array
    coefficients: Array
    degree: int

    def __call__(self, at: ArrayLike, order: int = 0) -> Array:
        """Evaluate the spline, or a derivative; beyond the ends the outer polynomials continue.

            s(x) = sum_i c_i B_i(x)

        Parameters
        ----------
        at : (points,) or one x
        order : of the derivative, at most the degree

        Returns
        -------
        (points, ...), or (...) at one
        """
        if order:
            return self.derivative(order)(at)
        at = np.asarray(at, dtype=np.float64)
        points = at.reshape(-1)
        first = _first_basis(self.knots, self.degree, points)
        basis = _basis(self.knots, self.degree, points, first)
        # A copy, because a kernel is compiled anew for arrays that are read-only.
        coefficients = self.coefficients.reshape(len(self.coefficients), -1).copy()
        values = np.empty((len(points), coefficients.shape[1]))
        sum_basis(basis, first, coefficients, values)
        return values.reshape(at.shape + self.coefficients.shape[1:])

    def derivative(self, order: int = 1) -> Spline:
        """Differentiate the spline.

            d/dx sum_i c_i B_i,k = sum_i k (c_i+1 - c_i) / (t_i+k+1 - t_i+1) B_i,k-1

        Source: de Boor 1978, chapter X.

        Parameters
        ----------
        order : of the derivative, at most the degree

        Returns
        -------
        a spline whose degree is smaller by `order`
        """
        spline = self
        for _ in range(order):
            k = spline.degree
            widths = spline.knots[k + 1 : -1] - spline.knots[1 : -k - 1]
            further = (1,) * (spline.coefficients.ndim - 1)
            slopes = k * np.diff(spline.coefficients, axis=0) / widths.reshape(-1, *further)
            spline = Spline(knots=spline.knots[1:-1], coefficients=slopes, degree=k - 1)
        return spline


def natural_spline(time: Array, values: Array, degree: int = 5) -> Spline:
    """Interpolate every column of values by a natural spline.

    OpenSim's `GCVSpline` with no error variance: the derivatives of order (degree + 1) / 2 ...
    degree - 1 vanish at both ends.

    Source: Woltring 1986.

    Parameters
    ----------
    time : (frames,) that increase [s]
    values : (frames, ...)
    degree : 3 or 5

    Returns
    -------
    a spline through all values, a curve for each column

    Raises
    ------
    BadData : there are too few frames, values are not finite, or times do not increase
    """
    if len(time) <= degree:
        raise BadData(
            f"a spline of degree {degree} needs at least {degree + 1} frames, but got {len(time)}"
        )
    if not np.isfinite(values).all():
        raise BadData(
            "a spline needs finite values, but some are NaN or infinite: fill the gaps or choose"
            " another time"
        )
    time = np.asarray(time, dtype=np.float64)
    values = np.asarray(values, dtype=np.float64)
    if not np.all(np.diff(time) > 0.0):
        raise BadData("a spline needs times that increase")
    knots = np.concatenate([[time[0]] * degree, time, [time[-1]] * degree])
    rows = _conditions(knots, degree, time)
    ends = len(NATURAL_ORDERS[degree])
    coefficients = np.zeros((len(rows), values[0].size))
    coefficients[ends : ends + len(time)] = values.reshape(len(time), -1)
    solve_banded(rows, coefficients, degree)
    return Spline(
        knots=knots,
        coefficients=coefficients.reshape(len(coefficients), *values.shape[1:]),
        degree=degree,
    )


def _conditions(knots: Array, degree: int, time: Array) -> Array:
    """State what a natural spline fulfills, as rows of a banded matrix.

    First the derivatives that vanish at the start, then the values at all times, then the
    derivatives that vanish at the end.

    Parameters
    ----------
    knots : (coefficients + degree + 1,)
    degree : of the polynomials
    time : (frames,)

    Returns
    -------
    (coefficients, 3 degree + 1), each row about its diagonal, as `solve_banded` takes them
    """
    orders = NATURAL_ORDERS[degree]
    count = len(time) + 2 * len(orders)
    rows = np.zeros((count, 3 * degree + 1))

    first = _first_basis(knots, degree, time)
    numbers = len(orders) + np.arange(len(time))[:, None]
    columns = first[:, None] - numbers + degree + np.arange(degree + 1)
    # At the ends a B-spline that is 0 there may lie outside the band.
    inside = (columns >= 0) & (columns < rows.shape[1])
    basis = _basis(knots, degree, time, first)
    rows[np.broadcast_to(numbers, columns.shape)[inside], columns[inside]] = basis[inside]

    for number, order in enumerate(orders):
        left = _end_derivative(knots, degree, order)
        rows[number, degree - number : degree - number + len(left)] = left
        # At the other end the knots are reversed, and so are the coefficients.
        right = _end_derivative(-knots[::-1], degree, order)[::-1]
        last = degree + number
        rows[count - 1 - number, last - len(right) + 1 : last + 1] = right
    return rows


def _first_basis(knots: Array, degree: int, at: Array) -> np.ndarray:
    """Find the first B-spline that is not 0 at each point.

    Parameters
    ----------
    knots : (coefficients + degree + 1,)
    degree : of the polynomials
    at : (points,)

    Returns
    -------
    (points,) its number; beyond the ends that of the outer interval
    """
    last = len(knots) - degree - 2
    return np.clip(np.searchsorted(knots, at, side="right") - 1, degree, last) - degree


def _basis(knots: Array, degree: int, at: Array, first: np.ndarray) -> Array:
    """Evaluate the B-splines that are not 0 at each point.

        B_i,k = (x - t_i) / (t_i+k - t_i) B_i,k-1 + (t_i+k+1 - x) / (t_i+k+1 - t_i+1) B_i+1,k-1

    Source: de Boor 1978, chapter X.

    Parameters
    ----------
    knots : (coefficients + degree + 1,)
    degree : of the polynomials
    at : (points,)
    first : (points,) of `_first_basis`

    Returns
    -------
    (points, degree + 1)
    """
    basis = np.zeros((degree + 1, len(at)))
    basis[0] = 1.0
    # The knots about each point, the last at or before it in row degree - 1
    near = knots[first + np.arange(1, 2 * degree + 1)[:, None]]
    for k in range(1, degree + 1):
        carried = np.zeros(len(at))
        for j in range(k):
            after = near[degree + j]
            before = near[degree + j - k]
            share = basis[j] / (after - before)
            basis[j] = carried + (after - at) * share
            carried = (at - before) * share
        basis[k] = carried
    return np.ascontiguousarray(basis.T)


def _end_derivative(knots: Array, degree: int, order: int) -> Array:
    """Compute the row of the first coefficients that gives a derivative at the first knot.

    Parameters
    ----------
    knots : (coefficients + degree + 1,)
    degree : of the polynomials
    order : of the derivative

    Returns
    -------
    (order + 1,) scaled to a largest element of 1
    """
    row = np.eye(order + 1)
    for j in range(order):
        numbers = np.arange(len(row) - 1)
        widths = knots[numbers + degree + 1] - knots[numbers + j + 1]
        row = np.diff(row, axis=0) / widths[:, None]
    return np.asarray(row[0] / np.abs(row[0]).max())


@kernel
def sum_basis(basis, first, coefficients, values):
    """Fill values with the sums of each point's B-splines times their coefficients.

    Parameters
    ----------
    basis : (points, degree + 1) of `_basis`
    first : (points,) number of the first of them
    coefficients : (coefficients, curves)
    values : (points, curves) filled
    """
    for point in range(basis.shape[0]):
        # Rows as arrays of their own, which the compiler makes fast.
        sums = values[point]
        sums[:] = 0.0
        for j in range(basis.shape[1]):
            weight = basis[point, j]
            summands = coefficients[first[point] + j]
            for curve in range(len(sums)):
                sums[curve] += weight * summands[curve]
