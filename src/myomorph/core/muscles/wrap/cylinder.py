"""Wrapping around a cylinder as OpenSim defines it (`WrapCylinder`, 4.6), one segment at a time.

In the frame of the surface its axis is z and its middle the origin. The path of least length would
be a helix; OpenSim takes the tangent points of the projection along the axis, slides them along the
axis into the plane of both points and an apex of the cylinder, and joins them by a helix. Where a
path has several surfaces the points are slid on until the helix leaves at the angle of the straight
parts, to within 0.1 degrees.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.muscles.wrap.surface import (
    INSIDE,
    MANDATORY,
    NO_WRAP,
    WRAPPED,
    Vector,
    Wrap,
    missed,
    nearest_pair,
    on_half,
)
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import EPSILON, along, cross, dot, minus, norm, unit

PARALLEL = 2e-13  # Square of the sine of a direction that counts as parallel to the axis
CHORD = 0.002  # Length of the parts of a helix [m]
TANGENCY = math.radians(0.1)  # Difference of angles at which sliding ends [rad]
MAX_SLIDES = 100


class _Ends(NamedTuple):
    """A segment beside a cylinder.

    Attributes
    ----------
    a, b : its ends [m]
    distance_a, distance_b : of the ends from the axis [m]
    """

    a: Vector
    b: Vector
    distance_a: float
    distance_b: float


class _View(NamedTuple):
    """A point p, a tangent point q and a point w of the circle, seen along the axis.

    Sliding along the axis leaves this as it is.

    Attributes
    ----------
    pq, qw, pw : squares of the distances [m^2]
    share : of the way from p to w at which the point nearest to q lies
    """

    pq: float
    qw: float
    pw: float
    share: float


@bare
def wrap_cylinder(a, b, size, half, single):
    """Wrap the segment from a to b around a cylinder.

    Parameters
    ----------
    a, b : points in the frame of the cylinder [m]
    size : radius and length of the cylinder [m]
    half : `Half` that the path may touch
    single : whether the path has no other surface, so that points are not slid to tangency

    Returns
    -------
    `Wrap`; `INSIDE` is a point within the infinite cylinder
    """
    radius, length = size
    square = radius * radius
    ends = _Ends(a=a, b=b, distance_a=_distance(a), distance_b=_distance(b))
    if ends.distance_a * ends.distance_a < square or ends.distance_b * ends.distance_b < square:
        return missed(INSIDE, a, b)
    t, nearest = _nearest_to_axis(a, b)
    through = nearest[0] * nearest[0] + nearest[1] * nearest[1] < square and 0.0 < t < 1.0
    if not through and not _may_wrap(a, b, nearest, half):
        return missed(NO_WRAP, a, b)

    of_a = _tangents(a, ends.distance_a, radius)
    of_b = _tangents(b, ends.distance_b, radius)
    far = False
    long = False
    if half.side == 0:
        r, s = _nearest_tangents(of_a, of_b)
    else:
        r, s, far = _tangents_on_half(of_a, of_b, half)
        long = _goes_the_long_way(a, b, r, s)
    r, s = _slide_to_plane(ends, r, s, radius, far)
    if abs(r[2]) > 0.5 * length and abs(s[2]) > 0.5 * length:
        return missed(NO_WRAP, a, b)
    arc, r, s = _helix(ends, r, s, radius, _turn(r, s, long), single)
    return Wrap(code=MANDATORY if through else WRAPPED, arc=arc, r=r, s=s)


@bare
def _distance(p):
    """Distance of a point from the axis [m]."""
    return math.sqrt(p[0] * p[0] + p[1] * p[1])


@in_place
def _may_wrap(a, b, nearest, half):
    """Return whether a segment beside the cylinder is to be bent around its half.

    It is where no end lies on the side of the half, or where one does and the point of the segment
    nearest to the axis does not.
    """
    if half.side == 0:
        return False
    a_on = on_half(a, half)
    b_on = on_half(b, half)
    if not a_on and not b_on:
        return True
    return a_on != b_on and not on_half(nearest, half)


@in_place
def _nearest_tangents(of_a, of_b):
    """Choose the pair of tangent points with the least angle between them.

    Parameters
    ----------
    of_a, of_b : two tangent points of lines from either end
    """
    ra, rb = of_a
    sa, sb = of_b
    r_first, s_first = nearest_pair(
        _flat_dot(ra, sa), _flat_dot(ra, sb), _flat_dot(rb, sa), _flat_dot(rb, sb)
    )
    r = ra if r_first else rb
    s = sa if s_first else sb
    return r, s


@bare
def _flat_dot(p, q):
    """Scalar product across the axis."""
    return p[0] * q[0] + p[1] * q[1]


@in_place
def _tangents_on_half(of_a, of_b, half):
    """Choose the pair of tangent points that leads around a half.

    Parameters
    ----------
    of_a, of_b : as of `_nearest_tangents`

    Returns
    -------
    both points, and whether the other pair has the lesser angle between its points
    """
    ra, rb = of_a
    sa, sb = of_b
    # The angle from ra to sb against the one from rb to sa, by their cosines.
    wider = _flat_dot(ra, sb) < _flat_dot(rb, sa)
    on_a = on_half(ra, half)
    on_b = on_half(rb, half)
    if on_a != on_b:
        first = on_a
    elif on_half(sa, half):
        first = False
    else:
        first = on_a or on_half(sb, half) or wider
    if first:
        return ra, sb, wider
    return rb, sa, not wider


@in_place
def _goes_the_long_way(a, b, r, s):
    """Return whether the straight parts a r and s b lead away from the middle of r and s."""
    x = r[0] - a[0] + s[0] - b[0]
    y = r[1] - a[1] + s[1] - b[1]
    return x * (r[0] + s[0]) + y * (r[1] + s[1]) < 0.0


@in_place
def _nearest_to_axis(a, b):
    """Find the point of a line nearest to the z axis, after its share of the way from a to b."""
    d = minus(b, a)
    v = unit(d)
    denominator = v[0] * v[0] + v[1] * v[1]
    if denominator <= PARALLEL:
        return math.nan, (math.nan, math.nan, math.nan)
    s = -(a[0] * v[0] + a[1] * v[1]) / denominator
    return s / norm(d), along(a, s, v)


@bare
def _tangents(p, distance, radius):
    """Find both points where lines across the axis through p touch the circle at p's height."""
    x = p[0] / distance
    y = p[1] / distance
    foot = radius * (radius / distance)
    h = math.sqrt(max(0.0, radius * radius - foot * foot))
    return (foot * x - h * y, foot * y + h * x, p[2]), (foot * x + h * y, foot * y - h * x, p[2])


@in_place
def _apex(ends, radius, far):
    """Find the point of the surface that a, b and the path have a plane with.

    It lies at the height at which the segment is divided in the ratio of its ends' distances, on
    the side of the segment, or with `far` on the other.
    """
    share = ends.distance_a / (ends.distance_a + ends.distance_b)
    middle = along(ends.a, share, minus(ends.b, ends.a))
    foot = (0.0, 0.0, middle[2])
    n = unit(cross(unit(minus(ends.a, foot)), unit(minus(ends.b, foot))))
    out = unit((-n[1], n[0], 0.0))
    one = along(foot, radius, out)
    other = along(foot, -radius, out)
    to_one = minus(middle, one)
    to_other = minus(middle, other)
    first_is_near = dot(to_one, to_one) < dot(to_other, to_other)
    return one if first_is_near != far else other


@in_place
def _slide_to_plane(ends, r, s, radius, far):
    """Move r and s along the axis into the plane of a, b and the cylinder's apex.

    With n the normal of the plane, z = r_z - n . (r - a) / n_z; so for s and b.
    """
    a = ends.a
    b = ends.b
    apex = _apex(ends, radius, far)
    n = unit(cross(unit(minus(a, apex)), unit(minus(b, apex))))
    if abs(20.0 * n[2]) < 1e-5:
        return r, s
    limit = 10.0 * (1.0 + 2e-5)
    span = (b[2] - a[2]) * (b[2] - a[2])
    # OpenSim measures from a in the direction of b's foot on the axis, which is no direction at 0.
    degenerate = abs(b[2]) < EPSILON
    z = r[2] - dot(n, minus(r, a)) / n[2]
    seen = a[2] if degenerate else z
    if abs(z - r[2]) <= limit and (seen - b[2]) * (seen - b[2]) < span:
        r = (r[0], r[1], z)
    z = s[2] - dot(n, minus(s, a)) / n[2]
    seen = a[2] if degenerate else z
    if abs(z - s[2]) <= limit and (seen - a[2]) * (seen - a[2]) < span:
        s = (s[0], s[1], z)
    return r, s


@in_place
def _turn(r, s, long):
    """Angle about the axis from r to s [rad], with its sign.

    On the long way, which has the other sense, it is 2 pi less the angle of the short way, which
    there counts with its sign.
    """
    angle = math.atan2(r[0] * s[1] - r[1] * s[0], r[0] * s[0] + r[1] * s[1])
    return -(2.0 * math.pi - angle) if long else angle


@in_place
def _helix(ends, r, s, radius, turn, single):
    """Compute the length of the helix from r to s, slid to tangency unless `single`, and its ends.

    Of the angle phi and the height z it is sqrt((radius phi)^2 + z^2).

    Parameters
    ----------
    turn : of `_turn`
    """
    a = ends.a
    b = ends.b
    z = r[2]
    y = s[2]
    arc = _helix_length(radius * turn, y - z)
    slides = 0 if not single else MAX_SLIDES
    known = 0
    t = 0.0
    at_r = _View(pq=0.0, qw=0.0, pw=0.0, share=0.0)
    at_s = at_r
    while slides < MAX_SLIDES and arc >= 2.0 * CHORD:
        chords = int(arc / CHORD)
        if chords != known:
            known = chords
            t = 1.0 / chords
            at_r = _flat_view(a, r, r, t * turn)
            at_s = _flat_view(b, s, r, (1.0 - t) * turn)
        slid_r, new_z = _slide_to_tangency(a[2], z, z + t * (y - z), at_r)
        # The other end is compared with the helix of the new r, as OpenSim does.
        slid_s, new_y = _slide_to_tangency(b[2], y, new_z + (1.0 - t) * (y - z), at_s)
        if not slid_r and not slid_s:
            break
        z = new_z
        y = new_y
        arc = _helix_length(radius * turn, y - z)
        slides += 1
    return arc, (r[0], r[1], z), (s[0], s[1], y)


@bare
def _helix_length(flat, rise):
    """Length of a helix from its length along the circle and its rise [m]."""
    return math.sqrt(flat * flat + rise * rise)


@bare
def _flat_view(p, q, r, turn):
    """View p, q and the point w to which `turn` rotates r, along the axis: `_View`."""
    cosine = math.cos(turn)
    sine = math.sin(turn)
    w0 = cosine * r[0] - sine * r[1]
    w1 = sine * r[0] + cosine * r[1]
    q0 = q[0] - p[0]
    q1 = q[1] - p[1]
    d0 = w0 - p[0]
    d1 = w1 - p[1]
    pw = d0 * d0 + d1 * d1
    return _View(
        pq=q0 * q0 + q1 * q1,
        qw=(w0 - q[0]) ** 2 + (w1 - q[1]) ** 2,
        pw=pw,
        share=(q0 * d0 + q1 * d1) / pw if pw > 0.0 else 0.0,
    )


@bare
def _slide_to_tangency(p, q, w, view):
    """Slide a tangent point where the line to it and the helix from it meet at another angle.

    Parameters
    ----------
    p, q, w : heights along the axis of the outer point, the tangent point and one on the helix [m]
    view : of `_flat_view`

    Returns
    -------
    whether it slid, and the height of the tangent point after [m]
    """
    into = q - p
    away = w - q
    v = into / math.sqrt(view.pq + into * into)
    u = away / math.sqrt(view.qw + away * away)
    # acos is steep: only cosines this near need their angles.
    slides = abs(v - u) > TANGENCY or abs(math.acos(v) - math.acos(u)) > TANGENCY
    crosses_axis = view.pw > PARALLEL * (view.pw + (w - p) * (w - p))
    if slides and abs(w - p) >= EPSILON and crosses_axis:
        # To the height of the line from p to w where it passes the tangent point, and half as far
        # again.
        return True, q + 1.5 * (p + view.share * (w - p) - q)
    return False, q
