"""The point of an ellipsoid nearest to another point, as OpenSim finds it.

Eberly's method (Graphics Gems IV) with OpenSim's tolerances and special cases near axes and planes,
which are kept because they are felt in the length of a path. Lengths are divided by the mean half
axis.
"""

from __future__ import annotations

import math

from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import dot

# OpenSim's: of a component that counts as 0, of the equation of the surface, and of its search
ROUNDING = 2e-13
SMALL = 1e-9
MAX_STEPS = 64


@bare
def nearest_on_ellipsoid(a, p):
    """Find the nearest point to p on an ellipsoid around the origin, by Newton's method.

    The nearest point is a_i^2 p_i / (t + a_i^2) for the t that puts it on the surface,

        sum_i a_i^2 p_i^2 / (t + a_i^2)^2 = 1

    Parameters
    ----------
    a : half axes, about 1
    p : point

    Returns
    -------
    whether the iteration ended, and the point
    """
    plane = _plane_through(a, p)
    if plane >= 0:
        return True, nearest_in_plane(a, p, plane)
    squares = (a[0] * a[0], a[1] * a[1], a[2] * a[2])
    weighted = (squares[0] * p[0] * p[0], squares[1] * p[1] * p[1], squares[2] * p[2] * p[2])
    t = 0.0
    if _level(squares, weighted) >= 1.0:
        t = max(a[0], a[1], a[2]) * math.sqrt(dot(p, p))
    for _ in range(MAX_STEPS):
        shifted = (t + squares[0], t + squares[1], t + squares[2])
        f = _surface_equation(shifted, weighted)
        if abs(f) < SMALL:
            nearest = (
                squares[0] * p[0] / shifted[0],
                squares[1] * p[1] / shifted[1],
                squares[2] * p[2] / shifted[2],
            )
            return True, nearest
        t -= f / (2.0 * _surface_slope(shifted, weighted))
    return False, p


@in_place
def _plane_through(a, p):
    """Find the plane of coordinates that p lies in: its axis, or -1 where p lies in none.

    Of several it is the one whose ellipse is the smallest.
    """
    plane = -1
    narrowest = math.inf
    for i in range(3):
        others = a[0] + a[1] + a[2] - a[i]
        if abs(p[i]) <= ROUNDING and others < narrowest:
            plane = i
            narrowest = others
    return plane


@in_place
def _level(squares, weighted):
    """Level of a point: sum of p_i^2 / a_i^2, 1 on the surface."""
    u = weighted[0] / (squares[0] * squares[0])
    v = weighted[1] / (squares[1] * squares[1])
    w = weighted[2] / (squares[2] * squares[2])
    return u + v + w


@in_place
def _surface_equation(shifted, weighted):
    """Polynomial in t that is 0 on the surface, with P, Q, R = t + a_i^2 and u, v, w = a_i^2 p_i^2.

    P^2 Q^2 R^2 - u Q^2 R^2 - v P^2 R^2 - w P^2 Q^2
    """
    P2 = shifted[0] * shifted[0]
    Q2 = shifted[1] * shifted[1]
    R2 = shifted[2] * shifted[2]
    u, v, w = weighted
    return P2 * Q2 * R2 - u * Q2 * R2 - v * P2 * R2 - w * P2 * Q2


@in_place
def _surface_slope(shifted, weighted):
    """Half the derivative of `_surface_equation` in t."""
    P, Q, R = shifted
    u, v, w = weighted
    of_u = u * Q * R * (Q + R)
    of_v = v * P * R * (P + R)
    of_w = w * P * Q * (P + Q)
    return P * Q * R * (Q * R + P * R + P * Q) - of_u - of_v - of_w


@bare
def nearest_in_plane(a, p, plane):
    """Find the nearest point to p on an ellipse, in a plane of coordinates.

    The ellipse has the half axes of the ellipsoid other than `plane`. The component `plane` stays
    p's own: OpenSim does not look for the section through p.

    Parameters
    ----------
    a : half axes, about 1
    p : point
    plane : axis across the plane
    """
    if plane == 0:
        y, z = _nearest_on_ellipse(a[1], a[2], p[1], p[2])
        return p[0], y, z
    if plane == 1:
        z, x = _nearest_on_ellipse(a[2], a[0], p[2], p[0])
        return x, p[1], z
    x, y = _nearest_on_ellipse(a[0], a[1], p[0], p[1])
    return x, y, p[2]


@bare
def _nearest_on_ellipse(a, b, u, v):
    """Find the nearest point to (u, v) on the ellipse with half axes a, b."""
    on_y = abs(u) <= ROUNDING
    on_x = abs(v) <= ROUNDING
    if on_x and on_y:
        if a < b:
            return -a if u < 0.0 else a, v
        return u, -b if v < 0.0 else b
    if on_y:
        return _nearest_from_axis(a, b, u, v)
    if on_x:
        y, x = _nearest_from_axis(b, a, v, u)
        return x, y
    a2 = a * a
    b2 = b * b
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


@bare
def _nearest_from_axis(a, b, u, v):
    """Find the nearest point to (u, v), u about 0, on the ellipse with half axes a, b.

    It is the vertex at b, unless the point lies within the center of curvature there, b - a^2 / b.
    """
    if a >= b or abs(v) >= b - a * a / b:
        return u, b if v >= 0.0 else -b
    b2 = b * b
    y = b2 * v / (b2 - a * a)
    return a * math.sqrt(abs(1.0 - y * y / b2)), y
