"""The separable problem as arrays: pattern of A, data that all frames share, and of frames.

    minimise    sum_i w_i |x_i - t_i|^p_i + k_i dist(x_i, [l_i, h_i])^2
    subject to  A x = b,  lower <= x <= upper

`dual.py` solves it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.tension.elimination_order import coupled_rows, elimination_order


class Separable(NamedTuple):
    """Pattern and data that all frames share.

    Attributes
    ----------
    start : (variables + 1,) entries of column i of A are start[i] ... start[i + 1] - 1
    row : (entries,) their rows, in the order of elimination, ascending in each column
    first : (rows,) in the envelope of A D A^T, the first column of each row
    weight, exponent : (variables,) w and p of the cost w |x|^p
    lower, upper : (variables,) bounds
    capped : number of leading variables that lie under a common bound besides
    peak : cost of one unit of that bound, 0 for no such bound
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    weight: Array
    exponent: Array
    lower: Array
    upper: Array
    capped: int = 0
    peak: float = 0.0

    @property
    def column(self) -> NDArray[np.int64]:
        """(entries,) the variable that each entry of A belongs to."""
        return np.repeat(np.arange(len(self.weight)), np.diff(self.start))

    def dense(self, values: Array) -> Array:
        """Write A out from its entries.

        Parameters
        ----------
        values : (frames, entries)

        Returns
        -------
        (frames, rows, variables)
        """
        A = np.zeros((len(values), len(self.first), len(self.weight)))
        A[:, self.row, self.column] = values
        return A


class SeparableFrames(NamedTuple):
    """What differs from frame to frame.

    Attributes
    ----------
    values : (frames, entries) of A, in the order of the pattern
    right : (frames, rows) b, rows in the order of elimination
    targets : (1 or frames, variables) t
    penalties : (1 or frames, 3, variables) l, h and k; a k of 0 leaves l and h unread
    """

    values: Array
    right: Array
    targets: Array
    penalties: Array


class SeparableFrame(NamedTuple):
    """The same of one frame.

    Attributes
    ----------
    values : (entries,) of A
    right : (rows,) b
    targets : (variables,) t
    low, high, pull : (variables,) l, h and k of the interval penalties
    """

    values: Array
    right: Array
    targets: Array
    low: Array
    high: Array
    pull: Array


class SolvedSeparable(NamedTuple):
    """Solution of the separable problem in some frames.

    Attributes
    ----------
    x : (frames, variables)
    multipliers : (frames, rows) y, rows in the order of elimination
    residual : (frames,) equilibrium residual max |b - A x|
    iterations : (frames,) Newton steps
    status : (frames,) index into `STATUS_NAMES`
    """

    x: Array
    multipliers: Array
    residual: Array
    iterations: NDArray[np.int64]
    status: NDArray[np.int8]


class FrameLinks(NamedTuple):
    """Variables that should change little from one frame to the next.

    The cost gains stiffness_j w_i (amount_j - amount_(j-1))^2 for each linked variable i and each
    pair of neighbouring frames.

    Attributes
    ----------
    first : the variables first ... first + linked - 1 are linked
    scale : (frames, linked) amount of one unit of the variable, 0 where it takes no part
    amount : (frames, linked) room for the amounts as other frames see them
    stiffness : (frames - 1,) between a frame and the next, in units of the variables' weights
    over : factor of over-relaxation, 1 to 2
    sweeps : maximum number of passes over the frames
    tolerance : change of an amount at which passes end
    """

    first: int
    scale: Array
    amount: Array
    stiffness: Array
    over: float
    sweeps: int
    tolerance: float


def no_links() -> FrameLinks:
    """Links of frames that do not know of each other."""
    return FrameLinks(
        first=0,
        scale=np.zeros((0, 0)),
        amount=np.zeros((0, 0)),
        stiffness=np.zeros(0),
        over=1.0,
        sweeps=0,
        tolerance=0.0,
    )


@read_only
class Pattern:
    """Where A (rows, variables) may differ from 0, and an order of its rows with a small envelope.

    Attributes
    ----------
    start, row, first : as of `Separable`
    order : (rows,) the rows in the order of elimination
    place : (entries,) position of each of the caller's entries in the kernel's order
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    order: NDArray[np.int64]
    place: NDArray[np.int64]


def pattern(rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Pattern:
    """Pattern of a matrix A, its rows in an order that keeps the envelope of A A^T small.

    It is the reverse order of Cuthill and McKee.

    Parameters
    ----------
    rows, columns : (entries,) where the matrix may differ from 0, each position at most once
    shape : (rows, variables) of the matrix

    Returns
    -------
    pattern whose rows are in the order of elimination
    """
    n, variables = shape
    neighbors = coupled_rows(rows, columns, n)
    order = elimination_order(neighbors)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)

    first = np.arange(n, dtype=np.int64)
    for row, coupled in enumerate(neighbors):
        # A row without entries is coupled to none.
        first[rank[row]] = rank[[row, *coupled]].min()

    sorted_entries = np.lexsort((rank[rows], columns))
    place = np.empty(len(rows), np.int64)
    place[sorted_entries] = np.arange(len(rows))
    counts = np.bincount(columns, minlength=variables)
    return Pattern(
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        row=rank[rows][sorted_entries],
        first=first,
        order=order,
        place=place,
    )
