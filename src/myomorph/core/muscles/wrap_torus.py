"""Wrapping through a torus as OpenSim defines it (`WrapTorus`, 4.6), one segment at a time.

OpenSim looks for the point of the torus's circle nearest to the segment, puts a long cylinder there
along the circle, and wraps around that cylinder. The search is MINPACK's least squares in one
unknown with loose tolerances, which decide where it stops; so the same steps are taken here.
"""

from __future__ import annotations

import math

from myomorph.core.muscles.wrap_cylinder import NO_WRAP, WRAPPED, Half, wrap_cylinder
from myomorph.core.rigid.kernels import inner
from myomorph.core.rigid.vectors import along, dot, minus, sign, unit

# OpenSim's: length of the helper cylinder [m], step of differences, tolerances of MINPACK, first
# bound of a step, and evaluations
CYLINDER_LENGTH = 10000.0
STEP = 1e-5
TOLERANCE = 1e-4
FIRST_BOUND = 0.2
MAX_CALLS = 500


@inner
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
    code, arc, r, s : as of `wrap_cylinder`, but never `MANDATORY`; arc is NaN where the code is
        `WRAPPED` although the cylinder was missed, which only matters to the order of several
        surfaces
    """
    inner_radius, outer = size
    result, x, y = _nearest_on_circle(a, b, outer, half.axis, half.side)
    if not result:
        return NO_WRAP, 0.0, a, b
    # Cylinder frame: x towards the center of the torus, y down, z along the circle.
    cx = -x / outer
    cy = -y / outer
    p = (cx * a[0] + cy * a[1] + outer, -a[2], -cy * a[0] + cx * a[1])
    q = (cx * b[0] + cy * b[1] + outer, -b[2], -cy * b[0] + cx * b[1])
    # OpenSim's helper cylinder keeps the side it is born with: the half towards the center.
    # (Written as variables, since a call with literals would compile the cylinder once more.)
    code, arc, r, s = wrap_cylinder(
        p,
        q,
        (inner_radius, CYLINDER_LENGTH),
        Half(axis=half.axis * 0, side=half.side * 0 + 1),
        single,
    )
    if code < WRAPPED:
        return WRAPPED, math.nan, a, b
    u = r[0] - outer
    v = s[0] - outer
    r = (cx * u - cy * r[2], cy * u + cx * r[2], -r[1])
    s = (cx * v - cy * s[2], cy * v + cx * s[2], -s[1])
    return WRAPPED, arc, r, s


@inner
def _nearest_on_circle(a, b, radius, axis, side):
    """Find the point of the circle nearest to a line, searched from both ends.

    Returns
    -------
    whether it is on the right half, x and y [m]
    """
    d = unit(minus(b, a))
    one = along(a, _search(a, d, radius), d)
    d = (-d[0], -d[1], -d[2])
    other = along(b, _search(b, d, radius), d)
    nearer = _distance(one, radius) < _distance(other, radius)
    if side != 0:
        one_on = sign(one[axis]) == side
        other_on = sign(other[axis]) == side
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
    """Distance of a point from the circle [m]."""
    return math.sqrt(max(0.0, dot(p, p) + radius * radius - 2.0 * radius * math.hypot(p[0], p[1])))


@inner
def _slope(p, d, radius, u):
    """Differentiate the squared distance to the circle along the line, at p + u d.

    With rho the distance of p + u d from the z axis,

        d/du (|p + u d|^2 - 2 radius rho)
    """
    flat = p[0] * d[0] + p[1] * d[1]
    level = d[0] * d[0] + d[1] * d[1]
    across = math.sqrt(u * u * level + 2.0 * flat * u + p[0] * p[0] + p[1] * p[1])
    if across == 0.0:
        return math.nan
    return 2.0 * dot(p, d) + 2.0 * u - 2.0 * radius * (2.0 * level * u + 2.0 * flat) / across


@inner
def _search(p, d, radius):
    """Search the root of `_slope` from u = 0 by MINPACK's Levenberg-Marquardt, in one unknown."""
    x = 0.0
    par = 0.0
    delta = 0.0
    scale = 0.0
    x_norm = 0.0
    f = _slope(p, d, radius, x)
    calls = 1
    first = True
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
            t1 = abs(slope * step / f)
            t2 = math.sqrt(par) * size / abs(f)
            predicted = t1 * t1 + 2.0 * t2 * t2
            direction = -(t1 * t1 + t2 * t2)
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
    """Compute a step of scaled size about `delta` at most, and MINPACK's parameter of it."""
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
        before = excess
        excess = scale * abs(step) - delta
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
