"""Wrapping around an ellipsoid as OpenSim defines it (`WrapEllipsoid`, 4.6), one segment at a time.

The path lies in a plane through both points and a third point c on the surface, found from the
nearest surface points of the chord inside the ellipsoid: in the coordinate plane that the segment
crosses most squarely ("axial"), of the chord's middle ("midpoint"), or of all the chord ("fan"),
blended with the first ("hybrid"). It is not the shortest path. All lengths are divided by the mean
half axis, for the sake of OpenSim's tolerances, which are kept because they are felt in the result.
So are the special cases near axes and planes of the search for the nearest point (Eberly, Graphics
Gems IV).
"""

from __future__ import annotations

import math

import numpy as np

from myomorph.core.muscles.wrap_cylinder import INSIDE, MANDATORY, NO_WRAP
from myomorph.core.rigid.kernels import inner
from myomorph.core.rigid.vectors import along, cross, dot, minus, norm, replaced, sign, unit

ROUNDING = 2e-13
SMALL = 1e-9
MAX_STEPS = 64


@inner
def nearest_in_plane(a, p, plane):
    """Find the nearest point to p on an ellipse, in a plane of coordinates.

    The ellipse has the half axes of the ellipsoid other than `plane`. The component `plane` stays
    p's own: OpenSim does not look for the section through p.
    """
    if plane == 0:
        y, z = _nearest_on_ellipse(a[1], a[2], p[1], p[2])
        return p[0], y, z
    if plane == 1:
        z, x = _nearest_on_ellipse(a[2], a[0], p[2], p[0])
        return x, p[1], z
    x, y = _nearest_on_ellipse(a[0], a[1], p[0], p[1])
    return x, y, p[2]


@inner
def nearest_on_ellipsoid(a, p):
    """Find the nearest point to p on an ellipsoid around the origin, by Newton's method.

    The nearest point is a_i^2 p_i / (t + a_i^2) for the t that puts it on the surface.

    Parameters
    ----------
    a : half axes, about 1
    p : point

    Returns
    -------
    whether the iteration ended, and the point
    """
    plane = -1
    narrowest = math.inf
    for i in range(3):
        others = a[0] + a[1] + a[2] - a[i]
        if abs(p[i]) <= ROUNDING and others < narrowest:
            plane = i
            narrowest = others
    if plane >= 0:
        return True, nearest_in_plane(a, p, plane)
    a2 = a[0] * a[0]
    b2 = a[1] * a[1]
    c2 = a[2] * a[2]
    u = a2 * p[0] * p[0]
    v = b2 * p[1] * p[1]
    w = c2 * p[2] * p[2]
    t = 0.0
    if u / (a2 * a2) + v / (b2 * b2) + w / (c2 * c2) >= 1.0:
        t = max(a[0], a[1], a[2]) * math.sqrt(dot(p, p))
    for _ in range(MAX_STEPS):
        P = t + a2
        Q = t + b2
        R = t + c2
        P2 = P * P
        Q2 = Q * Q
        R2 = R * R
        f = P2 * Q2 * R2 - u * Q2 * R2 - v * P2 * R2 - w * P2 * Q2
        if abs(f) < SMALL:
            return True, (a2 * p[0] / P, b2 * p[1] / Q, c2 * p[2] / R)
        slope = (
            P * Q * R * (Q * R + P * R + P * Q)
            - u * Q * R * (Q + R)
            - v * P * R * (P + R)
            - w * P * Q * (P + Q)
        )
        t -= f / (2.0 * slope)
    return False, p


@inner
def _nearest_on_ellipse(a, b, u, v):
    """Find the nearest point to (u, v) on the ellipse with half axes a, b."""
    a2 = a * a
    b2 = b * b
    on_y = abs(u) <= ROUNDING
    on_x = abs(v) <= ROUNDING
    if on_x and on_y:
        if a < b:
            return -a if u < 0.0 else a, v
        return u, -b if v < 0.0 else b
    if on_y:
        if a >= b or abs(v) >= b - a2 / b:
            return u, b if v >= 0.0 else -b
        y = b2 * v / (b2 - a2)
        return a * math.sqrt(abs(1.0 - y * y / b2)), y
    if on_x:
        if b >= a or abs(u) >= a - b2 / a:
            return a if u >= 0.0 else -a, v
        x = a2 * u / (a2 - b2)
        return x, b * math.sqrt(abs(1.0 - x * x / a2))
    t = 0.0
    if u * u / a2 + v * v / b2 >= 1.0:
        t = max(a, b) * math.hypot(u, v)
    P = t + a2
    Q = t + b2
    for _ in range(MAX_STEPS):
        P = t + a2
        Q = t + b2
        f = P * P * Q * Q - a2 * u * u * Q * Q - b2 * v * v * P * P
        if abs(f) < SMALL:
            break
        t -= f / (2.0 * (P * Q * (P + Q) - a2 * u * u * Q - b2 * v * v * P))
    return a2 * u / P, b2 * v / Q


SMALL_RESIDUAL = 1e-8
MAX_NEWTON_STEPS = 50
MAX_TRIES = 1000


@inner
def tangent_point(p, r, a, n, d):
    """Find the point of the ellipsoid, in a plane, where a line from p touches it.

    By OpenSim's damped Gauss-Newton method on `_residuals`, whose tolerances show in the result.

    Parameters
    ----------
    p : point outside
    r : start of the search
    a : half axes, about 1
    n, d : of the plane n . x + d = 0
    """
    w = (2.0 / (a[0] * a[0]), 2.0 / (a[1] * a[1]), 2.0 / (a[2] * a[2]))
    h = -_weighted(w, r, r)
    e = _residuals(p, r, h, w, n, d)
    before = _squares(e)
    now = before
    damping = 0.01
    A = np.empty((4, 4))
    b = np.empty(4)
    steps = 0
    while now > SMALL_RESIDUAL and steps < MAX_NEWTON_STEPS:
        steps += 1
        _normal_equations(p, r, w, n, e, A, b)
        cosine = dot(unit(minus(p, r)), unit(p))
        gain = (1.0 - cosine**100 if cosine > 0.1 else 1.0) / 16.0
        tries = 0
        u = (0.0, 0.0, 0.0, 0.0)
        while now >= before and tries < MAX_TRIES:
            u = _solved(A, b, damping, gain)
            r = (r[0] + u[0], r[1] + u[1], r[2] + u[2])
            h = h + u[3]
            before = now
            now = _squares(_residuals(p, r, h, w, n, d))
            damping *= 4.0
            tries += 1
        damping /= 8.0
        stretch = 0.5
        tries = 0
        while now <= before and tries < MAX_TRIES:
            stretch *= 2.0
            r = (r[0] + stretch * u[0], r[1] + stretch * u[1], r[2] + stretch * u[2])
            h = h + stretch * u[3]
            before = now
            now = _squares(_residuals(p, r, h, w, n, d))
            tries += 1
        r = (r[0] - stretch * u[0], r[1] - stretch * u[1], r[2] - stretch * u[2])
        h = h - stretch * u[3]
        e = _residuals(p, r, h, w, n, d)
        now = _squares(e)
        before = now
    return r


@inner
def _weighted(w, p, q):
    """Sum of w_i p_i q_i."""
    return w[0] * p[0] * q[0] + w[1] * p[1] * q[1] + w[2] * p[2] * q[2]


@inner
def _residuals(p, r, h, w, n, d):
    """Residuals of the tangent point.

    In the plane, on the surface, h the offset of the tangent plane, p in the tangent plane.
    """
    weighted = _weighted(w, r, r)
    return dot(n, r) + d, 0.5 * weighted - 1.0, weighted + h, _weighted(w, r, p) + h


@inner
def _squares(e):
    """Sum of the squares of four residuals."""
    return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]


@inner
def _normal_equations(p, r, w, n, e, A, b):
    """J^T J and -J^T e of the residuals e, lower half of A only."""
    for i in range(3):
        for j in range(i + 1):
            A[i, j] = n[i] * n[j] + w[i] * w[j] * (5.0 * r[i] * r[j] + p[i] * p[j])
        A[3, i] = w[i] * (2.0 * r[i] + p[i])
        b[i] = -(n[i] * e[0] + w[i] * (r[i] * e[1] + 2.0 * r[i] * e[2] + p[i] * e[3]))
    A[3, 3] = 2.0
    b[3] = -(e[2] + e[3])


@inner
def _solved(A, b, damping, gain):
    """Solve (A + damping diag(A)) u = gain b by the factors L D L^T."""
    scale = 1.0 + damping
    i0 = 1.0 / (A[0, 0] * scale)
    l10 = A[1, 0] * i0
    l20 = A[2, 0] * i0
    l30 = A[3, 0] * i0
    i1 = 1.0 / (A[1, 1] * scale - l10 * A[1, 0])
    e2 = A[2, 1] - l20 * A[1, 0]
    e3 = A[3, 1] - l30 * A[1, 0]
    l21 = e2 * i1
    l31 = e3 * i1
    i2 = 1.0 / (A[2, 2] * scale - l20 * A[2, 0] - l21 * e2)
    f3 = A[3, 2] - l30 * A[2, 0] - l31 * e2
    l32 = f3 * i2
    i3 = 1.0 / (A[3, 3] * scale - l30 * A[3, 0] - l31 * e3 - l32 * f3)
    y0 = gain * b[0]
    y1 = gain * b[1] - l10 * y0
    y2 = gain * b[2] - l20 * y0 - l21 * y1
    y3 = gain * b[3] - l30 * y0 - l31 * y1 - l32 * y2
    u3 = y3 * i3
    u2 = y2 * i2 - l32 * u3
    u1 = y1 * i1 - l21 * u2 - l31 * u3
    u0 = y0 * i0 - l10 * u1 - l20 * u2 - l30 * u3
    return u0, u1, u2, u3


HYBRID = 0
MIDPOINT = 1
AXIAL = 2
BLEND_FROM = 0.7073
BLEND_TO = 0.9
EDGE = 0.3
FAN = 300
CHORD = 0.001
MAX_CHORDS = 499


@inner
def wrap_ellipsoid(p, q, size, method, half):
    """Wrap the segment from p to q around an ellipsoid at the origin.

    Parameters
    ----------
    p, q : points in the frame of the ellipsoid [m]
    size : half axes [m]
    method : `HYBRID`, `MIDPOINT` or `AXIAL`
    half : `Half` that the path may touch

    Returns
    -------
    code, arc, r, s : as of `wrap_cylinder`, but never `WRAPPED`
    """
    factor = 3.0 / (size[0] + size[1] + size[2])
    a = (size[0] * factor, size[1] * factor, size[2] * factor)
    x = (p[0] * factor, p[1] * factor, p[2] * factor)
    y = (q[0] * factor, q[1] * factor, q[2] * factor)
    x_out = _outside(x, a)
    y_out = _outside(y, a)
    if x_out < -0.0001 or y_out < -0.0001:
        return INSIDE, 0.0, p, q
    if abs(dot(unit(x), unit(y)) - 1.0) < 0.0001:
        return NO_WRAP, 0.0, p, q
    crosses, r, s = _chord(x, y, a)
    if not crosses:
        return NO_WRAP, 0.0, p, q
    best, square, place = _most_square(x, y, r, s)
    c, square, fan = _plane_point(r, s, a, method, best, square, place)
    if method != AXIAL or 0.0 < place < 1.0:
        r = c
        s = c
    axis = half.axis
    if half.side != 0 and sign(c[axis]) != half.side:
        c = replaced(c, axis, -c[axis])
        r = c
        s = c
        if fan > 0.0:
            # The middle between c and its mirror image has a zero there.
            target = replaced(c, axis, (1.0 - min(fan, 1.0)) * c[axis])
            result, nearest = nearest_on_ellipsoid(a, target)
            c = nearest if result else target
    n = unit(cross(minus(x, y), minus(x, c)))
    d = -dot(n, c)
    if abs(x_out) < 0.0001:
        r = x
    else:
        r = tangent_point(x, r, a, n, d)
    if abs(y_out) < 0.0001:
        s = y
    else:
        s = tangent_point(y, s, a, n, d)
    arc = _arc(x, y, r, s, a, n, d, factor, half.side != 0)
    return MANDATORY, arc / factor, _scaled(r, factor), _scaled(s, factor)


@inner
def _scaled(p, factor):
    """Divide a vector by the factor of lengths."""
    return p[0] / factor, p[1] / factor, p[2] / factor


@inner
def _outside(p, a):
    """Level of a point: below 0 inside the ellipsoid, 0 on it."""
    u = p[0] / a[0]
    v = p[1] / a[1]
    w = p[2] / a[2]
    return u * u + v * v + w * w - 1.0


@inner
def _chord(x, y, a):
    """Find where the segment from x to y enters and leaves the ellipsoid; false where it misses."""
    d = minus(x, y)
    f = (d[0] / a[0], d[1] / a[1], d[2] / a[2])
    g = (y[0] / a[0], y[1] / a[1], y[2] / a[2])
    A = dot(f, f)
    B = 2.0 * dot(f, g)
    C = dot(g, g) - 1.0
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0 or A == 0.0:
        return False, x, y
    root = math.sqrt(discriminant)
    one = (-B + root) / (2.0 * A)
    other = (-B - root) / (2.0 * A)
    if not (0.0 < one < 1.0 and 0.0 < other < 1.0):
        return False, x, y
    return True, along(y, one, d), along(y, other, d)


@inner
def _most_square(x, y, r, s):
    """Find the axis most parallel to the segment.

    Returns
    -------
    the axis, its cosine, and the share of the chord at which it crosses the plane across the axis
    """
    d = unit(minus(x, y))
    best = 0
    for i in range(1, 3):
        if abs(d[i]) > abs(d[best]):
            best = i
    return best, abs(d[best]), -r[best] / (s[best] - r[best])


@inner
def _plane_point(r, s, a, method, best, square, place):
    """Find the surface point that sets the plane of the path.

    Returns
    -------
    the point, the cosine after fading, and the share of the fan (-inf where unset)
    """
    chord = minus(s, r)
    middle = along(r, 0.5, chord)
    if method == MIDPOINT:
        _, c = nearest_on_ellipsoid(a, middle)
        return c, square, -math.inf
    if method == HYBRID and square > BLEND_FROM:
        # Near the ends of the chord the axial point turns away from the fan's: it is faded out.
        fade = 1.0
        if place < 0.0 or place > 1.0:
            fade = 0.0
        elif place < EDGE:
            fade = place / EDGE
        elif place > 1.0 - EDGE:
            fade = (1.0 - place) / EDGE
        square = BLEND_FROM + fade * (square - BLEND_FROM)
    c = middle
    if method == AXIAL or square > BLEND_FROM:
        c = nearest_in_plane(a, along(r, place, chord), best)
    if method == AXIAL or square >= BLEND_TO:
        return c, square, -math.inf
    _, fan_c = nearest_on_ellipsoid(a, along(middle, 1.0, _fan(r, chord, a)))
    if square <= BLEND_FROM:
        return fan_c, square, 1.0
    share = (square - BLEND_FROM) / (BLEND_TO - BLEND_FROM)
    _, c = nearest_on_ellipsoid(a, along(fan_c, share, minus(c, fan_c)))
    return c, square, 1.0 - share


@inner
def _fan(r, chord, a):
    """Mean direction from the chord to the surface points nearest to it."""
    total = (0.0, 0.0, 0.0)
    c = r
    for i in range(1, FAN - 1):
        p = along(r, i / FAN, chord)
        result, nearest = nearest_on_ellipsoid(a, p)
        if result:
            c = nearest
        total = along(total, 1.0, unit(minus(c, p)))
    return unit(total)


@inner
def _arc(x, y, r, s, a, n, d, factor, constrained):
    """Compute the length from r to s on the surface, in the plane n . x + d = 0.

    Constrained paths go the other way round where they would double back.
    """
    gap = norm(minus(r, s))
    if gap / factor < CHORD:
        return gap
    chords = min(int(gap / factor / CHORD), MAX_CHORDS)
    most = 0
    for i in range(1, 3):
        if abs(n[i]) > abs(n[most]):
            most = i
    center = replaced((0.0, 0.0, 0.0), most, -d / n[most])
    e = unit(minus(r, center))
    f = unit(minus(s, center))
    whole = math.acos(min(1.0, max(-1.0, dot(e, f))))
    f = cross(unit(cross(e, f)), e)
    length, second, last = _chords_length(center, e, f, whole / chords, chords, r, s, a)
    if constrained and chords > 1:
        start = minus(second, r)
        end = minus(last, s)
        if dot(minus(x, r), start) > 0.0 or dot(minus(y, s), end) > 0.0:
            length, second, last = _chords_length(
                center, e, f, (whole - 2.0 * math.pi) / chords, chords, r, s, a
            )
    return length


@inner
def _chords_length(center, e, f, step, chords, r, s, a):
    """Sum the chords from r to s at even angles about `center`.

    Returns
    -------
    length, second point, last point but one
    """
    g = (center[0] / a[0], center[1] / a[1], center[2] / a[2])
    C = dot(g, g) - 1.0
    length = 0.0
    before = r
    second = s
    c = 1.0
    d = 0.0
    turn_c = math.cos(step)
    turn_d = math.sin(step)
    for i in range(1, chords):
        c, d = c * turn_c - d * turn_d, d * turn_c + c * turn_d
        direction = (c * e[0] + d * f[0], c * e[1] + d * f[1], c * e[2] + d * f[2])
        h = (direction[0] / a[0], direction[1] / a[1], direction[2] / a[2])
        A = dot(h, h)
        B = 2.0 * dot(h, g)
        point = along(center, (-B + math.sqrt(B * B - 4.0 * A * C)) / (2.0 * A), direction)
        length += norm(minus(point, before))
        before = point
        if i == 1:
            second = point
    return length + norm(minus(s, before)), second, before
