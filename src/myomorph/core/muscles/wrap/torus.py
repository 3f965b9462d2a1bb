"""Wrapping through a torus as OpenSim defines it (`WrapTorus`, 4.6), one segment at a time.

OpenSim looks for the point of the torus's circle nearest to the segment, puts a long cylinder there
along the circle, and wraps around that cylinder. The search is MINPACK's least squares (`lmder`,
Moré 1978) in one unknown with loose tolerances, which decide where it stops; so the same steps are
taken here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.muscles.wrap.cylinder import wrap_cylinder
from myomorph.core.muscles.wrap.surface import (
    NO_WRAP,
    WRAPPED,
    half_of,
    missed,
    on_half,
    wrapped,
)
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import along, dot, minus, unit

# OpenSim's: length of the helper cylinder [m], step of differences, tolerances of MINPACK, first
# bound of a step, and evaluations
CYLINDER_LENGTH = 10000.0
STEP = 1e-5
TOLERANCE = 1e-4
FIRST_BOUND = 0.2
MAX_CALLS = 500
# MINPACK's: least ratio of a step that is taken, and number that stands for 0
MIN_RATIO = 1e-4
TINY = 1e-38


@bare
def wrap_torus(a, b, size, half, single):
    """Wrap the segment from a to b around the tube of a torus.

    Parameters
    ----------
    a, b : points in the frame of the torus, whose circle lies in z = 0 [m]
    size : radii of the tube and of the circle [m]
    half : `Half` of the circle that the path may touch
    single : as of `wrap_cylinder`

    Returns
    -------
    `Wrap`, but never `MANDATORY`; the arc is NaN where the code is `WRAPPED` although the cylinder
    was missed, which only matters to the order of several surfaces
    """
    tube_radius, radius = size
    found, x, y = _nearest_on_circle(a, b, radius, half)
    if not found:
        return missed(NO_WRAP, a, b)
    # Cylinder frame: x towards the center of the torus, y down, z along the circle.
    cx = -x / radius
    cy = -y / radius
    p = (cx * a[0] + cy * a[1] + radius, -a[2], -cy * a[0] + cx * a[1])
    q = (cx * b[0] + cy * b[1] + radius, -b[2], -cy * b[0] + cx * b[1])
    # OpenSim's helper cylinder keeps the side it is born with: the half towards the center.
    wrap = wrap_cylinder(p, q, (tube_radius, CYLINDER_LENGTH), half_of(0, 1), single)
    if wrap.code < WRAPPED:
        return wrapped(WRAPPED, math.nan, a, b)
    u = wrap.r[0] - radius
    v = wrap.s[0] - radius
    r = (cx * u - cy * wrap.r[2], cy * u + cx * wrap.r[2], -wrap.r[1])
    s = (cx * v - cy * wrap.s[2], cy * v + cx * wrap.s[2], -wrap.s[1])
    return wrapped(WRAPPED, wrap.arc, r, s)


@in_place
def _nearest_on_circle(a, b, radius, half):
    """Find the point of the circle nearest to a line, searched from both ends.

    Returns
    -------
    whether it is on the right half, x and y [m]
    """
    d = unit(minus(b, a))
    one = along(a, _search(a, d, radius), d)
    back = (-d[0], -d[1], -d[2])
    other = along(b, _search(b, back, radius), back)
    nearer = _distance(one, radius) < _distance(other, radius)
    if half.side != 0:
        one_on = on_half(one, half)
        other_on = on_half(other, half)
        if not one_on and not other_on:
            return False, 0.0, 0.0
        if one_on != other_on:
            nearer = one_on
    best = one if nearer else other
    length = math.hypot(best[0], best[1])
    if length == 0.0:
        return False, 0.0, 0.0
    return True, best[0] * radius / length, best[1] * radius / length


@bare
def _distance(p, radius):
    """Distance of a point from the circle [m]: sqrt(|p|^2 + radius^2 - 2 radius rho)."""
    rho = math.hypot(p[0], p[1])
    return math.sqrt(max(0.0, dot(p, p) + radius * radius - 2.0 * radius * rho))


@bare
def _slope(p, d, radius, u):
    """Differentiate the squared distance to the circle along the line, at p + u d.

    With rho the distance of p + u d from the z axis,

        d/du (|p + u d|^2 - 2 radius rho)
    """
    flat = p[0] * d[0] + p[1] * d[1]
    level = d[0] * d[0] + d[1] * d[1]
    rho = math.sqrt(u * u * level + 2.0 * flat * u + p[0] * p[0] + p[1] * p[1])
    if rho == 0.0:
        return math.nan
    return 2.0 * dot(p, d) + 2.0 * u - 2.0 * radius * (2.0 * level * u + 2.0 * flat) / rho


class _Step(NamedTuple):
    """A step as MINPACK judges it, all relative to the square of the value before.

    Attributes
    ----------
    actual, predicted : decrease of the square, and what the linear model with its damping foretold
    direction : derivative of the square along the step
    ratio : of actual to predicted
    size : scaled length of the step
    falls : whether the new value is less than ten times the old one
    """

    actual: float
    predicted: float
    direction: float
    ratio: float
    size: float
    falls: bool


class _Bound(NamedTuple):
    """Bound of a step.

    Attributes
    ----------
    delta : largest scaled length of the next step
    damping : MINPACK's parameter `par`, 0 for a full Gauss-Newton step
    """

    delta: float
    damping: float


@bare
def _search(p, d, radius):
    """Search the root of `_slope` from u = 0 by MINPACK's Levenberg-Marquardt, in one unknown.

    Returns
    -------
    u, where along the line the search ends [m]
    """
    u = 0.0
    value = _slope(p, d, radius, u)
    calls = 1
    first = True
    scale = 0.0
    scaled_u = 0.0
    bound = _Bound(delta=0.0, damping=0.0)
    while True:
        slope = (_slope(p, d, radius, u + STEP) - value) / STEP
        if value == 0.0 or slope == 0.0 or math.isnan(slope):
            return u
        scale = max(scale, abs(slope))
        if first:
            scaled_u = scale * abs(u)
            bound = _first_bound(scaled_u)
        ratio = 0.0
        while ratio < MIN_RATIO:
            step, damping = _bounded_step(slope, value, scale, bound)
            size = scale * abs(step)
            new = _slope(p, d, radius, u - step)
            if math.isnan(new):
                return u
            calls += 1
            judged = _judged(value, new, slope * step, damping, size)
            # The first step of all narrows the bound to its own size.
            delta = min(bound.delta, size) if first else bound.delta
            bound = _next_bound(judged, delta, damping)
            ratio = judged.ratio
            if ratio >= MIN_RATIO:
                u -= step
                scaled_u = scale * abs(u)
                value = new
                first = False
            if _settled(judged, bound, scaled_u) or calls >= MAX_CALLS:
                return u


@in_place
def _first_bound(scaled_u):
    """Bound the first step in proportion to the start, or by a constant where that is small."""
    delta = FIRST_BOUND * scaled_u
    if delta <= 1e-4:
        delta = FIRST_BOUND
    return _Bound(delta=delta, damping=0.0)


@in_place
def _judged(value, new, change, damping, size):
    """Compare the decrease of the squared value with the one that was predicted.

    With f before and f' after a step that should change f by c, and s its scaled size,

        actual    = 1 - (f' / f)^2,   -1 where f' is more than ten times f
        predicted = (c / f)^2 + 2 damping (s / f)^2
    """
    falls = 0.1 * abs(new) < abs(value)
    actual = 1.0 - (new / value) * (new / value) if falls else -1.0
    linear = abs(change / value)
    damped = math.sqrt(damping) * size / abs(value)
    predicted = linear * linear + 2.0 * damped * damped
    return _Step(
        actual=actual,
        predicted=predicted,
        direction=-(linear * linear + damped * damped),
        ratio=actual / predicted if predicted != 0.0 else 0.0,
        size=size,
        falls=falls,
    )


@in_place
def _next_bound(step, delta, damping):
    """Narrow the bound after a step that did little, widen it after a good one."""
    if step.ratio <= 0.25:
        factor = 0.5
        if step.actual < 0.0:
            factor = 0.5 * step.direction / (step.direction + 0.5 * step.actual)
        if not step.falls or factor < 0.1:
            factor = 0.1
        return _Bound(delta=factor * min(delta, step.size / 0.1), damping=damping / factor)
    if damping == 0.0 or step.ratio >= 0.75:
        return _Bound(delta=step.size / 0.5, damping=damping * 0.5)
    return _Bound(delta=delta, damping=damping)


@in_place
def _settled(step, bound, scaled_u):
    """Return whether the search ends.

    It does where neither the actual nor the predicted decrease is worth a further step, or the
    bound is small against where it is.
    """
    small = abs(step.actual) <= TOLERANCE and step.predicted <= TOLERANCE
    return (small and 0.5 * step.ratio <= 1.0) or bound.delta <= TOLERANCE * scaled_u


@in_place
def _bounded_step(slope, value, scale, bound):
    """Compute a step of scaled size about `bound.delta` at most, and MINPACK's parameter of it.

    The step to a root of the linear model, damped by D = scale, is

        slope value / (slope^2 + damping D^2)

    with a damping between `low` and `high` at which its scaled size is delta within a tenth.
    """
    delta = bound.delta
    step = value / slope
    size = scale * abs(step)
    excess = size - delta
    if excess <= 0.1 * delta:
        return step, 0.0
    ratio = scale / abs(slope)
    low = excess / delta / ratio / ratio
    gradient = abs(slope * value) / scale
    high = gradient / delta
    if high == 0.0:
        high = TINY / min(delta, 0.1)
    damping = min(max(bound.damping, low), high)
    if damping == 0.0:
        damping = gradient / size
    for i in range(1, 11):
        if damping == 0.0:
            damping = max(TINY, 0.001 * high)
        square = slope * slope + damping * scale * scale
        step = slope * value / square
        before = excess
        excess = scale * abs(step) - delta
        if abs(excess) <= 0.1 * delta or (low == 0.0 and excess <= before < 0.0) or i == 10:
            break
        ratio = scale / math.sqrt(square)
        correction = excess / delta / ratio / ratio
        if excess > 0.0:
            low = max(low, damping)
        elif excess < 0.0:
            high = min(high, damping)
        damping = max(low, damping + correction)
    return step, damping
