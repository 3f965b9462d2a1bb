"""Tendons around spheres and cylinders in the way of MuJoCo: one surface between two sites.

The path lies in a plane: for a sphere the one through both points and its center, for a cylinder
the one across its axis, along which the path then climbs evenly. In the plane it is straight, an
arc of the circle, straight. The path takes the near way round, and only where the surface is in its
way; but where the center lies within the triangle of both points and a side point outside of the
surface, it takes the way over that side in any case. A side point inside of the surface makes the
path run through the inside of the ring and touch it at one point (a pulley seen from within). These
are the rules of MuJoCo 4.0 (`tendon/spatial/geom` in its documentation, found out by experiment).
Versions before 4.0 went over the side of a side point outside wherever the straight line passes the
center on the other side of it, and of both ways took the one whose ends point more towards it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.muscles.wrap.surface import (
    NO_WRAP,
    SPHERE,
    WRAPPED,
    Vector,
    missed,
    wrapped,
)
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import cross, dot, minus, norm

# Rules of side points: without one, those of MuJoCo before 4.0, those since
NO_SIDE = 0
BEFORE_FOUR = 3
FOUR = 4
TINY = 1e-15
MAX_STEPS = 60  # Of the search for the point at which a path touches a ring from within
ON_RING = 1e-14  # Error of its equation that ends the search [rad]

Flat = tuple[float, float]


class Side(NamedTuple):
    """The side that a path is to take.

    Attributes
    ----------
    rule : `NO_SIDE`, `BEFORE_FOUR` or `FOUR`
    point : side point, not read without one [m]
    """

    rule: int
    point: Vector


class _Axes(NamedTuple):
    """Axes of the plane of a path: x and y, unit vectors from the center."""

    x: Vector
    y: Vector


class _Arc(NamedTuple):
    """Arc on the circle.

    Attributes
    ----------
    length : -1 for none [m]
    r, s : where the path meets and leaves the circle [m]
    """

    length: float
    r: Flat
    s: Flat


@bare
def wrap_tendon(a, b, surface, side):
    """Wrap a tendon around a surface between two points, all in one frame.

    Parameters
    ----------
    a, b : points before and after the surface [m]
    surface : `Surface` of the kind `SPHERE`, or `CYLINDER`, which is infinite
    side : `Side`

    Returns
    -------
    `Wrap`, `WRAPPED` or `NO_WRAP`
    """
    to_a = minus(a, surface.center)
    to_b = minus(b, surface.center)
    if norm(to_a) < TINY or dot(to_b, to_b) < TINY * TINY:
        return missed(NO_WRAP, a, b)
    axes = _axes(to_a, to_b, surface)
    to_side = (0.0, 0.0, 0.0)
    if side.rule != NO_SIDE:
        to_side = minus(side.point, surface.center)
    arc = _plane_arc(_seen(axes, to_a), _seen(axes, to_b), to_side, axes, surface, side.rule)
    if arc.length < 0.0:
        return missed(NO_WRAP, a, b)
    if surface.kind == SPHERE:
        r = _placed(surface, axes, arc.r, 0.0)
        s = _placed(surface, axes, arc.s, 0.0)
        return wrapped(WRAPPED, math.sqrt(arc.length * arc.length), r, s)
    return _climbing(to_a, to_b, arc, axes, surface)


@in_place
def _axes(to_a, to_b, surface):
    """Axes of the plane of a path: towards a and across it, or those across a cylinder's."""
    rotation = surface.rotation
    if surface.kind != SPHERE:
        return _Axes(
            x=(rotation[0], rotation[3], rotation[6]), y=(rotation[1], rotation[4], rotation[7])
        )
    distance = norm(to_a)
    x = (to_a[0] / distance, to_a[1] / distance, to_a[2] / distance)
    return _Axes(x=x, y=cross(_plane_normal(x, to_a, to_b), x))


@bare
def _seen(axes, p):
    """Coordinates of a point in the plane of the path."""
    return dot(p, axes.x), dot(p, axes.y)


@bare
def _placed(surface, axes, p, height):
    """Position of a point of the plane, at a height along the surface's z axis."""
    rotation = surface.rotation
    center = surface.center
    return (
        center[0] + p[0] * axes.x[0] + p[1] * axes.y[0] + height * rotation[2],
        center[1] + p[0] * axes.x[1] + p[1] * axes.y[1] + height * rotation[5],
        center[2] + p[0] * axes.x[2] + p[1] * axes.y[2] + height * rotation[8],
    )


@in_place
def _climbing(to_a, to_b, arc, axes, surface):
    """Let a path around a cylinder climb along the axis in proportion to its length across it.

    Over the arc of length l, of a path l_a + l + l_b across the axis that climbs by z, the height
    is h = z l / (l_a + l + l_b), and the helix sqrt(l^2 + h^2) long.
    """
    rotation = surface.rotation
    axis = (rotation[2], rotation[5], rotation[8])
    height_a = dot(to_a, axis)
    climb = dot(to_b, axis) - height_a
    before = _flat_distance(_seen(axes, to_a), arc.r)
    after = _flat_distance(_seen(axes, to_b), arc.s)
    h = climb * arc.length / (before + arc.length + after)
    height_r = height_a + climb * before / (before + arc.length + after)
    return wrapped(
        WRAPPED,
        math.sqrt(arc.length * arc.length + h * h),
        _placed(surface, axes, arc.r, height_r),
        _placed(surface, axes, arc.s, height_r + h),
    )


@bare
def _flat_distance(p, q):
    """Distance of two points of the plane."""
    return math.hypot(q[0] - p[0], q[1] - p[1])


@in_place
def _plane_arc(a, b, to_side, axes, surface, rule):
    """Find the arc in the plane of the path by the rule of its side point.

    Parameters
    ----------
    a, b : points in the plane [m]
    to_side : from the center to the side point [m]
    """
    radius = surface.size[0]
    if rule == NO_SIDE:
        return _around(a, b, radius, (0.0, 0.0), False)
    if dot(to_side, to_side) < radius * radius:
        return _touch_inside(a, b, radius)
    x, y = _seen(axes, to_side)
    side = _unit(x, y)
    if rule == BEFORE_FOUR:
        return _towards_side(a, b, radius, side)
    return _around(a, b, radius, side, True)


@in_place
def _plane_normal(e, a, b):
    """Find the unit normal of the plane of a and b; of any plane of a, along e, if in line."""
    n = cross(a, b)
    if norm(n) < TINY:
        if abs(e[1]) > abs(e[0]) and abs(e[1]) > abs(e[2]):
            n = (e[1], e[2] - e[0], -e[1])
        elif abs(e[2]) > abs(e[0]) and abs(e[2]) > abs(e[1]):
            n = (-e[2], e[2], e[0] - e[1])
        else:
            n = (e[1] - e[2], -e[0], e[0])
    length = norm(n)
    return n[0] / length, n[1] / length, n[2] / length


@bare
def _unit(x, y):
    """Scale a vector of the plane to norm 1; (1, 0) for one without norm."""
    length = math.hypot(x, y)
    if length < TINY:
        return 1.0, 0.0
    return x / length, y / length


@bare
def _no_arc():
    """Make the arc of a path that does not touch the circle."""
    return _Arc(length=-1.0, r=(0.0, 0.0), s=(0.0, 0.0))


@bare
def _square(p):
    """Square of the norm."""
    return p[0] * p[0] + p[1] * p[1]


@bare
def _cross_product(p, q):
    """Product of two vectors that is positive where q lies counterclockwise of p."""
    return p[0] * q[1] - p[1] * q[0]


@bare
def _may_touch(a, b, radius):
    """Return whether both ends lie outside of the circle and apart."""
    d = (b[0] - a[0], b[1] - a[1])
    outside = not (_square(a) < radius * radius or _square(b) < radius * radius)
    return outside and not (radius < TINY or _square(d) < TINY)


@bare
def _nearest_to_center(a, b):
    """Find the point of the segment from a to b nearest to the center."""
    d = (b[0] - a[0], b[1] - a[1])
    t = min(1.0, max(0.0, -(d[0] * a[0] + d[1] * a[1]) / _square(d)))
    return a[0] + t * d[0], a[1] + t * d[1]


@bare
def _around(a, b, radius, side, has_side):
    """Go around the outside of a circle the near way, or over the side if the center lies between.

    Parameters
    ----------
    side : direction of the side point
    has_side : whether there is one
    """
    if not _may_touch(a, b, radius):
        return _no_arc()
    turned = _cross_product(a, b)
    left = _cross_product(a, side)
    right = _cross_product(side, b)
    far = has_side and left * turned < 0.0 and right * turned < 0.0
    if not far and _square(_nearest_to_center(a, b)) > radius * radius:
        return _no_arc()
    # Clockwise is 1; where both ways are as long, the side point chooses.
    turn = 1.0 if turned < 0.0 or (turned == 0.0 and left < 0.0) else -1.0
    return _arc(a, b, radius, -turn if far else turn)


@bare
def _arc(a, b, radius, turn):
    """Go around a circle in one sense, clockwise where `turn` is 1.

    A line from p touches the circle at (p radius^2 +- p' radius sqrt(|p|^2 - radius^2)) / |p|^2,
    with p' across p. The arc is radius times the angle between both points.
    """
    r = _touched(a, radius, turn)
    s = _touched(b, radius, -turn)
    turned = turn * _cross_product(r, s)
    angle = math.atan2(abs(turned), r[0] * s[0] + r[1] * s[1])
    if turned > 0.0:
        angle = 2.0 * math.pi - angle
    return _Arc(length=radius * angle, r=r, s=s)


@bare
def _touched(p, radius, turn):
    """Find where a line from p touches the circle, on the side that `turn` (1 or -1) names."""
    square = _square(p)
    h = turn * radius * math.sqrt(square - radius * radius)
    x = (p[0] * (radius * radius) + p[1] * h) / square
    y = (p[1] * (radius * radius) - p[0] * h) / square
    return x, y


@in_place
def _towards_side(a, b, radius, side):
    """Go around as `_around` with a side point outside, by the rule before MuJoCo 4.0."""
    none = _no_arc()
    if not _may_touch(a, b, radius):
        return none
    nearest = _nearest_to_center(a, b)
    on_side = side[0] * nearest[0] + side[1] * nearest[1] >= 0.0
    if _square(nearest) > radius * radius and on_side:
        return none
    best = none
    most = -2.0
    for turn in (1.0, -1.0):
        arc = _arc(a, b, radius, turn)
        x, y = _unit(arc.r[0] + arc.s[0], arc.r[1] + arc.s[1])
        towards = x * side[0] + y * side[1]
        # A way whose straight parts cross is none.
        if towards > most and not _cross(a, arc.r, b, arc.s):
            best = arc
            most = towards
    return best


@in_place
def _cross(a, r, b, s):
    """Whether the segments from a to r and from b to s have a point in common.

    With p = r - a and q = s - b, a + t p = b + u q for t and u from 0 to 1.
    """
    p = (r[0] - a[0], r[1] - a[1])
    q = (s[0] - b[0], s[1] - b[1])
    size = q[1] * p[0] - q[0] * p[1]
    if abs(size) < TINY:
        return False
    t = (q[0] * (a[1] - b[1]) - q[1] * (a[0] - b[0])) / size
    u = (p[0] * (a[1] - b[1]) - p[1] * (a[0] - b[0])) / size
    return 0.0 <= t <= 1.0 and 0.0 <= u <= 1.0


@in_place
def _touch_inside(a, b, radius):
    """Find where the path from a to b touches a ring from within, leaving at the angle it came in.

    Returns
    -------
    an arc of length 0
    """
    distance_a = math.hypot(a[0], a[1])
    distance_b = math.hypot(b[0], b[1])
    if distance_a <= radius or distance_b <= radius or radius < TINY:
        return _no_arc()
    d = (b[0] - a[0], b[1] - a[1])
    square = _square(d)
    if square > TINY:
        t = -(d[0] * a[0] + d[1] * a[1]) / square
        if 0.0 < t < 1.0 and math.hypot(a[0] + t * d[0], a[1] + t * d[1]) <= radius:
            return _no_arc()
    squares = distance_a * distance_a + distance_b * distance_b
    cosine = (squares - square) / (2.0 * distance_a * distance_b)
    if cosine < -1.0 + TINY:
        return _no_arc()
    unit_a = (a[0] / distance_a, a[1] / distance_a)
    unit_b = (b[0] / distance_b, b[1] / distance_b)
    if cosine > 1.0 - TINY:
        direction = _middle(a, b)
    elif _cross_product(a, b) > 0.0:
        direction = _contact(a, b, unit_a, radius / distance_a, radius / distance_b, cosine)
    else:
        direction = _contact(a, b, unit_b, radius / distance_b, radius / distance_a, cosine)
    contact = (radius * direction[0], radius * direction[1])
    return _Arc(length=0.0, r=contact, s=contact)


@bare
def _middle(a, b):
    """Direction of the middle of a and b."""
    return _unit(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))


@bare
def _contact(a, b, unit, ratio, other_ratio, cosine):
    """Direction of the point where a path touches a ring from within.

    Parameters
    ----------
    a, b : ends of the path [m]
    unit : direction of the end that the other lies counterclockwise of
    ratio, other_ratio : radius over distance, of that end and of the other
    cosine : of the angle between both ends
    """
    between = math.acos(cosine)
    # Without a root the points are too far round: the tie is broken in the middle.
    if math.asin(ratio) + math.asin(other_ratio) - math.pi + between > 0.0:
        return _middle(a, b)
    theta = _contact_angle(ratio, other_ratio, between)
    return _rotated(unit, theta - math.asin(ratio * math.sin(theta)))


@in_place
def _rotated(p, angle):
    """Rotate a vector of the plane counterclockwise."""
    cosine = math.cos(angle)
    sine = math.sin(angle)
    return cosine * p[0] - sine * p[1], sine * p[0] + cosine * p[1]


@in_place
def _contact_angle(ratio_a, ratio_b, between):
    """Find the angle between path and radius where a path touches a ring from within.

    With theta that angle, the law of sines in both triangles gives

        asin(r sin(theta) / |a|) + asin(r sin(theta) / |b|) + (angle between a and b) = 2 theta

    Parameters
    ----------
    ratio_a, ratio_b : r / |a| and r / |b|
    between : angle between a and b [rad]

    Returns
    -------
    theta, from 0 to pi / 2, by Newton's method with bisection [rad]
    """
    low = 0.0
    high = 0.5 * math.pi
    theta = high
    for _ in range(MAX_STEPS):
        sine = math.sin(theta)
        cosine = math.cos(theta)
        value = math.asin(ratio_a * sine) + math.asin(ratio_b * sine) - 2.0 * theta + between
        if value > 0.0:
            low = theta
        else:
            high = theta
        if abs(value) < ON_RING:
            break
        slope_a = ratio_a * cosine / math.sqrt(1.0 - ratio_a * ratio_a * sine * sine)
        slope_b = ratio_b * cosine / math.sqrt(1.0 - ratio_b * ratio_b * sine * sine)
        step = theta - value / (slope_a + slope_b - 2.0)
        theta = step if low < step < high else 0.5 * (low + high)
    return theta
