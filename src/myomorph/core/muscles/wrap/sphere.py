"""Wrapping around a sphere as OpenSim defines it (`WrapSphere`, 4.6), one segment at a time.

The path lies in the plane of both points and the center: straight to where it touches the circle,
along the circle, straight on. Of the two points at which a line from either end touches, the pair
is taken with the lesser angle between them, or on a constrained sphere the pair that leads over its
half.
"""

from __future__ import annotations

import math

from myomorph.core.muscles.wrap.surface import (
    INSIDE,
    MANDATORY,
    NO_WRAP,
    WRAPPED,
    Wrap,
    crossed_between,
    leads_away,
    missed,
    nearest_pair,
    on_half,
)
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import along, cross, dot, minus, norm, unit

IN_LINE = 1e-5  # Sine of the angle to the center below which a segment aims at it


@bare
def wrap_sphere(a, b, radius, half):
    """Wrap the segment from a to b around a sphere at the origin.

    With the angle phi from r to s about the center, the arc is radius phi. On the far side of a
    constrained sphere OpenSim counts the arc as negative, radius (phi - 2 pi); so do we. A segment
    that aims at the center within 1e-5 has no tangent points, and is not wrapped.

    Parameters
    ----------
    a, b : points in the frame of the sphere [m]
    radius : of the sphere [m]
    half : `Half` that the path may touch

    Returns
    -------
    `Wrap`
    """
    distance_a = norm(a)
    distance_b = norm(b)
    if distance_a < radius or distance_b < radius:
        return missed(INSIDE, a, b)
    if not _crosses(a, b, distance_b, radius):
        return missed(NO_WRAP, a, b)
    direction = unit(minus(a, b))
    across = cross(direction, unit(b))
    if norm(across) < IN_LINE:
        return missed(NO_WRAP, a, b)
    code = _code(a, b, direction, radius, half)
    if code == NO_WRAP:
        return missed(NO_WRAP, a, b)

    normal = unit(across)
    of_a = _tangents(a, distance_a, normal, radius)
    of_b = _tangents(b, distance_b, normal, radius)
    far = False
    if half.side == 0 or (on_half(a, half) and on_half(b, half)):
        r, s = _nearest_tangents(of_a, of_b)
    else:
        r, s = _tangents_over_half(a, b, of_a, of_b, half)
        far = leads_away(a, b, r, s)
    angle = math.acos(min(1.0, max(-1.0, dot(unit(r), unit(s)))))
    if far:
        angle -= 2.0 * math.pi
    return Wrap(code=code, arc=radius * angle, r=r, s=s)


@in_place
def _crosses(a, b, distance_b, radius):
    """Return whether the segment from a to b runs through the sphere.

    With d = a - b it does where |b + t d| = radius has both roots between 0 and 1.
    """
    d = minus(a, b)
    A = dot(d, d)
    B = 2.0 * dot(b, d)
    C = distance_b * distance_b - radius * radius
    crosses, _, _ = crossed_between(A, B, C)
    return crosses


@in_place
def _code(a, b, direction, radius, half):
    """Return how a segment that runs through the sphere is to be wrapped: its code."""
    a_on = on_half(a, half)
    b_on = on_half(b, half)
    if not a_on and not b_on:
        return WRAPPED
    # Distance from a to the point nearest to the center, which OpenSim compares with 0 and 1 m.
    t = dot(a, direction)
    nearest = along(a, -t, direction)
    if dot(nearest, nearest) < radius * radius and 0.0 < t < 1.0:
        return MANDATORY
    if a_on != b_on and not on_half(nearest, half):
        return WRAPPED
    return NO_WRAP


@bare
def _tangents(p, distance, normal, radius):
    """Find both points of the plane with a normal where lines through p touch the sphere.

    With y from p to the center, z across it in the plane, and sin(beta) = radius / distance, they
    are

        p + distance cos(beta)^2 y -+ distance cos(beta) sin(beta) z
    """
    y = (-p[0] / distance, -p[1] / distance, -p[2] / distance)
    z = cross(normal, y)
    sine = radius / distance
    cosine = math.sqrt(max(0.0, 1.0 - sine * sine))
    foot = along(p, distance * cosine * cosine, y)
    one = along(foot, -distance * cosine * sine, z)
    other = along(foot, distance * cosine * sine, z)
    return one, other


@in_place
def _nearest_tangents(of_a, of_b):
    """Choose the pair of tangent points with the least angle between them.

    Parameters
    ----------
    of_a, of_b : two tangent points of lines from either end
    """
    ra, rb = of_a
    sa, sb = of_b
    ra_out = unit(ra)
    rb_out = unit(rb)
    sa_out = unit(sa)
    sb_out = unit(sb)
    r_first, s_first = nearest_pair(
        dot(ra_out, sa_out), dot(ra_out, sb_out), dot(rb_out, sa_out), dot(rb_out, sb_out)
    )
    r = ra if r_first else rb
    s = sa if s_first else sb
    return r, s


@in_place
def _tangents_over_half(a, b, of_a, of_b, half):
    """Choose the tangent points that lead the path over a half of the sphere.

    Of each end's points it is the one nearer to the side away from both ends, along -(a + b), or
    both others where those lead off the half.
    """
    ra, rb = of_a
    sa, sb = of_b
    inward = unit((-a[0] - b[0], -a[1] - b[1], -a[2] - b[2]))
    r_first = dot(unit(ra), inward) > dot(unit(rb), inward)
    s_first = dot(unit(sa), inward) > dot(unit(sb), inward)
    r = ra if r_first else rb
    s = sa if s_first else sb
    axis = half.axis
    if half.side * (r[axis] - a[axis] + s[axis] - b[axis]) < 0.0:
        r = rb if r_first else ra
        s = sb if s_first else sa
    return r, s
