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

from myomorph.core.rigid.kernels import inner, kernel
from myomorph.core.rigid.vectors import cross, dot, minus, norm

SPHERE = 0
CYLINDER = 1
# Rules of side points: without one, those of MuJoCo before 4.0, those since
NO_SIDE = 0
BEFORE_FOUR = 3
FOUR = 4
TINY = 1e-15


@kernel
def wrap_tendon(p0, p1, kind, radius, R, x, side, rule, out):
    """Wrap a tendon around a surface between two points, all in one frame.

    Parameters
    ----------
    p0, p1 : (3,) points before and after the surface [m]
    kind : `SPHERE` or `CYLINDER` (infinite, its axis is the third column of `R`)
    radius : of the surface [m]
    R, x : (3, 3), (3,) pose of the surface
    side : (3,) side point; not read without one [m]
    rule : `NO_SIDE`, `BEFORE_FOUR` or `FOUR`
    out : (2, 3) filled with the points where the path meets and leaves the surface [m]

    Returns
    -------
    length of the arc [m], or -1 where the path does not touch the surface; then `out` is left
    """
    a = minus(p0, x)
    b = minus(p1, x)
    la = norm(a)
    if la < TINY or dot(b, b) < TINY * TINY:
        return -1.0
    if kind == SPHERE:
        e = (a[0] / la, a[1] / la, a[2] / la)
        f = cross(_plane_normal(e, a, b), e)
    else:
        e = (R[0, 0], R[1, 0], R[2, 0])
        f = (R[0, 1], R[1, 1], R[2, 1])
    ax = dot(a, e)
    ay = dot(a, f)
    bx = dot(b, e)
    by = dot(b, f)
    sx = 0.0
    sy = 0.0
    within = False
    if rule != NO_SIDE:
        s = minus(side, x)
        sx, sy = _unit(dot(s, e), dot(s, f))
        within = dot(s, s) < radius * radius
    if within:
        result, tx, ty = _touch_inside(ax, ay, bx, by, radius)
        arc = 0.0
        ux = tx
        uy = ty
    else:
        if rule == BEFORE_FOUR:
            arc, tx, ty, ux, uy = _towards_side(ax, ay, bx, by, radius, sx, sy)
        else:
            arc, tx, ty, ux, uy = _around(ax, ay, bx, by, radius, sx, sy, rule == FOUR)
        result = arc >= 0.0
    if not result:
        return -1.0
    z = 0.0
    w = 0.0
    h = 0.0
    if kind == CYLINDER:
        axis = (R[0, 2], R[1, 2], R[2, 2])
        za = dot(a, axis)
        rise = dot(b, axis) - za
        before = math.hypot(tx - ax, ty - ay)
        after = math.hypot(ux - bx, uy - by)
        h = rise * arc / (before + arc + after)
        z = za + rise * before / (before + arc + after)
        w = z + h
    for end in range(2):
        for i in range(3):
            out[end, i] = x[i] + tx * e[i] + ty * f[i] + z * R[i, 2]
        tx = ux
        ty = uy
        z = w
    return math.sqrt(arc * arc + h * h)


@inner
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


@inner
def _unit(x, y):
    """Scale a vector of the plane to norm 1; (1, 0) for one without norm."""
    length = math.hypot(x, y)
    if length < TINY:
        return 1.0, 0.0
    return x / length, y / length


@inner
def _around(ax, ay, bx, by, r, sx, sy, has_side):
    """Go around the outside of a circle: length of the arc, -1 for no wrap, and its two ends."""
    aa = ax * ax + ay * ay
    bb = bx * bx + by * by
    rr = r * r
    dx = bx - ax
    dy = by - ay
    dd = dx * dx + dy * dy
    if aa < rr or bb < rr or r < TINY or dd < TINY:
        return -1.0, 0.0, 0.0, 0.0, 0.0
    turned = ax * by - ay * bx
    left = ax * sy - ay * sx
    right = sx * by - sy * bx
    far = has_side and left * turned < 0.0 and right * turned < 0.0
    if not far:
        t = min(1.0, max(0.0, -(dx * ax + dy * ay) / dd))
        nx = ax + t * dx
        ny = ay + t * dy
        if nx * nx + ny * ny > rr:
            return -1.0, 0.0, 0.0, 0.0, 0.0
    # Clockwise is 1; where both ways are as long, the side point chooses.
    turn = 1.0 if turned < 0.0 or (turned == 0.0 and left < 0.0) else -1.0
    if far:
        turn = -turn
    return _arc(ax, ay, bx, by, r, turn)


@inner
def _arc(ax, ay, bx, by, r, turn):
    """Go around a circle in one sense, clockwise where `turn` is 1: length of the arc, its ends."""
    aa = ax * ax + ay * ay
    bb = bx * bx + by * by
    rr = r * r
    ha = turn * r * math.sqrt(aa - rr)
    hb = turn * r * math.sqrt(bb - rr)
    tx = (ax * rr + ay * ha) / aa
    ty = (ay * rr - ax * ha) / aa
    ux = (bx * rr - by * hb) / bb
    uy = (by * rr + bx * hb) / bb
    turned = turn * (tx * uy - ty * ux)
    angle = math.atan2(abs(turned), tx * ux + ty * uy)
    if turned > 0.0:
        angle = 2.0 * math.pi - angle
    return r * angle, tx, ty, ux, uy


@inner
def _towards_side(ax, ay, bx, by, r, sx, sy):
    """Go around as `_around` with a side point outside, by the rule before MuJoCo 4.0."""
    none = (-1.0, 0.0, 0.0, 0.0, 0.0)
    rr = r * r
    dx = bx - ax
    dy = by - ay
    dd = dx * dx + dy * dy
    if ax * ax + ay * ay < rr or bx * bx + by * by < rr or r < TINY or dd < TINY:
        return none
    t = min(1.0, max(0.0, -(dx * ax + dy * ay) / dd))
    nx = ax + t * dx
    ny = ay + t * dy
    if nx * nx + ny * ny > rr and sx * nx + sy * ny >= 0.0:
        return none
    best = none
    most = -2.0
    for turn in (1.0, -1.0):
        result = _arc(ax, ay, bx, by, r, turn)
        mx, my = _unit(result[1] + result[3], result[2] + result[4])
        # A way whose straight parts cross is none.
        if mx * sx + my * sy > most and not _cross(
            ax, ay, result[1], result[2], bx, by, result[3], result[4]
        ):
            best = result
            most = mx * sx + my * sy
    return best


@inner
def _cross(ax, ay, tx, ty, bx, by, ux, uy):
    """Whether the segments from a to t and from b to u have a point in common."""
    px = tx - ax
    py = ty - ay
    qx = ux - bx
    qy = uy - by
    size = qy * px - qx * py
    if abs(size) < TINY:
        return False
    along = (qx * (ay - by) - qy * (ax - bx)) / size
    other = (px * (ay - by) - py * (ax - bx)) / size
    return 0.0 <= along <= 1.0 and 0.0 <= other <= 1.0


@inner
def _touch_inside(ax, ay, bx, by, r):
    """Find where the path from a to b touches a ring from within, leaving at the angle it came in.

    With theta the angle between path and radius at the point of contact, the law of sines in both
    triangles gives

        asin(r sin(theta) / |a|) + asin(r sin(theta) / |b|) + (angle between a and b) = 2 theta

    Returns
    -------
    whether there is such a point, x and y [m]
    """
    la = math.hypot(ax, ay)
    lb = math.hypot(bx, by)
    dx = bx - ax
    dy = by - ay
    dd = dx * dx + dy * dy
    if la <= r or lb <= r or r < TINY:
        return False, 0.0, 0.0
    if dd > TINY:
        t = -(dx * ax + dy * ay) / dd
        if 0.0 < t < 1.0 and math.hypot(ax + t * dx, ay + t * dy) <= r:
            return False, 0.0, 0.0
    cosine = (la * la + lb * lb - dd) / (2.0 * la * lb)
    if cosine < -1.0 + TINY:
        return False, 0.0, 0.0
    mx, my = _unit(0.5 * (ax + bx), 0.5 * (ay + by))
    if cosine > 1.0 - TINY:
        return True, r * mx, r * my
    between = math.acos(cosine)
    A = r / la
    B = r / lb
    low = 0.0
    high = 0.5 * math.pi
    # Without a root the points are too far round: the tie is broken in the middle.
    if math.asin(A) + math.asin(B) - 2.0 * high + between > 0.0:
        return True, r * mx, r * my
    theta = high
    for _ in range(60):
        s = math.sin(theta)
        c = math.cos(theta)
        value = math.asin(A * s) + math.asin(B * s) - 2.0 * theta + between
        if value > 0.0:
            low = theta
        else:
            high = theta
        if abs(value) < 1e-14:
            break
        slope = (
            A * c / math.sqrt(1.0 - A * A * s * s) + B * c / math.sqrt(1.0 - B * B * s * s) - 2.0
        )
        step = theta - value / slope
        theta = step if low < step < high else 0.5 * (low + high)
    s = math.sin(theta)
    if ax * by - ay * bx > 0.0:
        x = ax / la
        y = ay / la
        turn = theta - math.asin(A * s)
    else:
        x = bx / lb
        y = by / lb
        turn = theta - math.asin(B * s)
    c = math.cos(turn)
    s = math.sin(turn)
    return True, r * (c * x - s * y), r * (s * x + c * y)
