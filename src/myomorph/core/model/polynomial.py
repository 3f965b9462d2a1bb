"""Polynomials of several coordinates."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only


@read_only
class Polynomial:
    """p(x_1, ..., x_n) = sum_k coefficients[k] prod_i x_i^exponents[k, i].

    The terms are all those whose exponents add up to the order or less, the exponents of the last
    coordinate ascending first, as in OpenSim's MultivariatePolynomialFunction.

    Attributes
    ----------
    dimension : number of coordinates n
    order : largest sum of exponents of a term
    coefficients : (terms,) as many as (n + order)! / (n! order!)
    """

    dimension: int
    order: int
    coefficients: Array

    def __post_init__(self) -> None:
        freeze(self, coefficients=(-1,))

    @property
    def arity(self) -> int:
        """Number of coordinates that the polynomial takes."""
        return self.dimension

    @cached_property
    def exponents(self) -> np.ndarray:
        """(terms, dimension) exponent of each coordinate."""
        rows: list[tuple[int, ...]] = [()]
        for _ in range(self.dimension):
            rows = [(*row, power) for row in rows for power in range(self.order - sum(row) + 1)]
        return np.array(rows, dtype=np.int64).reshape(len(rows), self.dimension)

    def __call__(self, x: Array) -> Array:
        """Evaluate the polynomial.

        Parameters
        ----------
        x : (samples, dimension)

        Returns
        -------
        (samples,)
        """
        used = self.coefficients != 0.0
        terms = self._monomials(x, self.exponents[used])
        return np.asarray(terms @ self.coefficients[used])

    def slope(self, x: Array, index: int) -> Array:
        """Evaluate the derivative in one coordinate.

        Parameters
        ----------
        x : (samples, dimension)
        index : of the coordinate

        Returns
        -------
        (samples,)
        """
        used = (self.coefficients != 0.0) & (self.exponents[:, index] > 0)
        exponents = self.exponents[used].copy()
        factors = self.coefficients[used] * exponents[:, index]
        exponents[:, index] -= 1
        return np.asarray(self._monomials(x, exponents) @ factors)

    def scaled(self, factor: float) -> Polynomial:
        """Multiply the polynomial by a factor."""
        return replace(self, coefficients=self.coefficients * factor)

    def _monomials(self, x: Array, exponents: np.ndarray) -> Array:
        """Products of powers of the coordinates, (samples, terms)."""
        powers = np.asarray(x, dtype=np.float64)[:, :, None] ** np.arange(self.order + 1)
        result = np.ones((len(powers), len(exponents)))
        for index in range(self.dimension):
            result *= powers[:, index, exponents[:, index]]
        return result
