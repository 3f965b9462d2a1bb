"""Sums over mass points by link and by pair of links, in threads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.identify.body.point_kernels import PRODUCT_OF, PRODUCTS, pull, push, push_pairs, respond
from myomorph.identify.body.points import MassPoints
from myomorph.model.arrays import Array
from myomorph.rigid.frames import over_frames, thread_count


@dataclass(frozen=True, eq=False)
class PointSums:
    """Products with G (10 links, points): column j holds w_ij m(x_j) for every link i, m the ten monomials.

    Points are counted from their mean, so that powers of four keep their digits wherever the ground's
    origin is.

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
        """The sums over these points."""
        mean, W = points.points.mean(axis=0), points.weights
        if not W.has_canonical_format:
            W = W.copy()
            W.sum_duplicates()
        return PointSums(
            points.points - mean,
            np.array(W.indptr, np.int64),
            np.array(W.indices, np.int32),
            np.array(W.data, np.float64),
            W.shape[1],
            _shift(mean),
        )

    def pull(self, c: Array) -> Array:
        """(points,) G^T c of c (10 links,)."""
        by_link, out = np.ascontiguousarray(c.reshape(self.links, 10)), np.empty(len(self.x))
        over_frames(
            lambda start, stop: pull(self.x, self.first, self.columns, self.weights, by_link, start, stop, out),
            len(self.x),
            chunk=self._chunk,
        )
        return out

    def push(self, masses: Array) -> Array:
        """(10 links,) G masses of masses (points,)."""
        parts = np.zeros((-(-len(self.x) // self._chunk), self.links, 10))

        def part(start: int, stop: int) -> None:
            out = parts[start // self._chunk]
            push(self.x, self.first, self.columns, self.weights, masses, start, stop, out)

        over_frames(part, len(self.x), chunk=self._chunk)
        return parts.sum(axis=0).ravel()

    def pairs(self, factors: Array) -> Array:
        """(pairs of links, 36) sums that make G diag(factors) G^T; `matrix` puts them in place."""
        parts = np.zeros((-(-len(self.x) // self._chunk), self.links * (self.links + 1) // 2, PRODUCTS + 1))

        def part(start: int, stop: int) -> None:
            out = parts[start // self._chunk]
            push_pairs(self.x, self.first, self.columns, self.weights, factors, start, stop, out)

        if factors.any():
            over_frames(part, len(self.x), chunk=self._chunk)
        return parts.sum(axis=0)

    def matrix(self, pairs: Array) -> Array:
        """(10 links, 10 links) G F G^T from the sums of `pairs`."""
        i, k = np.tril_indices(self.links)
        blocks = np.empty((self.links, self.links, 10, 10))
        blocks[i, k] = blocks[k, i] = pairs[:, PRODUCT_OF]
        return blocks.transpose(0, 2, 1, 3).reshape(10 * self.links, 10 * self.links)

    def respond(
        self, reference: Array, freedom: Array, floor: Array, s: Array, ds: Array, t: float
    ) -> tuple[float, float]:
        """Sum of (rho_j - reference_j) ds_j at step t of the masses (`respond`), and its derivative by t."""
        parts = np.zeros((-(-len(self.x) // self._chunk), 2))
        over_frames(
            lambda start, stop: respond(reference, freedom, floor, s, ds, t, start, stop, parts[start // self._chunk]),
            len(self.x),
            chunk=self._chunk,
        )
        slope, curvature = parts.sum(axis=0)
        return float(slope), float(curvature)

    @property
    def _chunk(self) -> int:
        # A few parts a thread: each has sums of its own, which are added up afterwards.
        return max(4096, -(-len(self.x) // (4 * thread_count())))


def _shift(mean: Array) -> Array:
    """(10, 10) monomials at x + mean from those at x."""
    T, pairs = np.eye(10), ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    T[1:4, 0] = mean
    for row, (a, b) in enumerate(pairs, start=4):
        T[row, 0] = mean[a] * mean[b]
        T[row, 1 + a] += mean[b]
        T[row, 1 + b] += mean[a]
    return T
