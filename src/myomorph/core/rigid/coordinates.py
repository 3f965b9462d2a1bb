"""Functions of coordinates in flat arrays: values, slopes and curvatures in one kernel; dependent
coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import Function, PiecewisePolynomial
from myomorph.core.rigid.kernels import bare, in_place, kernel

Ints = NDArray[np.int64]

POLYNOMIAL = 0
SINES = 1
KIND = 0
FIRST = 1
PIECES = 2
WIDTH = 3
START = 4


class FunctionArrays(NamedTuple):
    """Functions one after another, in as few arrays as possible: every array a kernel takes costs
    time.
    """

    # (functions, 5) KIND (POLYNOMIAL or SINES), FIRST break and number of PIECES of a piecewise
    # polynomial, WIDTH (its coefficients a piece, or the coordinates of a sine product), START of
    # the coefficients
    table: Ints
    # breaks, coefficients: of all functions
    breaks: Array
    coefficients: Array


def compile_functions(functions: Sequence[Function]) -> FunctionArrays:
    """The functions as flat arrays, in the order given."""
    table: list[tuple[int, ...]] = []
    breaks: list[float] = []
    coefficients: list[float] = []
    for function in functions:
        at = len(breaks), len(coefficients)
        if isinstance(function, PiecewisePolynomial):
            table.append(
                (POLYNOMIAL, at[0], len(function.breaks), function.coefficients.shape[1], at[1])
            )
            breaks.extend(function.breaks)
            coefficients.extend(function.coefficients.ravel())
        else:
            table.append((SINES, at[0], 0, function.arity, at[1]))
            coefficients.extend([function.factor, function.offset])
            for frequency, phase in zip(function.frequencies, function.phases, strict=True):
                coefficients.extend([frequency, phase])
    return FunctionArrays(
        np.array(table, np.int64).reshape(-1, 5),
        np.array(breaks, np.float64),
        np.array(coefficients, np.float64),
    )


@kernel
def evaluate(F, i, x1, x2):
    """Value and derivatives of function i at (x1, x2): f, f_1, f_2, f_11, f_12, f_22.
    A function of one coordinate takes x1 and leaves the derivatives in x2 zero.
    """
    if F.table[i, PIECES] == 1 and F.table[i, WIDTH] == 2:
        # Most axes move in proportion to a coordinate: short enough for the compiler to put in
        # place.
        c = F.table[i, START]
        slope = F.coefficients[c + 1]
        return (
            F.coefficients[c] + slope * (x1 - F.breaks[F.table[i, FIRST]]),
            slope,
            0.0,
            0.0,
            0.0,
            0.0,
        )
    return evaluate_curved(F, i, x1, x2)


@bare
def evaluate_at(F, function, i, j, c):
    """`evaluate` at the coordinates number i and j of c; -1 for none, which counts as 0."""
    return evaluate(F, function, c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0)


@bare
def function_rates(F, function, i, j, c, cdot, cddot):
    """Velocity and acceleration of a function of the coordinates i and j by the chain rule, as of
    `evaluate_at`.
    """
    _, d1, d2, d11, d12, d22 = evaluate_at(F, function, i, j, c)
    v1 = cdot[i] if i >= 0 else 0.0
    v2 = cdot[j] if j >= 0 else 0.0
    a1 = cddot[i] if i >= 0 else 0.0
    a2 = cddot[j] if j >= 0 else 0.0
    return (
        d1 * v1 + d2 * v2,
        d1 * a1 + d2 * a2 + d11 * v1 * v1 + 2.0 * d12 * v1 * v2 + d22 * v2 * v2,
    )


@bare
def evaluate_curved(F, i, x1, x2):
    """`evaluate` for any function."""
    c = F.table[i, START]
    if F.table[i, KIND] == POLYNOMIAL:
        low = F.table[i, FIRST]
        high = low + F.table[i, PIECES] - 1
        while low < high:
            middle = (low + high + 1) // 2
            if x1 >= F.breaks[middle]:
                low = middle
            else:
                high = middle - 1
        h = x1 - F.breaks[low]
        n = F.table[i, WIDTH]
        c += (low - F.table[i, FIRST]) * n
        f = 0.0
        d = 0.0
        dd = 0.0
        for j in range(n - 1, -1, -1):
            dd = dd * h + 2.0 * d
            d = d * h + f
            f = f * h + F.coefficients[c + j]
        return f, d, 0.0, dd, 0.0, 0.0
    a = F.coefficients[c]
    offset = F.coefficients[c + 1]
    k1 = F.coefficients[c + 2]
    s1 = np.sin(k1 * x1 + F.coefficients[c + 3])
    c1 = np.cos(k1 * x1 + F.coefficients[c + 3])
    k2 = 0.0
    s2 = 1.0
    c2 = 0.0
    if F.table[i, WIDTH] == 2:
        k2 = F.coefficients[c + 4]
        s2 = np.sin(k2 * x2 + F.coefficients[c + 5])
        c2 = np.cos(k2 * x2 + F.coefficients[c + 5])
    return (
        a * s1 * s2 + offset,
        a * k1 * c1 * s2,
        a * k2 * s1 * c2,
        -a * k1 * k1 * s1 * s2,
        a * k1 * k2 * c1 * c2,
        -a * k2 * k2 * s1 * s2,
    )


@bare
def couple(T, c):
    """Set the dependent coordinates in c (coordinates,) from those they follow."""
    for index in range(T.coupler_coordinate.shape[0]):
        i = T.coupler_source[index, 0]
        j = T.coupler_source[index, 1]
        c[T.coupler_coordinate[index]] = evaluate_at(
            T.functions, T.coupler_function[index], i, j, c
        )[0]


@bare
def couple_rates(T, c, cdot, cddot):
    """Set the dependent velocities and accelerations by the chain rule; c is consistent already."""
    for index in range(T.coupler_coordinate.shape[0]):
        d = T.coupler_coordinate[index]
        i = T.coupler_source[index, 0]
        j = T.coupler_source[index, 1]
        cdot[d], cddot[d] = function_rates(
            T.functions, T.coupler_function[index], i, j, c, cdot, cddot
        )


@kernel
def gather_dependents(T, c, rows):
    """Turn derivatives in all coordinates into derivatives in the independent ones, in place.
    Each row of `rows` (n, coordinates) holds df/dc; afterwards the entry of an independent
    coordinate includes what reaches f through the coordinates that follow it, and the entries of
    dependent coordinates are left as they were.
    """
    for index in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d = T.coupler_coordinate[index]
        i = T.coupler_source[index, 0]
        j = T.coupler_source[index, 1]
        _, d1, d2, _, _, _ = evaluate_at(T.functions, T.coupler_function[index], i, j, c)
        for row in range(rows.shape[0]):
            if i >= 0:
                rows[row, i] += d1 * rows[row, d]
            if j >= 0:
                rows[row, j] += d2 * rows[row, d]


@in_place
def fold_dependents(T, c, H, g, D):
    """Carry what dependent coordinates feel over to those they follow, by the chain rule, in place."""
    for index in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d = T.coupler_coordinate[index]
        i = T.coupler_source[index, 0]
        j = T.coupler_source[index, 1]
        _, d1, d2, d11, d12, d22 = evaluate_at(T.functions, T.coupler_function[index], i, j, c)
        for side in range(2):
            s = i if side == 0 else j
            slope = d1 if side == 0 else d2
            if s >= 0:
                g[s] += slope * g[d]
                D[s] += slope * slope * D[d]
                H[s, s] += g[d] * (d11 if side == 0 else d22)
                for t in range(c.shape[0]):
                    H[s, t] += slope * H[d, t]
                for t in range(c.shape[0]):
                    H[t, s] += slope * H[t, d]
        if i >= 0 and j >= 0:
            H[i, j] += g[d] * d12
            H[j, i] += g[d] * d12


@kernel
def couple_frames(T, values):
    """`couple` for every row of values (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple(T, values[frame])


@kernel
def couple_rates_frames(T, values, velocities, accelerations):
    """`couple_rates` for every row of three arrays (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple_rates(T, values[frame], velocities[frame], accelerations[frame])
