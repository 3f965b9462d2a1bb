"""Wrapping around a sphere as OpenSim defines it (`WrapSphere`, 4.6), one segment at a time."""

from __future__ import annotations

import math

from myomorph.core.muscles.wrap_cylinder import INSIDE, MANDATORY, NO_WRAP, WRAPPED, nearest_pair
from myomorph.core.rigid.kernels import inner
from myomorph.core.rigid.vectors import along, cross, dot, minus, norm, sign, unit

IN_LINE = 1e-5  # Sine of the angle to the center below which a segment aims at it


@inner
def wrap_sphere(a, b, radius, half):
    """Wrap the segment from a to b around a sphere at the origin.

    On the far side of a constrained sphere OpenSim counts the arc as negative; so do we. A segment
    that aims at the center within 1e-5 has no tangent points, and is not wrapped.

    Parameters
    ----------
    a, b : points in the frame of the sphere [m]
    radius : of the sphere [m]
    half : `Half` that the path may touch

    Returns
    -------
    code, arc, r, s : as of `wrap_cylinder`
    """
    axis, side = half
    la = norm(a)
    lb = norm(b)
    if la < radius or lb < radius:
        return INSIDE, 0.0, a, b
    d = minus(a, b)
    A = dot(d, d)
    B = 2.0 * dot(b, d)
    C = lb * lb - radius * radius
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0 or A == 0.0:
        return NO_WRAP, 0.0, a, b
    root = math.sqrt(discriminant)
    one = (-B + root) / (2.0 * A)
    other = (-B - root) / (2.0 * A)
    if not (0.0 < one < 1.0 and 0.0 < other < 1.0):
        return NO_WRAP, 0.0, a, b
    d = unit(d)
    h = cross(d, unit(b))
    if norm(h) < IN_LINE:
        return NO_WRAP, 0.0, a, b
    n = unit(h)
    ra, rb = _tangents(a, la, n, radius)
    sa, sb = _tangents(b, lb, n, radius)
    ra_out = unit(ra)
    rb_out = unit(rb)
    sa_out = unit(sa)
    sb_out = unit(sb)
    r_first, s_first = nearest_pair(
        dot(ra_out, sa_out), dot(ra_out, sb_out), dot(rb_out, sa_out), dot(rb_out, sb_out)
    )
    code = WRAPPED
    far = False
    a_on = sign(a[axis]) == side
    b_on = sign(b[axis]) == side
    if side != 0 and (a_on or b_on):
        # Distance from a to the point nearest to the center, which OpenSim compares with 0 and 1 m.
        t = dot(a, d)
        near = along(a, -t, d)
        if dot(near, near) < radius * radius and 0.0 < t < 1.0:
            code = MANDATORY
        elif not (sign(a[axis]) != sign(b[axis]) and sign(near[axis]) != side):
            return NO_WRAP, 0.0, a, b
    r = ra if r_first else rb
    s = sa if s_first else sb
    if side != 0 and not (a_on and b_on):
        inward = unit((-a[0] - b[0], -a[1] - b[1], -a[2] - b[2]))
        r_first = dot(ra_out, inward) > dot(rb_out, inward)
        s_first = dot(sa_out, inward) > dot(sb_out, inward)
        r = ra if r_first else rb
        s = sa if s_first else sb
        if side * (r[axis] - a[axis] + s[axis] - b[axis]) < 0.0:
            r = rb if r_first else ra
            s = sb if s_first else sa
        reach = (r[0] - a[0] + s[0] - b[0], r[1] - a[1] + s[1] - b[1], r[2] - a[2] + s[2] - b[2])
        far = dot(reach, (r[0] + s[0], r[1] + s[1], r[2] + s[2])) < 0.0
    angle = math.acos(min(1.0, max(-1.0, dot(unit(r), unit(s)))))
    if far:
        angle -= 2.0 * math.pi
    return code, radius * angle, r, s


@inner
def _tangents(p, distance, n, radius):
    """Find both points of the plane with normal n where lines through p touch the sphere."""
    y = (-p[0] / distance, -p[1] / distance, -p[2] / distance)
    z = cross(n, y)
    s = radius / distance
    c = math.sqrt(max(0.0, 1.0 - s * s))
    foot = along(p, distance * c * c, y)
    return along(foot, -distance * c * s, z), along(foot, distance * c * s, z)
