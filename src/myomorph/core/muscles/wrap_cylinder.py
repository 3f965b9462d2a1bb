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

from myomorph.core.rigid.kernels import inner
from myomorph.core.rigid.vectors import EPSILON, along, cross, dot, minus, norm, sign, unit

# OpenSim's results of a wrap: none; a point lies within the surface; wrapped; the segment runs
# through the surface
NO_WRAP = 0
INSIDE = 1
WRAPPED = 2
MANDATORY = 3
PARALLEL = 2e-13  # Square of the sine of a direction that counts as parallel to the axis
CHORD = 0.002  # Length of the parts of a helix [m]
TANGENCY = math.radians(0.1)  # Difference of angles at which sliding ends [rad]
MAX_SLIDES = 100


class Half(NamedTuple):
    """Half of a surface that a path may touch: where sign(component `axis`) is `side`.

    Attributes
    ----------
    axis : 0, 1 or 2 in the frame of the surface
    side : 1 or -1; 0 for the whole surface
    """

    axis: int
    side: int


@inner
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
    code : `NO_WRAP`, `INSIDE` (a point lies in the infinite cylinder), `WRAPPED` or `MANDATORY`
        (the segment runs through the cylinder)
    arc : length on the surface [m]
    r, s : points where the path meets and leaves the surface [m]; a and b where it does not
    """
    radius, length = size
    rr = radius * radius
    da = math.sqrt(a[0] * a[0] + a[1] * a[1])
    db = math.sqrt(b[0] * b[0] + b[1] * b[1])
    if da * da < rr or db * db < rr:
        return INSIDE, 0.0, a, b
    t, near = _nearest_to_axis(a, b)
    through = near[0] * near[0] + near[1] * near[1] < rr and 0.0 < t < 1.0
    if not through and not _may_wrap(a, b, near, half):
        return NO_WRAP, 0.0, a, b
    of_a = _tangents(a, da, radius)
    of_b = _tangents(b, db, radius)
    far = False
    long = False
    if half.side == 0:
        r, s = _nearest_tangents(of_a, of_b)
    else:
        r, s, far = _tangents_on_half(of_a, of_b, half)
        long = _goes_the_long_way(a, b, r, s)
    r, s = _slide_to_plane(a, b, da, db, r, s, radius, far)
    if abs(r[2]) > 0.5 * length and abs(s[2]) > 0.5 * length:
        return NO_WRAP, 0.0, a, b
    arc, r, s = _helix(a, b, r, s, radius, long, single)
    return MANDATORY if through else WRAPPED, arc, r, s


@inner
def _may_wrap(a, b, near, half):
    """Return whether a segment beside the cylinder is to be bent around its half.

    It is where no end lies on the side of the half, or where one does and the point of the segment
    nearest to the axis does not.
    """
    if half.side == 0:
        return False
    side_a = sign(a[half.axis])
    side_b = sign(b[half.axis])
    if side_a != half.side and side_b != half.side:
        return True
    return side_a != side_b and sign(near[half.axis]) != half.side


@inner
def _nearest_tangents(of_a, of_b):
    """Choose the pair of tangent points with the least angle between them.

    Parameters
    ----------
    of_a, of_b : two tangent points of lines from either end
    """
    ra, rb = of_a
    sa, sb = of_b
    first = ra[0] * sa[0] + ra[1] * sa[1]
    other = ra[0] * sb[0] + ra[1] * sb[1]
    r_first, s_first = nearest_pair(
        first, other, rb[0] * sa[0] + rb[1] * sa[1], rb[0] * sb[0] + rb[1] * sb[1]
    )
    return ra if r_first else rb, sa if s_first else sb


@inner
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
    wider = ra[0] * sb[0] + ra[1] * sb[1] < rb[0] * sa[0] + rb[1] * sa[1]
    on_a = sign(ra[half.axis]) == half.side
    on_b = sign(rb[half.axis]) == half.side
    if on_a != on_b:
        first = on_a
    elif sign(sa[half.axis]) == half.side:
        first = False
    else:
        first = on_a or sign(sb[half.axis]) == half.side or wider
    if first:
        return ra, sb, wider
    return rb, sa, not wider


@inner
def _goes_the_long_way(a, b, r, s):
    """Return whether the straight parts a r and s b lead away from the middle of r and s."""
    x = r[0] - a[0] + s[0] - b[0]
    y = r[1] - a[1] + s[1] - b[1]
    return x * (r[0] + s[0]) + y * (r[1] + s[1]) < 0.0


@inner
def _nearest_to_axis(a, b):
    """Find the point of a line nearest to the z axis, after its share of the way from a to b."""
    d = minus(b, a)
    v = unit(d)
    denominator = v[0] * v[0] + v[1] * v[1]
    if denominator <= PARALLEL:
        return math.nan, (math.nan, math.nan, math.nan)
    s = -(a[0] * v[0] + a[1] * v[1]) / denominator
    return s / norm(d), along(a, s, v)


@inner
def _tangents(p, distance, radius):
    """Find both points where lines across the axis through p touch the circle at p's height."""
    x = p[0] / distance
    y = p[1] / distance
    foot = radius * (radius / distance)
    h = math.sqrt(max(0.0, radius * radius - foot * foot))
    return (foot * x - h * y, foot * y + h * x, p[2]), (foot * x + h * y, foot * y - h * x, p[2])


@inner
def nearest_pair(aa, ab, ba, bb):
    """Choose the nearest pair of two tangent points a, b at either end, by cosines of all pairs.

    Returns
    -------
    whether the pair has a at the first end, and at the second
    """
    if aa > ab and aa > ba and aa > bb:
        return True, True
    if ab > ba and ab > bb:
        return True, False
    return False, ba > bb


@inner
def _apex(a, b, da, db, radius, far):
    """Find the point of the surface that a, b and the path have a plane with.

    It lies at the height at which the segment is divided in the ratio of its ends' distances, on
    the side of the segment, or with `far` on the other.

    Parameters
    ----------
    a, b : ends of the segment [m]
    da, db : their distances from the axis [m]
    """
    middle = along(a, da / (da + db), minus(b, a))
    foot = (0.0, 0.0, middle[2])
    n = unit(cross(unit(minus(a, foot)), unit(minus(b, foot))))
    out = unit((-n[1], n[0], 0.0))
    one = along(foot, radius, out)
    other = along(foot, -radius, out)
    to_one = minus(middle, one)
    to_other = minus(middle, other)
    first_is_near = dot(to_one, to_one) < dot(to_other, to_other)
    return one if first_is_near != far else other


@inner
def _slide_to_plane(a, b, da, db, r, s, radius, far):
    """Move r and s along the axis into the plane of a, b and the cylinder's apex."""
    apex = _apex(a, b, da, db, radius, far)
    n = unit(cross(unit(minus(a, apex)), unit(minus(b, apex))))
    if abs(20.0 * n[2]) < 1e-5:
        return r, s
    reach = 10.0 * (1.0 + 2e-5)
    span = (b[2] - a[2]) * (b[2] - a[2])
    # OpenSim measures from a in the direction of b's foot on the axis, which is no direction at 0.
    degenerate = abs(b[2]) < EPSILON
    z = r[2] - dot(n, minus(r, a)) / n[2]
    seen = a[2] if degenerate else z
    if abs(z - r[2]) <= reach and (seen - b[2]) * (seen - b[2]) < span:
        r = (r[0], r[1], z)
    z = s[2] - dot(n, minus(s, a)) / n[2]
    seen = a[2] if degenerate else z
    if abs(z - s[2]) <= reach and (seen - a[2]) * (seen - a[2]) < span:
        s = (s[0], s[1], z)
    return r, s


@inner
def _helix(a, b, r, s, radius, long, single):
    """Compute the length of the helix from r to s, slid to tangency unless `single`, and its ends.

    Of the angle phi and the height z it is sqrt((radius phi)^2 + z^2).
    """
    angle = math.atan2(r[0] * s[1] - r[1] * s[0], r[0] * s[0] + r[1] * s[1])
    if long:
        angle = 2.0 * math.pi - angle
    turn = -angle if long else angle
    z = r[2]
    y = s[2]
    arc = _helix_length(radius * angle, y - z)
    slides = 0 if not single else MAX_SLIDES
    known = 0
    t = 0.0
    at_r = (0.0, 0.0, 0.0, 0.0)
    at_s = (0.0, 0.0, 0.0, 0.0)
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
        arc = _helix_length(radius * angle, y - z)
        slides += 1
    return arc, (r[0], r[1], z), (s[0], s[1], y)


@inner
def _helix_length(flat, rise):
    """Length of a helix from its length along the circle and its rise [m]."""
    return math.sqrt(flat * flat + rise * rise)


@inner
def _flat_view(p, q, r, turn):
    """View a point p, a tangent point q, and w, which is r turned by `turn`, along the axis.

    Sliding leaves this as it is.

    Returns
    -------
    squares of the distances p q, q w and p w, and the share of the way from p to w at which the
    point nearest to q lies
    """
    c = math.cos(turn)
    s = math.sin(turn)
    w0 = c * r[0] - s * r[1]
    w1 = s * r[0] + c * r[1]
    q0 = q[0] - p[0]
    q1 = q[1] - p[1]
    d0 = w0 - p[0]
    d1 = w1 - p[1]
    pw = d0 * d0 + d1 * d1
    share = (q0 * d0 + q1 * d1) / pw if pw > 0.0 else 0.0
    return q0 * q0 + q1 * q1, (w0 - q[0]) ** 2 + (w1 - q[1]) ** 2, pw, share


@inner
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
    pq, qw, pw, share = view
    into = q - p
    away = w - q
    v = into / math.sqrt(pq + into * into)
    u = away / math.sqrt(qw + away * away)
    # acos is steep: only cosines this near need their angles.
    slides = abs(v - u) > TANGENCY or abs(math.acos(v) - math.acos(u)) > TANGENCY
    if slides and abs(w - p) >= EPSILON and pw > PARALLEL * (pw + (w - p) * (w - p)):
        # To the height of the line from p to w where it passes the tangent point, and half as far
        # again.
        return True, q + 1.5 * (p + share * (w - p) - q)
    return False, q
