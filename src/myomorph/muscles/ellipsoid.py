"""The point of an ellipse or ellipsoid nearest to a given one (Eberly, Graphics Gems IV), as OpenSim finds it.

The special cases near the axes and planes are OpenSim's: they decide on which side of an ellipsoid a muscle path runs.
"""

from __future__ import annotations

import math

import numpy as np

from myomorph.rigid.kernels import inner
from myomorph.rigid.vectors import dot, minus, unit

ROUNDING = 2e-13
SMALL = 1e-9
MAX_STEPS = 64


@inner
def nearest_in_plane(a, p, plane):
    """Nearest point, of the ellipse with the half axes a of the ellipsoid other than `plane`, to p.
    The component `plane` stays p's own: OpenSim does not look for the section through p.
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
    """Nearest point of the ellipsoid with half axes a around the origin to p.
    `a`: half axes, about 1; `p`: the given point. Returns `found`: false where Newton's iteration did not end;
    `nearest` (3,).
    """
    plane, narrowest = -1, math.inf
    for i in range(3):
        others = a[0] + a[1] + a[2] - a[i]
        if abs(p[i]) <= ROUNDING and others < narrowest:
            plane, narrowest = i, others
    if plane >= 0:
        return True, nearest_in_plane(a, p, plane)
    a2, b2, c2 = a[0] * a[0], a[1] * a[1], a[2] * a[2]
    u, v, w = a2 * p[0] * p[0], b2 * p[1] * p[1], c2 * p[2] * p[2]
    t = 0.0
    if u / (a2 * a2) + v / (b2 * b2) + w / (c2 * c2) >= 1.0:
        t = max(a[0], a[1], a[2]) * math.sqrt(dot(p, p))
    for _ in range(MAX_STEPS):
        P, Q, R = t + a2, t + b2, t + c2
        P2, Q2, R2 = P * P, Q * Q, R * R
        f = P2 * Q2 * R2 - u * Q2 * R2 - v * P2 * R2 - w * P2 * Q2
        if abs(f) < SMALL:
            return True, (a2 * p[0] / P, b2 * p[1] / Q, c2 * p[2] / R)
        slope = P * Q * R * (Q * R + P * R + P * Q) - u * Q * R * (Q + R) - v * P * R * (P + R) - w * P * Q * (P + Q)
        t -= f / (2.0 * slope)
    return False, p


@inner
def _nearest_on_ellipse(a, b, u, v):
    """Nearest point of the ellipse with half axes a, b to (u, v)."""
    a2, b2 = a * a, b * b
    on_y, on_x = abs(u) <= ROUNDING, abs(v) <= ROUNDING
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
    P, Q = t + a2, t + b2
    for _ in range(MAX_STEPS):
        P, Q = t + a2, t + b2
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
    """Point of the ellipsoid, in the plane n . x + d = 0, where a line from p touches it.
    `p`: point outside; `r`: where the search starts; `a`: half axes, about 1.
    """
    w = (2.0 / (a[0] * a[0]), 2.0 / (a[1] * a[1]), 2.0 / (a[2] * a[2]))
    h = -_weighted(w, r, r)
    e = _residuals(p, r, h, w, n, d)
    before = _squares(e)
    now, damping = before, 0.01
    A, b = np.empty((4, 4)), np.empty(4)
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
            r, h = (r[0] + u[0], r[1] + u[1], r[2] + u[2]), h + u[3]
            before, now = now, _squares(_residuals(p, r, h, w, n, d))
            damping *= 4.0
            tries += 1
        damping /= 8.0
        stretch, tries = 0.5, 0
        while now <= before and tries < MAX_TRIES:
            stretch *= 2.0
            r, h = (r[0] + stretch * u[0], r[1] + stretch * u[1], r[2] + stretch * u[2]), h + stretch * u[3]
            before, now = now, _squares(_residuals(p, r, h, w, n, d))
            tries += 1
        r, h = (r[0] - stretch * u[0], r[1] - stretch * u[1], r[2] - stretch * u[2]), h - stretch * u[3]
        e = _residuals(p, r, h, w, n, d)
        now = _squares(e)
        before = now
    return r


@inner
def _weighted(w, p, q):
    return w[0] * p[0] * q[0] + w[1] * p[1] * q[1] + w[2] * p[2] * q[2]


@inner
def _residuals(p, r, h, w, n, d):
    """In the plane, on the surface, h the offset of the tangent plane, p in the tangent plane."""
    weighted = _weighted(w, r, r)
    return dot(n, r) + d, 0.5 * weighted - 1.0, weighted + h, _weighted(w, r, p) + h


@inner
def _squares(e):
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
    """Solution of (A + damping diag(A)) u = gain b by the factors L D L^T."""
    scale = 1.0 + damping
    i0 = 1.0 / (A[0, 0] * scale)
    l10, l20, l30 = A[1, 0] * i0, A[2, 0] * i0, A[3, 0] * i0
    i1 = 1.0 / (A[1, 1] * scale - l10 * A[1, 0])
    e2, e3 = A[2, 1] - l20 * A[1, 0], A[3, 1] - l30 * A[1, 0]
    l21, l31 = e2 * i1, e3 * i1
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
