"""Quintic splines with even knots: few unknowns, and derivatives that belong to them."""

from __future__ import annotations

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.coordinates import Ints

DEGREE = 5  # Accelerations are cubic splines then, smooth as those of a filtered motion
WIDTH = DEGREE + 1  # Knots that a frame depends on
GAP_STIFFNESS = 1e-6  # Of a curvature, against values: bends splines little where nothing is known


@read_only
class Basis:
    """Values and derivatives at frames of splines with even knots.

    Attributes
    ----------
    first : (frames,) number of the first coefficient that a frame depends on
    weights : (3, frames, WIDTH) of the following coefficients, for values, rates and accelerations
    count : coefficients of each coordinate
    """

    first: Ints
    weights: Array
    count: int

    @classmethod
    def of(cls, time: Array, spacing: float, span: tuple[float, float] | None = None) -> Basis:
        """Build a basis for frames.

        Parameters
        ----------
        time : (frames,) [s]
        spacing : about how far apart knots are [s]
        span : of the knots, by default that of the frames [s]

        Returns
        -------
        basis of `DEGREE`
        """
        start, end = (float(time[0]), float(time[-1])) if span is None else span
        pieces = max(1, round((end - start) / spacing))
        step = (end - start) / pieces
        knots = start + step * np.arange(-DEGREE, pieces + DEGREE + 1)
        first = np.clip(((time - start) / step).astype(np.int64), 0, pieces - 1)
        weights = np.empty((3, len(time), WIDTH))
        # All pieces are the same function: the piece of each coefficient, shifted into the first
        # interval.
        local = (time - start - first * step)[:, None] + start
        for index in range(WIDTH):
            bspline = scipy.interpolate.BSpline(
                knots[: 2 * WIDTH], np.eye(WIDTH)[index], DEGREE, extrapolate=True
            )
            for nu in range(3):
                weights[nu, :, index] = bspline(local, nu)[:, 0]
        return cls(first, weights, pieces + DEGREE)

    def at(self, coefficients: Array, derivative: int = 0) -> Array:
        """Evaluate splines at the frames.

        Parameters
        ----------
        coefficients : (count, columns)
        derivative : 0 for values, 1 for rates, 2 for accelerations

        Returns
        -------
        (frames, columns)
        """
        window = coefficients[self.first[:, None] + np.arange(WIDTH)]
        return np.einsum("fk,fkn->fn", self.weights[derivative], window)

    def fitted(self, values: Array) -> Array:
        """Fit splines to values at the frames, little bent in gaps.

        Parameters
        ----------
        values : (frames, columns); frames with NaN are left out

        Returns
        -------
        (count, columns) coefficients
        """
        known: np.ndarray = np.asarray(np.isfinite(values).all(axis=1))
        band = np.zeros((WIDTH, self.count))
        right = np.zeros((self.count, values.shape[1]))
        bent = self.weights[2] / np.abs(self.weights[2]).max()
        for f in range(len(values)):
            w = self.weights[0, f]
            at = self.first[f]
            for i in range(WIDTH):
                for j in range(i + 1):
                    band[i - j, at + j] += (
                        known[f] * w[i] * w[j] + GAP_STIFFNESS * bent[f, i] * bent[f, j]
                    )
                if known[f]:
                    right[at + i] += w[i] * values[f]
        band[0] += 1e-12
        return scipy.linalg.cho_solve_banded(
            (scipy.linalg.cholesky_banded(band, lower=True), True), right
        )
