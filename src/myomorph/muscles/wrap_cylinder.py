"""The way around a cylinder as OpenSim defines it (`WrapCylinder`, 4.6), one segment at a time.

In the frame of the surface its axis is z and its middle the origin. The path of least length would
be a helix; OpenSim takes the tangent points of the projection along the axis, slides them along the
axis into the plane of both points and an apex of the cylinder, and joins them by a helix. Where a
path has several surfaces the points are slid on until the helix leaves at the angle of the straight
parts, to within 0.1 degrees.
"""

from __future__ import annotations

import math

from myomorph.muscles.vectors import EPSILON, along, cross, dot, inner, minus, norm, sign, unit

NO_WRAP, INSIDE, WRAPPED, MANDATORY = 0, 1, 2, 3
PARALLEL = 2e-13
CHORD = 0.002
TANGENCY = math.radians(0.1)
MOST_SLIDES = 100


@inner
def wrap_cylinder(a, b, radius, length, axis, side, single):
    """Where the segment from a to b meets and leaves the cylinder.

    Parameters
    ----------
    a, b : points in the frame of the cylinder [m]
    radius, length : [m]
    axis, side : the path may only touch the half where sign(component `axis`) is `side`; 0 for all
    single : the path has no other surface, so the points are not slid to tangency

    Returns
    -------
    code : NO_WRAP, INSIDE (a point lies in the infinite cylinder), WRAPPED or MANDATORY (the segment
        runs through the cylinder)
    arc : length on the surface [m]
    r, s : where the path meets and leaves the surface; only on WRAPPED and MANDATORY
    """
    rr = radius * radius
    da, db = math.hypot(a[0], a[1]), math.hypot(b[0], b[1])
    if da * da < rr or db * db < rr:
        return INSIDE, 0.0, a, b
    t, near = _nearest_to_axis(a, b)
    through = near[0] * near[0] + near[1] * near[1] < rr and 0.0 < t < 1.0
    code = MANDATORY if through else WRAPPED
    if side == 0:
        if not through:
            return NO_WRAP, 0.0, a, b
    elif (
        (sign(a[axis]) == side or sign(b[axis]) == side)
        and not through
        and not (sign(a[axis]) != sign(b[axis]) and sign(near[axis]) != side)
    ):
        return NO_WRAP, 0.0, a, b
    ra, rb = _tangents(a, da, radius)
    sa, sb = _tangents(b, db, radius)
    far, long = False, False
    if side == 0:
        r, s = _nearest_pair(ra, rb, sa, sb)
    else:
        # The angle from ra to sb against the one from rb to sa, by their cosines.
        wider = ra[0] * sb[0] + ra[1] * sb[1] < rb[0] * sa[0] + rb[1] * sa[1]
        on_a, on_b = sign(ra[axis]) == side, sign(rb[axis]) == side
        if on_a != on_b:
            first = on_a
        elif sign(sa[axis]) == side:
            first = False
        else:
            first = on_a or sign(sb[axis]) == side or wider
        r, s, far = (ra, sb, wider) if first else (rb, sa, not wider)
        reach = (r[0] - a[0] + s[0] - b[0], r[1] - a[1] + s[1] - b[1], r[2] - a[2] + s[2] - b[2])
        long = reach[0] * (r[0] + s[0]) + reach[1] * (r[1] + s[1]) < 0.0
    r, s = _slide_to_plane(a, b, da, db, r, s, radius, far)
    half = 0.5 * length
    if abs(r[2]) > half and abs(s[2]) > half:
        return NO_WRAP, 0.0, a, b
    arc, r, s = _helix(a, b, r, s, radius, long, single)
    return code, arc, r, s


@inner
def _nearest_to_axis(a, b):
    """Point of the line through a and b nearest to the z axis, and its place from a (0) to b (1)."""
    d = minus(b, a)
    v = unit(d)
    denominator = v[0] * v[0] + v[1] * v[1]
    if denominator <= PARALLEL:
        return math.nan, (math.nan, math.nan, math.nan)
    s = -(a[0] * v[0] + a[1] * v[1]) / denominator
    return s / norm(d), along(a, s, v)


@inner
def _tangents(p, distance, radius):
    """Both points where lines across the axis through p touch the circle at p's height."""
    x, y = p[0] / distance, p[1] / distance
    foot = radius * (radius / distance)
    h = math.sqrt(max(0.0, radius * radius - foot * foot))
    return (foot * x - h * y, foot * y + h * x, p[2]), (foot * x + h * y, foot * y - h * x, p[2])


@inner
def _nearest_pair(ra, rb, sa, sb):
    """Of the tangent points, the pair with the smallest angle about the axis."""
    aa, ab = ra[0] * sa[0] + ra[1] * sa[1], ra[0] * sb[0] + ra[1] * sb[1]
    ba, bb = rb[0] * sa[0] + rb[1] * sa[1], rb[0] * sb[0] + rb[1] * sb[1]
    if aa > ab and aa > ba and aa > bb:
        return ra, sa
    if ab > ba and ab > bb:
        return ra, sb
    if ba > bb:
        return rb, sa
    return rb, sb


@inner
def _slide_to_plane(a, b, da, db, r, s, radius, far):
    """Move r and s along the axis into the plane of a, b and the cylinder's apex."""
    middle = along(a, da / (da + db), minus(b, a))
    foot = (0.0, 0.0, middle[2])
    n = unit(cross(unit(minus(a, foot)), unit(minus(b, foot))))
    out = unit((-n[1], n[0], 0.0))
    one, other = along(foot, radius, out), along(foot, -radius, out)
    to_one, to_other = minus(middle, one), minus(middle, other)
    first_is_near = dot(to_one, to_one) < dot(to_other, to_other)
    apex = one if first_is_near != far else other
    n = unit(cross(unit(minus(a, apex)), unit(minus(b, apex))))
    if abs(20.0 * n[2]) < 1e-5:
        return r, s
    reach, span = 10.0 * (1.0 + 2e-5), (b[2] - a[2]) * (b[2] - a[2])
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
    """Length of the helix from r to s, slid to tangency unless `single`, and its ends."""
    slides = 0
    while True:
        rise = s[2] - r[2]
        angle = math.atan2(r[0] * s[1] - r[1] * s[0], r[0] * s[0] + r[1] * s[1])
        if long:
            angle = 2.0 * math.pi - angle
        arc = math.hypot(radius * angle, rise)
        chords = int(arc / CHORD)
        if single or chords < 2 or slides >= MOST_SLIDES:
            return arc, r, s
        turn = -angle if long else angle
        t = 1.0 / chords
        slid_r, r_new = _slide_to_tangency(a, r, _on_helix(r, t * turn, t * rise))
        # The other end is compared with the helix of the new r, as OpenSim does.
        slid_s, s_new = _slide_to_tangency(b, s, _on_helix(r_new, (1.0 - t) * turn, (1.0 - t) * rise))
        if not slid_r and not slid_s:
            return arc, r, s
        r, s = r_new, s_new
        slides += 1


@inner
def _on_helix(r, turn, rise):
    c, s = math.cos(turn), math.sin(turn)
    return c * r[0] - s * r[1], s * r[0] + c * r[1], r[2] + rise


@inner
def _slide_to_tangency(p, r, w):
    """Slide r along the axis where the line from p and the helix towards w do not meet at one angle."""
    v, u = unit(minus(r, p)), unit(minus(w, r))
    if not abs(math.acos(min(1.0, max(-1.0, v[2]))) - math.acos(min(1.0, max(-1.0, u[2])))) > TANGENCY:
        return False, r
    d, along_axis = unit(minus(w, p)), 1.0 if w[2] > p[2] else -1.0
    if abs(w[2] - p[2]) < EPSILON:
        return False, r
    # Nearest point, on the line through r along the axis, to the line from p to w.
    n = cross(d, (0.0, 0.0, along_axis))
    denominator = dot(n, n)
    if denominator <= PARALLEL:
        return False, r
    start = (r[0], r[1], p[2])
    t = dot(cross(minus(start, p), d), n) / denominator
    return True, (r[0], r[1], r[2] + 1.5 * (start[2] + t * along_axis - r[2]))
