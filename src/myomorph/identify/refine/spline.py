"""Coordinates over time as quintic splines: few unknowns, and derivatives that belong to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

from myomorph.model.arrays import Array, read_only
from myomorph.rigid.coordinates import Ints

DEGREE = 5
"""Accelerations are cubic splines then, smooth as those of a filtered motion."""

WIDTH = DEGREE + 1
"""Knots that a frame depends on."""


@read_only
@dataclass(frozen=True, eq=False)
class Basis:
    """Values and derivatives at frames of splines with even knots."""

    first: Ints  # (frames,) number of the first coefficient that a frame depends on
    weights: Array  # (3, frames, WIDTH) of the following coefficients, for values, rates and accelerations
    count: int  # coefficients of each coordinate

    @classmethod
    def of(cls, time: Array, spacing: float, span: tuple[float, float] | None = None) -> Basis:
        """Basis for frames at `time` (frames,) with knots about `spacing` apart over a span, by default theirs [s]."""
        start, end = (float(time[0]), float(time[-1])) if span is None else span
        pieces = max(1, round((end - start) / spacing))
        step = (end - start) / pieces
        knots = start + step * np.arange(-DEGREE, pieces + DEGREE + 1)
        first = np.clip(((time - start) / step).astype(np.int64), 0, pieces - 1)
        weights = np.empty((3, len(time), WIDTH))
        # All pieces are the same function: the piece of each coefficient, shifted into the first interval.
        local = (time - start - first * step)[:, None] + start
        for index in range(WIDTH):
            bspline = BSpline(knots[: 2 * WIDTH], np.eye(WIDTH)[index], DEGREE, extrapolate=True)
            for nu in range(3):
                weights[nu, :, index] = bspline(local, nu)[:, 0]
        return cls(first, weights, pieces + DEGREE)

    def at(self, coefficients: Array, derivative: int = 0) -> Array:
        """(frames, columns) of coefficients (count, columns)."""
        window = coefficients[self.first[:, None] + np.arange(WIDTH)]
        return np.einsum("fk,fkn->fn", self.weights[derivative], window)

    def fitted(self, values: Array) -> Array:
        """(count, columns) whose splines are nearest to values (frames, columns), NaN left out; little bent in gaps."""
        known: np.ndarray = np.asarray(np.isfinite(values).all(axis=1))
        band, right = np.zeros((WIDTH, self.count)), np.zeros((self.count, values.shape[1]))
        bent = self.weights[2] / np.abs(self.weights[2]).max()
        for f in range(len(values)):
            w, at = self.weights[0, f], self.first[f]
            for i in range(WIDTH):
                for j in range(i + 1):
                    band[i - j, at + j] += known[f] * w[i] * w[j] + 1e-6 * bent[f, i] * bent[f, j]
                if known[f]:
                    right[at + i] += w[i] * values[f]
        band[0] += 1e-12
        result: Array = cho_solve_banded((cholesky_banded(band, lower=True), True), right)
        return result
