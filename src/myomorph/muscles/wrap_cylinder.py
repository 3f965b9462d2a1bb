"""The way around cylinders, spheres and tori as OpenSim defines it (`WrapCylinder`, 4.6), one segment at a time.

In the frame of the surface its axis is z and its middle the origin. The path of least length would be a helix; OpenSim
takes the tangent points of the projection along the axis, slides them along the axis into the plane of both points and
an apex of the cylinder, and joins them by a helix. Where a path has several surfaces the points are slid on until the
helix leaves at the angle of the straight parts, to within 0.1 degrees.

Through a torus (`WrapTorus`) OpenSim looks for the point of the torus's circle nearest to the segment, puts a long
cylinder there along the circle, and wraps around that cylinder. The search is MINPACK's least squares in one unknown
with loose tolerances, which decide where it stops; so the same steps are taken here.
"""

from __future__ import annotations

import math

from myomorph.rigid.kernels import inner
from myomorph.rigid.vectors import EPSILON, along, cross, dot, minus, norm, sign, unit

NO_WRAP, INSIDE, WRAPPED, MANDATORY = 0, 1, 2, 3
PARALLEL = 2e-13
CHORD = 0.002
TANGENCY = math.radians(0.1)
MAX_SLIDES = 100


@inner
def wrap_cylinder(a, b, radius, length, axis, side, single):
    """Where the segment from a to b meets and leaves the cylinder.
    `a`, `b`: points in the frame of the cylinder [m]; `radius`, `length` [m]; `axis`, `side`: the path may only touch
    the half where sign(component `axis`) is `side`; 0 for all; `single`: the path has no other surface, so the points
    are not slid to tangency. Returns `code`: NO_WRAP, INSIDE (a point lies in the infinite cylinder), WRAPPED or
    MANDATORY (the segment runs through the cylinder); `arc`: length on the surface [m]; `r`, `s`: where the path meets
    and leaves the surface; only on WRAPPED and MANDATORY.
    """
    rr = radius * radius
    da, db = math.sqrt(a[0] * a[0] + a[1] * a[1]), math.sqrt(b[0] * b[0] + b[1] * b[1])
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
    angle = math.atan2(r[0] * s[1] - r[1] * s[0], r[0] * s[0] + r[1] * s[1])
    if long:
        angle = 2.0 * math.pi - angle
    turn = -angle if long else angle
    flat = radius * angle
    z, y = r[2], s[2]
    arc = math.sqrt(flat * flat + (y - z) * (y - z))
    slides = 0 if not single else MAX_SLIDES
    known, t = 0, 0.0
    at_r, at_s = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    while slides < MAX_SLIDES and arc >= 2.0 * CHORD:
        chords = int(arc / CHORD)
        if chords != known:
            known, t = chords, 1.0 / chords
            at_r, at_s = _flat_view(a, r, r, t * turn), _flat_view(b, s, r, (1.0 - t) * turn)
        rise = y - z
        slid_r, new_z = _slide_to_tangency(a[2], z, z + t * rise, at_r)
        # The other end is compared with the helix of the new r, as OpenSim does.
        slid_s, new_y = _slide_to_tangency(b[2], y, new_z + (1.0 - t) * rise, at_s)
        if not slid_r and not slid_s:
            break
        z, y = new_z, new_y
        arc = math.sqrt(flat * flat + (y - z) * (y - z))
        slides += 1
    return arc, (r[0], r[1], z), (s[0], s[1], y)


@inner
def _flat_view(p, q, r, turn):
    """What sliding leaves as it is, of p, a tangent point q, and the point w that r turned by `turn` makes.
    Seen along the axis: squares of the distances p q, q w and p w, and how far along p w the point nearest to q lies.
    """
    c, s = math.cos(turn), math.sin(turn)
    w0, w1 = c * r[0] - s * r[1], s * r[0] + c * r[1]
    q0, q1, d0, d1 = q[0] - p[0], q[1] - p[1], w0 - p[0], w1 - p[1]
    pw = d0 * d0 + d1 * d1
    share = (q0 * d0 + q1 * d1) / pw if pw > 0.0 else 0.0
    return q0 * q0 + q1 * q1, (w0 - q[0]) ** 2 + (w1 - q[1]) ** 2, pw, share


@inner
def _slide_to_tangency(p, q, w, view):
    """Slide a tangent point where the line to it and the helix away from it do not meet at one angle.
    Takes and gives heights along the axis: of the outer point, the tangent point and a point on the helix.
    """
    pq, qw, pw, share = view
    into, away = q - p, w - q
    v, u = into / math.sqrt(pq + into * into), away / math.sqrt(qw + away * away)
    # acos is steep: only cosines this near need their angles.
    slides = abs(v - u) > TANGENCY or abs(math.acos(v) - math.acos(u)) > TANGENCY
    if slides and abs(w - p) >= EPSILON and pw > PARALLEL * (pw + (w - p) * (w - p)):
        # To the height of the line from p to w where it passes the tangent point, and half as far again.
        return True, q + 1.5 * (p + share * (w - p) - q)
    return False, q


IN_LINE = 1e-5


@inner
def wrap_sphere(a, b, radius, axis, side):
    """Where the segment from a to b meets and leaves the sphere around the origin.
    `a`, `b`: points in the frame of the sphere [m]; `radius` [m]; `axis`, `side`: the half that constrains the path, as
    of `wrap_cylinder`; 0 for all. Returns `code`, `arc`, `r`, `s`: as of `wrap_cylinder`.

    Notes
    -----
    On the far side of a constrained sphere OpenSim counts the arc as negative; so do we. A segment
    that aims at the center within 1e-5 has no tangent points, and is not wrapped.
    """
    la, lb = norm(a), norm(b)
    if la < radius or lb < radius:
        return INSIDE, 0.0, a, b
    d = minus(a, b)
    A, B, C = dot(d, d), 2.0 * dot(b, d), lb * lb - radius * radius
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0 or A == 0.0:
        return NO_WRAP, 0.0, a, b
    root = math.sqrt(discriminant)
    one, other = (-B + root) / (2.0 * A), (-B - root) / (2.0 * A)
    if not (0.0 < one < 1.0 and 0.0 < other < 1.0):
        return NO_WRAP, 0.0, a, b
    d = unit(d)
    h = cross(d, unit(b))
    if norm(h) < IN_LINE:
        return NO_WRAP, 0.0, a, b
    n = unit(h)
    ra, rb = _sphere_tangents(a, la, n, radius)
    sa, sb = _sphere_tangents(b, lb, n, radius)
    ra_out, rb_out, sa_out, sb_out = unit(ra), unit(rb), unit(sa), unit(sb)
    aa, ab, ba, bb = dot(ra_out, sa_out), dot(ra_out, sb_out), dot(rb_out, sa_out), dot(rb_out, sb_out)
    if aa > ab and aa > ba and aa > bb:
        r_first, s_first = True, True
    elif ab > ba and ab > bb:
        r_first, s_first = True, False
    elif ba > bb:
        r_first, s_first = False, True
    else:
        r_first, s_first = False, False
    code, far = WRAPPED, False
    a_on, b_on = sign(a[axis]) == side, sign(b[axis]) == side
    if side != 0 and (a_on or b_on):
        # Distance from a to the point nearest to the center, which OpenSim compares with 0 and 1 m.
        t = dot(a, d)
        near = along(a, -t, d)
        if dot(near, near) < radius * radius and 0.0 < t < 1.0:
            code = MANDATORY
        elif not (sign(a[axis]) != sign(b[axis]) and sign(near[axis]) != side):
            return NO_WRAP, 0.0, a, b
    r, s = ra if r_first else rb, sa if s_first else sb
    if side != 0 and not (a_on and b_on):
        inward = unit((-a[0] - b[0], -a[1] - b[1], -a[2] - b[2]))
        r_first = dot(ra_out, inward) > dot(rb_out, inward)
        s_first = dot(sa_out, inward) > dot(sb_out, inward)
        r, s = ra if r_first else rb, sa if s_first else sb
        if side * (r[axis] - a[axis] + s[axis] - b[axis]) < 0.0:
            r, s = rb if r_first else ra, sb if s_first else sa
        reach = (r[0] - a[0] + s[0] - b[0], r[1] - a[1] + s[1] - b[1], r[2] - a[2] + s[2] - b[2])
        far = dot(reach, (r[0] + s[0], r[1] + s[1], r[2] + s[2])) < 0.0
    angle = math.acos(min(1.0, max(-1.0, dot(unit(r), unit(s)))))
    if far:
        angle -= 2.0 * math.pi
    return code, radius * angle, r, s


@inner
def _sphere_tangents(p, distance, n, radius):
    """Both points of the plane with normal n where lines through p touch the sphere."""
    y = (-p[0] / distance, -p[1] / distance, -p[2] / distance)
    z = cross(n, y)
    s = radius / distance
    c = math.sqrt(max(0.0, 1.0 - s * s))
    foot = along(p, distance * c * c, y)
    return along(foot, -distance * c * s, z), along(foot, distance * c * s, z)


CYLINDER_LENGTH = 10000.0
STEP = 1e-5
TOLERANCE = 1e-4
FIRST_BOUND = 0.2
MAX_CALLS = 500


@inner
def wrap_torus(a, b, inner_radius, outer, axis, side, single):
    """Where the segment from a to b meets and leaves the tube of radius `inner_radius`.
    `a`, `b`: points in the frame of the torus, whose circle of radius `outer` lies in z = 0 [m]; `inner_radius`,
    `outer` [m]; `axis`, `side`: the half of the circle that may be touched, as of `wrap_cylinder`; 0 for all; `single`:
    as of `wrap_cylinder`. Returns `code`, `arc`, `r`, `s`: as of `wrap_cylinder`, but never MANDATORY; arc is NaN where
    the code is WRAPPED although the cylinder was missed, which only matters to the order of several surfaces.
    """
    result, x, y = _nearest_on_circle(a, b, outer, axis, side)
    if not result:
        return NO_WRAP, 0.0, a, b
    # Cylinder frame: x towards the center of the torus, y down, z along the circle.
    cx, cy = -x / outer, -y / outer
    p = (cx * a[0] + cy * a[1] + outer, -a[2], -cy * a[0] + cx * a[1])
    q = (cx * b[0] + cy * b[1] + outer, -b[2], -cy * b[0] + cx * b[1])
    # OpenSim's helper cylinder keeps the side it is born with: the half towards the center. (Written as
    # variables, since a call with literals would compile the cylinder once more.)
    x_axis, positive = axis * 0, side * 0 + 1
    code, arc, r, s = wrap_cylinder(p, q, inner_radius, CYLINDER_LENGTH, x_axis, positive, single)
    if code < WRAPPED:
        return WRAPPED, math.nan, a, b
    u, v = r[0] - outer, s[0] - outer
    r = (cx * u - cy * r[2], cy * u + cx * r[2], -r[1])
    s = (cx * v - cy * s[2], cy * v + cx * s[2], -s[1])
    return WRAPPED, arc, r, s


@inner
def _nearest_on_circle(a, b, radius, axis, side):
    """Point of the circle nearest to the line, searched from both ends; false where on the wrong half."""
    d = unit(minus(b, a))
    one = along(a, _search(a, d, radius), d)
    d = (-d[0], -d[1], -d[2])
    other = along(b, _search(b, d, radius), d)
    nearer = _distance(one, radius) < _distance(other, radius)
    if side != 0:
        one_on, other_on = sign(one[axis]) == side, sign(other[axis]) == side
        if not one_on and not other_on:
            return False, 0.0, 0.0
        if one_on != other_on:
            nearer = one_on
    best = one if nearer else other
    length = math.hypot(best[0], best[1])
    if length == 0.0:
        return False, 0.0, 0.0
    return True, best[0] * radius / length, best[1] * radius / length


@inner
def _distance(p, radius):
    return math.sqrt(max(0.0, dot(p, p) + radius * radius - 2.0 * radius * math.hypot(p[0], p[1])))


@inner
def _slope(p, d, radius, u):
    """Derivative along the line of the squared distance to the circle, at p + u d."""
    flat, level = p[0] * d[0] + p[1] * d[1], d[0] * d[0] + d[1] * d[1]
    across = math.sqrt(u * u * level + 2.0 * flat * u + p[0] * p[0] + p[1] * p[1])
    if across == 0.0:
        return math.nan
    return 2.0 * dot(p, d) + 2.0 * u - 2.0 * radius * (2.0 * level * u + 2.0 * flat) / across


@inner
def _search(p, d, radius):
    """Root of `_slope` from u = 0 by Levenberg and Marquardt as MINPACK does it, in one unknown."""
    x, par, delta, scale, x_norm = 0.0, 0.0, 0.0, 0.0, 0.0
    f = _slope(p, d, radius, x)
    calls, first = 1, True
    while True:
        slope = (_slope(p, d, radius, x + STEP) - f) / STEP
        if f == 0.0 or slope == 0.0 or math.isnan(slope):
            return x
        scale = max(scale, abs(slope))
        if first:
            x_norm = scale * abs(x)
            delta = FIRST_BOUND * x_norm
            if delta <= 1e-4:
                delta = FIRST_BOUND
        ratio = 0.0
        while ratio < 1e-4:
            step, par = _bounded_step(slope, f, scale, delta, par)
            size = scale * abs(step)
            if first:
                delta = min(delta, size)
            f_new = _slope(p, d, radius, x - step)
            if math.isnan(f_new):
                return x
            calls += 1
            actual = 1.0 - (f_new / f) * (f_new / f) if 0.1 * abs(f_new) < abs(f) else -1.0
            t1, t2 = abs(slope * step / f), math.sqrt(par) * size / abs(f)
            predicted, direction = t1 * t1 + 2.0 * t2 * t2, -(t1 * t1 + t2 * t2)
            ratio = actual / predicted if predicted != 0.0 else 0.0
            if ratio <= 0.25:
                factor = 0.5 if actual >= 0.0 else 0.5 * direction / (direction + 0.5 * actual)
                if 0.1 * abs(f_new) >= abs(f) or factor < 0.1:
                    factor = 0.1
                delta = factor * min(delta, size / 0.1)
                par /= factor
            elif par == 0.0 or ratio >= 0.75:
                delta = size / 0.5
                par *= 0.5
            if ratio >= 1e-4:
                x -= step
                x_norm = scale * abs(x)
                f = f_new
                first = False
            if abs(actual) <= TOLERANCE and predicted <= TOLERANCE and 0.5 * ratio <= 1.0:
                return x
            if delta <= TOLERANCE * x_norm or calls >= MAX_CALLS:
                return x


@inner
def _bounded_step(slope, f, scale, delta, par):
    """Step of scaled size about `delta` at most, and MINPACK's parameter that makes it so."""
    step = f / slope
    size = scale * abs(step)
    excess = size - delta
    if excess <= 0.1 * delta:
        return step, 0.0
    ratio = scale / abs(slope)
    low = excess / delta / ratio / ratio
    gradient = abs(slope * f) / scale
    high = gradient / delta
    if high == 0.0:
        high = 1e-38 / min(delta, 0.1)
    par = min(max(par, low), high)
    if par == 0.0:
        par = gradient / size
    for i in range(1, 11):
        if par == 0.0:
            par = max(1e-38, 0.001 * high)
        square = slope * slope + par * scale * scale
        step = slope * f / square
        before, excess = excess, scale * abs(step) - delta
        if abs(excess) <= 0.1 * delta or (low == 0.0 and excess <= before < 0.0) or i == 10:
            break
        ratio = scale / math.sqrt(square)
        correction = excess / delta / ratio / ratio
        if excess > 0.0:
            low = max(low, par)
        elif excess < 0.0:
            high = min(high, par)
        par = max(low, par + correction)
    return step, par
