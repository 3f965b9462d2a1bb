"""The separable problem as arrays: pattern of A, what all frames share, links, and Cholesky factors in an envelope."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from myomorph.model.arrays import Array, read_only
from myomorph.rigid.kernels import inner


class Separable(NamedTuple):
    """Pattern and data that all frames share."""

    start: NDArray[np.int64]  # (variables + 1,) entries of column i of A are start[i] ... start[i + 1] - 1
    row: NDArray[np.int64]  # (entries,) their rows, in the order of elimination, ascending in each column
    first: NDArray[np.int64]  # (rows,) in the envelope of A D A^T, the first column of each row
    # weight, exponent, lower, upper: (variables,)
    weight: Array
    exponent: Array
    lower: Array
    upper: Array
    capped: int = 0  # the first so many variables lie under a common bound besides
    peak: float = 0.0  # what one unit of that bound costs, 0 for no such bound (see `ceiling.py`)

    @property
    def column(self) -> NDArray[np.int64]:
        """(entries,) the variable that each entry of A belongs to."""
        return np.repeat(np.arange(len(self.weight)), np.diff(self.start))

    def dense(self, values: Array) -> Array:
        """A (frames, rows, variables) from its entries (frames, entries)."""
        A = np.zeros((len(values), len(self.first), len(self.weight)))
        A[:, self.row, self.column] = values
        return A


class Links(NamedTuple):
    """Variables that should change little from frame to frame: stiffness_k w_i (amount_k - amount_(k-1))^2."""

    first: int  # variables first ... first + linked - 1 are linked
    scale: Array  # (frames, linked) amount of one unit of the variable, 0 where it takes no part
    amount: Array  # (frames, linked) room for the amounts as other frames see them
    stiffness: Array  # (frames - 1,) between a frame and the next, in units of the variables' weights
    over: float  # factor of over-relaxation, 1 to 2
    sweeps: int  # most passes over the frames
    tolerance: float  # change of an amount at which passes end


def no_links() -> Links:
    """Frames that do not know of each other."""
    return Links(0, np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), 1.0, 0, 0.0)


@read_only
class Pattern:
    """Where A (rows, variables) may differ from zero, and an order of its rows with a small envelope."""

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    order: NDArray[np.int64]  # (rows,) the rows in the order of elimination
    place: NDArray[np.int64]  # (entries,) position of the caller's k-th entry in the kernel's order


def pattern(rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Pattern:
    """Pattern of a matrix of `shape` (rows, variables) from `rows`, `columns` (entries,), each place at most once."""
    n, variables = shape
    filled = csr_array(coo_array((np.ones(len(rows)), (rows, columns)), shape=shape))
    coupled = csr_array(filled @ filled.T)
    order = np.asarray(reverse_cuthill_mckee(coupled, symmetric_mode=True), dtype=np.int64)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    first = np.arange(n, dtype=np.int64)
    links = coo_array(coupled)
    np.minimum.at(first, rank[links.coords[0]], rank[links.coords[1]])
    sorted_entries = np.lexsort((rank[rows], columns))
    place = np.empty(len(rows), np.int64)
    place[sorted_entries] = np.arange(len(rows))
    start = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=variables))]).astype(np.int64)
    return Pattern(start, rank[rows][sorted_entries], first, order, place)


@inner(fastmath={"reassoc", "contract"})
def factorize(M, first, floor):
    """Cholesky factor of M in its envelope, in place; pivots below `floor` are raised to it."""
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


@inner
def back_substitute(M, first, z):
    """Solve with the factor M, in place of z."""
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
