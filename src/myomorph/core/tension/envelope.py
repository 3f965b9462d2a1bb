"""Symmetric matrices inside an envelope: their Cholesky factor, and equations solved by it.

Row i of a matrix and of its factor is 0 before column first_i (George and Liu 1981, Computer
Solution of Large Sparse Positive Definite Systems, ch. 4).
"""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.kernels import bare, inner


@inner(_nrt=False, fastmath={"reassoc", "contract"})
def factorize(M, first, floor):
    """Factorize M = L L^T inside its envelope, in place; pivots below `floor` are raised to it.

    Parameters
    ----------
    M : (rows, rows) symmetric, of which the lower triangle is read and becomes L
    first : (rows,) first column of each row inside the envelope
    floor : (rows,) least pivots
    """
    n = M.shape[0]
    for i in range(n):
        for j in range(first[i], i):
            total = M[i, j]
            for index in range(max(first[i], first[j]), j):
                total -= M[i, index] * M[j, index]
            M[i, j] = total / M[j, j]
        total = M[i, i]
        for index in range(first[i], i):
            total -= M[i, index] * M[i, index]
        M[i, i] = np.sqrt(max(total, floor[i]))


@bare
def back_substitute(M, first, z):
    """Solve L L^T z = right-hand side, in place.

    Parameters
    ----------
    M : (rows, rows) the factor L of `factorize`
    first : (rows,) first column of each row inside the envelope
    z : (rows,) the right-hand side, then the solution
    """
    n = M.shape[0]
    for i in range(n):
        total = z[i]
        for index in range(first[i], i):
            total -= M[i, index] * z[index]
        z[i] = total / M[i, i]
    for i in range(n - 1, -1, -1):
        z[i] /= M[i, i]
        for index in range(first[i], i):
            z[index] -= M[i, index] * z[i]


@bare
def add_outer(vector, divisor, first, M):
    """Add v v^T / divisor to M inside its envelope.

    Parameters
    ----------
    vector : (rows,) v
    divisor : above 0
    first : (rows,) first column of each row inside the envelope
    M : (rows, rows) whose lower triangle is changed
    """
    for i in range(M.shape[0]):
        for j in range(first[i], i + 1):
            M[i, j] += vector[i] * vector[j] / divisor
