"""Cholesky factors of sparse matrices inside their envelope: in each row, from its first entry to the diagonal."""

from __future__ import annotations

import numpy as np

from myomorph.rigid.kernels import inner


@inner(fastmath={"reassoc", "contract"})
def factorize(M, first, floor):
    """Cholesky factor of M in its envelope, in place; pivots below `floor` are raised to it."""
    n = M.shape[0]
    for i in range(n):
        for j in range(first[i], i):
            total = M[i, j]
            for k in range(max(first[i], first[j]), j):
                total -= M[i, k] * M[j, k]
            M[i, j] = total / M[j, j]
        total = M[i, i]
        for k in range(first[i], i):
            total -= M[i, k] * M[i, k]
        M[i, i] = np.sqrt(max(total, floor[i]))


@inner
def back_substitute(M, first, z):
    """Solve with the factor M, in place of z."""
    n = M.shape[0]
    for i in range(n):
        total = z[i]
        for k in range(first[i], i):
            total -= M[i, k] * z[k]
        z[i] = total / M[i, i]
    for i in range(n - 1, -1, -1):
        z[i] /= M[i, i]
        for k in range(first[i], i):
            z[k] -= M[i, k] * z[i]
