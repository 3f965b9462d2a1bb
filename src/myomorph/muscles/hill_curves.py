"""Curves of Hill-type muscles: quintic Bezier pieces y(u), x(u), evaluated exactly at x.

Millard's curves are chains of quintic Bezier "corners" (Millard, Uchida, Seth and Delp 2013);
cubic splines are the same thing with x linear in u. Nothing is sampled: u(x) is found by a
guarded Newton iteration on a monotone quintic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadModel
from myomorph.model.functions import simm_spline
from myomorph.rigid.kernels import inner, kernel

# Power basis of the quintic Bernstein polynomials: coefficients = POWER @ control points.
_POWER = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.0, 5.0, 0.0, 0.0, 0.0, 0.0],
        [10.0, -20.0, 10.0, 0.0, 0.0, 0.0],
        [-10.0, 30.0, -30.0, 10.0, 0.0, 0.0],
        [5.0, -20.0, 30.0, -20.0, 5.0, 0.0],
        [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0],
    ]
)


@read_only
@dataclass(frozen=True, eq=False)
class Curve:
    """A smooth function made of quintic pieces and continued by straight lines.

    Attributes
    ----------
    pieces : (pieces, 2, 6) power coefficients in u, 0 <= u <= 1, of x and of y
    slopes : (left, right) slopes of the lines that continue it
    """

    pieces: Array
    slopes: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pieces", frozen_array(self.pieces, (-1, 2, 6)))

    def __call__(self, x: ArrayLike) -> Array:
        """Values at x, any shape."""
        x = np.asarray(x, dtype=np.float64)
        values = np.empty(x.size)
        _values(pack_curves([self]), x.ravel(), values)
        return values.reshape(x.shape)


class CurveArrays(NamedTuple):
    """Curves one after another, as the kernels read them.

    Attributes
    ----------
    first : (curves + 1,) index of each curve's first piece
    left, right : (curves,) slopes outside
    start : (pieces,) x where a piece begins
    end_x, end_y : (curves,) the last point of each curve
    pieces : (pieces, 2, 6)
    """

    first: NDArray[np.int64]
    left: Array
    right: Array
    start: Array
    end_x: Array
    end_y: Array
    pieces: Array


def pack_curves(curves: Sequence[Curve]) -> CurveArrays:
    """The curves as flat arrays, in the order given."""
    counts = [len(curve.pieces) for curve in curves]
    pieces = np.concatenate([curve.pieces for curve in curves] or [np.zeros((0, 2, 6))])
    ends = [curve.pieces[-1].sum(axis=1) for curve in curves]
    return CurveArrays(
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        left=np.array([curve.slopes[0] for curve in curves], dtype=np.float64),
        right=np.array([curve.slopes[1] for curve in curves], dtype=np.float64),
        start=np.ascontiguousarray(pieces[:, 0, 0]),
        end_x=np.array([end[0] for end in ends], dtype=np.float64),
        end_y=np.array([end[1] for end in ends], dtype=np.float64),
        pieces=np.ascontiguousarray(pieces),
    )


@inner(forceinline=True)
def parameter_at(P, k, x):
    """Parameter of the quintic of piece k at which it is at x: Newton steps inside brackets."""
    a0, a1, a2, a3, a4, a5 = P[k, 0, 0], P[k, 0, 1], P[k, 0, 2], P[k, 0, 3], P[k, 0, 4], P[k, 0, 5]
    u = (x - a0) / (a1 + a2 + a3 + a4 + a5)
    below, above = 0.0, 1.0
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


@inner
def curve_value(C, i, x):
    """Value of curve i at x; NaN stays NaN."""
    low, high = C.first[i], C.first[i + 1] - 1
    if not x >= C.start[low]:
        return C.pieces[low, 1, 0] + C.left[i] * (x - C.start[low])
    if x >= C.end_x[i]:
        return C.end_y[i] + C.right[i] * (x - C.end_x[i])
    while high > low and x < C.start[high]:
        high -= 1
    P = C.pieces
    u = parameter_at(P, high, x)
    return P[high, 1, 0] + u * (
        P[high, 1, 1] + u * (P[high, 1, 2] + u * (P[high, 1, 3] + u * (P[high, 1, 4] + u * P[high, 1, 5])))
    )


@kernel
def _values(C, x, y):
    for index in range(x.shape[0]):
        y[index] = curve_value(C, 0, x[index])


def bezier_corner(start: tuple[float, float, float], end: tuple[float, float, float], curviness: float) -> Array:
    """A C-shaped quintic from one point and slope to another, (2, 6) power coefficients.

    The two middle pairs of control points lie on the tangents, the fraction `curviness` of the
    way to where these meet.

    Parameters
    ----------
    start, end : (x, y, dy/dx)
    curviness : 0 straight ... 1 sharp; Millard's parameter after scaling to 0.1 ... 0.9

    Raises
    ------
    BadModel
        where the tangents do not meet between the points, so that the curve would be S-shaped
    """
    (x0, y0, s0), (x1, y1, s1) = start, end
    if abs(s0 - s1) > np.sqrt(np.finfo(float).eps):
        x = (y1 - y0 - x1 * s1 + x0 * s0) / (s0 - s1)
    else:
        x = 0.5 * (x0 + x1)
    y = (x - x1) * s1 + y1
    reach = (x1 - x0) ** 2 + (y1 - y0) ** 2
    if not max((x - x0) ** 2 + (y - y0) ** 2, (x - x1) ** 2 + (y - y1) ** 2) < reach:
        raise BadModel(
            f"a muscle curve from ({x0:g}, {y0:g}) of slope {s0:g} to ({x1:g}, {y1:g}) of slope {s1:g} "
            "has no C-shaped corner: check the parameters of the curve"
        )
    ax, ay = x0 + curviness * (x - x0), y0 + curviness * (y - y0)
    bx, by = x1 + curviness * (x - x1), y1 + curviness * (y - y1)
    return np.stack([_POWER @ [x0, ax, ax, bx, bx, x1], _POWER @ [y0, ay, ay, by, by, y1]])


def _chain(points: Sequence[tuple[float, float, float]], curviness: Sequence[float]) -> Curve:
    """Corners through (x, y, slope) points, the curviness of each in Millard's 0 ... 1."""
    corners = [bezier_corner(a, b, 0.1 + 0.8 * c) for a, b, c in zip(points[:-1], points[1:], curviness, strict=True)]
    return Curve(np.stack(corners), (points[0][2], points[-1][2]))


def active_force_length(
    minimum: float = 0.4441,
    transition: float = 0.73,
    maximum: float = 1.8123,
    shallow_slope: float = 0.8616,
    minimum_value: float = 0.1,
) -> Curve:
    """Millard's active force-length curve over the normalized fiber length, 1 at 1.

    Parameters
    ----------
    minimum, transition, maximum : normalized lengths where it begins, turns to the shallow
        ascending limb, and ends
    shallow_slope : of the shallow ascending limb
    minimum_value : its value outside (0 for a rigid tendon; OpenSim's default is 0.1)
    """
    half_plateau = 0.05
    shoulder = 1.0 - half_plateau
    y_transition = 1.0 - shallow_slope * (shoulder - transition)
    ascending = (
        0.5 * (minimum + transition),
        0.5 * y_transition,
        1.25 * y_transition / (transition - minimum),
    )
    shallow = (0.5 * (transition + shoulder), 0.5 * (1.0 + y_transition), shallow_slope)
    descending = (
        0.5 * (1.0 + half_plateau + maximum),
        0.5,
        -1.0 / ((maximum - half_plateau) - (1.0 + half_plateau)),
    )
    points = [
        (minimum, minimum_value, 0.0),
        ascending,
        shallow,
        (1.0, 1.0, 0.0),
        descending,
        (maximum, minimum_value, 0.0),
    ]
    return _chain(points, [1.0] * 5)


def force_velocity(
    concentric_slope_at_vmax: float = 0.0,
    concentric_slope_near_vmax: float = 0.25,
    isometric_slope: float = 5.0,
    eccentric_slope_at_vmax: float = 0.0,
    eccentric_slope_near_vmax: float = 0.15,
    maximum: float = 1.4,
    concentric_curviness: float = 0.6,
    eccentric_curviness: float = 0.9,
) -> Curve:
    """Millard's force-velocity curve over the normalized fiber velocity: 0 at -1, 1 at 0, `maximum` at 1."""
    near = 0.1
    concentric = 0.5 * near * (concentric_slope_near_vmax + concentric_slope_at_vmax)
    eccentric = maximum - 0.5 * near * (eccentric_slope_near_vmax + eccentric_slope_at_vmax)
    points = [
        (-1.0, 0.0, concentric_slope_at_vmax),
        (-1.0 + near, concentric, concentric_slope_near_vmax),
        (0.0, 1.0, isometric_slope),
        (1.0 - near, eccentric, eccentric_slope_near_vmax),
        (1.0, maximum, eccentric_slope_at_vmax),
    ]
    return _chain(points, [concentric_curviness] * 2 + [eccentric_curviness] * 2)


def passive_force_length(
    strain_at_zero: float = 0.0,
    strain_at_one: float = 0.7,
    low_stiffness: float = 0.2,
    stiffness_at_one: float | None = None,
    curviness: float = 0.75,
) -> Curve:
    """Millard's passive force-length curve over the normalized fiber length, 1 at 1 + `strain_at_one`.

    Parameters
    ----------
    stiffness_at_one : slope there; None for 2 / (strain_at_one - strain_at_zero)
    """
    span = strain_at_one - strain_at_zero
    stiff = 2.0 / span if stiffness_at_one is None else stiffness_at_one
    toe = 0.1 * min(1.0 / stiff, span)
    zero = 1.0 + strain_at_zero
    points = [
        (zero, 0.0, 0.0),
        (zero + toe, 0.5 * toe * low_stiffness, low_stiffness),
        (1.0 + strain_at_one, 1.0, stiff),
    ]
    return _chain(points, [curviness] * 2)


def tendon_force_length(
    strain_at_one: float = 0.049, stiffness: float | None = None, toe_force: float = 2.0 / 3.0, curviness: float = 0.5
) -> Curve:
    """Millard's tendon force over the tendon length by its slack length, 1 at 1 + `strain_at_one`.

    Parameters
    ----------
    stiffness : slope of the straight part; None for 1.375 / strain_at_one
    toe_force : where the straight part begins
    """
    slope = 1.375 / strain_at_one if stiffness is None else stiffness
    end = 1.0 + strain_at_one
    toe = (toe_force - 1.0) / slope + end
    foot = 1.0 + (toe - 1.0) / 10.0
    half = (0.5 * toe_force - 1.0) / slope + end
    middle = 0.5 * toe_force / (half - foot)
    corner = foot + 0.5 * (half - foot)
    points = [(1.0, 0.0, 0.0), (corner, middle * (corner - foot), middle), (toe, toe_force, slope)]
    return _chain(points, [curviness] * 2)


def spline_curve(x: ArrayLike, y: ArrayLike) -> Curve:
    """OpenSim's `SimmSpline` through the points as a curve."""
    spline = simm_spline(x, y)
    # The first and last pieces of a SimmSpline are the straight lines outside.
    breaks, coefficients = spline.breaks[1:], spline.coefficients
    pieces = np.zeros((len(breaks) - 1, 2, 6))
    for piece, start, width, row in zip(pieces, breaks[:-1], np.diff(breaks), coefficients[1:-1], strict=True):
        piece[0, :2] = start, width
        piece[1, : len(row)] = row * width ** np.arange(len(row))
    return Curve(pieces, (float(coefficients[0, 1]), float(coefficients[-1, 1])))
