"""Force of fibers along an elastic tendon, with derivatives, and tendon length over force.

    P(x, u, a) = cos(alpha) (a f_L(l) f_V(v / kappa(a)) + f_PE(l) + damping v), never below 0

with x the fibers' part along the tendon [m], u its velocity [m/s], a the activation, l = sqrt(x^2 +
h^2) / L0 the normalized fiber length, cos(alpha) = x / sqrt(x^2 + h^2), v = u cos(alpha) / (v_max
L0), and kappa = 1 - slowed (1 - a). A muscle is in equilibrium where P is the normalized tendon
force.

A jet is a value with its derivatives. The curves are `MuscleModel.smooth_curves` and
`MuscleModel.stretch`.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.muscles.curves import curve_jet
from myomorph.core.rigid.kernels import inner

# Normalized force that fibers have per activation, and always, beside that of their curves: those
# that shorten so fast that the tendon is slack stay in equilibrium, and no activation becomes
# infinite.
FLOOR = 1e-3
TONE = 5e-4
# Least part of fibers along the tendon, by optimal length; shorter ones count as this long
MIN_ALONG = 1e-2
# Width of the step from fibers that pull to fibers that are slack [normalized force]
SLACKENED = 1e-3


@inner(counted=False, forceinline=True)
def tendon_jet(E, m, f):
    """Tendon length over slack length at the normalized force f > 0, slope and curvature over f.

    Parameters
    ----------
    E : `ElasticArrays`
    m : number of the muscle
    f : normalized force
    """
    return curve_jet(E.curves, E.curve[m, 3], f)


@inner(counted=False, forceinline=True)
def fiber_jet(  # page: a value and nine derivatives, each an equation by the chain rule
    E, m, x, u, a, out
):
    """P of a muscle and its derivatives.

    With b = a f_L f_V + f_PE + damping v, a function of l, v and a, the chain rule gives its
    derivatives in x and u. Fibers do not push, so b is replaced by (b + sqrt(b^2 + w^2)) / 2 plus a
    little tone, with the width w = `SLACKENED`. Last, P = cos(alpha) b.

    Parameters
    ----------
    E : `ElasticArrays`
    m : number of the muscle
    x, u, a : fibers' part along the tendon [m], its velocity [m/s], activation
    out : (10,) filled with P, P_x, P_u, P_a, P_xx, P_xu, P_uu, P_xa, P_ua, P_aa

    Returns
    -------
    l, v : normalized fiber length and velocity
    """
    H = E.hill
    h = H.height[m]
    fiber = H.fiber[m]
    speed = H.speed[m]
    least = max(H.shortest_along[m], MIN_ALONG * fiber)
    held = x < least
    if held:
        x = least
    # cos(alpha) and its derivatives in x; normalized length and velocity in x and u.
    size = np.sqrt(x * x + h * h)
    c0 = x / size
    c1 = h * h / (size * size * size)
    c2 = -3.0 * x * c1 / (size * size)
    l1 = c0 / fiber
    l2 = c1 / fiber
    v0 = c0 * u / speed
    v_x = c1 * u / speed
    v_u = c0 / speed
    v_xx = c2 * u / speed
    v_xu = c1 / speed
    # f_L, f_V and f_PE with slopes and curvatures.
    L0, L1, L2 = curve_jet(E.curves, E.curve[m, 0], size / fiber)
    kappa = 1.0 - E.slowed[m] * (1.0 - a)
    kappa1 = E.slowed[m]
    V0, V1, V2 = curve_jet(E.curves, E.curve[m, 1], v0 / kappa)
    q0 = 0.0
    q1 = 0.0
    q2 = 0.0
    if E.passive[m] > 0.0:
        q0, q1, q2 = curve_jet(E.curves, E.curve[m, 2], size / fiber)
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
        l1 = 0.0
        l2 = 0.0
        c1 = 0.0
        c2 = 0.0
        v_x = 0.0
        v_xx = 0.0
        v_xu = 0.0
    # From l and v to x and u.
    b_x = b_l * l1 + b_v * v_x
    b_u = b_v * v_u
    b_xx = b_ll * l1 * l1 + 2.0 * b_lv * l1 * v_x + b_vv * v_x * v_x + b_l * l2 + b_v * v_xx
    b_xu = b_lv * l1 * v_u + b_vv * v_x * v_u + b_v * v_xu
    b_uu = b_vv * v_u * v_u
    b_xa = b_la * l1 + b_va * v_x
    b_ua = b_va * v_u
    # Fibers do not push: a smooth step from their sum to nothing, and a little force beside.
    root = np.sqrt(b0 * b0 + SLACKENED * SLACKENED)
    s1 = 0.5 + 0.5 * b0 / root
    s2 = 0.5 * SLACKENED * SLACKENED / (root * root * root)
    b0 = 0.5 * (b0 + root) + TONE + FLOOR * a
    b_xx = s1 * b_xx + s2 * b_x * b_x
    b_xu = s1 * b_xu + s2 * b_x * b_u
    b_uu = s1 * b_uu + s2 * b_u * b_u
    b_xa = s1 * b_xa + s2 * b_x * b_a
    b_ua = s1 * b_ua + s2 * b_u * b_a
    b_aa = s1 * b_aa + s2 * b_a * b_a
    b_x = s1 * b_x
    b_u = s1 * b_u
    b_a = s1 * b_a + FLOOR
    # P = cos(alpha) b.
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
