"""Radial basis functions over feature points, on top of an affine map.

In three dimensions |x| gives the biharmonic spline and |x|^3 the triharmonic one (Duchon 1977): they go through
scattered points with the least bending of their kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lu_factor, lu_solve
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from myomorph.model.arrays import Array, frozen_array
from myomorph.morph.affine import AffineMap, unknown_directions

Kernel = Literal["r", "r3"]

PAIRS = 500_000
"""Pairs of points and features at a time."""


@dataclass(frozen=True, eq=False)
class RadialMap:
    """y = matrix x + offset + sum_i c_i phi(|x - x_i|), phi(r) = r or r^3.

    Attributes
    ----------
    whole : matrix and offset
    points : (n, 3) features of the source [m]
    coefficients : (n, 3) c_i, which sum to zero and have no first moment [1] or [m^-2]
    kernel : phi
    """

    whole: AffineMap
    points: Array
    coefficients: Array
    kernel: Kernel

    def __post_init__(self) -> None:
        count = len(self.points)
        object.__setattr__(self, "points", frozen_array(self.points, (count, 3)))
        object.__setattr__(self, "coefficients", frozen_array(self.coefficients, (count, 3)))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) carried over [m]."""
        given = np.asarray(points, dtype=np.float64)
        flat = given.reshape(-1, 3)
        moved = self.whole.apply(flat)
        for part in self._chunks(len(flat)):
            moved[part] += _phi(cdist(flat[part], self.points), self.kernel) @ self.coefficients
        return moved.reshape(given.shape)

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives (..., 3, 3); at a feature, where r has a corner, the mean of both sides."""
        given = np.asarray(points, dtype=np.float64)
        flat = given.reshape(-1, 3)
        result = self.whole.jacobian(flat)
        for part in self._chunks(len(flat)):
            away = flat[part][:, None] - self.points
            distance = np.linalg.norm(away, axis=2)
            slope = 3.0 * distance
            if self.kernel == "r":
                slope = np.divide(1.0, distance, out=np.zeros_like(distance), where=distance > 0)
            result[part] += np.matmul(self.coefficients.T, slope[:, :, None] * away)
        return result.reshape(*given.shape[:-1], 3, 3)

    def _chunks(self, count: int) -> list[slice]:
        step = max(1, PAIRS // len(self.points))
        return [slice(start, start + step) for start in range(0, count, step)]


def fit_radial(source: Array, target: Array, whole: AffineMap, kernel: Kernel, smoothing: float = 0.0) -> RadialMap:
    """Functions through feature points, or past them by no more than a root mean square distance.

    With [[K + m I, P], [P^T, 0]] [c; a] = [y; 0] the map passes the features by m c. `smoothing` fixes m: the root mean
    square of these distances, or that of the affine map alone where this is less.

    Parameters
    ----------
    source, target : (features, 3), no two at the same place [m]
    whole : of the whole bone: what it makes of an unknown direction is kept
    smoothing : root mean square distance from the features [m]
    """
    rest = target - whole.apply(source)
    middle = source.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((source - middle) ** 2, axis=1))))
    across = unknown_directions(source)
    known = np.linalg.svd(np.eye(3) - across.T @ across)[2][: 3 - len(across)]
    scaled = (source - middle) / size
    system = _System(_phi(cdist(scaled, scaled), kernel), np.column_stack([np.ones(len(source)), scaled @ known.T]))
    with threadpool_limits(1, "blas"):
        if smoothing > 0.0 and np.sqrt(np.mean(np.sum(rest**2, axis=1))) <= smoothing:
            return RadialMap(whole, source, np.zeros_like(source), kernel)
        coefficients, linear = system.solved(rest, 0.0 if smoothing == 0.0 else system.penalty(rest, smoothing, kernel))
    turned = linear[1:].T @ known / size
    affine = AffineMap(whole.matrix + turned, whole.offset + linear[0] - turned @ middle)
    return RadialMap(affine, source, coefficients / size ** (1 if kernel == "r" else 3), kernel)


@dataclass(frozen=True, eq=False)
class _System:
    """The saddle point problem of values (n, n) and polynomials (n, k)."""

    values: Array
    polynomials: Array

    def solved(self, rest: Array, penalty: float) -> tuple[Array, Array]:
        count, width = self.polynomials.shape
        full = np.zeros((count + width, count + width))
        full[:count, :count] = self.values + penalty * np.eye(count)
        full[:count, count:] = self.polynomials
        full[count:, :count] = self.polynomials.T
        found = lu_solve(lu_factor(full, overwrite_a=True), np.vstack([rest, np.zeros((width, 3))]))
        return found[:count], found[count:]

    def penalty(self, rest: Array, smoothing: float, kernel: Kernel) -> float:
        """With the sign that keeps the problem definite: r is negative definite on what polynomials leave."""
        sign = -1.0 if kernel == "r" else 1.0

        def passed(logarithm: float) -> float:
            penalty = sign * np.exp(logarithm)
            coefficients = self.solved(rest, penalty)[0]
            return float(np.sqrt(np.mean(np.sum((penalty * coefficients) ** 2, axis=1))))

        low, high = np.log(1e-12), np.log(1e6)
        while high - low > 1e-3:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if passed(middle) < smoothing else (low, middle)
        return sign * float(np.exp(0.5 * (low + high)))


def _phi(distance: Array, kernel: Kernel) -> Array:
    return distance if kernel == "r" else distance**3
