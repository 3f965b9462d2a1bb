"""Wrapping around an ellipsoid as OpenSim defines it (`WrapEllipsoid`, 4.6), one segment at a time.

The path lies in a plane through both points and a third point c on the surface, found from the
nearest surface points of the chord inside the ellipsoid: in the coordinate plane that the segment
crosses most squarely ("axial"), of the chord's middle ("midpoint"), or of all the chord ("fan"),
blended with the first ("hybrid"). It is not the shortest path. All lengths are divided by the mean
half axis, for the sake of OpenSim's tolerances, which are kept because they are felt in the result.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.muscles.wrap.ellipsoid_points import nearest_in_plane, nearest_on_ellipsoid
from myomorph.core.muscles.wrap.ellipsoid_tangents import Plane, tangent_point
from myomorph.core.muscles.wrap.surface import (
    INSIDE,
    MANDATORY,
    NO_WRAP,
    Vector,
    crossed_between,
    missed,
    on_half,
    wrapped,
)
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import along, cross, dot, minus, norm, replaced, times, unit

# Methods
HYBRID = 0
MIDPOINT = 1
AXIAL = 2
# OpenSim's: levels and cosines that count as on the surface and in line; cosines of the segment
# between which the hybrid method blends; share of the chord near its ends in which the axial point
# fades; points of the fan; length of the chords of an arc [m], and their number
ON_SURFACE = 0.0001
IN_LINE = 0.0001
BLEND_FROM = 0.7073
BLEND_TO = 0.9
EDGE = 0.3
FAN = 300
CHORD = 0.001
MAX_CHORDS = 499


class _Chord(NamedTuple):
    """Where a segment enters and leaves the ellipsoid: from r, on the side of x, to s."""

    r: Vector
    s: Vector


class _Crossing(NamedTuple):
    """The coordinate plane that a segment crosses most squarely.

    Attributes
    ----------
    axis : across the plane
    cosine : of the angle between the segment and the axis
    share : of the chord at which it crosses the plane
    """

    axis: int
    cosine: float
    share: float


class _Guide(NamedTuple):
    """The surface point that sets the plane of the path.

    Attributes
    ----------
    point : on the surface
    fan : share of the fan in it, -inf where the method has none
    """

    point: Vector
    fan: float


class _Section(NamedTuple):
    """Rays in the plane of the path, from which the chords of its arc are made.

    Attributes
    ----------
    center : where they begin
    e : unit vector towards r
    f : unit vector across e, on the side of s
    angle : from r to s about the center [rad]
    """

    center: Vector
    e: Vector
    f: Vector
    angle: float


class _Way(NamedTuple):
    """An arc whose length is asked for.

    Attributes
    ----------
    x, y : ends of the segment
    touched : tangent points
    chords : number of them
    constrained : whether the path may touch one half only
    """

    x: Vector
    y: Vector
    touched: _Chord
    chords: int
    constrained: bool


@bare
def wrap_ellipsoid(p, q, size, method, half):
    """Wrap the segment from p to q around an ellipsoid at the origin.

    Parameters
    ----------
    p, q : points in the frame of the ellipsoid [m]
    size : half axes [m]
    method : `HYBRID`, `MIDPOINT` or `AXIAL`
    half : `Half` that the path may touch

    Returns
    -------
    `Wrap`, but never `WRAPPED`
    """
    factor = 3.0 / (size[0] + size[1] + size[2])
    a = times(factor, size)
    x = times(factor, p)
    y = times(factor, q)
    if _level(x, a) < -ON_SURFACE or _level(y, a) < -ON_SURFACE:
        return missed(INSIDE, p, q)
    if abs(dot(unit(x), unit(y)) - 1.0) < IN_LINE:
        return missed(NO_WRAP, p, q)
    crosses, chord = _chord(x, y, a)
    if not crosses:
        return missed(NO_WRAP, p, q)
    c, start = _third_point(chord, _crossing(x, y, chord), a, method, half)
    n = unit(cross(minus(x, y), minus(x, c)))
    plane = Plane(n=n, d=-dot(n, c))
    touched = _Chord(
        r=x if abs(_level(x, a)) < ON_SURFACE else tangent_point(x, start.r, a, plane),
        s=y if abs(_level(y, a)) < ON_SURFACE else tangent_point(y, start.s, a, plane),
    )
    arc = _arc(x, y, touched, a, plane, factor, half.side != 0)
    return wrapped(MANDATORY, arc / factor, _scaled(touched.r, factor), _scaled(touched.s, factor))


@in_place
def _third_point(chord, crossing, a, method, half):
    """Find the surface point c that sets the plane of the path with both ends of the segment.

    Returns
    -------
    c, and where the searches for both tangent points start: at c, or with the axial method where
    the segment crosses the plane beyond the chord at the ends of the chord
    """
    guide = _guide(chord, a, method, crossing)
    c = guide.point
    start = _Chord(r=c, s=c)
    if method == AXIAL and not 0.0 < crossing.share < 1.0:
        start = chord
    if half.side != 0 and not on_half(c, half):
        mirrored = replaced(c, half.axis, -c[half.axis])
        start = _Chord(r=mirrored, s=mirrored)
        c = _over_half(mirrored, guide.fan, half.axis, a)
    return c, start


@bare
def _scaled(p, factor):
    """Divide a vector by the factor of lengths."""
    return p[0] / factor, p[1] / factor, p[2] / factor


@bare
def _over_axes(p, a):
    """Divide each component of a vector by its half axis: the ellipsoid becomes a unit sphere."""
    return p[0] / a[0], p[1] / a[1], p[2] / a[2]


@bare
def _level(p, a):
    """Level of a point, sum p_i^2 / a_i^2 - 1: below 0 inside the ellipsoid, 0 on it."""
    scaled = _over_axes(p, a)
    return dot(scaled, scaled) - 1.0


@in_place
def _chord(x, y, a):
    """Find where the segment from x to y enters and leaves the ellipsoid.

    With d = x - y, f = d / a and g = y / a by components, |g + t f| = 1:

        (f . f) t^2 + 2 (f . g) t + g . g - 1 = 0

    Returns
    -------
    whether it does both between its ends, and the chord
    """
    d = minus(x, y)
    f = _over_axes(d, a)
    g = _over_axes(y, a)
    crosses, one, other = crossed_between(dot(f, f), 2.0 * dot(f, g), dot(g, g) - 1.0)
    return crosses, _Chord(r=along(y, one, d), s=along(y, other, d))


@in_place
def _crossing(x, y, chord):
    """Find the axis most parallel to the segment, and where the chord crosses its plane."""
    d = unit(minus(x, y))
    axis = 0
    for i in range(1, 3):
        if abs(d[i]) > abs(d[axis]):
            axis = i
    r = chord.r
    s = chord.s
    share = -r[axis] / (s[axis] - r[axis])
    return _Crossing(axis=axis, cosine=abs(d[axis]), share=share)


@in_place
def _guide(chord, a, method, crossing):
    """Find the surface point that sets the plane of the path.

    The hybrid method blends the fan's point with the axial one where the cosine of the segment lies
    between `BLEND_FROM` and `BLEND_TO`.
    """
    r = chord.r
    along_chord = minus(chord.s, r)
    middle = along(r, 0.5, along_chord)
    if method == MIDPOINT:
        _, c = nearest_on_ellipsoid(a, middle)
        return _Guide(point=c, fan=-math.inf)
    cosine = crossing.cosine
    if method == HYBRID and cosine > BLEND_FROM:
        cosine = BLEND_FROM + _axial_share(crossing.share) * (cosine - BLEND_FROM)
    c = middle
    if method == AXIAL or cosine > BLEND_FROM:
        c = nearest_in_plane(a, along(r, crossing.share, along_chord), crossing.axis)
    if method == AXIAL or cosine >= BLEND_TO:
        return _Guide(point=c, fan=-math.inf)
    _, of_fan = nearest_on_ellipsoid(a, along(middle, 1.0, _fan(r, along_chord, a)))
    if cosine <= BLEND_FROM:
        return _Guide(point=of_fan, fan=1.0)
    share = (cosine - BLEND_FROM) / (BLEND_TO - BLEND_FROM)
    _, c = nearest_on_ellipsoid(a, along(of_fan, share, minus(c, of_fan)))
    return _Guide(point=c, fan=1.0 - share)


@in_place
def _axial_share(share):
    """Weight of the axial point by where the chord crosses its plane.

    Near the ends of the chord the axial point turns away from the fan's: it is faded out.
    """
    if share < 0.0 or share > 1.0:
        return 0.0
    if share < EDGE:
        return share / EDGE
    if share > 1.0 - EDGE:
        return (1.0 - share) / EDGE
    return 1.0


@in_place
def _fan(r, chord, a):
    """Mean direction from the chord to the surface points nearest to it."""
    total = (0.0, 0.0, 0.0)
    c = r
    for i in range(1, FAN - 1):
        p = along(r, i / FAN, chord)
        ended, nearest = nearest_on_ellipsoid(a, p)
        if ended:
            c = nearest
        total = along(total, 1.0, unit(minus(c, p)))
    return unit(total)


@in_place
def _over_half(mirrored, fan, axis, a):
    """Move the guide, mirrored onto the half, between its two images by the share of the fan.

    The middle between the point and its mirror image has a zero there.
    """
    if not fan > 0.0:
        return mirrored
    target = replaced(mirrored, axis, (1.0 - min(fan, 1.0)) * mirrored[axis])
    ended, nearest = nearest_on_ellipsoid(a, target)
    return nearest if ended else target


@in_place
def _arc(x, y, touched, a, plane, factor, constrained):
    """Compute the length from r to s on the surface, in the plane of the path, as chords.

    Constrained paths go the other way round where they would double back.
    """
    r = touched.r
    s = touched.s
    gap = norm(minus(r, s))
    if gap / factor < CHORD:
        return gap
    chords = min(int(gap / factor / CHORD), MAX_CHORDS)
    way = _Way(x=x, y=y, touched=touched, chords=chords, constrained=constrained)
    length = _way_length(way, _section(r, s, _center_on_axis(plane)), a)
    if length < math.inf:
        return length
    # That center may lie outside, and some of its rays miss the surface: OpenSim has NaN there.
    return _way_length(way, _section(r, s, _center_of_section(plane, a)), a)


@in_place
def _way_length(way, section, a):
    """Sum the chords of an arc with the rays of a section, the other way round if it must."""
    touched = way.touched
    chords = way.chords
    length, second, last = _chords_length(section, section.angle / chords, chords, touched, a)
    if way.constrained and chords > 1:
        start = minus(second, touched.r)
        end = minus(last, touched.s)
        back = minus(way.x, touched.r)
        ahead = minus(way.y, touched.s)
        if dot(back, start) > 0.0 or dot(ahead, end) > 0.0:
            other_angle = section.angle - 2.0 * math.pi
            length, _, _ = _chords_length(section, other_angle / chords, chords, touched, a)
    return length


@in_place
def _section(r, s, center):
    """Lay rays from a center in the plane of both tangent points."""
    e = unit(minus(r, center))
    to_s = unit(minus(s, center))
    angle = math.acos(min(1.0, max(-1.0, dot(e, to_s))))
    f = cross(unit(cross(e, to_s)), e)
    return _Section(center=center, e=e, f=f, angle=angle)


@in_place
def _center_on_axis(plane):
    """Find the point of the plane on the axis that it crosses most squarely."""
    axis = 0
    for i in range(1, 3):
        if abs(plane.n[i]) > abs(plane.n[axis]):
            axis = i
    return replaced((0.0, 0.0, 0.0), axis, -plane.d / plane.n[axis])


@in_place
def _center_of_section(plane, a):
    """Find the center of the ellipse in which the plane cuts, c_i = -d n_i a_i^2 / |n a|^2."""
    wide = (plane.n[0] * a[0], plane.n[1] * a[1], plane.n[2] * a[2])
    scale = -plane.d / dot(wide, wide)
    return scale * wide[0] * a[0], scale * wide[1] * a[1], scale * wide[2] * a[2]


@bare
def _chords_length(section, step, chords, touched, a):
    """Sum the chords from r to s at even angles about the center of a section.

    A ray center + t u, with u = cos(i step) e + sin(i step) f, meets the surface where, with h = u
    / a and g = center / a by components,

        (h . h) t^2 + 2 (h . g) t + g . g - 1 = 0

    Returns
    -------
    length, second point, last point but one
    """
    g = _over_axes(section.center, a)
    C = dot(g, g) - 1.0
    length = 0.0
    before = touched.r
    second = touched.s
    cosine = 1.0
    sine = 0.0
    step_cosine = math.cos(step)
    step_sine = math.sin(step)
    for i in range(1, chords):
        turned_cosine = cosine * step_cosine - sine * step_sine
        sine = sine * step_cosine + cosine * step_sine
        cosine = turned_cosine
        u = _ray(section, cosine, sine)
        point = along(section.center, _ray_length(_over_axes(u, a), g, C), u)
        length += norm(minus(point, before))
        before = point
        if i == 1:
            second = point
    return length + norm(minus(touched.s, before)), second, before


@in_place
def _ray(section, cosine, sine):
    """Direction of a ray: cos e + sin f."""
    e = section.e
    f = section.f
    return (
        cosine * e[0] + sine * f[0],
        cosine * e[1] + sine * f[1],
        cosine * e[2] + sine * f[2],
    )


@in_place
def _ray_length(h, g, C):
    """Positive root t of (h . h) t^2 + 2 (h . g) t + C = 0, NaN where there is none."""
    A = dot(h, h)
    B = 2.0 * dot(h, g)
    square = B * B - 4.0 * A * C
    return (-B + math.sqrt(square)) / (2.0 * A) if square >= 0.0 else math.nan
