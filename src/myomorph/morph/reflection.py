"""Reflections in planes, of points, vectors, poses and functions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.functions import Function, PiecewisePolynomial
from myomorph.model.spatial import Transform

SNAP = 1e-6
"""A normal this near to an axis is that axis, a plane this near to the origin [m] goes through it."""


@dataclass(frozen=True, eq=False)
class Reflection:
    """x -> x - 2 (n . x - d) n, in the plane n . x = d.

    Attributes
    ----------
    normal : (3,) n, a unit vector
    offset : d [m]
    """

    normal: Array
    offset: float = 0.0

    def __post_init__(self) -> None:
        normal = np.asarray(self.normal, dtype=np.float64) / np.linalg.norm(self.normal)
        if np.abs(normal).max() > 1.0 - SNAP**2 / 2.0:
            normal = np.where(np.abs(normal) > 0.5, np.sign(normal), 0.0)
        object.__setattr__(self, "normal", frozen_array(normal, (3,)))
        object.__setattr__(self, "offset", 0.0 if abs(self.offset) < SNAP else float(self.offset))

    @property
    def matrix(self) -> Array:
        """(3, 3) of vectors, its own inverse."""
        matrix: Array = np.eye(3) - 2.0 * np.outer(self.normal, self.normal)
        return matrix

    @property
    def axis(self) -> int:
        """The axis of the frame that is nearest to the normal."""
        return int(np.argmax(np.abs(self.normal)))

    def points(self, points: ArrayLike) -> Array:
        """Points (..., 3) on the other side [m]."""
        given = np.asarray(points, dtype=np.float64)
        moved: Array = given - 2.0 * (given @ self.normal - self.offset)[..., None] * self.normal
        return moved

    def vectors(self, vectors: ArrayLike) -> Array:
        """Directions (..., 3), forces and velocities among them."""
        given = np.asarray(vectors, dtype=np.float64)
        moved: Array = given - 2.0 * (given @ self.normal)[..., None] * self.normal
        return moved

    def turns(self, turns: ArrayLike) -> Array:
        """Axes of rotation (..., 3), moments among them: by the same angle they turn the other way."""
        moved: Array = -self.vectors(turns)
        return moved

    def pose(self, pose: Transform, inner: Reflection) -> Transform:
        """The pose of a frame on the other side, itself reflected by `inner` so that it is right-handed again."""
        return Transform(self.matrix @ pose.rotation @ inner.matrix, self.points(pose.translation))

    def seen_from(self, pose: Transform) -> Reflection:
        """The same plane in the frame that has this pose."""
        return Reflection(pose.rotation.T @ self.normal, self.offset - float(self.normal @ pose.translation))


def flip(axis: int) -> Reflection:
    """The reflection in the plane across an axis of the frame."""
    return Reflection(np.eye(3)[axis])


def backwards(function: Function, signs: tuple[float, ...], factor: float = 1.0) -> Function:
    """The function factor f(signs[0] x_1, ...), each sign 1 or -1."""
    if factor != 1.0:
        function = function.scaled(factor)
    if all(sign > 0.0 for sign in signs) or function.arity == 0:
        return function
    if not isinstance(function, PiecewisePolynomial):
        return replace(function, frequencies=function.frequencies * np.array(signs[: function.arity]))
    breaks, rows = function.breaks, function.coefficients
    starts = np.concatenate([breaks[-1:], breaks[:0:-1]])
    return PiecewisePolynomial(
        -starts,
        np.array([_reversed(row, at - begin) for row, begin, at in zip(rows[::-1], breaks[::-1], starts, strict=True)]),
    )


def raised(function: Function, by: float) -> Function:
    """The function f(x) + by."""
    if by == 0.0:
        return function
    if not isinstance(function, PiecewisePolynomial):
        return replace(function, offset=function.offset + by)
    added = np.zeros(function.coefficients.shape[1])
    added[0] = by
    return replace(function, coefficients=function.coefficients + added)


def _reversed(coefficients: Array, shift: float) -> Array:
    """Coefficients of p(shift - x) for those of p(x)."""
    degree = len(coefficients) - 1
    return np.array(
        [
            (-1.0) ** k * sum(comb(j, k) * coefficients[j] * shift ** (j - k) for j in range(k, degree + 1))
            for k in range(degree + 1)
        ]
    )
