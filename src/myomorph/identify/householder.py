"""Rows turned into a triangular factor by Householder reflections, a few at a time and without BLAS.

R of a QR decomposition goes on growing: [R; rows] is reduced to a new R. For six rows at a time the compiled
loops are as fast as LAPACK's, and its threads, which disturb work beside them, are not needed.
"""

from __future__ import annotations

import math

from myomorph.rigid.kernels import kernel


@kernel
def fold(R, rows):
    """Turn six rows (6, n + 1) into a triangular factor (n, n + 1) by Householder reflections, in place.

    `rows` is used up.
    """
    for j in range(R.shape[0]):
        x0, x1, x2, x3, x4, x5 = rows[0, j], rows[1, j], rows[2, j], rows[3, j], rows[4, j], rows[5, j]
        square = x0 * x0 + x1 * x1 + x2 * x2 + x3 * x3 + x4 * x4 + x5 * x5
        if square == 0.0:
            continue
        diagonal = R[j, j]
        length = math.sqrt(diagonal * diagonal + square)
        new = -length if diagonal > 0.0 else length
        factor = (new - diagonal) / new
        scale = 1.0 / (diagonal - new)
        x0, x1, x2, x3, x4, x5 = x0 * scale, x1 * scale, x2 * scale, x3 * scale, x4 * scale, x5 * scale
        R[j, j] = new
        # Views that start at 0: only so does the compiler take several columns at a time, three times faster.
        r = R[j, j + 1 :]
        b0, b1, b2 = rows[0, j + 1 :], rows[1, j + 1 :], rows[2, j + 1 :]
        b3, b4, b5 = rows[3, j + 1 :], rows[4, j + 1 :], rows[5, j + 1 :]
        for k in range(r.shape[0]):
            w = factor * (r[k] + x0 * b0[k] + x1 * b1[k] + x2 * b2[k] + x3 * b3[k] + x4 * b4[k] + x5 * b5[k])
            r[k] -= w
            b0[k] -= w * x0
            b1[k] -= w * x1
            b2[k] -= w * x2
            b3[k] -= w * x3
            b4[k] -= w * x4
            b5[k] -= w * x5


@kernel
def fold_rows(R, given, rows):
    """Turn any number of rows (m, k) into a factor (k or k - 1, k), in place; `rows` (6, k) is used up."""
    for first in range(0, given.shape[0], 6):
        rows[:] = 0.0
        for k in range(min(6, given.shape[0] - first)):
            rows[k] = given[first + k]
        fold(R, rows)


@kernel
def fold_frames(R, i, Y, columns, constants, wrench, used, rows):
    """Turn row i of the base wrench in some frames into a factor (n + 7, n + 7), in place.

    Parameters
    ----------
    Y, constants, wrench : (frames, 6, 10 bodies), (frames, 6, 6), (frames, 6)
    columns : (n,) those of Y that count
    used : the frames that count
    rows : (6, n + 7), used up
    """
    n = columns.shape[0]
    for first in range(0, used.shape[0], 6):
        rows[:] = 0.0
        for k in range(min(6, used.shape[0] - first)):
            f = used[first + k]
            for j in range(n):
                rows[k, j] = Y[f, i, columns[j]]
            for j in range(6):
                rows[k, n + j] = constants[f, i, j]
            rows[k, n + 6] = wrench[f, i]
        fold(R, rows)
