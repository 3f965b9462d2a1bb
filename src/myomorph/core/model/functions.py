"""Scalar functions of coordinates, of which joints, couplers and moving points consist.

Every function a model file can hold is one of two kinds, so the kernels know only these two:
piecewise polynomials of one coordinate (constants, lines, splines, couplers) and products of
sines (OpenSim's `Sine`, the ellipsoid of the scapulothoracic joint).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, read_only


@read_only
class PiecewisePolynomial:
    """f(x) = sum_j coefficients[i, j] (x - breaks[i])^j on piece i, the last break <= x.

    Left of the first break the first piece holds. A single piece at break 0 is a polynomial. A
    first break that is there twice makes its first piece the continuation to the left.

    Attributes
    ----------
    breaks : (pieces,) ascending
    coefficients : (pieces, degree + 1), the constant term first
    """

    breaks: Array
    coefficients: Array

    def __post_init__(self) -> None:
        freeze(self, breaks=(-1,), coefficients=(len(self.breaks), -1))

    @property
    def arity(self) -> int:
        """Number of coordinates the function takes: 0 for a constant, else 1."""
        return 0 if self.coefficients.shape == (1, 1) else 1

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        """Evaluate the function or a derivative.

        Parameters
        ----------
        x : of any shape
        order : of the derivative, 0 for the value

        Returns
        -------
        values of the same shape
        """
        x = np.asarray(x, dtype=np.float64)
        piece = np.clip(np.searchsorted(self.breaks, x, side="right") - 1, 0, None)
        h = x - self.breaks[piece]
        total = np.zeros_like(h)
        for j in range(self.coefficients.shape[1] - 1, order - 1, -1):
            falling = float(np.prod(np.arange(j, j - order, -1)))
            total = total * h + falling * self.coefficients[piece, j]
        return total

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """Multiply the function by a factor (OpenSim's `MultiplierFunction`)."""
        return replace(self, coefficients=self.coefficients * factor)

    def raised(self, by: float) -> PiecewisePolynomial:
        """Add a number to the function: f(x) + by."""
        constant_term = by * np.eye(1, self.coefficients.shape[1])
        return replace(self, coefficients=self.coefficients + constant_term)


@read_only
class SineProduct:
    """Product of sines of one or two coordinates.

        f(x_1, ..., x_n) = offset + factor * prod_i sin(frequencies[i] x_i + phases[i])

    Attributes
    ----------
    factor, offset : see above
    frequencies, phases : (n,)
    """

    factor: float
    frequencies: Array
    phases: Array
    offset: float = 0.0

    def __post_init__(self) -> None:
        freeze(self, frequencies=(-1,), phases=(len(self.frequencies),))

    @property
    def arity(self) -> int:
        """Number of coordinates the function takes."""
        return len(self.frequencies)

    def __call__(self, *x: ArrayLike) -> Array:
        """Evaluate the function.

        Parameters
        ----------
        x : x_1, ..., x_n, of any common shape

        Returns
        -------
        values of that shape
        """
        total: Array = np.asarray(self.factor, dtype=np.float64)
        for argument, frequency, phase in zip(x, self.frequencies, self.phases, strict=True):
            total = total * np.sin(frequency * np.asarray(argument, dtype=np.float64) + phase)
        return total + self.offset

    def slope(self, *x: ArrayLike, index: int = 0) -> Array:
        """Evaluate the derivative in one coordinate.

        The derivative of sin(w x + p) is w sin(w x + p + pi / 2).

        Parameters
        ----------
        x : x_1, ..., x_n, of any common shape
        index : of the coordinate

        Returns
        -------
        values of that shape
        """
        quarter = 0.5 * np.pi * np.eye(self.arity)[index]
        factor = self.factor * self.frequencies[index]
        return replace(self, factor=factor, phases=self.phases + quarter, offset=0.0)(*x)

    def scaled(self, factor: float) -> SineProduct:
        """Multiply the function by a factor."""
        return replace(self, factor=self.factor * factor, offset=self.offset * factor)

    def raised(self, by: float) -> SineProduct:
        """Add a number to the function: f(x) + by."""
        return replace(self, offset=self.offset + by)


Function = PiecewisePolynomial | SineProduct


def value_at(function: Function, coordinates: Sequence[str], values: Mapping[str, float]) -> float:
    """Evaluate a function of some coordinates.

    Parameters
    ----------
    function : of the coordinates
    coordinates : names that it takes, in order
    values : by coordinate [rad or m]
    """
    if isinstance(function, PiecewisePolynomial):
        return float(function(values[coordinates[0]] if function.arity else 0.0))
    return float(function(*(values[name] for name in coordinates[: function.arity])))


def substituted(coefficients: Array, start: float, slope: float = 1.0) -> Array:
    """Substitute start + slope x in a polynomial p(x).

    Parameters
    ----------
    coefficients : (n,) of p, the constant term first
    start, slope : of the line

    Returns
    -------
    (n,) coefficients of p(start + slope x)
    """
    turned = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([start, slope])).coef
    return np.pad(turned, (0, len(coefficients) - len(turned)))


def constant(value: float) -> PiecewisePolynomial:
    """Make the function that is `value` everywhere."""
    return PiecewisePolynomial(np.zeros(1), np.array([[value]]))


def linear(slope: float, intercept: float = 0.0) -> PiecewisePolynomial:
    """Make the line slope x + intercept."""
    return PiecewisePolynomial(np.zeros(1), np.array([[intercept, slope]]))


def polynomial(coefficients: ArrayLike) -> PiecewisePolynomial:
    """Make the polynomial sum_j coefficients[j] x^j.

    Parameters
    ----------
    coefficients : (n,) the constant term first
    """
    row = np.atleast_2d(np.asarray(coefficients, dtype=np.float64))
    return PiecewisePolynomial(np.zeros(1), row)


def piecewise_linear(x: ArrayLike, y: ArrayLike) -> PiecewisePolynomial:
    """Make straight lines through points, continued with the end slopes.

    Parameters
    ----------
    x, y : (points,), x ascending
    """
    x = np.asarray(x, dtype=np.float64)
    y = np.asarray(y, dtype=np.float64)
    slopes = np.diff(y) / np.diff(x)
    return PiecewisePolynomial(x[:-1], np.column_stack([y[:-1], slopes]))


def simm_spline(x: ArrayLike, y: ArrayLike) -> PiecewisePolynomial:
    """Make a cubic spline with OpenSim's `SimmSpline` end conditions, continued by straight lines.

    The third derivative at each end equals that of the cubic through the four end points (Forsythe,
    Malcolm and Moler 1977). With two points it is a line, with three a parabola-like cubic with
    equal second derivatives.

    With widths h_i and slopes s_i of the intervals, sigma_i = f''(x_i) / 6 solves, inside,

        h_(i-1) sigma_(i-1) + 2 (h_(i-1) + h_i) sigma_i + h_i sigma_(i+1) = s_i - s_(i-1)

    Parameters
    ----------
    x : (points,) strictly ascending
    y : (points,)
    """
    x = np.asarray(x, dtype=np.float64)
    y = np.asarray(y, dtype=np.float64)
    n = len(x)
    if n < 2:
        return constant(float(y[0]) if n else 0.0)
    h = np.diff(x)
    slope = np.diff(y) / h
    if n == 2:
        return linear(slope[0], y[0] - slope[0] * x[0])
    matrix = np.zeros((n, n))
    right = np.zeros(n)
    for i in range(1, n - 1):
        matrix[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = slope[i] - slope[i - 1]
    matrix[0, :2] = -h[0], h[0]
    matrix[-1, -2:] = h[-1], -h[-1]
    if n > 3:
        second = np.diff(slope) / (x[2:] - x[:-2])
        right[0] = h[0] ** 2 * (second[1] - second[0]) / (x[3] - x[0])
        right[-1] = -(h[-1] ** 2) * (second[-1] - second[-2]) / (x[-1] - x[-4])
    sigma = np.linalg.solve(matrix, right)
    b = np.empty(n)
    b[:-1] = slope - h * (sigma[1:] + 2.0 * sigma[:-1])
    b[-1] = slope[-1] + h[-1] * (sigma[-2] + 2.0 * sigma[-1])
    pieces = np.column_stack([y[:-1], b[:-1], 3.0 * sigma[:-1], np.diff(sigma) / h])
    before = [y[0], b[0], 0.0, 0.0]
    after = [y[-1], b[-1], 0.0, 0.0]
    return PiecewisePolynomial(np.concatenate([x[:1], x]), np.vstack([before, pieces, after]))
