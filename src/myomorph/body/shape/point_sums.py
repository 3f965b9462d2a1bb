"""Sums over mass points by link and by pair of links, in threads.

They are products with matrices too large to form. The matrix is G (10 links, points), whose column
j holds w_ij m(x_j) for every link i, with the ten monomials m(x) = 1, x, y, z, xx, yy, zz, yz, zx,
xy. Weights come as the rows of a CSR matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from myomorph.body.shape.points import MassPoints
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.frames import over_frames, thread_count
from myomorph.core.rigid.kernels import bare, kernel

EXPONENTS = [
    (0, 0, 0),
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (2, 0, 0),
    (0, 2, 0),
    (0, 0, 2),
    (0, 1, 1),
    (1, 0, 1),
    (1, 1, 0),
]
"""Powers of x, y, z in each of the ten monomials."""
_PRODUCTS = sorted({(a + d, b + e, c + f) for a, b, c in EXPONENTS for d, e, f in EXPONENTS})
# Different products of two of the ten monomials: 35, all of degree 4 or less
PRODUCTS = len(_PRODUCTS)
PRODUCT_OF = np.array(
    [[_PRODUCTS.index((a + d, b + e, c + f)) for d, e, f in EXPONENTS] for a, b, c in EXPONENTS]
)
"""(10, 10) which of the 35 products a product of two monomials is."""
_POWERS = np.array(_PRODUCTS, np.int64)


@bare
def _monomials(x, j):
    a = x[j, 0]
    b = x[j, 1]
    c = x[j, 2]
    return 1.0, a, b, c, a * a, b * b, c * c, b * c, c * a, a * b


@kernel
def pull(x, first, links, weights, c, start, stop, out):
    """Fill out_j = sum_i w_ij c_i . m(x_j), that is G^T c.

    Parameters
    ----------
    x : (points, 3) [m]
    first, links, weights : rows of the weights, as CSR
    c : (links, 10)
    start, stop : points start ... stop - 1 are filled
    out : (points,)
    """
    for j in range(start, stop):
        m = _monomials(x, j)
        total = 0.0
        for entry in range(first[j], first[j + 1]):
            i = links[entry]
            total += weights[entry] * (
                c[i, 0]
                + c[i, 1] * m[1]
                + c[i, 2] * m[2]
                + c[i, 3] * m[3]
                + c[i, 4] * m[4]
                + c[i, 5] * m[5]
                + c[i, 6] * m[6]
                + c[i, 7] * m[7]
                + c[i, 8] * m[8]
                + c[i, 9] * m[9]
            )
        out[j] = total


@kernel
def push(x, first, links, weights, masses, start, stop, out):
    """Add to out_i the sum_j w_ij masses_j m(x_j), that is G masses.

    Parameters
    ----------
    x : (points, 3) [m]
    first, links, weights : rows of the weights, as CSR
    masses : (points,)
    start, stop : points start ... stop - 1 are summed
    out : (links, 10)
    """
    for j in range(start, stop):
        if masses[j] == 0.0:
            continue
        m = _monomials(x, j)
        for entry in range(first[j], first[j + 1]):
            i = links[entry]
            f = weights[entry] * masses[j]
            out[i, 0] += f
            out[i, 1] += f * m[1]
            out[i, 2] += f * m[2]
            out[i, 3] += f * m[3]
            out[i, 4] += f * m[4]
            out[i, 5] += f * m[5]
            out[i, 6] += f * m[6]
            out[i, 7] += f * m[7]
            out[i, 8] += f * m[8]
            out[i, 9] += f * m[9]


@kernel(fastmath={"reassoc", "contract"})
def push_pairs(x, first, links, weights, factors, start, stop, out):
    """Add all blocks of G F G^T, of links k <= i, as sums of 35 products.

        out[i (i + 1) / 2 + k] += sum_j factor_j w_ij w_kj (products at x_j)

    Points are taken eight at a time: neighbors on a grid share their links, and a sum of eight is
    written as fast as one. The last of the 36 columns is there for the processor.

    Parameters
    ----------
    x : (points, 3) [m]
    first, links, weights : rows of the weights, as CSR
    factors : (points,) the diagonal of F
    start, stop : points start ... stop - 1 are summed
    out : (pairs of links, 36)
    """
    most = 0
    for entry in range(first[start], first[stop]):
        most = max(most, links[entry] + 1)
    powers = np.empty((3, 5))
    products = np.zeros((8, PRODUCTS + 1))
    shares = np.zeros((most, 8))
    seen = np.zeros(most, np.bool_)
    used = np.empty(most, np.int64)
    taken = np.empty(8, np.int64)
    j = start
    while True:
        points = 0
        while j < stop and points < 8:
            if factors[j] != 0.0:
                taken[points] = j
                points += 1
            j += 1
        if points == 0:
            return
        count = 0
        for p in range(points):
            first_link = taken[p]
            for axis in range(3):
                powers[axis, 0] = 1.0
                for e in range(1, 5):
                    powers[axis, e] = powers[axis, e - 1] * x[first_link, axis]
            for q in range(PRODUCTS):
                products[p, q] = (
                    factors[first_link]
                    * powers[0, _POWERS[q, 0]]
                    * powers[1, _POWERS[q, 1]]
                    * powers[2, _POWERS[q, 2]]
                )
            for entry in range(first[first_link], first[first_link + 1]):
                i = links[entry]
                if not seen[i]:
                    seen[i] = True
                    shares[i] = 0.0
                    used[count] = i
                    count += 1
                shares[i, p] = weights[entry]
        for a in range(count):
            for b in range(a + 1):
                i = max(used[a], used[b])
                entry = min(used[a], used[b])
                row = out[i * (i + 1) // 2 + entry]
                f0 = shares[i, 0] * shares[entry, 0]
                f1 = shares[i, 1] * shares[entry, 1]
                f2 = shares[i, 2] * shares[entry, 2]
                f3 = shares[i, 3] * shares[entry, 3]
                f4 = shares[i, 4] * shares[entry, 4]
                f5 = shares[i, 5] * shares[entry, 5]
                f6 = shares[i, 6] * shares[entry, 6]
                f7 = shares[i, 7] * shares[entry, 7]
                for q in range(PRODUCTS + 1):
                    row[q] += (
                        (f0 * products[0, q] + f1 * products[1, q])
                        + (f2 * products[2, q] + f3 * products[3, q])
                    ) + (
                        (f4 * products[4, q] + f5 * products[5, q])
                        + (f6 * products[6, q] + f7 * products[7, q])
                    )
        for a in range(count):
            seen[used[a]] = False


@kernel
def respond(reference, freedom, floor, s, ds, t, start, stop, out):
    """Add what the dual's line search needs of the masses at a step t.

    The masses are rho_j = max(floor_j, reference_j + freedom_j (s_j + t ds_j)).

    Parameters
    ----------
    reference, freedom, floor : (points,) [kg], [kg^2], [kg]
    s, ds : (points,)
    t : step
    start, stop : points start ... stop - 1 are summed
    out : (2,) sum of (rho_j - reference_j) ds_j, and its derivative by t
    """
    slope = 0.0
    curvature = 0.0
    for j in range(start, stop):
        change = freedom[j] * (s[j] + t * ds[j])
        if reference[j] + change > floor[j]:
            slope += change * ds[j]
            curvature += freedom[j] * ds[j] * ds[j]
        else:
            slope += (floor[j] - reference[j]) * ds[j]
    out[0] += slope
    out[1] += curvature


@read_only
class PointSums:
    """Products with G (10 links, points), see the head of this file.

    Points are counted from their mean, so that powers of four keep their digits wherever the
    ground's origin is.

    Attributes
    ----------
    x : (points, 3) from the mean of all [m]
    first, columns, weights : rows of the weights, as CSR
    links : how many
    shift : (10, 10) moments about the ground's origin are `shift @` moments about the mean
    """

    x: Array
    first: np.ndarray
    columns: np.ndarray
    weights: Array
    links: int
    shift: Array

    @staticmethod
    def of(points: MassPoints) -> PointSums:
        """Set up the sums over these points."""
        mean = points.points.mean(axis=0)
        W = points.weights
        if not W.has_canonical_format:
            W = W.copy()
            W.sum_duplicates()
        return PointSums(
            x=points.points - mean,
            first=np.array(W.indptr, np.int64),
            columns=np.array(W.indices, np.int32),
            weights=np.array(W.data, np.float64),
            links=W.shape[1],
            shift=_shift(mean),
        )

    def pull(self, c: Array) -> Array:
        """Compute G^T c.

        Parameters
        ----------
        c : (10 links,)

        Returns
        -------
        (points,)
        """
        by_link = np.ascontiguousarray(c.reshape(self.links, 10))
        out = np.empty(len(self.x))
        over_frames(
            lambda start, stop: pull(
                self.x, self.first, self.columns, self.weights, by_link, start, stop, out
            ),
            len(self.x),
            chunk=self._chunk,
        )
        return out

    def push(self, masses: Array) -> Array:
        """Compute G masses.

        Parameters
        ----------
        masses : (points,)

        Returns
        -------
        (10 links,) moments about the mean of all points
        """
        add = partial(push, self.x, self.first, self.columns, self.weights, masses)
        return self._summed(add, self.links, 10).ravel()

    def pairs(self, factors: Array) -> Array:
        """Compute the sums that make G diag(factors) G^T; `matrix` puts them in place.

        Parameters
        ----------
        factors : (points,)

        Returns
        -------
        (pairs of links, 36)
        """
        shape = self.links * (self.links + 1) // 2, PRODUCTS + 1
        if not factors.any():
            return np.zeros(shape)
        return self._summed(
            partial(push_pairs, self.x, self.first, self.columns, self.weights, factors), *shape
        )

    def matrix(self, pairs: Array) -> Array:
        """Build G F G^T from the sums of `pairs`.

        Parameters
        ----------
        pairs : (pairs of links, 36)

        Returns
        -------
        (10 links, 10 links)
        """
        i, j = np.tril_indices(self.links)
        blocks = np.empty((self.links, self.links, 10, 10))
        blocks[i, j] = blocks[j, i] = pairs[:, PRODUCT_OF]
        return blocks.transpose(0, 2, 1, 3).reshape(10 * self.links, 10 * self.links)

    def respond(
        self, reference: Array, freedom: Array, floor: Array, s: Array, ds: Array, t: float
    ) -> tuple[float, float]:
        """Compute the sum of (rho_j - reference_j) ds_j at a step, and its derivative by it.

        See `respond` for the masses.

        Parameters
        ----------
        reference, freedom, floor : (points,) [kg], [kg^2], [kg]
        s, ds : (points,)
        t : step

        Returns
        -------
        slope and curvature
        """
        slope, curvature = self._summed(partial(respond, reference, freedom, floor, s, ds, t), 2)
        return float(slope), float(curvature)

    def _summed(self, add: Callable[[int, int, Array], None], *shape: int) -> Array:
        """Sum over all points what `add` adds to an array of this shape, part by part."""
        parts = np.zeros((-(-len(self.x) // self._chunk), *shape))
        over_frames(
            lambda start, stop: add(start, stop, parts[start // self._chunk]),
            len(self.x),
            chunk=self._chunk,
        )
        return np.asarray(parts.sum(axis=0))

    @property
    def _chunk(self) -> int:
        # A few parts a thread: each has sums of its own, which are added up afterwards.
        return max(4096, -(-len(self.x) // (4 * thread_count())))


def _shift(mean: Array) -> Array:
    """Build the matrix from monomials at x to those at x + mean.

    Parameters
    ----------
    mean : (3,) [m]

    Returns
    -------
    (10, 10)
    """
    T = np.eye(10)
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    T[1:4, 0] = mean
    for row, (a, b) in enumerate(pairs, start=4):
        T[row, 0] = mean[a] * mean[b]
        T[row, 1 + a] += mean[b]
        T[row, 1 + b] += mean[a]
    return T
