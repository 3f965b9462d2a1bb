"""The linear systems of the solver: symmetric, banded over frames, dense in the muscles of a frame.

diag(d_k) + C_k^T C_k on the diagonal blocks, diag(e_k) and diag(g_k) on the first and second beside it
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from myomorph.model.arrays import Array
from myomorph.rigid.kernels import kernel


@kernel
def _fill(d, e, g, C, band):
    """Lower band (width + 1, unknowns) of the matrix; band is filled as its transpose, (unknowns, width + 1)."""
    frames, count = d.shape
    rows = C.shape[1]
    for index in range(frames):
        for i in range(count):
            column = band[index * count + i]
            for j in range(column.shape[0]):
                column[j] = 0.0
            for r in range(rows):
                left = C[index, r, i]
                if left != 0.0:
                    for j in range(i, count):
                        column[j - i] += left * C[index, r, j]
            column[0] += d[index, i]
            if index + 1 < frames:
                column[count] += e[index, i]
            if index + 2 < frames and g.shape[0] > 0:
                column[2 * count] += g[index, i]


class BandSystem:
    """A matrix of the form above, factorized."""

    def __init__(self, frames: int, muscles: int, second: bool):
        self.shape = (frames, muscles)
        width = min((2 if second else 1) * muscles, max(frames - 1, 0) * muscles)
        self._band = np.empty((frames * muscles, width + 1))
        self._factor = self._band.T

    def factorize(self, d: Array, e: Array, g: Array, C: Array) -> bool:
        """Whether the matrix is positive definite; then it can be solved with."""
        _fill(d, e, g, C, self._band)
        self._factor, info = dpbtrf(self._band.T, lower=1, overwrite_ab=1)
        return bool(info == 0)

    def solve(self, right: Array) -> Array:
        """(frames, muscles)."""
        result, _ = dpbtrs(self._factor, right.reshape(-1), lower=1)
        return result.reshape(self.shape)
