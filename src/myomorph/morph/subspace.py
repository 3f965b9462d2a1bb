"""Skeletal subspace deformation: local transforms of feature points, blended by their distance ([D] chapter 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from myomorph.model.arrays import Array, frozen_array
from myomorph.morph.affine import AffineMap

STIFFNESS = 0.5
"""How strongly a local transform holds on to that of the whole bone, against what its neighbors say.

This, `GRADIENT_EXPONENT` and the default exponent were chosen with the persons of `benchmarks/accuracy/morph/shapes.py`
in view; errors of transferred points change by less than a tenth between 0.3 and 1."""

GRADIENT_EXPONENT = 4.0
"""Of the distance, in the weights with which neighbors tell of a local transform."""

PAIRS = 100_000
"""Pairs of points and features at a time."""

AT_FEATURE = 1e-12
"""A point this near to a feature, as a share of the bone, is at it."""


@dataclass(frozen=True, eq=False)
class SubspaceMap:
    """Every feature carries a transform; a point goes where they send it, each counting by its distance.

    Feature i sends x to T_i(x) = y_i + A_i (x - x_i), and the map is sum_i w_i(x) T_i(x) with
    w_i = |x - x_i|^-p / sum_j |x - x_j|^-p. It goes through every feature, has the Jacobian A_i there, and is an affine
    map exactly where all A_i are that map's.

    Attributes
    ----------
    whole : of the whole bone, from `fit_whole`
    points : (n, 3) features of the source [m]
    shifts : (n, 3) y_i less what `whole` makes of x_i [m]
    slopes : (n, 3, 3) A_i less the matrix of `whole`
    exponent : p
    """

    whole: AffineMap
    points: Array
    shifts: Array
    slopes: Array
    exponent: float

    def __post_init__(self) -> None:
        count = len(self.points)
        object.__setattr__(self, "points", frozen_array(self.points, (count, 3)))
        object.__setattr__(self, "shifts", frozen_array(self.shifts, (count, 3)))
        object.__setattr__(self, "slopes", frozen_array(self.slopes, (count, 3, 3)))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) carried over [m]."""
        given = np.asarray(points, dtype=np.float64)
        flat = given.reshape(-1, 3)
        rest = np.empty_like(flat)
        for part in _chunks(len(flat), len(self.points)):
            rest[part] = self._blended(flat[part], self._squared(flat[part]))
        return (self.whole.apply(flat) + rest).reshape(given.shape)

    def foreseen(self) -> Array:
        """(n, 3) shifts of the features as all others have them."""
        found = np.empty_like(self.shifts)
        for part in _chunks(len(self.points), len(self.points)):
            squared = self._squared(self.points[part])
            squared[squared == 0.0] = np.inf
            found[part] = self._blended(self.points[part], squared)
        return found

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives (..., 3, 3): the A_i by their weights, and what the weights' own change adds."""
        given = np.asarray(points, dtype=np.float64)
        flat = given.reshape(-1, 3)
        result, start, slopes = np.empty((len(flat), 3, 3)), self._start(), self.slopes.reshape(-1, 9)
        for part in _chunks(len(flat), len(self.points)):
            squared = self._squared(flat[part])
            weights = self._weights(squared)
            sent = (flat[part] @ self.slopes.reshape(-1, 3).T).reshape(len(squared), -1, 3) + start
            sent -= np.einsum("mn,mnk->mk", weights, sent)[:, None]
            sent *= np.divide(weights, squared, out=np.zeros_like(weights), where=squared > 0)[:, :, None]
            change = np.matmul(sent.transpose(0, 2, 1), flat[part][:, None] - self.points)
            result[part] = (weights @ slopes).reshape(-1, 3, 3) - self.exponent * change
        return (self.whole.matrix + result).reshape(*given.shape[:-1], 3, 3)

    def _blended(self, points: Array, squared: Array) -> Array:
        """(m, 3) where features send points, beyond the whole bone's map."""
        weights = self._weights(squared)
        slopes = (weights @ self.slopes.reshape(-1, 9)).reshape(-1, 3, 3)
        blended: Array = weights @ self._start() + np.einsum("mij,mj->mi", slopes, points)
        return blended

    def _start(self) -> Array:
        """(n, 3) where each feature sends the frame's origin, beyond the whole bone's map."""
        start: Array = self.shifts - np.einsum("nij,nj->ni", self.slopes, self.points)
        return start

    def _squared(self, points: Array) -> Array:
        """(m, n) squared distances, 0 at a feature."""
        squared: Array = cdist(points, self.points, "sqeuclidean")
        least = AT_FEATURE**2 * np.ptp(self.points, axis=0).max() ** 2
        if squared.min(initial=np.inf) < least:
            squared[squared < least] = 0.0
        return squared

    def _weights(self, squared: Array) -> Array:
        """(m, n) normalized weights."""
        at = squared.min(axis=1, initial=np.inf) == 0.0
        if at.any():
            squared = squared.copy()
            squared[at] = np.where(squared[at] == 0.0, 1.0, np.inf)
        weights: Array = 1.0 / squared
        if self.exponent == 4.0:
            weights *= weights
        else:
            weights **= 0.5 * self.exponent
        weights /= weights.sum(axis=1, keepdims=True)
        return weights


def fit_subspace(
    source: Array, target: Array, whole: AffineMap, exponent: float, smoothing: float = 0.0
) -> SubspaceMap:
    """Local transforms of features from their neighbors.

    A_i minimizes sum_j |x_j - x_i|^-q |y_j - y_i - A (x_j - x_i)|^2 + s |A - A_whole|^2, where s is `STIFFNESS` times
    the mean over directions of sum_j |x_j - x_i|^(2 - q).

    Parameters
    ----------
    source, target : (features, 3), no two at the same place [m]
    whole : of the whole bone
    exponent : of the distance, in the weights of the blend
    smoothing : root mean square distance by which features are moved towards where the others send them, or all the
        way where this is less [m]
    """
    shifts: Array = target - whole.apply(source)
    found = SubspaceMap(whole, source, shifts, _slopes(source, shifts), exponent)
    if smoothing == 0.0:
        return found
    away = found.foreseen() - shifts
    far = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    shifts = shifts + min(1.0, smoothing / far) * away if far > 0.0 else shifts
    return SubspaceMap(whole, source, shifts, _slopes(source, shifts), exponent)


def _slopes(source: Array, shifts: Array) -> Array:
    """(n, 3, 3) A_i less the matrix of the whole bone."""
    slopes = np.zeros((len(source), 3, 3))
    with threadpool_limits(1, "blas"):
        for part in _chunks(len(source), len(source)):
            away = source[None] - source[part][:, None]
            squared = cdist(source[part], source, "sqeuclidean")
            weights = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0) ** (GRADIENT_EXPONENT / 2)
            weighted = weights[:, :, None] * away
            spread = np.matmul(weighted.transpose(0, 2, 1), away)
            rise = np.matmul(weighted.transpose(0, 2, 1), shifts[None] - shifts[part][:, None])
            hold = STIFFNESS / 3.0 * np.trace(spread, axis1=1, axis2=2)
            solved = np.linalg.solve(spread + hold[:, None, None] * np.eye(3), rise)
            slopes[part] = solved.transpose(0, 2, 1)
    return slopes


def _chunks(points: int, features: int) -> list[slice]:
    step = max(1, PAIRS // features)
    return [slice(start, start + step) for start in range(0, points, step)]
