"""The separable problem over frames: least effort in balance, by a semismooth Newton on its dual.

    minimise  sum_i w_i |x_i - t_i|^p_i   subject to  A x = b,  lower <= x <= upper

For given multipliers y every x_i has a closed form, x_i = clip(t_i + sign(s_i) (|s_i| / (p_i w_i))^(1/(p_i - 1)))
with s = A^T y, so stationarity and bounds hold exactly and only the balance b - A x is left to
solve for: it is the gradient of the concave dual. Its generalized Jacobian is A D A^T with a
diagonal D = dx/ds, of the size of the coordinates and not of the muscles, and sparse where muscles
cross few joints (Qi and Sun 1993; Hintermueller, Ito and Kunisch 2002 for the p = 2 case).

A tiny slack eps y in the balance makes the solution exist always: where no activations can
balance the torques it is, nearly, the one that misses them least, and the frame says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from myomorph.model.spatial import Array

OPTIMAL, INFEASIBLE, STALLED, MISSING = 0, 1, 2, 3
STATUS_NAMES = ("optimal", "infeasible", "not converged", "missing input")

TOLERANCE = 1e-9
"""Imbalance, relative to 1 + max |b|, at which a frame is solved."""

SLACKS = (1e-16, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12, 1e-15)
"""Slack per multiplier, relative to the row's stiffness: first try, then from large to small."""


class Separable(NamedTuple):
    """Pattern and data that all frames share.

    Attributes
    ----------
    start : (variables + 1,) entries of column i of A are start[i] ... start[i + 1] - 1
    row : (entries,) their rows, in the order of elimination, ascending in each column
    first : (rows,) in the envelope of A D A^T, the first column of each row
    weight, exponent, lower, upper : (variables,)
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    weight: Array
    exponent: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where A (rows, variables) may differ from zero, and an order of its rows with a small envelope.

    Attributes
    ----------
    order : (rows,) the rows in the order of elimination
    place : (entries,) position of the caller's k-th entry in the kernel's order
    """

    start: NDArray[np.int64]
    row: NDArray[np.int64]
    first: NDArray[np.int64]
    order: NDArray[np.int64]
    place: NDArray[np.int64]


def pattern(rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]) -> Pattern:
    """Pattern of a matrix from the places of its entries.

    Parameters
    ----------
    rows, columns : (entries,) each place at most once
    shape : (rows, variables) of the matrix
    """
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


@njit(cache=True, nogil=True, error_model="numpy")
def _response(S, i, target, s):
    """x_i at the reduced multiplier s, and dx_i/ds there (0 on a bound)."""
    w, p = S.weight[i], S.exponent[i]
    if p == 2.0:
        x, slope = target + 0.5 * s / w, 0.5 / w
    else:
        size = (abs(s) / (p * w)) ** (1.0 / (p - 1.0))
        x = target + (size if s > 0.0 else -size)
        slope = 1.0 / (p * (p - 1.0) * w * max(size, 1e-3 if p < 2.0 else 1e-30) ** (p - 2.0))
        # Near 0 the slope of a root (p > 2) would throw the iteration to the other side: the secant does not.
        if p > 2.0 and size < 1e-3:
            slope *= p - 1.0
        slope = min(slope, 1e8 / w)
    if x <= S.lower[i]:
        return S.lower[i], 0.0
    if x >= S.upper[i]:
        return S.upper[i], 0.0
    return x, slope


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _factorize(M, first, floor):
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


@njit(cache=True, nogil=True, error_model="numpy")
def _back_substitute(M, first, z):
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


@njit(cache=True, nogil=True, error_model="numpy")
def _assemble(S, values, slope, slack, M):
    """M = A diag(slope) A^T + diag(slack), inside its envelope."""
    n = M.shape[0]
    for i in range(n):
        for j in range(S.first[i], i):
            M[i, j] = 0.0
        M[i, i] = slack[i]
    for i in range(slope.shape[0]):
        if slope[i] == 0.0:
            continue
        for a in range(S.start[i], S.start[i + 1]):
            left = slope[i] * values[a]
            if left == 0.0:
                continue
            row = S.row[a]
            for b in range(S.start[i], a + 1):
                M[row, S.row[b]] += left * values[b]


@njit(cache=True, nogil=True, error_model="numpy")
def _ascent(S, targets, s, ds, t, constant, linear):
    """Slope of the dual along a direction at step t; it never grows with t."""
    total = constant - t * linear
    for i in range(s.shape[0]):
        if ds[i] != 0.0:
            total -= _response(S, i, targets[i], s[i] + t * ds[i])[0] * ds[i]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _step(S, targets, s, ds, constant, linear):
    """Step length that maximises the dual along a direction, to a tenth of the initial slope."""
    t, low, high, enough = 0.0, 0.0, np.inf, 0.0
    # One call of `_ascent` in the code: it is inlined, and each copy takes time to compile.
    for trial in range(62):
        now = _ascent(S, targets, s, ds, t, constant, linear)
        if trial == 0:
            enough = 0.1 * now
            t = 1.0
            continue
        if abs(now) <= enough or t > 1e6:
            break
        if now > 0.0:
            low = t
            t = 4.0 * t if high == np.inf else 0.5 * (low + high)
        else:
            high = t
            t = 0.1 * t if low == 0.0 else 0.5 * (low + high)
    return t


@njit(cache=True, nogil=True, error_model="numpy")
def _free_stiffness(S, values, slope, diagonal):
    """Diagonal of A D A^T with no variable on a bound, at |x| = 1; `slope` gets that D."""
    for j in range(diagonal.shape[0]):
        diagonal[j] = 0.0
    for i in range(slope.shape[0]):
        p = S.exponent[i]
        slope[i] = 1.0 / (p * (p - 1.0) * S.weight[i])
        for a in range(S.start[i], S.start[i + 1]):
            diagonal[S.row[a]] += slope[i] * values[a] * values[a]


@njit(cache=True, nogil=True, error_model="numpy")
def _newton(S, A, b, targets, relative, most, cold, x, y, by_variable, by_row, M):
    """Maximise the dual of one frame with a slack; y is where it begins and ends.

    by_variable, by_row, M are room to work in: (3, variables), (5, rows), (rows, rows).

    Returns
    -------
    worst, left, iterations : max |b - A x|, max |b - A x - slack y|, and how many steps it took
    """
    n, variables = b.shape[0], x.shape[0]
    slope, s, ds = by_variable[0], by_variable[1], by_variable[2]
    slack, floor, residual, z = by_row[0], by_row[1], by_row[2], by_row[3]
    _free_stiffness(S, A, slope, slack)
    scale = 1.0
    for j in range(n):
        slack[j] = relative * max(slack[j], 1.0)
        floor[j] = 10.0 * slack[j]
        scale = max(scale, 1.0 + abs(b[j]))
    for i in range(variables):
        s[i] = 0.0
        for a in range(S.start[i], S.start[i + 1]):
            s[i] += A[a] * y[S.row[a]]
    iteration = 0
    while True:
        for j in range(n):
            residual[j] = b[j]
        for i in range(variables):
            x[i], d = _response(S, i, targets[i], s[i])
            # The very first step of a cold start is that of the problem without bounds.
            if iteration > 0 or not cold:
                slope[i] = d
            for a in range(S.start[i], S.start[i + 1]):
                residual[S.row[a]] -= A[a] * x[i]
        worst, left = 0.0, 0.0
        for j in range(n):
            worst = max(worst, abs(residual[j]))
            z[j] = residual[j] - slack[j] * y[j]
            left = max(left, abs(z[j]))
        if left <= TOLERANCE * scale or iteration == most:
            return worst, left, iteration
        iteration += 1
        _assemble(S, A, slope, slack, M)
        _factorize(M, S.first, floor)
        _back_substitute(M, S.first, z)
        constant, linear = 0.0, 0.0
        for j in range(n):
            constant += (b[j] - slack[j] * y[j]) * z[j]
            linear += slack[j] * z[j] * z[j]
        for i in range(variables):
            ds[i] = 0.0
            for a in range(S.start[i], S.start[i + 1]):
                ds[i] += A[a] * z[S.row[a]]
        t = _step(S, targets, s, ds, constant, linear)
        for j in range(n):
            y[j] += t * z[j]
        for i in range(variables):
            s[i] += t * ds[i]


@njit(cache=True, nogil=True, error_model="numpy")
def solve_separable(S, values, balance, targets, warm, x, y, imbalance, iterations, status):
    """Solve frame after frame, each starting from the multipliers of the one before.

    A frame that the plain iteration does not settle is solved again with a large slack that then
    shrinks; where no slack can be small, the frame is infeasible and x misses the balance least.

    Parameters
    ----------
    S : `Separable`
    values : (frames, entries) of A
    balance : (frames, rows) b, rows in the order of elimination
    targets : (frames, variables) t
    warm : (rows,) multipliers to begin with, zero for none; afterwards those of the last frame
    x, y : (frames, variables), (frames, rows) filled with the solution and its multipliers
    imbalance, iterations, status : (frames,) filled; imbalance is max |b - A x|
    """
    n, variables = balance.shape[1], x.shape[1]
    M, by_variable, by_row = np.zeros((n, n)), np.zeros((3, variables)), np.zeros((5, n))
    steepest = 0.0
    for i in range(variables):
        steepest = max(steepest, S.exponent[i])
    # With p > 2 the multipliers of a variable near 0 fall under the rounding of the others.
    accepted = 10.0 * TOLERANCE if steepest <= 2.0 else 1e-6
    for frame in range(balance.shape[0]):
        A, b, result = values[frame], balance[frame], y[frame]
        unknown, scale = 0.0, 1.0
        for k in range(A.shape[0]):
            unknown += A[k] - A[k]
        for i in range(variables):
            unknown += targets[frame, i] - targets[frame, i]
        for j in range(n):
            unknown += b[j] - b[j]
            scale = max(scale, 1.0 + abs(b[j]))
        if unknown != 0.0:
            for i in range(variables):
                x[frame, i] = np.nan
            for j in range(n):
                result[j] = np.nan
            imbalance[frame], iterations[frame], status[frame] = np.nan, 0, MISSING
            continue
        cold = True
        for j in range(n):
            result[j] = warm[j]
            cold = cold and warm[j] == 0.0
        worst, before, steps, stuck, k = np.inf, np.inf, 0, False, 0
        most = 40
        while k < len(SLACKS):
            worst, left, more = _newton(
                S, A, b, targets[frame], SLACKS[k], most, cold, x[frame], result, by_variable, by_row, M
            )
            steps += more
            if most == 0:
                break
            if k == 0 and left <= TOLERANCE * scale:
                stuck = True
                break
            settled = left <= TOLERANCE * scale or left <= 1e-3 * worst
            cold = k == 0
            if k > 1 and not settled:
                # The last slack that could be solved for is the answer: x again, without a step.
                k, most = k - 1, 0
                for j in range(n):
                    result[j] = by_row[4, j]
                continue
            for j in range(n):
                by_row[4, j] = result[j]
                if k == 0:
                    result[j] = 0.0
            if k > 0:
                # Less slack, but the same imbalance: nothing is left that could take it.
                stuck = settled and worst > 0.5 * before
                before = worst
            k, most = k + 1, 150
        imbalance[frame], iterations[frame] = worst, steps
        if worst <= accepted * scale:
            status[frame] = OPTIMAL
        else:
            status[frame] = INFEASIBLE if stuck else STALLED
        for j in range(n):
            warm[j] = result[j] if status[frame] == OPTIMAL else 0.0
