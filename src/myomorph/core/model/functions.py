"""Scalar functions of coordinates: what joints, couplers and moving points are made of.

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
    Left of the first break the first piece holds. A single piece at break 0 is a polynomial; a
    first break given twice makes its first piece the continuation to the left.
    """

    breaks: Array  # (pieces,) ascending
    coefficients: Array  # (pieces, degree + 1), the constant term first

    def __post_init__(self) -> None:
        freeze(self, breaks=(-1,), coefficients=(len(self.breaks), -1))

    @property
    def arity(self) -> int:
        """Number of coordinates the function takes: 0 for a constant, else 1."""
        return 0 if self.coefficients.shape == (1, 1) else 1

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        """Value (or the derivative of `order`) at x, any shape."""
        x = np.asarray(x, dtype=np.float64)
        piece = np.clip(np.searchsorted(self.breaks, x, side="right") - 1, 0, None)
        h = x - self.breaks[piece]
        total = np.zeros_like(h)
        for j in range(self.coefficients.shape[1] - 1, order - 1, -1):
            falling = float(np.prod(np.arange(j, j - order, -1)))
            total = total * h + falling * self.coefficients[piece, j]
        return total

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """The function times a factor (OpenSim's `MultiplierFunction`)."""
        return replace(self, coefficients=self.coefficients * factor)

    def raised(self, by: float) -> PiecewisePolynomial:
        """The function f(x) + by."""
        return replace(
            self, coefficients=self.coefficients + by * np.eye(1, self.coefficients.shape[1])
        )


@read_only
class SineProduct:
    """f(x_1, ..., x_n) = offset + factor * prod_i sin(frequencies[i] x_i + phases[i]), n = 1 or 2."""

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
        """Value at the coordinates x_1, ..., x_n, any common shape."""
        total: Array = np.asarray(self.factor, dtype=np.float64)
        for argument, frequency, phase in zip(x, self.frequencies, self.phases, strict=True):
            total = total * np.sin(frequency * np.asarray(argument, dtype=np.float64) + phase)
        return total + self.offset

    def scaled(self, factor: float) -> SineProduct:
        """The function times a factor."""
        return replace(self, factor=self.factor * factor, offset=self.offset * factor)

    def raised(self, by: float) -> SineProduct:
        """The function f(x) + by."""
        return replace(self, offset=self.offset + by)


Function = PiecewisePolynomial | SineProduct


def value_at(function: Function, coordinates: Sequence[str], values: Mapping[str, float]) -> float:
    """The value of a function of some coordinates."""
    if isinstance(function, PiecewisePolynomial):
        return float(function(values[coordinates[0]] if function.arity else 0.0))
    return float(function(*(values[name] for name in coordinates[: function.arity])))


def substituted(coefficients: Array, start: float, slope: float = 1.0) -> Array:
    """Coefficients of the polynomial p(start + slope x) for those of p(x), as many of them, the
    constant term first.
    """
    turned = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([start, slope])).coef
    return np.pad(turned, (0, len(coefficients) - len(turned)))


def constant(value: float) -> PiecewisePolynomial:
    """The function that is `value` everywhere."""
    return PiecewisePolynomial(np.zeros(1), np.array([[value]]))


def linear(slope: float, intercept: float = 0.0) -> PiecewisePolynomial:
    """The line slope x + intercept."""
    return PiecewisePolynomial(np.zeros(1), np.array([[intercept, slope]]))


def polynomial(coefficients: ArrayLike) -> PiecewisePolynomial:
    """The polynomial sum_j coefficients[j] x^j, the constant term first."""
    return PiecewisePolynomial(
        np.zeros(1), np.atleast_2d(np.asarray(coefficients, dtype=np.float64))
    )


def piecewise_linear(x: ArrayLike, y: ArrayLike) -> PiecewisePolynomial:
    """Straight lines through the points (x, y), continued with the end slopes."""
    x = np.asarray(x, dtype=np.float64)
    y = np.asarray(y, dtype=np.float64)
    slopes = np.diff(y) / np.diff(x)
    return PiecewisePolynomial(x[:-1], np.column_stack([y[:-1], slopes]))


def simm_spline(x: ArrayLike, y: ArrayLike) -> PiecewisePolynomial:
    """Cubic spline with OpenSim's `SimmSpline` end conditions, continued by straight lines.
    The third derivative at each end equals that of the cubic through the four end points (Forsythe,
    Malcolm and Moler 1977); with two points it is a line, with three a parabola-like cubic with
    equal second derivatives. `x` (points,) strictly ascending abscissae; `y` (points,) ordinates.
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
