"""What fibers pull with along an elastic tendon, with first and second derivatives; tendon stretch over force.

    P(x, u, a) = cos(alpha) (a f_L(l) f_V(v / kappa(a)) + f_PE(l) + damping v), never below 0

with x the fibers' part along the tendon [m], u its velocity [m/s], a the activation, l = sqrt(x^2 + h^2) / L0 the
normalized fiber length, cos(alpha) = x / sqrt(x^2 + h^2), v = u cos(alpha) / (v_max L0), and kappa = 0.25 + 0.75 a of
Thelen2003Muscle, 1 of the others. A muscle is in equilibrium where P is the normalized tendon force.

A jet is a value with its derivatives. The curves are those of `hill`.
"""

from __future__ import annotations

import numpy as np

from myomorph.muscles.hill_classes import MILLARD, THELEN
from myomorph.muscles.hill_curves import parameter_at
from myomorph.rigid.kernels import inner

FLOOR, TONE = 1e-3, 5e-4
"""Normalized force that fibers have per activation, and always, beside that of their curves: those that shorten so fast
that the tendon is slack stay in equilibrium, and no activation becomes infinite."""

SLACKENED = 1e-3
"""Width of the step from fibers that pull to fibers that are slack [normalized force]."""

ROUNDED = 0.01
"""Normalized velocity up to which the corner of Thelen's force-velocity curve is rounded, by at most 0.013."""

TAKEN_UP = 0.02
"""Normalized length on both sides of 1 over which Thelen's passive force sets in, by at most 0.001 from his curve."""


@inner
def curve_jet(C, i, x):
    """Value, slope and curvature of curve i at x."""
    low, high = C.first[i], C.first[i + 1] - 1
    if not x >= C.start[low]:
        return C.pieces[low, 1, 0] + C.left[i] * (x - C.start[low]), C.left[i], 0.0
    if x >= C.end_x[i]:
        return C.end_y[i] + C.right[i] * (x - C.end_x[i]), C.right[i], 0.0
    while high > low and x < C.start[high]:
        high -= 1
    P = C.pieces
    u = parameter_at(P, high, x)
    a1, a2, a3, a4, a5 = P[high, 0, 1], P[high, 0, 2], P[high, 0, 3], P[high, 0, 4], P[high, 0, 5]
    b0, b1, b2, b3, b4, b5 = P[high, 1, 0], P[high, 1, 1], P[high, 1, 2], P[high, 1, 3], P[high, 1, 4], P[high, 1, 5]
    x1 = max(a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * (4.0 * a4 + u * 5.0 * a5))), 1e-9)
    x2 = 2.0 * a2 + u * (6.0 * a3 + u * (12.0 * a4 + u * 20.0 * a5))
    y0 = b0 + u * (b1 + u * (b2 + u * (b3 + u * (b4 + u * b5))))
    y1 = b1 + u * (2.0 * b2 + u * (3.0 * b3 + u * (4.0 * b4 + u * 5.0 * b5)))
    y2 = 2.0 * b2 + u * (6.0 * b3 + u * (12.0 * b4 + u * 20.0 * b5))
    return y0, y1 / x1, (y2 - y1 / x1 * x2) / (x1 * x1)


@inner(forceinline=True)
def tendon_jet(E, m, f):
    """Tendon length over slack length at the normalized force f > 0, slope and curvature over f."""
    if E.curve[m] >= 0:
        return curve_jet(E.curves, E.curve[m], f)
    p0, p1, p2, p3 = E.tendon[m, 0], E.tendon[m, 1], E.tendon[m, 2], E.tendon[m, 3]
    force = min(f, E.straight[m, 0])
    inside = p1 * force + p2
    stretch, slope = p0 * np.log(inside) + p3, p0 * p1 / inside
    if f > E.straight[m, 0]:
        return stretch + E.straight[m, 1] * (f - force), E.straight[m, 1], 0.0
    return stretch, slope, -slope * p1 / inside


@inner(forceinline=True)
def active_jet(H, m, x):
    """f_L at the normalized fiber length x, slope and curvature."""
    if H.kind[m] == MILLARD:
        return curve_jet(H.curves, H.curve[m, 0], x)
    if H.kind[m] == THELEN:
        width = H.parameters[m, 0]
        y = np.exp(-(x - 1.0) * (x - 1.0) / width)
        slope = -2.0 * (x - 1.0) / width
        return y, slope * y, (slope * slope - 2.0 / width) * y
    width = H.parameters[m, 0]
    x = (x - 1.0) / width + 1.0
    y0, y1, y2 = 0.0, 0.0, 0.0
    for index in range(3):
        if index == 0:
            size, middle, base, rise = 0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465
        elif index == 1:
            size, middle, base, rise = 0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188
        else:
            size, middle, base, rise = 0.1, 1.0, 0.353553390593274, 0.0
        spread = base + rise * x
        z = (x - middle) / spread
        z1 = (base + rise * middle) / (spread * spread)
        z2 = -2.0 * rise * z1 / spread
        bell = size * np.exp(-0.5 * z * z)
        y0 += bell
        y1 -= z * z1 * bell
        y2 += (z * z * z1 * z1 - z1 * z1 - z * z2) * bell
    return y0, y1 / width, y2 / (width * width)


@inner(forceinline=True)
def _rounded(x, half, y0, s0, y1, s1):
    """The cubic over -half ... half with values y0, y1 and slopes s0, s1 at its ends: value, slope, curvature at x."""
    width = 2.0 * half
    t, rise = (x + half) / width, y1 - y0
    c1, c2, c3 = s0 * width, 3.0 * rise - (2.0 * s0 + s1) * width, (s0 + s1) * width - 2.0 * rise
    y = y0 + t * (c1 + t * (c2 + t * c3))
    return y, (c1 + t * (2.0 * c2 + 3.0 * c3 * t)) / width, (2.0 * c2 + 6.0 * c3 * t) / (width * width)


@inner
def _thelen_velocity(shape, most, share, v):
    """Thelen's f_V with its tangent beyond the eccentric end; slope and curvature."""
    if v <= 0.0:
        if v < -1.0:
            return 0.0, 0.0, 0.0
        down = 1.0 - v / shape
        y, slope = (1.0 + v) / down, (1.0 + 1.0 / shape) / (down * down)
        return y, slope, 2.0 * slope / (shape * down)
    k = (2.0 + 2.0 / shape) / (most - 1.0)
    last = share * most
    end = (last - 1.0) / (k * (most - last))
    at = min(v, end)
    down = 1.0 + at * k
    y, slope = (1.0 + at * k * most) / down, k * (most - 1.0) / (down * down)
    if v > end:
        return y + slope * (v - at), slope, 0.0
    return y, slope, -2.0 * slope * k / down


@inner(forceinline=True)
def velocity_jet(H, m, v):
    """f_V at the normalized fiber velocity v, slope and curvature."""
    if H.kind[m] == MILLARD:
        return curve_jet(H.curves, H.curve[m, 1], v)
    if H.kind[m] == THELEN:
        shape, most, share = H.parameters[m, 3], H.parameters[m, 4], H.parameters[m, 5]
        if abs(v) >= ROUNDED:
            return _thelen_velocity(shape, most, share, v)
        # Both branches meet at rest with slopes 1 : 2, where no Newton step would end: a cubic between them.
        y0, s0, _ = _thelen_velocity(shape, most, share, -ROUNDED)
        y1, s1, _ = _thelen_velocity(shape, most, share, ROUNDED)
        return _rounded(v, ROUNDED, y0, s0, y1, s1)
    z = -8.149 * v - 0.374
    root = np.sqrt(z * z + 1.0)
    y = -0.3211346127989808 * np.log(z + root) + 0.8825327733249912
    if y <= 0.0:
        return 0.0, 0.0, 0.0
    slope = 0.3211346127989808 * 8.149 / root
    return y, slope, slope * 8.149 * z / (root * root)


@inner(forceinline=True)
def passive_jet(H, m, x):
    """f_PE at the normalized fiber length x, slope and curvature."""
    if H.kind[m] == MILLARD:
        return curve_jet(H.curves, H.curve[m, 2], x)
    if H.kind[m] == THELEN:
        if x <= 1.0 - TAKEN_UP:
            return 0.0, 0.0, 0.0
        rate, full = H.parameters[m, 2] / H.parameters[m, 1], np.exp(H.parameters[m, 2]) - 1.0
        # The curve begins with a slope, at which no Newton step would end.
        y = np.exp(rate * max(x - 1.0, TAKEN_UP))
        if x < 1.0 + TAKEN_UP:
            return _rounded(x - 1.0, TAKEN_UP, 0.0, 0.0, (y - 1.0) / full, rate * y / full)
        return (y - 1.0) / full, rate * y / full, rate * rate * y / full
    rate = 4.0 / H.parameters[m, 1]
    least = np.exp(-0.8 * rate)
    y = np.exp(rate * (x - 1.0))
    if y <= least or H.parameters[m, 2] == 0.0:
        return 0.0, 0.0, 0.0
    size = H.parameters[m, 2] / (np.exp(4.0) - least)
    return size * (y - least), size * rate * y, size * rate * rate * y


@inner(forceinline=True)
def fiber_jet(E, m, x, u, a, out):
    """P of muscle m and its derivatives.

    Parameters
    ----------
    x, u, a : fibers' part along the tendon [m], its velocity [m/s], activation
    out : (10,) filled with P, P_x, P_u, P_a, P_xx, P_xu, P_uu, P_xa, P_ua, P_aa

    Returns
    -------
    l, v : normalized fiber length and velocity
    """
    H = E.hill
    h, fiber, speed = H.height[m], H.fiber[m], H.speed[m]
    least = max(H.shortest_along[m], 1e-2 * fiber)
    held = x < least
    if held:
        x = least
    size = np.sqrt(x * x + h * h)
    c0 = x / size
    c1 = h * h / (size * size * size)
    c2 = -3.0 * x * c1 / (size * size)
    l1, l2 = c0 / fiber, c1 / fiber
    v0, v_x, v_u = c0 * u / speed, c1 * u / speed, c0 / speed
    v_xx, v_xu = c2 * u / speed, c1 / speed
    L0, L1, L2 = active_jet(H, m, size / fiber)
    kappa, kappa1 = 1.0 - E.slowed[m] * (1.0 - a), E.slowed[m]
    V0, V1, V2 = velocity_jet(H, m, v0 / kappa)
    q0, q1, q2 = 0.0, 0.0, 0.0
    if E.passive[m] > 0.0:
        q0, q1, q2 = passive_jet(H, m, size / fiber)
    # The factor of activation, F = f_L f_V: derivatives over l, v and a.
    r_a = -v0 * kappa1 / (kappa * kappa)
    r_aa = -2.0 * r_a * kappa1 / kappa
    F = V0 * L0
    b0 = a * F + q0 + E.damping[m] * v0
    b_l = a * V0 * L1 + q1
    b_v = a * L0 * V1 / kappa + E.damping[m]
    b_a = F + a * L0 * V1 * r_a
    b_ll = a * V0 * L2 + q2
    b_lv = a * L1 * V1 / kappa
    b_vv = a * L0 * V2 / (kappa * kappa)
    b_la = L1 * (V0 + a * V1 * r_a)
    b_va = L0 * (V1 / kappa + a * (V2 * r_a / kappa - V1 * kappa1 / (kappa * kappa)))
    b_aa = L0 * (2.0 * V1 * r_a + a * (V2 * r_a * r_a + V1 * r_aa))
    if held:
        l1, l2, c1, c2, v_x, v_xx, v_xu = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    b_x, b_u = b_l * l1 + b_v * v_x, b_v * v_u
    b_xx = b_ll * l1 * l1 + 2.0 * b_lv * l1 * v_x + b_vv * v_x * v_x + b_l * l2 + b_v * v_xx
    b_xu = b_lv * l1 * v_u + b_vv * v_x * v_u + b_v * v_xu
    b_uu = b_vv * v_u * v_u
    b_xa, b_ua = b_la * l1 + b_va * v_x, b_va * v_u
    # Fibers do not push: a smooth step from their sum to nothing, and a little force beside.
    root = np.sqrt(b0 * b0 + SLACKENED * SLACKENED)
    s1, s2 = 0.5 + 0.5 * b0 / root, 0.5 * SLACKENED * SLACKENED / (root * root * root)
    b0 = 0.5 * (b0 + root) + TONE + FLOOR * a
    b_xx, b_xu, b_uu = s1 * b_xx + s2 * b_x * b_x, s1 * b_xu + s2 * b_x * b_u, s1 * b_uu + s2 * b_u * b_u
    b_xa, b_ua, b_aa = s1 * b_xa + s2 * b_x * b_a, s1 * b_ua + s2 * b_u * b_a, s1 * b_aa + s2 * b_a * b_a
    b_x, b_u, b_a = s1 * b_x, s1 * b_u, s1 * b_a + FLOOR
    out[0] = c0 * b0
    out[1] = c1 * b0 + c0 * b_x
    out[2] = c0 * b_u
    out[3] = c0 * b_a
    out[4] = c2 * b0 + 2.0 * c1 * b_x + c0 * b_xx
    out[5] = c1 * b_u + c0 * b_xu
    out[6] = c0 * b_uu
    out[7] = c1 * b_a + c0 * b_xa
    out[8] = c0 * b_ua
    out[9] = c0 * b_aa
    return size / fiber, v0
