"""Triangular factors R x = z of least squares, which grow by rows.

R^T R is the information. R of a QR decomposition goes on growing: [R; rows] is reduced to a new R
by Householder reflections, a few rows at a time and without BLAS. For six rows at a time the
compiled loops are as fast as LAPACK's, and its threads, which disturb work beside them, are not
needed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.kernels import kernel


@kernel
def fold(R, rows):  # page: six rows written out, which the compiler takes together
    """Turn six rows into a triangular factor by Householder reflections, in place.

    Parameters
    ----------
    R : (n, n + 1) or (n + 1, n + 1) upper triangular, changed in place
    rows : (6, n + 1), used up
    """
    for j in range(R.shape[0]):
        x0 = rows[0, j]
        x1 = rows[1, j]
        x2 = rows[2, j]
        x3 = rows[3, j]
        x4 = rows[4, j]
        x5 = rows[5, j]
        square = x0 * x0 + x1 * x1 + x2 * x2 + x3 * x3 + x4 * x4 + x5 * x5
        if square == 0.0:
            continue
        diagonal = R[j, j]
        length = math.sqrt(diagonal * diagonal + square)
        new = -length if diagonal > 0.0 else length
        factor = (new - diagonal) / new
        scale = 1.0 / (diagonal - new)
        x0 = x0 * scale
        x1 = x1 * scale
        x2 = x2 * scale
        x3 = x3 * scale
        x4 = x4 * scale
        x5 = x5 * scale
        R[j, j] = new
        # Views that start at 0: only so does the compiler take several columns at a time, three
        # times faster.
        r = R[j, j + 1 :]
        b0 = rows[0, j + 1 :]
        b1 = rows[1, j + 1 :]
        b2 = rows[2, j + 1 :]
        b3 = rows[3, j + 1 :]
        b4 = rows[4, j + 1 :]
        b5 = rows[5, j + 1 :]
        for row in range(r.shape[0]):
            w = factor * (
                r[row]
                + x0 * b0[row]
                + x1 * b1[row]
                + x2 * b2[row]
                + x3 * b3[row]
                + x4 * b4[row]
                + x5 * b5[row]
            )
            r[row] -= w
            b0[row] -= w * x0
            b1[row] -= w * x1
            b2[row] -= w * x2
            b3[row] -= w * x3
            b4[row] -= w * x4
            b5[row] -= w * x5


@kernel
def fold_rows(R, new, rows):
    """Turn any number of rows into a factor, in place.

    Parameters
    ----------
    R : (k or k - 1, k) upper triangular, changed in place
    new : (m, k)
    rows : (6, k) scratch
    """
    for first in range(0, new.shape[0], 6):
        rows[:] = 0.0
        for index in range(min(6, new.shape[0] - first)):
            rows[index] = new[first + index]
        fold(R, rows)


def absorb(factor: Array, rows: Array) -> Array:
    """Compute the factor R of the QR decomposition of [factor; rows].

    Parameters
    ----------
    factor : (k, k) upper triangular
    rows : (m, k); leading zeros of a row cost nothing

    Returns
    -------
    (k, k) upper triangular
    """
    triangle = np.array(factor, dtype=np.float64, order="C")
    added = np.array(rows, dtype=np.float64, order="C")
    fold_rows(triangle, added, np.empty((6, triangle.shape[1])))
    return triangle


def with_prior(factor: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Add independent priors of n parameters to triangular data [R, z].

    Parameters
    ----------
    factor : (unknowns, unknowns + 1) [R, z]; unknowns beyond n come last and stay without a prior
    mean, sd : (n,) of the priors

    Returns
    -------
    (unknowns, unknowns) R and (unknowns,) z
    """
    unknowns = len(factor)
    n = len(mean)
    whole = np.zeros((unknowns + 1, unknowns + 1))
    whole[:unknowns] = factor
    rows = np.zeros((n, unknowns + 1))
    rows[:, :n] = np.diag(1.0 / sd)
    rows[:, -1] = mean / sd
    done = absorb(whole, rows)
    return done[:unknowns, :unknowns], done[:unknowns, unknowns]


class Shown(NamedTuple):
    """How many combinations of unknowns rows show, and how well.

    Attributes
    ----------
    rank : number of singular values that count
    condition : largest over smallest singular value; infinite where rounding cannot tell it from
        that
    """

    rank: int
    condition: float


def rank_and_condition(R: Array, tolerance: float = 1e-6) -> Shown:
    """Compute rank and condition number of R with columns scaled to length 1.

    Parameters
    ----------
    R : (n, n)
    tolerance : singular values below this share of the largest do not count for the rank

    Returns
    -------
    both
    """
    length = np.linalg.norm(R, axis=0)
    values = np.linalg.svd(R / np.where(length > 0.0, length, 1.0), compute_uv=False)
    rank = int(np.sum(values > tolerance * values[0])) if values[0] > 0.0 else 0
    singular = values[-1] <= len(R) * np.finfo(float).eps * values[0]
    condition = float("inf") if singular else float(values[0] / values[-1])
    return Shown(rank=rank, condition=condition)


class Triangle(NamedTuple):
    """Least squares in triangular form, R x = z, in units of noise.

    Attributes
    ----------
    R : (n, n) upper triangular
    z : (n,)
    """

    R: Array
    z: Array


@read_only
class Solution:
    """A least-squares problem in triangular form, and its solution with a prior.

    Attributes
    ----------
    R, z : (k, k) and (k,) with R x = z, data alone, in units of noise
    solution, sd : (k,) with the prior
    """

    R: Array
    z: Array
    solution: Array
    sd: Array

    def without(self, n: int) -> Triangle:
        """Return the data's equations of the first n unknowns, whatever the others are.

        Parameters
        ----------
        n : number of unknowns that are kept

        Returns
        -------
        equations of these alone
        """
        size = len(self.z)
        if n == size:
            return Triangle(R=self.R, z=self.z)
        # With the others first, their rows can be left out: they can be met for any value of the
        # rest.
        order = np.concatenate([np.arange(n, size), np.arange(n)])
        turned = absorb(np.zeros((size + 1, size + 1)), np.column_stack([self.R[:, order], self.z]))
        kept = slice(size - n, size)
        return Triangle(R=turned[kept, kept], z=turned[kept, size])


def solve(factors: Array, sigma: Array, mean: Array, sd: Array) -> Solution:
    """Solve least squares from factors of rows, weighed by their noise, with a prior.

    Parameters
    ----------
    factors : (m, k + 1, k + 1) triangular factors of [rows, right side]
    sigma : (m,) noise of each
    mean, sd : (n,) prior of the first n unknowns

    Returns
    -------
    the data alone, and the solution with the prior
    """
    size = factors.shape[2] - 1
    data = np.zeros((size + 1, size + 1))
    for factor, noise in zip(factors, sigma, strict=True):
        data = absorb(data, factor / noise)
    R, z = with_prior(data[:size], mean, sd)
    estimate = scipy.linalg.solve_triangular(R, z)
    return Solution(
        R=data[:size, :size], z=data[:size, size], solution=estimate, sd=row_lengths_of_inverse(R)
    )


def row_lengths_of_inverse(R: Array) -> Array:
    """Compute standard deviations of unknowns whose information is R^T R.

    Parameters
    ----------
    R : (k, k) upper triangular

    Returns
    -------
    (k,) norms of the rows of R^-1
    """
    return np.linalg.norm(scipy.linalg.solve_triangular(R, np.eye(len(R))), axis=1)


def levels(R: Array, mean: Array, sizes: Array) -> Array:
    """Compute the share of what is known that comes from the data: 1 - var / size^2.

    var is the variance with data, had the mean been right to within the sizes before.

    Parameters
    ----------
    R : (n, n) upper triangular, of the data
    mean : (n,) before anything is measured
    sizes : (n,) standard deviations before

    Returns
    -------
    (n,) 0 to 1
    """
    whole, _ = with_prior(np.column_stack([R, np.zeros(len(R))]), mean, sizes)
    return np.clip(1.0 - np.square(row_lengths_of_inverse(whole) / sizes), 0.0, 1.0)
