"""The way around an ellipsoid as OpenSim defines it (`WrapEllipsoid`, 4.6), one segment at a time.

The path lies in a plane through both points and a third point c on the surface, found from the
nearest surface points of the chord inside the ellipsoid: in the coordinate plane that the segment
crosses most squarely ("axial"), of the chord's middle ("midpoint"), or of all the chord ("fan"),
blended with the first ("hybrid"). It is not the shortest path. All lengths are divided by the mean
half axis, for the sake of OpenSim's tolerances, which are kept because they are felt in the result.
"""

from __future__ import annotations

import math

from myomorph.muscles.ellipsoid import nearest_in_plane, nearest_on_ellipsoid, tangent_point
from myomorph.muscles.wrap_cylinder import INSIDE, MANDATORY, NO_WRAP
from myomorph.rigid.kernels import inner
from myomorph.rigid.vectors import along, cross, dot, minus, norm, replaced, sign, unit

HYBRID, MIDPOINT, AXIAL = 0, 1, 2
BLEND_FROM, BLEND_TO = 0.7073, 0.9
EDGE = 0.3
FAN = 300
CHORD = 0.001
MAX_CHORDS = 499


@inner
def wrap_ellipsoid(p, q, size, method, axis, side):
    """Where the segment from p to q meets and leaves the ellipsoid around the origin.
    `p`, `q`: points in the frame of the ellipsoid [m]; `size`: half axes [m]; `method`: HYBRID, MIDPOINT or AXIAL;
    `axis`, `side`: the half that constrains the path, as of `wrap_cylinder`; 0 for all. Returns `code`, `arc`, `r`,
    `s`: as of `wrap_cylinder`, but never WRAPPED.
    """
    factor = 3.0 / (size[0] + size[1] + size[2])
    a = (size[0] * factor, size[1] * factor, size[2] * factor)
    x = (p[0] * factor, p[1] * factor, p[2] * factor)
    y = (q[0] * factor, q[1] * factor, q[2] * factor)
    x_out, y_out = _outside(x, a), _outside(y, a)
    if x_out < -0.0001 or y_out < -0.0001:
        return INSIDE, 0.0, p, q
    if abs(dot(unit(x), unit(y)) - 1.0) < 0.0001:
        return NO_WRAP, 0.0, p, q
    crosses, r, s = _chord(x, y, a)
    if not crosses:
        return NO_WRAP, 0.0, p, q
    best, square, place = _most_square(x, y, r, s)
    c, square, fan = _plane_point(r, s, a, method, best, square, place)
    if method != AXIAL or 0.0 < place < 1.0:
        r, s = c, c
    if side != 0 and sign(c[axis]) != side:
        c = replaced(c, axis, -c[axis])
        r, s = c, c
        if fan > 0.0:
            # The middle between c and its mirror image has a zero there.
            target = replaced(c, axis, (1.0 - min(fan, 1.0)) * c[axis])
            result, nearest = nearest_on_ellipsoid(a, target)
            c = nearest if result else target
    n = unit(cross(minus(x, y), minus(x, c)))
    d = -dot(n, c)
    if abs(x_out) < 0.0001:
        r = x
    else:
        r = tangent_point(x, r, a, n, d)
    if abs(y_out) < 0.0001:
        s = y
    else:
        s = tangent_point(y, s, a, n, d)
    arc = _arc(x, y, r, s, a, n, d, factor, side != 0)
    return MANDATORY, arc / factor, _scaled(r, factor), _scaled(s, factor)


@inner
def _scaled(p, factor):
    return p[0] / factor, p[1] / factor, p[2] / factor


@inner
def _outside(p, a):
    u, v, w = p[0] / a[0], p[1] / a[1], p[2] / a[2]
    return u * u + v * v + w * w - 1.0


@inner
def _chord(x, y, a):
    """Where the segment from x to y enters and leaves the ellipsoid; false where it does not."""
    d = minus(x, y)
    f = (d[0] / a[0], d[1] / a[1], d[2] / a[2])
    g = (y[0] / a[0], y[1] / a[1], y[2] / a[2])
    A, B, C = dot(f, f), 2.0 * dot(f, g), dot(g, g) - 1.0
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0 or A == 0.0:
        return False, x, y
    root = math.sqrt(discriminant)
    one, other = (-B + root) / (2.0 * A), (-B - root) / (2.0 * A)
    if not (0.0 < one < 1.0 and 0.0 < other < 1.0):
        return False, x, y
    return True, along(y, one, d), along(y, other, d)


@inner
def _most_square(x, y, r, s):
    """Axis most parallel to the segment, its cosine, and where the chord crosses the plane across it."""
    d = unit(minus(x, y))
    best = 0
    for i in range(1, 3):
        if abs(d[i]) > abs(d[best]):
            best = i
    return best, abs(d[best]), -r[best] / (s[best] - r[best])


@inner
def _plane_point(r, s, a, method, best, square, place):
    """The surface point that sets the plane, the cosine after fading, and the share of the fan.
    The share is -inf where OpenSim leaves it unset.
    """
    chord = minus(s, r)
    middle = along(r, 0.5, chord)
    if method == MIDPOINT:
        _, c = nearest_on_ellipsoid(a, middle)
        return c, square, -math.inf
    if method == HYBRID and square > BLEND_FROM:
        # Near the ends of the chord the axial point turns away from the fan's: it is faded out.
        fade = 1.0
        if place < 0.0 or place > 1.0:
            fade = 0.0
        elif place < EDGE:
            fade = place / EDGE
        elif place > 1.0 - EDGE:
            fade = (1.0 - place) / EDGE
        square = BLEND_FROM + fade * (square - BLEND_FROM)
    c = middle
    if method == AXIAL or square > BLEND_FROM:
        c = nearest_in_plane(a, along(r, place, chord), best)
    if method == AXIAL or square >= BLEND_TO:
        return c, square, -math.inf
    _, fan_c = nearest_on_ellipsoid(a, along(middle, 1.0, _fan(r, chord, a)))
    if square <= BLEND_FROM:
        return fan_c, square, 1.0
    share = (square - BLEND_FROM) / (BLEND_TO - BLEND_FROM)
    _, c = nearest_on_ellipsoid(a, along(fan_c, share, minus(c, fan_c)))
    return c, square, 1.0 - share


@inner
def _fan(r, chord, a):
    """Mean direction from the chord to the surface points nearest to it."""
    total = (0.0, 0.0, 0.0)
    c = r
    for i in range(1, FAN - 1):
        p = along(r, i / FAN, chord)
        result, nearest = nearest_on_ellipsoid(a, p)
        if result:
            c = nearest
        total = along(total, 1.0, unit(minus(c, p)))
    return unit(total)


@inner
def _arc(x, y, r, s, a, n, d, factor, constrained):
    """Length from r to s on the surface, in the plane n . x + d = 0; the other way round if need be."""
    gap = norm(minus(r, s))
    if gap / factor < CHORD:
        return gap
    chords = min(int(gap / factor / CHORD), MAX_CHORDS)
    most = 0
    for i in range(1, 3):
        if abs(n[i]) > abs(n[most]):
            most = i
    center = replaced((0.0, 0.0, 0.0), most, -d / n[most])
    e = unit(minus(r, center))
    f = unit(minus(s, center))
    whole = math.acos(min(1.0, max(-1.0, dot(e, f))))
    f = cross(unit(cross(e, f)), e)
    length, second, last = _chords_length(center, e, f, whole / chords, chords, r, s, a)
    if constrained and chords > 1:
        start, end = minus(second, r), minus(last, s)
        if dot(minus(x, r), start) > 0.0 or dot(minus(y, s), end) > 0.0:
            length, second, last = _chords_length(center, e, f, (whole - 2.0 * math.pi) / chords, chords, r, s, a)
    return length


@inner
def _chords_length(center, e, f, step, chords, r, s, a):
    """Length of the chords from r to s at even angles about `center`, and the second and last but one points."""
    g = (center[0] / a[0], center[1] / a[1], center[2] / a[2])
    C = dot(g, g) - 1.0
    length, before, second = 0.0, r, s
    c, d, turn_c, turn_d = 1.0, 0.0, math.cos(step), math.sin(step)
    for i in range(1, chords):
        c, d = c * turn_c - d * turn_d, d * turn_c + c * turn_d
        direction = (c * e[0] + d * f[0], c * e[1] + d * f[1], c * e[2] + d * f[2])
        h = (direction[0] / a[0], direction[1] / a[1], direction[2] / a[2])
        A, B = dot(h, h), 2.0 * dot(h, g)
        point = along(center, (-B + math.sqrt(B * B - 4.0 * A * C)) / (2.0 * A), direction)
        length += norm(minus(point, before))
        before = point
        if i == 1:
            second = point
    return length + norm(minus(s, before)), second, before
