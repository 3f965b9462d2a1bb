"""Linear equations whose matrix has entries near its diagonal only."""

from __future__ import annotations

from myomorph.core.rigid.kernels import bare, kernel


@kernel
def solve_banded(rows, right, reach):
    """Solve A x = b for many right sides, in place, by Gaussian elimination with row exchanges.

    Parameters
    ----------
    rows : (n, 3 reach + 1) A[i, i - reach + j] at [i, j], zero in the last `reach` columns, into
        which exchanges of rows carry entries; overwritten
    right : (n, sides) b, which becomes x
    reach : of the band to either side of the diagonal
    """
    n = len(rows)
    for i in range(n):
        last = min(i + reach, n - 1)
        # Entries of row i from the diagonal on, as many as an exchange can bring
        width = min(2 * reach, n - 1 - i) + 1
        pivot = _pivot(rows, reach, i, last)
        if pivot != i:
            start = i - pivot + reach
            _exchange(rows[i, reach : reach + width], rows[pivot, start : start + width])
            _exchange(right[i], right[pivot])
        for p in range(i + 1, last + 1):
            start = i - p + reach
            factor = rows[p, start] / rows[i, reach]
            if factor != 0.0:
                _subtract(rows[p, start : start + width], factor, rows[i, reach : reach + width])
                _subtract(right[p], factor, right[i])
    _substitute_back(rows, right, reach)


@bare
def _pivot(rows, reach, i, last):
    """Find the row from i to `last` whose entry in column i is largest."""
    best = i
    for p in range(i + 1, last + 1):
        if abs(rows[p, i - p + reach]) > abs(rows[best, i - best + reach]):
            best = p
    return best


@bare
def _exchange(first, second):
    """Exchange the entries of two arrays (n,)."""
    for i in range(len(first)):
        kept = first[i]
        first[i] = second[i]
        second[i] = kept


@bare
def _subtract(target, factor, source):
    """Subtract a multiple of one array (n,) from another."""
    for i in range(len(target)):
        target[i] -= factor * source[i]


@bare
def _substitute_back(rows, right, reach):
    """Solve the upper triangle that is left, from the last row up.

    x_i = (b_i - sum_(c > i) A_ic x_c) / A_ii
    """
    n = len(rows)
    for i in range(n - 1, -1, -1):
        values = right[i]
        for c in range(i + 1, min(i + 2 * reach, n - 1) + 1):
            _subtract(values, rows[i, c - i + reach], right[c])
        for side in range(len(values)):
            values[side] /= rows[i, reach]
