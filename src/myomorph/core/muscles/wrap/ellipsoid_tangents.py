"""The point of an ellipsoid, in a plane, where a line from outside touches it, as OpenSim finds it.

Unknown are the point r and h, the offset of its tangent plane. With half axes a_i, w_i = 2 / a_i^2
and the plane n . x + d = 0, four residuals are 0:

    n . r + d                       in the plane
    1/2 sum w_i r_i^2 - 1           on the surface
    sum w_i r_i^2 + h               h is the offset of the tangent plane at r
    sum w_i r_i p_i + h             the point outside, p, lies in the tangent plane

The search is OpenSim's damped Gauss-Newton method, whose tolerances show in the result.
"""

from __future__ import annotations

from typing import NamedTuple

from myomorph.core.muscles.wrap.surface import Vector
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import along, dot, minus, unit

# OpenSim's: sum of squares at which the search ends, and its limits
SMALL_RESIDUAL = 1e-8
MAX_NEWTON_STEPS = 50
MAX_TRIES = 1000


class Plane(NamedTuple):
    """Plane n . x + d = 0 of a path around an ellipsoid.

    Attributes
    ----------
    n : unit normal
    d : offset
    """

    n: Vector
    d: float


class _Tangency(NamedTuple):
    """What a tangent point has to fulfil.

    Attributes
    ----------
    p : point outside
    w : weights 2 / a_i^2 of the surface
    plane : of the path
    """

    p: Vector
    w: Vector
    plane: Plane


class _Component(NamedTuple):
    """One component of the plane's normal, the weights, the tangent point and the point outside."""

    n: float
    w: float
    r: float
    p: float


class _Unknowns(NamedTuple):
    """Tangent point r, and offset h of its tangent plane."""

    r: Vector
    h: float


class _Matrix(NamedTuple):
    """Lower triangle of a symmetric matrix (4, 4), row by row."""

    a00: float
    a10: float
    a11: float
    a20: float
    a21: float
    a22: float
    a30: float
    a31: float
    a32: float
    a33: float


class _Lower(NamedTuple):
    """Entries of a matrix (4, 4) below its diagonal."""

    a10: float
    a20: float
    a21: float
    a30: float
    a31: float
    a32: float


class _Factors(NamedTuple):
    """Factors of a symmetric matrix: L D L^T.

    Attributes
    ----------
    lower : L below its diagonal of ones
    inverse : 1 / D
    """

    lower: _Lower
    inverse: tuple[float, float, float, float]


@bare
def tangent_point(p, start, a, plane):
    """Find the point of the ellipsoid, in a plane, where a line from p touches it.

    Parameters
    ----------
    p : point outside
    start : of the search
    a : half axes, about 1
    plane : `Plane` of the path

    Returns
    -------
    the point
    """
    w = (2.0 / (a[0] * a[0]), 2.0 / (a[1] * a[1]), 2.0 / (a[2] * a[2]))
    tangency = _Tangency(p=p, w=w, plane=plane)
    at = _Unknowns(r=start, h=-_weighted(w, start, start))
    misfit = _misfit(tangency, at)
    damping = 0.01
    steps = 0
    while misfit > SMALL_RESIDUAL and steps < MAX_NEWTON_STEPS:
        steps += 1
        A, b = _normal_equations(tangency, at)
        gain = _gain(p, at.r)
        u = (0.0, 0.0, 0.0, 0.0)
        # Damped more and more until the misfit falls, each try from where the last has led.
        before = misfit
        tries = 0
        while misfit >= before and tries < MAX_TRIES:
            u = _solved(A, b, damping, gain)
            at = _moved(at, 1.0, u)
            before = misfit
            misfit = _misfit(tangency, at)
            damping *= 4.0
            tries += 1
        damping /= 8.0
        # Twice as far each time while it falls, and the last of these steps back.
        stretch = 0.5
        tries = 0
        while misfit <= before and tries < MAX_TRIES:
            stretch *= 2.0
            at = _moved(at, stretch, u)
            before = misfit
            misfit = _misfit(tangency, at)
            tries += 1
        at = _moved(at, -stretch, u)
        misfit = _misfit(tangency, at)
    return at.r


@in_place
def _gain(p, r):
    """Share of a step that is taken: less where the line from p to r points at the center."""
    cosine = dot(unit(minus(p, r)), unit(p))
    return (1.0 - cosine**100 if cosine > 0.1 else 1.0) / 16.0


@bare
def _moved(at, share, step):
    """Add a share of a step to the unknowns."""
    r = along(at.r, share, (step[0], step[1], step[2]))
    return _Unknowns(r=r, h=at.h + share * step[3])


@bare
def _weighted(w, p, q):
    """Sum of w_i p_i q_i."""
    return w[0] * p[0] * q[0] + w[1] * p[1] * q[1] + w[2] * p[2] * q[2]


@bare
def _residuals(tangency, at):
    """Residuals of the tangent point, in the order of the module's text."""
    plane = tangency.plane
    weighted = _weighted(tangency.w, at.r, at.r)
    in_plane = dot(plane.n, at.r) + plane.d
    tangent = _weighted(tangency.w, at.r, tangency.p) + at.h
    return in_plane, 0.5 * weighted - 1.0, weighted + at.h, tangent


@bare
def _misfit(tangency, at):
    """Sum of the squared residuals."""
    e = _residuals(tangency, at)
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]


@in_place
def _normal_equations(tangency, at):
    """Compute J^T J and -J^T e of the residuals e.

    A_ij = n_i n_j + w_i w_j (5 r_i r_j + p_i p_j),   A_3i = w_i (2 r_i + p_i),   A_33 = 2
    """
    p, w, plane = tangency
    n = plane.n
    r = at.r
    e = _residuals(tangency, at)
    x = _Component(n=n[0], w=w[0], r=r[0], p=p[0])
    y = _Component(n=n[1], w=w[1], r=r[1], p=p[1])
    z = _Component(n=n[2], w=w[2], r=r[2], p=p[2])
    A = _Matrix(
        a00=_curvature(x, x),
        a10=_curvature(y, x),
        a11=_curvature(y, y),
        a20=_curvature(z, x),
        a21=_curvature(z, y),
        a22=_curvature(z, z),
        a30=_offset_curvature(x),
        a31=_offset_curvature(y),
        a32=_offset_curvature(z),
        a33=2.0,
    )
    return A, (_descent(x, e), _descent(y, e), _descent(z, e), -(e[2] + e[3]))


@bare
def _curvature(x, y):
    """Entry of J^T J of two components of the point."""
    return x.n * y.n + x.w * y.w * (5.0 * x.r * y.r + x.p * y.p)


@bare
def _offset_curvature(x):
    """Entry of J^T J of a component of the point and the offset."""
    return x.w * (2.0 * x.r + x.p)


@bare
def _descent(x, e):
    """Entry of -J^T e of a component of the point."""
    return -(x.n * e[0] + x.w * (x.r * e[1] + 2.0 * x.r * e[2] + x.p * e[3]))


@in_place
def _solved(A, b, damping, gain):
    """Solve (A + damping diag(A)) u = gain b by the factors L D L^T."""
    factors = _factors(A, 1.0 + damping)
    lower = factors.lower
    y = _forward(lower, gain, b)
    u3 = y[3] * factors.inverse[3]
    u2 = y[2] * factors.inverse[2] - lower.a32 * u3
    u1 = y[1] * factors.inverse[1] - lower.a21 * u2 - lower.a31 * u3
    u0 = y[0] * factors.inverse[0] - lower.a10 * u1 - lower.a20 * u2 - lower.a30 * u3
    return u0, u1, u2, u3


@in_place
def _factors(A, scale):
    """Factor A, its diagonal times `scale`, into L D L^T.

    D_j = A_jj - sum_k L_jk E_jk,   L_ij = E_ij / D_j,   E_ij = A_ij - sum_k L_ik E_jk
    """
    inverse_0 = 1.0 / (A.a00 * scale)
    l10 = A.a10 * inverse_0
    l20 = A.a20 * inverse_0
    l30 = A.a30 * inverse_0
    inverse_1 = 1.0 / (A.a11 * scale - l10 * A.a10)
    e21 = A.a21 - l20 * A.a10
    e31 = A.a31 - l30 * A.a10
    l21 = e21 * inverse_1
    l31 = e31 * inverse_1
    inverse_2 = 1.0 / (A.a22 * scale - l20 * A.a20 - l21 * e21)
    e32 = A.a32 - l30 * A.a20 - l31 * e21
    l32 = e32 * inverse_2
    inverse_3 = 1.0 / (A.a33 * scale - l30 * A.a30 - l31 * e31 - l32 * e32)
    return _Factors(
        lower=_Lower(a10=l10, a20=l20, a21=l21, a30=l30, a31=l31, a32=l32),
        inverse=(inverse_0, inverse_1, inverse_2, inverse_3),
    )


@in_place
def _forward(lower, gain, b):
    """Solve L y = gain b."""
    y0 = gain * b[0]
    y1 = gain * b[1] - lower.a10 * y0
    y2 = gain * b[2] - lower.a20 * y0 - lower.a21 * y1
    y3 = gain * b[3] - lower.a30 * y0 - lower.a31 * y1 - lower.a32 * y2
    return y0, y1, y2, y3
