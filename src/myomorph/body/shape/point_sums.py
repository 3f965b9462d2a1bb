"""Sums over mass points by link and by pair of links, in threads.

They are products with matrices too large to form. The matrix is G (10 links, points), whose column
j holds w_ij m(x_j) for every link i, with the ten monomials m(x) = 1, x, y, z, xx, yy, zz, yz, zx,
xy. Weights come as the rows of a CSR matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from myomorph.body.shape.points import MassPoints
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.frames import over_frames, thread_count
from myomorph.core.rigid.kernels import bare, in_place, kernel

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
SQUARES = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""Axes of the last six monomials: xx, yy, zz, yz, zx, xy."""


def _times(first: tuple[int, int, int], second: tuple[int, int, int]) -> tuple[int, int, int]:
    """Powers of x, y, z in the product of two monomials."""
    return (first[0] + second[0], first[1] + second[1], first[2] + second[2])


_PRODUCTS = sorted({_times(first, second) for first in EXPONENTS for second in EXPONENTS})
# Different products of two of the ten monomials: 35, all of degree 4 or less
PRODUCTS = len(_PRODUCTS)
PRODUCT_OF = np.array(
    [[_PRODUCTS.index(_times(first, second)) for second in EXPONENTS] for first in EXPONENTS]
)
"""(10, 10) which of the 35 products a product of two monomials is."""
_POWERS = np.array(_PRODUCTS, np.int64)


class WeighedPoints(NamedTuple):
    """Mass points and their weights, as kernels read them.

    Attributes
    ----------
    x : (points, 3) [m]
    first : (points + 1,) where the row of each point begins among the entries
    links : (entries,) number of the link
    weights : (entries,) share of the point in that link
    """

    x: Array
    first: np.ndarray
    links: np.ndarray
    weights: Array


class PointMasses(NamedTuple):
    """Masses of points as functions of the dual, max(floor, reference + freedom s).

    Attributes
    ----------
    reference : (points,) masses at s = 0 [kg]
    freedom : (points,) [kg^2]
    floor : (points,) least masses [kg]
    """

    reference: Array
    freedom: Array
    floor: Array


class Slope(NamedTuple):
    """What a line search needs of the masses at a step.

    Attributes
    ----------
    slope : sum of (mass - reference) ds
    curvature : its derivative by the step
    """

    slope: float
    curvature: float


class PairRoom(NamedTuple):
    """Scratch arrays of `_push_pairs`, for eight points at a time.

    Attributes
    ----------
    powers : (3, 5) of the coordinates of a point, 0 to 4
    products : (8, 36) times the points' factors
    shares : (links, 8) of the points in each link
    seen : (links,) whether a link has a share in any of them
    used : (links,) numbers of these links, in the order in which they came
    points : (8,) numbers of the points
    """

    powers: Array
    products: Array
    shares: Array
    seen: np.ndarray
    used: np.ndarray
    points: np.ndarray


@bare
def _monomials(x, j):
    a = x[j, 0]
    b = x[j, 1]
    c = x[j, 2]
    return 1.0, a, b, c, a * a, b * b, c * c, b * c, c * a, a * b


@kernel
def _pull(points, c, start, stop, out):
    """Fill out_j = sum_i w_ij c_i . m(x_j), that is G^T c.

    Parameters
    ----------
    points : `WeighedPoints`
    c : (links, 10)
    start, stop : points start ... stop - 1 are filled
    out : (points,)
    """
    for j in range(start, stop):
        m = _monomials(points.x, j)
        total = 0.0
        for entry in range(points.first[j], points.first[j + 1]):
            i = points.links[entry]
            total += points.weights[entry] * (
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
def _push(points, masses, start, stop, out):
    """Add to out_i the sum_j w_ij masses_j m(x_j), that is G masses.

    Parameters
    ----------
    points : `WeighedPoints`
    masses : (points,)
    start, stop : points start ... stop - 1 are summed
    out : (links, 10)
    """
    for j in range(start, stop):
        if masses[j] == 0.0:
            continue
        m = _monomials(points.x, j)
        for entry in range(points.first[j], points.first[j + 1]):
            i = points.links[entry]
            f = points.weights[entry] * masses[j]
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
def _push_pairs(points, factors, start, stop, out):
    """Add all blocks of G F G^T, of links k <= i, as sums of 35 products.

        out[i (i + 1) / 2 + k] += sum_j factor_j w_ij w_kj (products at x_j)

    Points are taken eight at a time: neighbors on a grid share their links, and a sum of eight is
    written as fast as one. The last of the 36 columns is there for the processor.

    Parameters
    ----------
    points : `WeighedPoints`
    factors : (points,) the diagonal of F
    start, stop : points start ... stop - 1 are summed
    out : (pairs of links, 36)
    """
    links = 0
    for entry in range(points.first[start], points.first[stop]):
        links = max(links, points.links[entry] + 1)
    room = PairRoom(
        powers=np.empty((3, 5)),
        products=np.zeros((8, PRODUCTS + 1)),
        shares=np.zeros((links, 8)),
        seen=np.zeros(links, np.bool_),
        used=np.empty(links, np.int64),
        points=np.empty(8, np.int64),
    )
    j = start
    while True:
        count = 0
        while j < stop and count < 8:
            if factors[j] != 0.0:
                room.points[count] = j
                count += 1
            j += 1
        if count == 0:
            return
        used = 0
        for p in range(count):
            _fill_products(points.x, factors, room, p)
            used = _fill_shares(points, room, p, used)
        for a in range(used):
            for b in range(a + 1):
                _add_pair(room, a, b, out)
        for a in range(used):
            room.seen[room.used[a]] = False


@in_place
def _fill_products(x, factors, room, p):
    """Fill the 35 products of coordinates of one of the eight points, times its factor."""
    j = room.points[p]
    powers = room.powers
    for axis in range(3):
        powers[axis, 0] = 1.0
        for e in range(1, 5):
            powers[axis, e] = powers[axis, e - 1] * x[j, axis]
    for q in range(PRODUCTS):
        x_power = powers[0, _POWERS[q, 0]]
        y_power = powers[1, _POWERS[q, 1]]
        z_power = powers[2, _POWERS[q, 2]]
        room.products[p, q] = factors[j] * x_power * y_power * z_power


@in_place
def _fill_shares(points, room, p, used):
    """Fill the shares of one of the eight points.

    Returns how many links have a share in the points so far.
    """
    j = room.points[p]
    for entry in range(points.first[j], points.first[j + 1]):
        i = points.links[entry]
        if not room.seen[i]:
            room.seen[i] = True
            room.shares[i] = 0.0
            room.used[used] = i
            used += 1
        room.shares[i, p] = points.weights[entry]
    return used


@in_place
def _add_pair(room, a, b, out):
    """Add the eight points' products of two links, the a-th and the b-th of those used."""
    i = max(room.used[a], room.used[b])
    k = min(room.used[a], room.used[b])
    row = out[i * (i + 1) // 2 + k]
    products = room.products
    f0 = room.shares[i, 0] * room.shares[k, 0]
    f1 = room.shares[i, 1] * room.shares[k, 1]
    f2 = room.shares[i, 2] * room.shares[k, 2]
    f3 = room.shares[i, 3] * room.shares[k, 3]
    f4 = room.shares[i, 4] * room.shares[k, 4]
    f5 = room.shares[i, 5] * room.shares[k, 5]
    f6 = room.shares[i, 6] * room.shares[k, 6]
    f7 = room.shares[i, 7] * room.shares[k, 7]
    for q in range(PRODUCTS + 1):
        row[q] += (
            (f0 * products[0, q] + f1 * products[1, q])
            + (f2 * products[2, q] + f3 * products[3, q])
        ) + (
            (f4 * products[4, q] + f5 * products[5, q])
            + (f6 * products[6, q] + f7 * products[7, q])
        )


@kernel
def _respond(masses, s, ds, t, start, stop, out):
    """Add what the dual's line search needs of the masses at a step t.

    The masses are rho_j = max(floor_j, reference_j + freedom_j (s_j + t ds_j)).

    Parameters
    ----------
    masses : `PointMasses`
    s, ds : (points,)
    t : step
    start, stop : points start ... stop - 1 are summed
    out : (2,) sum of (rho_j - reference_j) ds_j, and its derivative by t
    """
    reference = masses.reference
    freedom = masses.freedom
    floor = masses.floor
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

    @property
    def _points(self) -> WeighedPoints:
        return WeighedPoints(x=self.x, first=self.first, links=self.columns, weights=self.weights)

    def pull(self, c: Array) -> Array:
        """Compute G^T c.

        Parameters
        ----------
        c : (10 links,)

        Returns
        -------
        (points,)
        """
        points = self._points
        by_link = np.ascontiguousarray(c.reshape(self.links, 10))
        out = np.empty(len(self.x))

        def fill(start: int, stop: int) -> None:
            _pull(points, by_link, start, stop, out)

        over_frames(fill, len(self.x), chunk=self._chunk)
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
        return self._summed(partial(_push, self._points, masses), self.links, 10).ravel()

    def pairs(self, factors: Array) -> Array:
        """Compute the sums that make G diag(factors) G^T; `matrix` puts them in place.

        Parameters
        ----------
        factors : (points,)

        Returns
        -------
        (pairs of links, 36)
        """
        pairs = self.links * (self.links + 1) // 2
        columns = PRODUCTS + 1
        if not factors.any():
            return np.zeros((pairs, columns))
        return self._summed(partial(_push_pairs, self._points, factors), pairs, columns)

    def matrix(self, pairs: Array) -> Array:
        """Build G F G^T from the sums of `pairs`.

        Parameters
        ----------
        pairs : (pairs of links, 36)

        Returns
        -------
        (10 links, 10 links)
        """
        first, second = np.tril_indices(self.links)
        of_products = pairs[:, PRODUCT_OF]
        blocks = np.empty((self.links, self.links, 10, 10))
        blocks[first, second] = of_products
        blocks[second, first] = of_products
        return blocks.transpose(0, 2, 1, 3).reshape(10 * self.links, 10 * self.links)

    def respond(self, masses: PointMasses, s: Array, ds: Array, t: float) -> Slope:
        """Compute the sum of (rho_j - reference_j) ds_j at a step, and its derivative by it.

        Parameters
        ----------
        masses : rho as functions of s
        s, ds : (points,)
        t : step

        Returns
        -------
        slope and curvature
        """
        slope, curvature = self._summed(partial(_respond, masses, s, ds, t), 2)
        return Slope(slope=float(slope), curvature=float(curvature))

    def _summed(self, add: Callable[[int, int, Array], None], *shape: int) -> Array:
        """Sum over all points what `add` adds to an array of this shape, part by part."""
        chunk = self._chunk
        count = -(-len(self.x) // chunk)
        parts = np.zeros((count, *shape))

        def add_part(start: int, stop: int) -> None:
            add(start, stop, parts[start // chunk])

        over_frames(add_part, len(self.x), chunk=chunk)
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
    T[1:4, 0] = mean
    for row, (a, b) in enumerate(SQUARES, start=4):
        T[row, 0] = mean[a] * mean[b]
        T[row, 1 + a] += mean[b]
        T[row, 1 + b] += mean[a]
    return T
