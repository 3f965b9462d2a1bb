"""Functions of coordinates as flat arrays, and the coordinates that such functions couple.

One kernel gives value, slopes and curvatures of any function of at most two coordinates. Couplers
make dependent coordinates follow others by them, and carry derivatives over by the chain rule.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import Function, PiecewisePolynomial
from myomorph.core.rigid.kernels import bare, in_place, inner, kernel

Ints = NDArray[np.int64]

# Kinds of functions
POLYNOMIAL = 0
SINES = 1
# Columns of `FunctionArrays.table`
KIND = 0
FIRST = 1
PIECES = 2
WIDTH = 3
START = 4


class FunctionArrays(NamedTuple):
    """Functions one after another, in few arrays: every array that a kernel takes costs time.

    Attributes
    ----------
    table : (functions, 5) with the columns KIND, `POLYNOMIAL` or `SINES`; FIRST, the first break,
        and PIECES, the number of pieces of a piecewise polynomial; WIDTH, its coefficients a piece,
        or the coordinates of a product of sines; START of the coefficients
    breaks : of all piecewise polynomials
    coefficients : of all functions
    """

    table: Ints
    breaks: Array
    coefficients: Array


class State(NamedTuple):
    """Coordinates of a frame with their velocities and accelerations.

    Attributes
    ----------
    c : (coordinates,) values, dependent ones consistent [rad or m]
    cdot : (coordinates,) [rad/s or m/s]
    cddot : (coordinates,) [rad/s^2 or m/s^2]
    """

    c: Array
    cdot: Array
    cddot: Array


def compile_functions(functions: Sequence[Function]) -> FunctionArrays:
    """Pack functions into flat arrays, in their order.

    Parameters
    ----------
    functions : of at most two coordinates each

    Returns
    -------
    the arrays, whose rows of `table` have the order of `functions`
    """
    table: list[tuple[int, ...]] = []
    breaks: list[float] = []
    coefficients: list[float] = []
    for function in functions:
        start = len(coefficients)
        if isinstance(function, PiecewisePolynomial):
            pieces = len(function.breaks)
            width = function.coefficients.shape[1]
            table.append((POLYNOMIAL, len(breaks), pieces, width, start))
            breaks.extend(function.breaks)
            coefficients.extend(function.coefficients.ravel())
            continue
        table.append((SINES, len(breaks), 0, function.arity, start))
        coefficients.extend([function.factor, function.offset])
        for frequency, phase in zip(function.frequencies, function.phases, strict=True):
            coefficients.extend([frequency, phase])
    return FunctionArrays(
        table=np.array(table, np.int64).reshape(-1, 5),
        breaks=np.array(breaks, np.float64),
        coefficients=np.array(coefficients, np.float64),
    )


@kernel
def evaluate(functions, i, x1, x2):
    """Value and derivatives of function i of `FunctionArrays` at (x1, x2).

    A function of one coordinate takes x1 and leaves the derivatives in x2 zero.

    Returns
    -------
    f, f_1, f_2, f_11, f_12, f_22 : with indices for derivatives in x1 and x2
    """
    if functions.table[i, PIECES] == 1 and functions.table[i, WIDTH] == 2:
        # Most axes move in proportion to a coordinate: short enough for the compiler to inline.
        c = functions.table[i, START]
        slope = functions.coefficients[c + 1]
        value = functions.coefficients[c] + slope * (
            x1 - functions.breaks[functions.table[i, FIRST]]
        )
        return value, slope, 0.0, 0.0, 0.0, 0.0
    return evaluate_curved(functions, i, x1, x2)


@bare
def evaluate_at(functions, function, i, j, c):
    """Evaluate a function at coordinates number i and j of c (coordinates,).

    A number of -1 stands for no coordinate, which counts as 0. Returns what `evaluate` does.
    """
    return evaluate(functions, function, c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0)


@bare
def function_rates(functions, function, i, j, state):
    """Velocity and acceleration of a function of coordinates i and j, as of `evaluate_at`.

    fdot  = f_1 v_1 + f_2 v_2
    fddot = f_1 a_1 + f_2 a_2 + f_11 v_1^2 + 2 f_12 v_1 v_2 + f_22 v_2^2

    Parameters
    ----------
    functions, function, i, j : as of `evaluate_at`
    state : `State` of the frame
    """
    _, d1, d2, d11, d12, d22 = evaluate_at(functions, function, i, j, state.c)
    v1 = state.cdot[i] if i >= 0 else 0.0
    v2 = state.cdot[j] if j >= 0 else 0.0
    a1 = state.cddot[i] if i >= 0 else 0.0
    a2 = state.cddot[j] if j >= 0 else 0.0
    return (
        d1 * v1 + d2 * v2,
        d1 * a1 + d2 * a2 + d11 * v1 * v1 + 2.0 * d12 * v1 * v2 + d22 * v2 * v2,
    )


@bare
def evaluate_curved(functions, i, x1, x2):
    """Evaluate any function, a straight line or not; returns what `evaluate` does."""
    if functions.table[i, KIND] == POLYNOMIAL:
        f, slope, curvature = _evaluate_polynomial(functions, i, x1)
        return f, slope, 0.0, curvature, 0.0, 0.0
    return _evaluate_sines(functions, i, x1, x2)


# A part of its caller: of a spline in a knee, the call took as long as Horner's scheme.
@inner(counted=False, forceinline=True)
def _evaluate_polynomial(functions, i, x):
    """Value, slope and curvature of piecewise polynomial i at x, by Horner's scheme."""
    first = functions.table[i, FIRST]
    low = first
    high = low + functions.table[i, PIECES] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if x >= functions.breaks[middle]:
            low = middle
        else:
            high = middle - 1
    h = x - functions.breaks[low]
    width = functions.table[i, WIDTH]
    start = functions.table[i, START] + (low - first) * width
    f = 0.0
    slope = 0.0
    curvature = 0.0
    for power in range(width - 1, -1, -1):
        curvature = curvature * h + 2.0 * slope
        slope = slope * h + f
        f = f * h + functions.coefficients[start + power]
    return f, slope, curvature


@bare
def _evaluate_sines(functions, i, x1, x2):
    """Product of sines a sin(k_1 x_1 + p_1) sin(k_2 x_2 + p_2) + offset; returns as `evaluate`.

    A function of one coordinate has 1 in the place of the second sine.
    """
    start = functions.table[i, START]
    a = functions.coefficients[start]
    offset = functions.coefficients[start + 1]
    k1 = functions.coefficients[start + 2]
    s1 = np.sin(k1 * x1 + functions.coefficients[start + 3])
    c1 = np.cos(k1 * x1 + functions.coefficients[start + 3])
    k2 = 0.0
    s2 = 1.0
    c2 = 0.0
    if functions.table[i, WIDTH] == 2:
        k2 = functions.coefficients[start + 4]
        s2 = np.sin(k2 * x2 + functions.coefficients[start + 5])
        c2 = np.cos(k2 * x2 + functions.coefficients[start + 5])
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
    for coupler in range(T.coupler_coordinate.shape[0]):
        i = T.coupler_source[coupler, 0]
        j = T.coupler_source[coupler, 1]
        c[T.coupler_coordinate[coupler]] = evaluate_at(
            T.functions, T.coupler_function[coupler], i, j, c
        )[0]


@bare
def couple_rates(T, c, cdot, cddot):
    """Set the dependent velocities and accelerations by the chain rule; c is consistent already.

    Parameters
    ----------
    T : `TreeArrays`
    c, cdot, cddot : (coordinates,); the last two are changed in place
    """
    state = State(c=c, cdot=cdot, cddot=cddot)
    for coupler in range(T.coupler_coordinate.shape[0]):
        d = T.coupler_coordinate[coupler]
        i = T.coupler_source[coupler, 0]
        j = T.coupler_source[coupler, 1]
        cdot[d], cddot[d] = function_rates(T.functions, T.coupler_function[coupler], i, j, state)


@kernel
def gather_dependents(T, c, rows):
    """Turn derivatives in all coordinates into derivatives in the independent ones, in place.

    With a dependent coordinate c_d = f(c_i, c_j), last couplers first:

        df/dc_i += df/dc_d f_1,   df/dc_j += df/dc_d f_2

    Afterwards the entry of an independent coordinate includes what reaches f through the
    coordinates that follow it. The entries of dependent coordinates are left as they were.

    Parameters
    ----------
    T : `TreeArrays`
    c : (coordinates,) consistent values
    rows : (n, coordinates) each a df/dc, changed in place
    """
    for coupler in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d = T.coupler_coordinate[coupler]
        i = T.coupler_source[coupler, 0]
        j = T.coupler_source[coupler, 1]
        _, d1, d2, _, _, _ = evaluate_at(T.functions, T.coupler_function[coupler], i, j, c)
        for row in range(rows.shape[0]):
            if i >= 0:
                rows[row, i] += d1 * rows[row, d]
            if j >= 0:
                rows[row, j] += d2 * rows[row, d]


@in_place
def fold_dependents(T, c, H, g, D):
    """Carry a cost's derivatives from dependent coordinates to those they follow, in place.

    With a dependent coordinate c_d = f(c_i, c_j), last couplers first, and the same for c_j:

        g_i += f_1 g_d,   H += f_1 (row and column d) + g_d f_11,   D_i += f_1^2 D_d

    Parameters
    ----------
    T : `TreeArrays`
    c : (coordinates,) consistent values
    H : (coordinates, coordinates) Hessian
    g : (coordinates,) gradient
    D : (coordinates,) weights of single coordinates, whose squares add up
    """
    for coupler in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d = T.coupler_coordinate[coupler]
        i = T.coupler_source[coupler, 0]
        j = T.coupler_source[coupler, 1]
        _, d1, d2, d11, d12, d22 = evaluate_at(T.functions, T.coupler_function[coupler], i, j, c)
        for side in range(2):
            source = i if side == 0 else j
            slope = d1 if side == 0 else d2
            if source < 0:
                continue
            g[source] += slope * g[d]
            D[source] += slope * slope * D[d]
            H[source, source] += g[d] * (d11 if side == 0 else d22)
            for other in range(c.shape[0]):
                H[source, other] += slope * H[d, other]
            for other in range(c.shape[0]):
                H[other, source] += slope * H[other, d]
        if i >= 0 and j >= 0:
            H[i, j] += g[d] * d12
            H[j, i] += g[d] * d12


@kernel
def couple_frames(T, values):
    """`couple` for every row of values (frames, coordinates), in place."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple(T, values[frame])


@kernel
def couple_rates_frames(T, values, velocities, accelerations):
    """`couple_rates` for every row of three arrays (frames, coordinates), in place."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple_rates(T, values[frame], velocities[frame], accelerations[frame])
