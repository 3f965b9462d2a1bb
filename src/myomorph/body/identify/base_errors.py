"""Errors that noise of the motion makes of base parameters.

Least squares takes the regressor as known. It is made of coordinates that were measured too, so the
noise of these pulls at the estimate: at random, and always towards less. Each of the six rows of
the wrench has a weight of its own, and its noise counts by that weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.identify.base_parameters import BaseParameters
from myomorph.body.identify.least_squares import Blocks, Recording, gather
from myomorph.body.identify.motion_noise import DRAWS, once_more
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model


class WeighedRows(NamedTuple):
    """Equations of the six rows of the wrench, and what they are weighed by.

    Attributes
    ----------
    factors : (6, k + 1, k + 1) triangular factors of [rows, right side]
    weight : (6,) noise that each row is divided by
    solution : (k,) that fits best
    R : (k, k) upper triangular, of all rows with the prior, in units of noise
    prior_sd : (n,) of the first n unknowns
    """

    factors: Array
    weight: Array
    solution: Array
    R: Array
    prior_sd: Array

    @property
    def residual(self) -> Array:
        """(k + 1,) the solution, then -1, which a factor is multiplied by."""
        return np.append(self.solution, -1.0)

    def variance(self, shares: Array) -> Array:
        """Compute what noise of the rows, and the prior, leave open of the unknowns.

            diag(A^-1 (sum_i s_i A_i + P) A^-1),    A = sum_i A_i + P = R^T R

        with the information A_i of each row, and P of the prior.

        Parameters
        ----------
        shares : (6,) s, of each row's noise

        Returns
        -------
        (n,)
        """
        n = len(self.prior_sd)
        inverse = scipy.linalg.solve_triangular(self.R, np.eye(len(self.R)))
        half = inverse @ inverse[:n].T
        scales = np.sqrt(shares) / self.weight
        of_rows = np.square(scales[:, None, None] * (self.factors[:, :, :-1] @ half)).sum(axis=0)
        of_prior = np.square(half[:n] / self.prior_sd[:, None])
        return np.asarray(of_rows.sum(axis=0) + of_prior.sum(axis=0))

    def moved(self, pulls: Array) -> Array:
        """Compute how far pulls move the first n unknowns.

        Parameters
        ----------
        pulls : (draws, k) in units of noise

        Returns
        -------
        (draws, n)
        """
        half = scipy.linalg.solve_triangular(self.R, pulls.T, trans="T")
        return np.asarray(scipy.linalg.solve_triangular(self.R, half).T[:, : len(self.prior_sd)])


class Drawn(NamedTuple):
    """Effects of noise that is added once more to rows.

    Attributes
    ----------
    pulls : (draws, k) at the unknowns, in units of noise
    squares : (6,) on the mean, beyond those that each row leaves without it [(N m)^2], [N^2]
    """

    pulls: Array
    squares: Array


class MotionErrors(NamedTuple):
    """Errors that noise of the motion makes of base parameters.

    Attributes
    ----------
    shares : (6,) of the squares that each row leaves, what other noise made
    sd : (n,) root mean square of the error
    """

    shares: Array
    sd: Array


def motion_errors(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    rows: WeighedRows,
    blocks: Blocks,
) -> MotionErrors:
    """Draw noise of the motion anew, and find what it does to the estimate.

    With noise added once more to rows A_i that hold such noise already, the solution x is pulled by

        g = sum_i (A_i^T (A_i x - b_i) - A_d,i^T (A_d,i x - b_i)) / weight_i^2

    and moves by A^-1 g. Its mean is the bias that the noise which is there has made, to the first
    order of its variance, and its scatter is that of the error. Noise that alone would make more
    misfit of the moments, or of the forces, than there is was given too large: the scatter is then
    taken as less by the root of the ratio, and the bias by the ratio.

    Parameters
    ----------
    model : of the rows
    recordings : with the noise of their coordinates
    base : columns of the regressor
    rows : without further noise
    blocks : how recordings are taken apart

    Returns
    -------
    errors, always of the same random numbers
    """
    drawn = _drawn(model, recordings, base, rows, blocks)
    squares = np.square(rows.factors @ rows.residual).sum(axis=1)
    share = _at_most(drawn.squares, squares)
    moved = rows.moved(drawn.pulls)
    bias = share * moved.mean(axis=0)
    # Known from few draws only: the variance of Student's t, not of a normal distribution.
    scatter = share * moved.var(axis=0, ddof=1) * (DRAWS - 1) / (DRAWS - 3)
    by_others = 1.0 - share * drawn.squares / np.maximum(squares, 1e-300)
    return MotionErrors(shares=np.clip(by_others, 0.0, 1.0), sd=np.sqrt(np.square(bias) + scatter))


def _drawn(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    rows: WeighedRows,
    blocks: Blocks,
) -> Drawn:
    """Add noise of the motion once more, several times; see `motion_errors`."""
    random = np.random.default_rng(0)
    before, before_squares = _gradients(rows.factors, rows.residual)
    pulls = np.empty((DRAWS, len(rows.solution)))
    squares = np.empty((DRAWS, 6))
    for draw in range(DRAWS):
        made = gather(model, [once_more(one, random) for one in recordings], base, blocks)
        factors = made.factors if made.factors.shape == rows.factors.shape else made.plain
        gradients, squares[draw] = _gradients(factors, rows.residual)
        pulls[draw] = rows.weight**-2.0 @ (before - gradients)
    return Drawn(pulls=pulls, squares=squares.mean(axis=0) - before_squares)


def _gradients(factors: Array, residual: Array) -> tuple[Array, Array]:
    """Compute gradients of half the squares that each row leaves, and the squares.

    Parameters
    ----------
    factors : (6, k + 1, k + 1)
    residual : (k + 1,) the solution, then -1

    Returns
    -------
    (6, k) and (6,)
    """
    left = factors @ residual
    return np.einsum("rij,ri->rj", factors, left)[:, :-1], np.square(left).sum(axis=1)


def _at_most(added: Array, squares: Array) -> float:
    """Find the share of the noise's variance that the misfit allows.

    Parameters
    ----------
    added : (6,) squares that noise of the motion makes of each row
    squares : (6,) that each row leaves

    Returns
    -------
    at most 1
    """
    by_noise = np.reshape(added, (2, 3)).sum(axis=1)
    there = np.reshape(squares, (2, 3)).sum(axis=1)
    known = by_noise > 0.0
    if not known.any():
        return 1.0
    return min(1.0, float(np.min(there[known] / by_noise[known])))
