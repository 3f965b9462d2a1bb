"""Curves of muscles and tendons: tables of pieces that one kernel evaluates, whatever muscle they
belong to.

A piece is a polynomial and a sum of elementary functions of ratios of straight lines,

    y(x) = p(u) + sum_i size_i f_i((a_i + b_i x) / (c_i + d_i x)),

with u from x = q(u), a quintic: Millard's corners (Millard, Uchida, Seth and Delp 2013) and splines
are polynomials alone, exponentials, bells, hyperbolas and logarithms are functions alone. Nothing
is sampled: u is found by a guarded Newton iteration on a monotone quintic. A jet is a value with
its slope and curvature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import simm_spline
from myomorph.core.rigid.kernels import inner, kernel

RATIO, EXPONENTIAL, BELL, LOGARITHM, ASINH, LOGISTIC = range(6)
"""Elementary functions of z: z, exp(z), exp(-z^2), log(z), asinh(z), 1 / (1 + exp(z))."""
STEEPEST = 1e9  # Slope of the line that continues an inverse where the curve itself is flat


class Shape(NamedTuple):
    """An elementary function in a piece: size f(z) with z = (a + b x) / (c + d x)."""

    form: int  # which f, `RATIO` ... `LOGISTIC`
    size: float
    a: float = 0.0
    b: float = 1.0
    c: float = 1.0
    d: float = 0.0


class Piece(NamedTuple):
    """A curve from `start` to where the next piece starts."""

    start: float  # x where it begins, or minus infinity
    # y, x: power coefficients in u of the polynomial part and of x, at most six; without x they are
    # those of x - start
    y: tuple[float, ...] = ()
    x: tuple[float, ...] = ()
    shapes: tuple[Shape, ...] = ()  # what is added to the polynomial


@dataclass(frozen=True, eq=False)
class Curve:
    """A function made of pieces, continued by straight lines and held within bounds."""

    pieces: tuple[Piece, ...]  # in the order of x
    end: float = np.inf  # x where the last one ends, or infinity
    # (left, right) of the lines that continue it; None for the tangent
    slopes: tuple[float | None, float | None] = (0.0, 0.0)
    # least and greatest value; the slope beyond is 0
    bounds: tuple[float, float] = (-np.inf, np.inf)

    def __call__(self, x: ArrayLike) -> Array:
        """Values at x, any shape; NaN stays NaN."""
        x = np.asarray(x, dtype=np.float64)
        values = np.empty(x.size)
        _values(self.arrays, x.ravel(), values)
        return values.reshape(x.shape)

    def jets(self, x: ArrayLike) -> Array:
        """Values, slopes and curvatures (..., 3) at x."""
        x = np.asarray(x, dtype=np.float64)
        jets = np.empty((x.size, 3))
        _jets(self.arrays, x.ravel(), jets)
        return jets.reshape(*x.shape, 3)

    @cached_property
    def arrays(self) -> CurveArrays:
        """The curve alone as the kernels read it."""
        return pack_curves([self])

    def within(self, low: float = -np.inf, high: float = np.inf) -> Curve:
        """The curve held within bounds."""
        return Curve(pieces=self.pieces, end=self.end, slopes=self.slopes, bounds=(low, high))

    def inverse(self) -> Curve:
        """X over y, of a rising curve that is made of polynomials."""
        if any(piece.shapes for piece in self.pieces):
            raise ValueError("only polynomials are inverted")
        pieces = tuple(Piece(piece.y[0], _line(piece), piece.y) for piece in self.pieces)
        left, right = (1.0 / max(slope, 1.0 / STEEPEST) for slope in self._ends()[2:])
        return Curve(pieces, sum(self.pieces[-1].y), (left, right))

    def rounded(self, at: float, half: float) -> Curve:
        """The curve with a corner taken off: a cubic over at - half ... at + half with its values
        and slopes there.
        """
        low = at - half
        high = at + half
        y0, s0, _ = self.jets(low)
        y1, s1, _ = self.jets(high)
        width = 2.0 * half
        rise = y1 - y0
        cubic = (
            y0,
            s0 * width,
            3.0 * rise - (2.0 * s0 + s1) * width,
            (s0 + s1) * width - 2.0 * rise,
        )
        starts = [piece.start for piece in self.pieces]
        before = tuple(piece for piece in self.pieces if piece.start < low)
        last = max(sum(start <= high for start in starts) - 1, 0)
        after = (
            self.pieces[last]._replace(start=high, x=_line(self.pieces[last])),
            *self.pieces[last + 1 :],
        )
        return Curve(
            pieces=(*before, Piece(low, cubic, (low, width)), *after),
            end=self.end,
            slopes=self.slopes,
            bounds=self.bounds,
        )

    def _ends(self) -> tuple[float, float, float, float]:
        """First and last value, and the slopes beyond; where a curve ends nowhere its value there
        is 0, not used.
        """
        first = self.pieces[0]
        last = self.pieces[-1]
        y0, left = _jet_of(first, first.start)
        y1, right = _jet_of(last, self.end)
        left, right = (
            slope if fixed is None else fixed
            for slope, fixed in zip((left, right), self.slopes, strict=True)
        )
        return y0, y1, left, right


def _line(piece: Piece) -> tuple[float, ...]:
    return piece.x or (piece.start if np.isfinite(piece.start) else 0.0, 1.0)


def _jet_of(piece: Piece, x: float) -> tuple[float, float]:
    """Value and slope of a piece at x."""
    if not np.isfinite(x):
        return 0.0, 0.0
    table = np.zeros((1, 13))
    line = _line(piece)
    table[0, 1 : 1 + len(line)], table[0, 7 : 7 + len(piece.y)] = line, piece.y
    u = parameter_at.py_func(table, 0, x)
    powers = u ** np.arange(6.0)
    coefficients = table[0, 1:].reshape(2, 6)
    slopes = coefficients[:, 1:] @ (np.arange(1.0, 6.0) * powers[:-1])
    value = float(coefficients[1] @ powers)
    slope = float(slopes[1] / max(slopes[0], 1e-9))
    for shape in piece.shapes:
        below = shape.c + shape.d * x
        f0, f1, _ = shape_jet.py_func(shape.form, (shape.a + shape.b * x) / below)
        value += shape.size * f0
        slope += shape.size * f1 * (shape.b * shape.c - shape.a * shape.d) / below**2
    return value, slope


class CurveArrays(NamedTuple):
    """Curves one after another, as the kernels read them; few arrays, as a call counts the users of
    each.
    """

    # (curves, 8) x, y and slope of the line on the left, the same on the right, least and greatest
    # value
    ends: Array
    pieces: Array  # (pieces, 13) x where a piece begins, power coefficients of x and of y
    shapes: Array  # (shapes, 6) form, size, a, b, c, d
    of_curve: NDArray[np.int64]  # (curves, 2) index of a curve's first and last piece
    # (pieces, 3) whether the polynomial is more than a number; index of the first shape, and after
    # the last
    of_piece: NDArray[np.int64]


def pack_curves(curves: Sequence[Curve]) -> CurveArrays:
    """The curves as flat arrays, in their order."""
    pieces = [piece for curve in curves for piece in curve.pieces]
    shapes = [shape for piece in pieces for shape in piece.shapes]
    table = np.zeros((len(pieces), 13))
    ends = np.zeros((len(curves), 8))
    for row, piece in zip(table, pieces, strict=True):
        x = _line(piece)
        row[0], row[1 : 1 + len(x)], row[7 : 7 + len(piece.y)] = piece.start, x, piece.y
    for row, curve in zip(ends, curves, strict=True):
        y0, y1, left, right = curve._ends()
        row[:] = curve.pieces[0].start, y0, left, curve.end, y1, right, *curve.bounds
    first = np.cumsum([0, *(len(curve.pieces) for curve in curves)])
    shape = np.cumsum([0, *(len(piece.shapes) for piece in pieces)])
    bent = [len(piece.y) > 1 for piece in pieces]
    return CurveArrays(
        ends=ends,
        pieces=table,
        shapes=np.array(shapes, dtype=np.float64).reshape(len(shapes), 6),
        of_curve=np.stack([first[:-1], first[1:] - 1], axis=1).astype(np.int64),
        of_piece=np.stack([np.array(bent, np.int64), shape[:-1], shape[1:]], axis=1).astype(
            np.int64
        ),
    )


@inner(counted=False, forceinline=True)
def parameter_at(P, piece, x):
    """Parameter of the quintic of piece k at which it is at x: Newton steps inside brackets."""
    a0 = P[piece, 1]
    a1 = P[piece, 2]
    a2 = P[piece, 3]
    a3 = P[piece, 4]
    a4 = P[piece, 5]
    a5 = P[piece, 6]
    u = (x - a0) / (a1 + a2 + a3 + a4 + a5)
    below = 0.0
    above = 1.0
    for _ in range(60):
        error = a0 + u * (a1 + u * (a2 + u * (a3 + u * (a4 + u * a5)))) - x
        if abs(error) <= 1e-15:
            break
        if error > 0.0:
            above = u
        else:
            below = u
        slope = a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * (4.0 * a4 + u * 5.0 * a5)))
        step = error / slope if slope > 0.0 else 2.0
        if below < u - step < above:
            u -= step
            if abs(step) < 1e-9:  # Newton doubles the digits: the next step would be 1e-16
                break
        else:
            u = 0.5 * (below + above)
    return u


@inner(counted=False, forceinline=True)
def shape_jet(form, z):
    """Value, slope and curvature of an elementary function at z."""
    if form == EXPONENTIAL:
        y = np.exp(z)
        return y, y, y
    if form == BELL:
        y = np.exp(-z * z)
        return y, -2.0 * z * y, (4.0 * z * z - 2.0) * y
    if form == LOGARITHM:
        return np.log(z), 1.0 / z, -1.0 / (z * z)
    if form == ASINH:
        root = np.sqrt(z * z + 1.0)
        return np.arcsinh(z), 1.0 / root, -z / (root * root * root)
    if form == LOGISTIC:
        y = 1.0 / (1.0 + np.exp(z))
        return y, -y * (1.0 - y), y * (1.0 - y) * (1.0 - 2.0 * y)
    return z, 1.0, 0.0


@inner(counted=False, forceinline=True)
def _shape_value(form, z):
    """Value of an elementary function at z."""
    if form == EXPONENTIAL:
        return np.exp(z)
    if form == BELL:
        return np.exp(-z * z)
    if form == LOGARITHM:
        return np.log(z)
    if form == ASINH:
        return np.arcsinh(z)
    if form == LOGISTIC:
        return 1.0 / (1.0 + np.exp(z))
    return z


@inner(counted=False)
def curve_value(C, i, x):
    """Value of curve i at x; NaN stays NaN."""
    E = C.ends
    if not x >= E[i, 0]:
        y = E[i, 1] + E[i, 2] * (x - E[i, 0])
    elif x >= E[i, 3]:
        y = E[i, 4] + E[i, 5] * (x - E[i, 3])
    else:
        P = C.pieces
        S = C.shapes
        low = C.of_curve[i, 0]
        piece = C.of_curve[i, 1]
        while piece > low and x < P[piece, 0]:
            piece -= 1
        y = P[piece, 7]
        if C.of_piece[piece, 0]:
            u = parameter_at(P, piece, x)
            y += u * (
                P[piece, 8]
                + u * (P[piece, 9] + u * (P[piece, 10] + u * (P[piece, 11] + u * P[piece, 12])))
            )
        for s in range(C.of_piece[piece, 1], C.of_piece[piece, 2]):
            y += S[s, 1] * _shape_value(S[s, 0], (S[s, 2] + S[s, 3] * x) / (S[s, 4] + S[s, 5] * x))
    if y < E[i, 6]:
        return E[i, 6]
    return E[i, 7] if y > E[i, 7] else y


@inner(counted=False)
def curve_jet(C, i, x):
    """Value, slope and curvature of curve i at x."""
    E = C.ends
    if not x >= E[i, 0]:
        y0 = E[i, 1] + E[i, 2] * (x - E[i, 0])
        y1 = E[i, 2]
        y2 = 0.0
    elif x >= E[i, 3]:
        y0 = E[i, 4] + E[i, 5] * (x - E[i, 3])
        y1 = E[i, 5]
        y2 = 0.0
    else:
        P = C.pieces
        S = C.shapes
        low = C.of_curve[i, 0]
        piece = C.of_curve[i, 1]
        while piece > low and x < P[piece, 0]:
            piece -= 1
        y0 = P[piece, 7]
        y1 = 0.0
        y2 = 0.0
        if C.of_piece[piece, 0]:
            u = parameter_at(P, piece, x)
            a1 = P[piece, 2]
            a2 = P[piece, 3]
            a3 = P[piece, 4]
            a4 = P[piece, 5]
            a5 = P[piece, 6]
            b1 = P[piece, 8]
            b2 = P[piece, 9]
            b3 = P[piece, 10]
            b4 = P[piece, 11]
            b5 = P[piece, 12]
            x1 = max(a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * (4.0 * a4 + u * 5.0 * a5))), 1e-9)
            x2 = 2.0 * a2 + u * (6.0 * a3 + u * (12.0 * a4 + u * 20.0 * a5))
            y0 += u * (b1 + u * (b2 + u * (b3 + u * (b4 + u * b5))))
            y1 = (b1 + u * (2.0 * b2 + u * (3.0 * b3 + u * (4.0 * b4 + u * 5.0 * b5)))) / x1
            y2 = (2.0 * b2 + u * (6.0 * b3 + u * (12.0 * b4 + u * 20.0 * b5)) - y1 * x2) / (x1 * x1)
        for s in range(C.of_piece[piece, 1], C.of_piece[piece, 2]):
            size = S[s, 1]
            b = S[s, 3]
            d = S[s, 5]
            scale = 1.0 / (S[s, 4] + d * x)
            f0, f1, f2 = shape_jet(S[s, 0], (S[s, 2] + b * x) * scale)
            z1 = (b * S[s, 4] - S[s, 2] * d) * scale * scale
            y0 += size * f0
            y1 += size * f1 * z1
            y2 += size * (f2 * z1 - 2.0 * f1 * d * scale) * z1
    if y0 <= E[i, 6]:
        return E[i, 6], 0.0, 0.0
    if y0 >= E[i, 7]:
        return E[i, 7], 0.0, 0.0
    return y0, y1, y2


@kernel(counted=False)
def _values(C, x, y):
    for index in range(x.shape[0]):
        y[index] = curve_value(C, 0, x[index])


@kernel(counted=False)
def _jets(C, x, jets):
    for index in range(x.shape[0]):
        jets[index, 0], jets[index, 1], jets[index, 2] = curve_jet(C, 0, x[index])


@lru_cache(maxsize=64)
def spline_curve(x: tuple[float, ...], y: tuple[float, ...]) -> Curve:
    """OpenSim's `SimmSpline` through the points as a curve."""
    spline = simm_spline(x, y)
    # The first and last pieces of a SimmSpline are the straight lines outside.
    breaks = [float(at) for at in spline.breaks[1:]]
    coefficients = spline.coefficients
    pieces = []
    for start, stop, row in zip(breaks[:-1], breaks[1:], coefficients[1:-1], strict=True):
        scaled = row * (stop - start) ** np.arange(len(row))
        pieces.append(Piece(start, tuple(scaled.tolist()), (start, stop - start)))
    return Curve(tuple(pieces), breaks[-1], (float(coefficients[0, 1]), float(coefficients[-1, 1])))
