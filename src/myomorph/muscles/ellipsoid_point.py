"""The point of an ellipse or ellipsoid nearest to a given one (Eberly, Graphics Gems IV), as OpenSim finds it.

The special cases near the axes and planes are OpenSim's: they decide on which side of an ellipsoid
a muscle path runs.
"""

from __future__ import annotations

import math

from myomorph.rigid.kernels import inner
from myomorph.rigid.vectors import dot

ROUNDING = 2e-13
SMALL = 1e-9
MOST_STEPS = 64


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

    Parameters
    ----------
    a : half axes, about 1
    p : the given point

    Returns
    -------
    found : false where Newton's iteration did not end
    nearest : (3,)
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
    for _ in range(MOST_STEPS):
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
    for _ in range(MOST_STEPS):
        P, Q = t + a2, t + b2
        f = P * P * Q * Q - a2 * u * u * Q * Q - b2 * v * v * P * P
        if abs(f) < SMALL:
            break
        t -= f / (2.0 * (P * Q * (P + Q) - a2 * u * u * Q - b2 * v * v * P))
    return a2 * u / P, b2 * v / Q
