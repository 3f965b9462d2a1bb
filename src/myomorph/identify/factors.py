"""Triangular factors of least-squares problems: R x = z, where R^T R is the information."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from myomorph.identify.householder import fold_rows
from myomorph.model.arrays import Array


def absorb(factor: Array, rows: Array) -> Array:
    """The factor R of the QR decomposition of [factor; rows], (k, k) upper triangular.

    Parameters
    ----------
    factor : (k, k) upper triangular
    rows : (m, k); leading zeros of a row cost nothing
    """
    triangle = np.array(factor, dtype=np.float64, order="C")
    fold_rows(triangle, np.array(rows, dtype=np.float64, order="C"), np.empty((6, triangle.shape[1])))
    return triangle


def with_prior(factor: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Triangular system (R, z) of data [R, z] (n, n + 1) and independent priors of n parameters.

    A factor (k, k + 1) with more unknowns than the prior knows has those last; they stay without one.
    """
    k, n = len(factor), len(mean)
    whole = np.zeros((k + 1, k + 1))
    whole[:k] = factor
    rows = np.zeros((n, k + 1))
    rows[:, :n] = np.diag(1.0 / sd)
    rows[:, -1] = mean / sd
    done = absorb(whole, rows)
    return done[:k, :k], done[:k, k]


def rank_and_condition(R: Array, tolerance: float = 1e-6) -> tuple[int, float]:
    """Rank, and the largest over the smallest singular value, of R with columns scaled to length 1.

    The condition number is infinite where rounding cannot tell it from that.
    """
    length = np.linalg.norm(R, axis=0)
    values = np.linalg.svd(R / np.where(length > 0.0, length, 1.0), compute_uv=False)
    rank = int(np.sum(values > tolerance * values[0])) if values[0] > 0.0 else 0
    singular = values[-1] <= len(R) * np.finfo(float).eps * values[0]
    return rank, float("inf") if singular else float(values[0] / values[-1])


@dataclass(frozen=True, eq=False)
class Solution:
    """A least-squares problem in triangular form, and its solution with a prior.

    Attributes
    ----------
    R, z : (k, k), (k,) with R x = z, data alone, in units of noise
    solution, sd : (k,) with the prior
    """

    R: Array
    z: Array
    solution: Array
    sd: Array

    def without(self, n: int) -> tuple[Array, Array]:
        """R and z of the first n unknowns, whatever the others are."""
        k = len(self.z)
        if n == k:
            return self.R, self.z
        # With the others first, their rows can be left out: they can be met for any value of the rest.
        order = np.concatenate([np.arange(n, k), np.arange(n)])
        turned = absorb(np.zeros((k + 1, k + 1)), np.column_stack([self.R[:, order], self.z]))
        return turned[k - n : k, k - n : k], turned[k - n : k, k]


def solve(factors: Array, sigma: Array, mean: Array, sd: Array) -> Solution:
    """Weigh triangular factors (m, k + 1, k + 1) by the noise (m,) of their rows, with a prior on the first n unknowns.

    Parameters
    ----------
    mean, sd : (n,) of the prior
    """
    k = factors.shape[2] - 1
    data = np.zeros((k + 1, k + 1))
    for factor, noise in zip(factors, sigma, strict=True):
        data = absorb(data, factor / noise)
    R, z = with_prior(data[:k], mean, sd)
    return Solution(data[:k, :k], data[:k, k], solve_triangular(R, z), row_lengths_of_inverse(R))


def row_lengths_of_inverse(R: Array) -> Array:
    """(k,) standard deviations of unknowns whose information is R^T R."""
    lengths: Array = np.linalg.norm(solve_triangular(R, np.eye(len(R))), axis=1)
    return lengths


def levels(R: Array, mean: Array, sizes: Array) -> Array:
    """(n,) share of what is known that comes from data R (n, n): 1 - var / size^2, 0 to 1.

    var is the variance with data, had the mean been right to within the sizes before.
    """
    whole, _ = with_prior(np.column_stack([R, np.zeros(len(R))]), mean, sizes)
    share: Array = np.clip(1.0 - np.square(row_lengths_of_inverse(whole) / sizes), 0.0, 1.0)
    return share
