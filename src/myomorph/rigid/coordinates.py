"""Functions of coordinates in flat arrays: values, slopes and curvatures in one kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from myomorph.model.functions import Function, PiecewisePolynomial
from myomorph.model.spatial import Array

Ints = NDArray[np.int64]

POLYNOMIAL, SINES = 0, 1


class FunctionArrays(NamedTuple):
    """Functions one after another.

    Attributes
    ----------
    kind : (functions,) POLYNOMIAL or SINES
    first, pieces, width : (functions,) of a piecewise polynomial: index of its first break, number
        of pieces, coefficients a piece; of a sine product `width` is its number of coordinates
    start : (functions,) index of the first coefficient
    breaks, coefficients : all breaks and coefficients
    """

    kind: Ints
    first: Ints
    pieces: Ints
    width: Ints
    start: Ints
    breaks: Array
    coefficients: Array


def compile_functions(functions: Sequence[Function]) -> FunctionArrays:
    """The functions as flat arrays, in the order given."""
    kind, first, pieces, width, start = [], [], [], [], []
    breaks: list[float] = []
    coefficients: list[float] = []
    for function in functions:
        first.append(len(breaks))
        start.append(len(coefficients))
        if isinstance(function, PiecewisePolynomial):
            kind.append(POLYNOMIAL)
            pieces.append(len(function.breaks))
            width.append(function.coefficients.shape[1])
            breaks.extend(function.breaks)
            coefficients.extend(function.coefficients.ravel())
        else:
            kind.append(SINES)
            pieces.append(0)
            width.append(function.arity)
            coefficients.extend([function.factor, function.offset])
            for frequency, phase in zip(function.frequencies, function.phases, strict=True):
                coefficients.extend([frequency, phase])
    return FunctionArrays(
        kind=np.array(kind, np.int64),
        first=np.array(first, np.int64),
        pieces=np.array(pieces, np.int64),
        width=np.array(width, np.int64),
        start=np.array(start, np.int64),
        breaks=np.array(breaks, np.float64),
        coefficients=np.array(coefficients, np.float64),
    )


@njit(cache=True, nogil=True)
def evaluate(F, i, x1, x2):
    """Value and derivatives of function i at (x1, x2): f, f_1, f_2, f_11, f_12, f_22.

    A function of one coordinate takes x1 and leaves the derivatives in x2 zero.
    """
    c = F.start[i]
    if F.kind[i] == POLYNOMIAL:
        low, high = F.first[i], F.first[i] + F.pieces[i] - 1
        while low < high:
            middle = (low + high + 1) // 2
            if x1 >= F.breaks[middle]:
                low = middle
            else:
                high = middle - 1
        h = x1 - F.breaks[low]
        n = F.width[i]
        c += (low - F.first[i]) * n
        f, d, dd = 0.0, 0.0, 0.0
        for j in range(n - 1, -1, -1):
            dd = dd * h + 2.0 * d
            d = d * h + f
            f = f * h + F.coefficients[c + j]
        return f, d, 0.0, dd, 0.0, 0.0
    a, offset = F.coefficients[c], F.coefficients[c + 1]
    k1 = F.coefficients[c + 2]
    s1, c1 = np.sin(k1 * x1 + F.coefficients[c + 3]), np.cos(k1 * x1 + F.coefficients[c + 3])
    k2, s2, c2 = 0.0, 1.0, 0.0
    if F.width[i] == 2:
        k2 = F.coefficients[c + 4]
        s2, c2 = np.sin(k2 * x2 + F.coefficients[c + 5]), np.cos(k2 * x2 + F.coefficients[c + 5])
    return (
        a * s1 * s2 + offset,
        a * k1 * c1 * s2,
        a * k2 * s1 * c2,
        -a * k1 * k1 * s1 * s2,
        a * k1 * k2 * c1 * c2,
        -a * k2 * k2 * s1 * s2,
    )
