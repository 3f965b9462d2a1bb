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

from typing import NamedTuple

import numpy as np

from myomorph.core.muscles.curves import curve_jet
from myomorph.core.rigid.kernels import in_place, inner

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


class FiberPart(NamedTuple):
    """Fibers whose part along the tendon is x and changes by u, with derivatives.

    Attributes
    ----------
    size : length of the fibers [m]
    cosine, cosine_x, cosine_xx : cos(alpha), over x [1/m, 1/m^2]
    l_x, l_xx : of the normalized length [1/m, 1/m^2]
    v : normalized velocity
    v_x, v_u, v_xx, v_xu : its derivatives
    """

    size: float
    cosine: float
    cosine_x: float
    cosine_xx: float
    l_x: float
    l_xx: float
    v: float
    v_x: float
    v_u: float
    v_xx: float
    v_xu: float


class CurveJet(NamedTuple):
    """Normalized force b(l, v, a) of the curves, and its derivatives."""

    b: float
    b_l: float
    b_v: float
    b_a: float
    b_ll: float
    b_lv: float
    b_vv: float
    b_la: float
    b_va: float
    b_aa: float


class ForceJet(NamedTuple):
    """Normalized force b(x, u, a) along the fibers, and its derivatives."""

    b: float
    b_x: float
    b_u: float
    b_a: float
    b_xx: float
    b_xu: float
    b_uu: float
    b_xa: float
    b_ua: float
    b_aa: float


@inner(counted=False, forceinline=True)
def fiber_jet(  # page: a muscle's state, and the array that is filled
    E, m, x, u, a, out
):
    """Compute P of a muscle and its derivatives.

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
    fiber = E.hill.fiber[m]
    part = _fiber_part(E.hill.height[m], fiber, E.hill.speed[m], E.hill.shortest_along[m], x, u)
    curves = _curve_jet(E, m, part.size / fiber, part.v, a)
    _along_tendon(part, _pulling(_along_fibers(curves, part), a), out)
    return part.size / fiber, part.v


@in_place
def _fiber_part(h, fiber, speed, shortest, x, u):
    """Find length, direction and velocity of fibers by their part along the tendon.

    Parts below the shortest one count as this, so that nothing changes with x there.

    Parameters
    ----------
    h : distance between the planes of attachment [m]
    fiber, speed : optimal length [m], maximum velocity [m/s]
    shortest : least part along the tendon [m]
    x, u : part along the tendon [m], its velocity [m/s]

    Returns
    -------
    `FiberPart`
    """
    least = max(shortest, MIN_ALONG * fiber)
    held = x < least
    if held:
        x = least
    size = np.sqrt(x * x + h * h)
    cosine = x / size
    v = cosine * u / speed
    v_u = cosine / speed
    if held:
        return FiberPart(
            size=size,
            cosine=cosine,
            cosine_x=0.0,
            cosine_xx=0.0,
            l_x=0.0,
            l_xx=0.0,
            v=v,
            v_x=0.0,
            v_u=v_u,
            v_xx=0.0,
            v_xu=0.0,
        )
    cosine_x = h * h / (size * size * size)
    cosine_xx = -3.0 * x * cosine_x / (size * size)
    return FiberPart(
        size=size,
        cosine=cosine,
        cosine_x=cosine_x,
        cosine_xx=cosine_xx,
        l_x=cosine / fiber,
        l_xx=cosine_x / fiber,
        v=v,
        v_x=cosine_x * u / speed,
        v_u=v_u,
        v_xx=cosine_xx * u / speed,
        v_xu=cosine_x / speed,
    )


@in_place
def _curve_jet(E, m, length, v, a):
    """Compute the normalized force of the curves of a muscle.

        b = a f_L(l) f_V(v / kappa) + f_PE(l) + damping v,   kappa = 1 - slowed (1 - a)

    With r = v / kappa, so that r_a = -v slowed / kappa^2.

    Parameters
    ----------
    E : `ElasticArrays`
    m : number of the muscle
    length, v, a : normalized fiber length and velocity, activation

    Returns
    -------
    `CurveJet`
    """
    slowed = E.slowed[m]
    kappa = 1.0 - slowed * (1.0 - a)
    L0, L1, L2 = curve_jet(E.curves, E.curve[m, 0], length)
    V0, V1, V2 = curve_jet(E.curves, E.curve[m, 1], v / kappa)
    q0 = 0.0
    q1 = 0.0
    q2 = 0.0
    if E.passive[m] > 0.0:
        q0, q1, q2 = curve_jet(E.curves, E.curve[m, 2], length)
    r_a = -v * slowed / (kappa * kappa)
    r_aa = -2.0 * r_a * slowed / kappa
    F = V0 * L0
    return CurveJet(
        b=a * F + q0 + E.damping[m] * v,
        b_l=a * V0 * L1 + q1,
        b_v=a * L0 * V1 / kappa + E.damping[m],
        b_a=F + a * L0 * V1 * r_a,
        b_ll=a * V0 * L2 + q2,
        b_lv=a * L1 * V1 / kappa,
        b_vv=a * L0 * V2 / (kappa * kappa),
        b_la=L1 * (V0 + a * V1 * r_a),
        b_va=L0 * (V1 / kappa + a * (V2 * r_a / kappa - V1 * slowed / (kappa * kappa))),
        b_aa=L0 * (2.0 * V1 * r_a + a * (V2 * r_a * r_a + V1 * r_aa)),
    )


@in_place
def _along_fibers(c, p):
    """Take a force over l and v as one over x and u, by the chain rule.

    Parameters
    ----------
    c : `CurveJet`
    p : `FiberPart`

    Returns
    -------
    `ForceJet`
    """
    b_ll = c.b_ll * p.l_x * p.l_x
    b_lv = 2.0 * c.b_lv * p.l_x * p.v_x
    return ForceJet(
        b=c.b,
        b_x=c.b_l * p.l_x + c.b_v * p.v_x,
        b_u=c.b_v * p.v_u,
        b_a=c.b_a,
        b_xx=b_ll + b_lv + c.b_vv * p.v_x * p.v_x + c.b_l * p.l_xx + c.b_v * p.v_xx,
        b_xu=c.b_lv * p.l_x * p.v_u + c.b_vv * p.v_x * p.v_u + c.b_v * p.v_xu,
        b_uu=c.b_vv * p.v_u * p.v_u,
        b_xa=c.b_la * p.l_x + c.b_va * p.v_x,
        b_ua=c.b_va * p.v_u,
        b_aa=c.b_aa,
    )


@in_place
def _pulling(f, a):
    """Replace a force b by one that never pushes, and add a little force.

        (b + sqrt(b^2 + w^2)) / 2 + tone + floor a,   w = `SLACKENED`

    Parameters
    ----------
    f : `ForceJet`
    a : activation

    Returns
    -------
    `ForceJet`
    """
    root = np.sqrt(f.b * f.b + SLACKENED * SLACKENED)
    s1 = 0.5 + 0.5 * f.b / root
    s2 = 0.5 * SLACKENED * SLACKENED / (root * root * root)
    return ForceJet(
        b=0.5 * (f.b + root) + TONE + FLOOR * a,
        b_x=s1 * f.b_x,
        b_u=s1 * f.b_u,
        b_a=s1 * f.b_a + FLOOR,
        b_xx=s1 * f.b_xx + s2 * f.b_x * f.b_x,
        b_xu=s1 * f.b_xu + s2 * f.b_x * f.b_u,
        b_uu=s1 * f.b_uu + s2 * f.b_u * f.b_u,
        b_xa=s1 * f.b_xa + s2 * f.b_x * f.b_a,
        b_ua=s1 * f.b_ua + s2 * f.b_u * f.b_a,
        b_aa=s1 * f.b_aa + s2 * f.b_a * f.b_a,
    )


@in_place
def _along_tendon(p, f, out):
    """Fill in P = cos(alpha) b and its derivatives.

    Parameters
    ----------
    p : `FiberPart`
    f : `ForceJet`
    out : (10,) filled with P, P_x, P_u, P_a, P_xx, P_xu, P_uu, P_xa, P_ua, P_aa
    """
    out[0] = p.cosine * f.b
    out[1] = p.cosine_x * f.b + p.cosine * f.b_x
    out[2] = p.cosine * f.b_u
    out[3] = p.cosine * f.b_a
    out[4] = p.cosine_xx * f.b + 2.0 * p.cosine_x * f.b_x + p.cosine * f.b_xx
    out[5] = p.cosine_x * f.b_u + p.cosine * f.b_xu
    out[6] = p.cosine * f.b_uu
    out[7] = p.cosine_x * f.b_a + p.cosine * f.b_xa
    out[8] = p.cosine * f.b_ua
    out[9] = p.cosine * f.b_aa
