"""Triangular factors of least-squares problems: R x = z, where R^T R is the information."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtpqrt

from myomorph.model.spatial import Array

_PANEL = 32


def absorb(factor: Array, rows: Array, triangular: int = 0) -> Array:
    """The factor R of the QR decomposition of [factor; rows], (k, k) upper triangular.

    Parameters
    ----------
    factor : (k, k) upper triangular
    rows : (m, k), used up where its columns are contiguous
    triangular : how many of the last rows are upper triangular, which saves work
    """
    factor, rows = np.asfortranarray(factor), np.asfortranarray(rows)
    done, _, _, info = dtpqrt(triangular, min(_PANEL, len(factor)), factor, rows, overwrite_b=1)
    assert info == 0
    triangle: Array = np.triu(done)
    return triangle


def with_prior(factor: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Triangular system (R, z) of data [R, z] (n, n + 1) and independent priors of n parameters.

    A factor (k, k + 1) with more unknowns than the prior knows has those last; they stay without one.
    """
    k, n = len(factor), len(mean)
    whole = np.zeros((k + 1, k + 1), order="F")
    whole[:k] = factor
    rows = np.zeros((n, k + 1), order="F")
    rows[:, :n] = np.diag(1.0 / sd)
    rows[:, -1] = mean / sd
    done = absorb(whole, rows, triangular=n)
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
