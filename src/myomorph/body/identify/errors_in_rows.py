"""Equations whose noise is not independent: rows that know what errors of the motion make of them.

Condensed rows R x = z, from A x = b by A = Q R, have noise of 1. Errors s of the rows beside it, of
which A^T s is known to have the covariance P P^T, leave

    cov(R x - z) = K = 1 + R^-T P P^T R^-1

so that rows L^-1 R x = L^-1 z with K = L L^T have noise of 1 again: generalized least squares of
the condensed equations.
"""

from __future__ import annotations

import numpy as np
import scipy

from myomorph.body.identify.triangles import Triangle
from myomorph.core.model.arrays import Array, checked_array, read_only

# Singular value, of the largest, from which rows show a combination of unknowns at all
SEEN = 1e-6


@read_only
class ReturningErrors:
    """What errors of the motion that return with the posture make of rows, by parts.

    Attributes
    ----------
    pulls : (parts, 2, n, k) A^T s by k independent errors of size 1, moments and forces apart
    squares : (parts, 2) sum of squares of all errors over the frames of a part [(N m)^2], [N^2]
    """

    pulls: Array
    squares: Array

    def __post_init__(self) -> None:
        checked_array(self.pulls, ("parts", 2, "base parameters", "errors"), "pulls of errors")
        checked_array(self.squares, (len(self.pulls), 2), "squares of errors")

    def only(self, parts: np.ndarray) -> ReturningErrors:
        """Select parts.

        Parameters
        ----------
        parts : (chosen,) numbers

        Returns
        -------
        the errors of these parts
        """
        return ReturningErrors(pulls=self.pulls[parts], squares=self.squares[parts])


@read_only
class Whitening:
    """Rows in their singular directions, and what errors do to them.

    Attributes
    ----------
    left : (n, seen) U of R = U S V^T
    sizes : (seen,) S
    right : (seen, n) V^T
    lower : (seen, seen) L, whose square L L^T is the covariance K
    """

    left: Array
    sizes: Array
    right: Array
    lower: Array

    @classmethod
    def of(cls, R: Array, pulls: Array) -> Whitening:
        """Decompose rows and the covariance of their errors.

        Parameters
        ----------
        R : (n, n) of rows with noise of 1
        pulls : (n, k) P, what independent errors of size 1 make of A^T s

        Returns
        -------
        the weighing
        """
        left, sizes, right = np.linalg.svd(R)
        seen = sizes > SEEN * sizes[0]
        errors = right[seen] @ pulls / sizes[seen, None]
        return cls(
            left=left[:, seen],
            sizes=sizes[seen],
            right=right[seen],
            lower=np.linalg.cholesky(np.eye(len(errors)) + errors @ errors.T),
        )

    @property
    def explained(self) -> float:
        """Sum of squares of the errors that the unknowns can explain, in units of noise."""
        return float(np.square(self.lower).sum()) - len(self.lower)

    def rows(self, z: Array) -> Triangle:
        """Weigh rows, so that their noise is 1 again.

        Parameters
        ----------
        z : (n,) right side of R x = z

        Returns
        -------
        (n, n) L^-1 R and (n,) L^-1 z, in singular directions; rows that show nothing are 0
        """
        n = self.right.shape[1]
        both = np.column_stack([self.sizes[:, None] * self.right, self.left.T @ z])
        weighed = np.zeros((n, n + 1))
        weighed[: len(both)] = scipy.linalg.solve_triangular(self.lower, both, lower=True)
        return Triangle(R=weighed[:, :n], z=weighed[:, n])

    def scores(self, scores: Array) -> Array:
        """Weigh pulls of errors at the unknowns as the rows are weighed: A^T s to R^T K^-1 Q^T s.

        Parameters
        ----------
        scores : (draws, n) A^T s of each draw

        Returns
        -------
        (draws, n)
        """
        turned = (self.right @ scores.T) / self.sizes[:, None]
        weighed = scipy.linalg.cho_solve((self.lower, True), turned)
        result: Array = (self.right.T @ (self.sizes[:, None] * weighed)).T
        return result
