"""Curves of muscles and tendons: tables of pieces that one kernel evaluates for all classes.

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
MAX_SLOPE = 1e9  # Of the line that continues an inverse where the curve itself is flat
COLUMNS = 13  # Of `CurveArrays.pieces`


class Shape(NamedTuple):
    """An elementary function in a piece: size f(z) with z = (a + b x) / (c + d x).

    Attributes
    ----------
    form : of f, `RATIO` ... `LOGISTIC`
    size : its factor
    a, b, c, d : of the ratio z
    """

    form: int
    size: float
    a: float = 0.0
    b: float = 1.0
    c: float = 1.0
    d: float = 0.0


class Piece(NamedTuple):
    """A curve from its start to where the next piece starts.

    Attributes
    ----------
    start : x where it begins, or minus infinity
    y, x : power coefficients in u of the polynomial part and of x, at most six; without x, u is
        x - start
    shapes : added to the polynomial
    """

    start: float
    y: tuple[float, ...] = ()
    x: tuple[float, ...] = ()
    shapes: tuple[Shape, ...] = ()

    @property
    def line(self) -> tuple[float, ...]:
        """Power coefficients of x in u."""
        return self.x or (self.start if np.isfinite(self.start) else 0.0, 1.0)


class CurveEnds(NamedTuple):
    """First and last values of a curve, and slopes of the lines beyond.

    Attributes
    ----------
    first, last : values at the start and the end, 0 where the curve has none
    left, right : slopes beyond
    """

    first: float
    last: float
    left: float
    right: float


@dataclass(frozen=True, eq=False)
class Curve:
    """A function made of pieces, continued by straight lines and held within bounds.

    Attributes
    ----------
    pieces : in the order of x
    end : x where the last one ends, or infinity
    slopes : (left, right) of the lines that continue it; None for the tangent
    bounds : least and greatest value, beyond which the slope is 0
    """

    pieces: tuple[Piece, ...]
    end: float = np.inf
    slopes: tuple[float | None, float | None] = (0.0, 0.0)
    bounds: tuple[float, float] = (-np.inf, np.inf)

    def __call__(self, x: ArrayLike) -> Array:
        """Evaluate the curve.

        Parameters
        ----------
        x : of any shape

        Returns
        -------
        values of the same shape; NaN stays NaN
        """
        x = np.asarray(x, dtype=np.float64)
        values = np.empty(x.size)
        _values(self.arrays, x.ravel(), values)
        return values.reshape(x.shape)

    def jets(self, x: ArrayLike) -> Array:
        """Values, slopes and curvatures.

        Parameters
        ----------
        x : of any shape (...)

        Returns
        -------
        (..., 3)
        """
        x = np.asarray(x, dtype=np.float64)
        jets = np.empty((x.size, 3))
        _jets(self.arrays, x.ravel(), jets)
        return jets.reshape(*x.shape, 3)

    @cached_property
    def arrays(self) -> CurveArrays:
        """Arrays of this curve alone, as the kernels read them."""
        return pack_curves([self])

    def within(self, low: float = -np.inf, high: float = np.inf) -> Curve:
        """Hold the curve within bounds."""
        return Curve(pieces=self.pieces, end=self.end, slopes=self.slopes, bounds=(low, high))

    def inverse(self) -> Curve:
        """Invert a rising curve that is made of polynomials: x over y."""
        if any(piece.shapes for piece in self.pieces):
            raise ValueError("only polynomials are inverted")
        ends = self.ends
        left = 1.0 / max(ends.left, 1.0 / MAX_SLOPE)
        right = 1.0 / max(ends.right, 1.0 / MAX_SLOPE)
        return Curve(
            pieces=tuple(Piece(piece.y[0], piece.line, piece.y) for piece in self.pieces),
            end=sum(self.pieces[-1].y),
            slopes=(left, right),
        )

    def rounded(self, at: float, half: float) -> Curve:
        """Round a corner: a cubic with the curve's values and slopes at both its ends.

        With u from 0 to 1 over the width w, values y0 and y1 and slopes s0 and s1,

            y = y0 + s0 w u + (3 (y1 - y0) - (2 s0 + s1) w) u^2 + ((s0 + s1) w - 2 (y1 - y0)) u^3

        Parameters
        ----------
        at : x of the corner
        half : half of the width w
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
        continued = self.pieces[last]._replace(start=high, x=self.pieces[last].line)
        after = (continued, *self.pieces[last + 1 :])
        return Curve(
            pieces=(*before, Piece(low, cubic, (low, width)), *after),
            end=self.end,
            slopes=self.slopes,
            bounds=self.bounds,
        )

    @property
    def ends(self) -> CurveEnds:
        """First and last values and the slopes beyond."""
        first = self.pieces[0]
        first_value, first_slope = _jet_of(first, first.start)
        last_value, last_slope = _jet_of(self.pieces[-1], self.end)
        left, right = self.slopes
        return CurveEnds(
            first=first_value,
            last=last_value,
            left=first_slope if left is None else left,
            right=last_slope if right is None else right,
        )


def _row_of(piece: Piece) -> Array:
    """(13,) row of `CurveArrays.pieces`."""
    row = np.zeros(COLUMNS)
    row[0] = piece.start
    row[1 : 1 + len(piece.line)] = piece.line
    row[7 : 7 + len(piece.y)] = piece.y
    return row


def _jet_of(piece: Piece, x: float) -> tuple[float, float]:
    """Value and slope of a piece at x; 0 at infinity.

    Of the polynomial part dy/dx = (dy/du) / (dx/du); of a shape

        size f'(z) dz/dx,   dz/dx = (b c - a d) / (c + d x)^2
    """
    if not np.isfinite(x):
        return 0.0, 0.0
    row = _row_of(piece)
    u = parameter_at.py_func(row[None], 0, x)
    powers = u ** np.arange(6.0)
    coefficients = row[1:].reshape(2, 6)
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
    """Curves one after another, as the kernels read them.

    In few arrays, as a call counts the users of each.

    Attributes
    ----------
    ends : (curves, 8) x, y and slope of the line on the left, the same on the right, least and
        greatest value
    pieces : (pieces, 13) x where a piece begins, six power coefficients of x, six of y
    shapes : (shapes, 6) form, size, a, b, c, d
    of_curve : (curves, 2) index of a curve's first and last piece
    of_piece : (pieces, 3) whether the polynomial is more than a number; index of the first shape,
        and after the last
    """

    ends: Array
    pieces: Array
    shapes: Array
    of_curve: NDArray[np.int64]
    of_piece: NDArray[np.int64]


def pack_curves(curves: Sequence[Curve]) -> CurveArrays:
    """Pack curves into flat arrays, in their order.

    Parameters
    ----------
    curves : of any number of pieces
    """
    pieces = [piece for curve in curves for piece in curve.pieces]
    shapes = [shape for piece in pieces for shape in piece.shapes]
    ends = np.zeros((len(curves), 8))
    for row, curve in zip(ends, curves, strict=True):
        values = curve.ends
        row[:3] = curve.pieces[0].start, values.first, values.left
        row[3:6] = curve.end, values.last, values.right
        row[6:] = curve.bounds
    first_piece = np.cumsum([0, *(len(curve.pieces) for curve in curves)])
    first_shape = np.cumsum([0, *(len(piece.shapes) for piece in pieces)])
    is_bent = np.array([len(piece.y) > 1 for piece in pieces], np.int64)
    of_curve = np.stack([first_piece[:-1], first_piece[1:] - 1], axis=1)
    of_piece = np.stack([is_bent, first_shape[:-1], first_shape[1:]], axis=1)
    return CurveArrays(
        ends=ends,
        pieces=np.array([_row_of(piece) for piece in pieces]).reshape(len(pieces), COLUMNS),
        shapes=np.array(shapes, dtype=np.float64).reshape(len(shapes), 6),
        of_curve=of_curve.astype(np.int64),
        of_piece=of_piece.astype(np.int64),
    )


@inner(counted=False, forceinline=True)
def parameter_at(pieces, piece, x):
    """Find the parameter u of a piece at which its quintic x(u) is x.

    By Newton steps within a bracket, which is halved where a step would leave it.

    Parameters
    ----------
    pieces : (pieces, 13) see `CurveArrays`
    piece : its row
    x : within the piece
    """
    a0 = pieces[piece, 1]
    a1 = pieces[piece, 2]
    a2 = pieces[piece, 3]
    a3 = pieces[piece, 4]
    a4 = pieces[piece, 5]
    a5 = pieces[piece, 6]
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
    """Value of curve i of `CurveArrays` C at x; NaN stays NaN."""
    E = C.ends
    if not x >= E[i, 0]:
        y = E[i, 1] + E[i, 2] * (x - E[i, 0])
    elif x >= E[i, 3]:
        y = E[i, 4] + E[i, 5] * (x - E[i, 3])
    else:
        pieces = C.pieces
        shapes = C.shapes
        low = C.of_curve[i, 0]
        piece = C.of_curve[i, 1]
        while piece > low and x < pieces[piece, 0]:
            piece -= 1
        y = pieces[piece, 7]
        if C.of_piece[piece, 0]:
            u = parameter_at(pieces, piece, x)
            y += u * (
                pieces[piece, 8]
                + u
                * (
                    pieces[piece, 9]
                    + u * (pieces[piece, 10] + u * (pieces[piece, 11] + u * pieces[piece, 12]))
                )
            )
        for s in range(C.of_piece[piece, 1], C.of_piece[piece, 2]):
            y += shapes[s, 1] * _shape_value(
                shapes[s, 0], (shapes[s, 2] + shapes[s, 3] * x) / (shapes[s, 4] + shapes[s, 5] * x)
            )
    if y < E[i, 6]:
        return E[i, 6]
    return E[i, 7] if y > E[i, 7] else y


@inner(counted=False)
def curve_jet(C, i, x):
    """Value, slope and curvature of curve i of `CurveArrays` C at x.

    Of the polynomial part, with primes for derivatives in u,

        dy/dx = y' / x',   d^2y/dx^2 = (y'' - dy/dx x'') / x'^2
    """
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
        pieces = C.pieces
        low = C.of_curve[i, 0]
        piece = C.of_curve[i, 1]
        while piece > low and x < pieces[piece, 0]:
            piece -= 1
        y0 = pieces[piece, 7]
        y1 = 0.0
        y2 = 0.0
        if C.of_piece[piece, 0]:
            rise, y1, y2 = _polynomial_jet(pieces, piece, parameter_at(pieces, piece, x))
            y0 += rise
        y0, y1, y2 = _with_shapes(C, piece, x, (y0, y1, y2))
    if y0 <= E[i, 6]:
        return E[i, 6], 0.0, 0.0
    if y0 >= E[i, 7]:
        return E[i, 7], 0.0, 0.0
    return y0, y1, y2


@inner(counted=False, forceinline=True)
def _with_shapes(C, piece, x, jet):
    """Add the shapes of a piece to the jet of its polynomial at x.

    Of a shape size f(z), with z = (a + b x) / (c + d x) and
    dz/dx = z_1 = (b c - a d) / (c + d x)^2,

        size f,   size f' z_1,   size (f'' z_1 - 2 f' d / (c + d x)) z_1
    """
    shapes = C.shapes
    y0, y1, y2 = jet
    for s in range(C.of_piece[piece, 1], C.of_piece[piece, 2]):
        size = shapes[s, 1]
        b = shapes[s, 3]
        d = shapes[s, 5]
        scale = 1.0 / (shapes[s, 4] + d * x)
        f0, f1, f2 = shape_jet(shapes[s, 0], (shapes[s, 2] + b * x) * scale)
        z1 = (b * shapes[s, 4] - shapes[s, 2] * d) * scale * scale
        y0 += size * f0
        y1 += size * f1 * z1
        y2 += size * (f2 * z1 - 2.0 * f1 * d * scale) * z1
    return y0, y1, y2


@inner(counted=False, forceinline=True)
def _polynomial_jet(pieces, piece, u):
    """Value less that at u = 0, slope and curvature over x of a piece's polynomial at u."""
    a1 = pieces[piece, 2]
    a2 = pieces[piece, 3]
    a3 = pieces[piece, 4]
    a4 = pieces[piece, 5]
    a5 = pieces[piece, 6]
    b1 = pieces[piece, 8]
    b2 = pieces[piece, 9]
    b3 = pieces[piece, 10]
    b4 = pieces[piece, 11]
    b5 = pieces[piece, 12]
    x1 = max(a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * (4.0 * a4 + u * 5.0 * a5))), 1e-9)
    x2 = 2.0 * a2 + u * (6.0 * a3 + u * (12.0 * a4 + u * 20.0 * a5))
    y0 = u * (b1 + u * (b2 + u * (b3 + u * (b4 + u * b5))))
    y1 = (b1 + u * (2.0 * b2 + u * (3.0 * b3 + u * (4.0 * b4 + u * 5.0 * b5)))) / x1
    y2 = (2.0 * b2 + u * (6.0 * b3 + u * (12.0 * b4 + u * 20.0 * b5)) - y1 * x2) / (x1 * x1)
    return y0, y1, y2


@kernel(counted=False)
def _values(C, x, y):
    """Fill y (n,) with the first curve's values at x (n,)."""
    for i in range(x.shape[0]):
        y[i] = curve_value(C, 0, x[i])


@kernel(counted=False)
def _jets(C, x, jets):
    """Fill jets (n, 3) with the first curve's values, slopes and curvatures at x (n,)."""
    for i in range(x.shape[0]):
        jets[i, 0], jets[i, 1], jets[i, 2] = curve_jet(C, 0, x[i])


@lru_cache(maxsize=64)
def spline_curve(x: tuple[float, ...], y: tuple[float, ...]) -> Curve:
    """Make a curve of OpenSim's `SimmSpline` through points.

    Parameters
    ----------
    x, y : of the points
    """
    spline = simm_spline(x, y)
    # The first and last pieces of a SimmSpline are the straight lines outside.
    breaks = [float(at) for at in spline.breaks[1:]]
    coefficients = spline.coefficients
    pieces = []
    for start, stop, row in zip(breaks[:-1], breaks[1:], coefficients[1:-1], strict=True):
        scaled = row * (stop - start) ** np.arange(len(row))
        pieces.append(Piece(start, tuple(scaled.tolist()), (start, stop - start)))
    left = float(coefficients[0, 1])
    right = float(coefficients[-1, 1])
    return Curve(tuple(pieces), breaks[-1], (left, right))
