"""Maps through feature points: radial basis functions and subspace deformation ([D] chapter 2).

Radial functions stand on top of an affine map. In three dimensions |x| gives the biharmonic spline
and |x|^3 the triharmonic one (Duchon 1977): they go through scattered points with the least bending
of their kind. Skeletal subspace deformation blends local transforms of the feature points by their
distance.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.surfaces.linear_maps import AffineMap, unknown_directions

Kernel = Literal["r", "r3"]

RADIAL_PAIRS = 500_000  # Pairs of points and features at a time.


@read_only
class RadialMap:
    """y = matrix x + offset + sum_i c_i phi(|x - x_i|), phi(r) = r or r^3."""

    whole: AffineMap  # matrix and offset
    points: Array  # (n, 3) features of the source [m]
    coefficients: Array  # (n, 3) c_i, which sum to zero and have no first moment [1] or [m^-2]
    kernel: Kernel  # phi

    def __post_init__(self) -> None:
        count = len(self.points)
        freeze(self, points=(count, 3), coefficients=(count, 3))

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3) in the target's frame [m]
        """
        array = np.asarray(points, dtype=np.float64)
        flat = array.reshape(-1, 3)
        moved = self.whole.apply(flat)
        for part in _chunks(len(flat), len(self.points), RADIAL_PAIRS):
            moved[part] += (
                _phi(scipy.spatial.distance.cdist(flat[part], self.points), self.kernel)
                @ self.coefficients
            )
        return moved.reshape(array.shape)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the mapped points with the points.

        At a feature, where r has a corner, they are the mean of both sides.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        array = np.asarray(points, dtype=np.float64)
        flat = array.reshape(-1, 3)
        result = self.whole.jacobian(flat)
        for part in _chunks(len(flat), len(self.points), RADIAL_PAIRS):
            away = flat[part][:, None] - self.points
            distance = np.linalg.norm(away, axis=2)
            slope = 3.0 * distance
            if self.kernel == "r":
                slope = np.divide(1.0, distance, out=np.zeros_like(distance), where=distance > 0)
            result[part] += np.matmul(self.coefficients.T, slope[:, :, None] * away)
        return result.reshape(*array.shape[:-1], 3, 3)


def fit_radial(
    source: Array, target: Array, whole: AffineMap, kernel: Kernel, smoothing: float = 0.0
) -> RadialMap:
    """Fit radial functions through feature points, or near them.

    With [[K + m I, P], [P^T, 0]] [c; a] = [y; 0] the map passes the features by m c. `smoothing`
    fixes m. What `whole` makes of an unknown direction is kept.

    Parameters
    ----------
    source : (features, 3) points [m]
    target : (features, 3) where they are mapped to [m]
    whole : affine map below the functions
    kernel : r or r^3
    smoothing : root mean square distance by which the features are passed, or that of the affine
        map alone where this is less [m]

    Returns
    -------
    map
    """
    rest = target - whole.apply(source)
    middle = source.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((source - middle) ** 2, axis=1))))
    across = unknown_directions(source)
    known = np.linalg.svd(np.eye(3) - across.T @ across)[2][: 3 - len(across)]
    scaled = (source - middle) / size
    values = _phi(scipy.spatial.distance.cdist(scaled, scaled), kernel)
    system = _System(values, np.column_stack([np.ones(len(source)), scaled @ known.T]))
    with threadpool_limits(1, "blas"):
        if smoothing > 0.0 and np.sqrt(np.mean(np.sum(rest**2, axis=1))) <= smoothing:
            return RadialMap(
                whole=whole, points=source, coefficients=np.zeros_like(source), kernel=kernel
            )
        coefficients, linear = system.solved(
            rest, 0.0 if smoothing == 0.0 else system.penalty(rest, smoothing, kernel)
        )
    turned = linear[1:].T @ known / size
    affine = AffineMap(whole.matrix + turned, whole.offset + linear[0] - turned @ middle)
    return RadialMap(
        whole=affine,
        points=source,
        coefficients=coefficients / size ** (1 if kernel == "r" else 3),
        kernel=kernel,
    )


@read_only
class _System:
    """The saddle point problem of values (n, n) and polynomials (n, k)."""

    values: Array
    polynomials: Array

    def solved(self, rest: Array, penalty: float) -> tuple[Array, Array]:
        """Solve for the weights of kernels and polynomials.

        Parameters
        ----------
        rest : (points, 3) values to interpolate
        penalty : added to the diagonal of the kernels

        Returns
        -------
        (points, 3) weights of the kernels
        (polynomials, 3) weights of the polynomials
        """
        count, width = self.polynomials.shape
        full = np.zeros((count + width, count + width))
        full[:count, :count] = self.values + penalty * np.eye(count)
        full[:count, count:] = self.polynomials
        full[count:, :count] = self.polynomials.T
        factors = scipy.linalg.lu_factor(full, overwrite_a=True)
        solution = scipy.linalg.lu_solve(factors, np.vstack([rest, np.zeros((width, 3))]))
        return solution[:count], solution[count:]

    def penalty(self, rest: Array, smoothing: float, kernel: Kernel) -> float:
        """Return m with the sign that keeps the problem definite.

        The kernel r is negative definite on what polynomials leave.
        """
        sign = -1.0 if kernel == "r" else 1.0

        def passed(logarithm: float) -> float:
            penalty = sign * np.exp(logarithm)
            coefficients = self.solved(rest, penalty)[0]
            return float(np.sqrt(np.mean(np.sum((penalty * coefficients) ** 2, axis=1))))

        low = np.log(1e-12)
        high = np.log(1e6)
        while high - low > 1e-3:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if passed(middle) < smoothing else (low, middle)
        return sign * float(np.exp(0.5 * (low + high)))


def _phi(distance: Array, kernel: Kernel) -> Array:
    return distance if kernel == "r" else distance**3


STIFFNESS = 0.5
"""How strongly a local transform holds on to that of the whole bone, against what its neighbors
say.

This, `GRADIENT_EXPONENT` and the default exponent were chosen with the persons of
`benchmarks/accuracy/morph/shapes.py` in view; errors of transferred points change by less than a
tenth between 0.3 and 1.
"""

# Of the distance, in the weights with which neighbors tell of a local transform.
GRADIENT_EXPONENT = 4.0
SUBSPACE_PAIRS = 100_000  # Pairs of points and features at a time.
AT_FEATURE = 1e-12  # A point this near to a feature, as a share of the bone, is at it.


@read_only
class SubspaceMap:
    """A map that blends the transforms of features, each weighted by its distance.

    Feature i sends x to T_i(x) = y_i + A_i (x - x_i), and the map is sum_i w_i(x) T_i(x)
    with w_i = |x - x_i|^-p / sum_j |x - x_j|^-p. It goes through every feature, has the Jacobian
    A_i there, and is an affine map exactly where all A_i are that map's.
    """

    whole: AffineMap  # of the whole bone, from `fit_whole`
    points: Array  # (n, 3) features of the source [m]
    shifts: Array  # (n, 3) y_i less what `whole` makes of x_i [m]
    slopes: Array  # (n, 3, 3) A_i less the matrix of `whole`
    exponent: float  # p

    def __post_init__(self) -> None:
        count = len(self.points)
        freeze(self, points=(count, 3), shifts=(count, 3), slopes=(count, 3, 3))

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3) in the target's frame [m]
        """
        array = np.asarray(points, dtype=np.float64)
        flat = array.reshape(-1, 3)
        rest = np.empty_like(flat)
        for part in _chunks(len(flat), len(self.points)):
            rest[part] = self._blended(flat[part], self._squared(flat[part]))
        return (self.whole.apply(flat) + rest).reshape(array.shape)

    def foreseen(self) -> Array:
        """Return the shifts of the features as all others predict them.

        Returns
        -------
        (features, 3) shifts beyond the affine map [m]
        """
        result = np.empty_like(self.shifts)
        for part in _chunks(len(self.points), len(self.points)):
            squared = self._squared(self.points[part])
            squared[squared == 0.0] = np.inf
            result[part] = self._blended(self.points[part], squared)
        return result

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives: the weighted A_i and the change of the weights themselves.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        array = np.asarray(points, dtype=np.float64)
        flat = array.reshape(-1, 3)
        result = np.empty((len(flat), 3, 3))
        start = self._start()
        slopes = self.slopes.reshape(-1, 9)
        for part in _chunks(len(flat), len(self.points)):
            squared = self._squared(flat[part])
            weights = self._weights(squared)
            sent = (flat[part] @ self.slopes.reshape(-1, 3).T).reshape(len(squared), -1, 3) + start
            sent -= np.einsum("mn,mnk->mk", weights, sent)[:, None]
            sent *= np.divide(weights, squared, out=np.zeros_like(weights), where=squared > 0)[
                :, :, None
            ]
            change = np.matmul(sent.transpose(0, 2, 1), flat[part][:, None] - self.points)
            result[part] = (weights @ slopes).reshape(-1, 3, 3) - self.exponent * change
        return (self.whole.matrix + result).reshape(*array.shape[:-1], 3, 3)

    def _blended(self, points: Array, squared: Array) -> Array:
        """(m, 3) where features send points, beyond the whole bone's map."""
        weights = self._weights(squared)
        slopes = (weights @ self.slopes.reshape(-1, 9)).reshape(-1, 3, 3)
        return weights @ self._start() + np.einsum("mij,mj->mi", slopes, points)

    def _start(self) -> Array:
        """(n, 3) where each feature sends the frame's origin, beyond the whole bone's map."""
        return self.shifts - np.einsum("nij,nj->ni", self.slopes, self.points)

    def _squared(self, points: Array) -> Array:
        """(m, n) squared distances, 0 at a feature."""
        squared: Array = scipy.spatial.distance.cdist(points, self.points, "sqeuclidean")
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
    """Fit local transforms of features from their neighbors.

    A_i minimizes sum_j |x_j - x_i|^-q |y_j - y_i - A (x_j - x_i)|^2 + s |A - A_whole|^2, where s is
    `STIFFNESS` times the mean over directions of sum_j |x_j - x_i|^(2 - q).

    Parameters
    ----------
    source : (features, 3) points [m]
    target : (features, 3) where they are mapped to [m]
    whole : affine map that the transforms are drawn to
    exponent : p of `SubspaceMap`
    smoothing : root mean square distance by which features are moved towards where the others send
        them, or all the way where this is less [m]

    Returns
    -------
    map
    """
    shifts: Array = target - whole.apply(source)
    subspace_map = SubspaceMap(
        whole=whole, points=source, shifts=shifts, slopes=_slopes(source, shifts), exponent=exponent
    )
    if smoothing == 0.0:
        return subspace_map
    away = subspace_map.foreseen() - shifts
    far = float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
    shifts = shifts + min(1.0, smoothing / far) * away if far > 0.0 else shifts
    return SubspaceMap(
        whole=whole, points=source, shifts=shifts, slopes=_slopes(source, shifts), exponent=exponent
    )


def _slopes(source: Array, shifts: Array) -> Array:
    """(n, 3, 3) A_i less the matrix of the whole bone."""
    slopes = np.zeros((len(source), 3, 3))
    with threadpool_limits(1, "blas"):
        for part in _chunks(len(source), len(source)):
            away = source[None] - source[part][:, None]
            squared = scipy.spatial.distance.cdist(source[part], source, "sqeuclidean")
            weights = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0) ** (
                GRADIENT_EXPONENT / 2
            )
            weighted = weights[:, :, None] * away
            spread = np.matmul(weighted.transpose(0, 2, 1), away)
            rise = np.matmul(weighted.transpose(0, 2, 1), shifts[None] - shifts[part][:, None])
            hold = STIFFNESS / 3.0 * np.trace(spread, axis1=1, axis2=2)
            solved = np.linalg.solve(spread + hold[:, None, None] * np.eye(3), rise)
            slopes[part] = solved.transpose(0, 2, 1)
    return slopes


def _chunks(points: int, features: int, pairs: int = SUBSPACE_PAIRS) -> list[slice]:
    step = max(1, pairs // features)
    return [slice(start, start + step) for start in range(0, points, step)]
