"""Kernels of muscles in motion: activation dynamics, and the fibers of elastic tendons."""

from __future__ import annotations

import math

from myomorph.core.muscles.curves import curve_jet, curve_value
from myomorph.core.rigid.kernels import bare

MAX_SPEED = 100.0  # Normalized velocity of fibers beyond which no balance is searched
MAX_SEARCHES = 60  # Steps of the search for a fiber velocity
BALANCED = 1e-12  # Normalized force below which it has converged
MIN_COSINE = 1e-3  # Of the pennation
MIN_FIBER = 1e-6  # Length of fibers by the optimal one


@bare
def activation_rate(M, m, activation, excitation):
    """Rate of the activation of a muscle [1/s].

    Rising with tau_a (1/2 + 3/2 a), falling with tau_d / (1/2 + 3/2 a) (Thelen 2003), or smoothly
    between both (De Groote et al. 2016):

        adot = (u - a) / tau,   or   (u - a) ((1/2 + f) / rise + (1/2 - f) / fall),
        f = tanh(b (u - a)) / 2

    Parameters
    ----------
    M : `MuscleArrays`
    m : number of the muscle
    activation, excitation : a and u
    """
    a = max(activation, M.least[m])
    u = min(max(excitation, M.least[m]), 1.0)
    slow = 0.5 + 1.5 * a
    rise = M.times[0, m] * slow
    fall = M.times[1, m] / slow
    if M.smoothing[m] > 0.0:
        f = 0.5 * math.tanh(M.smoothing[m] * (u - a))
        return (u - a) * ((0.5 + f) / rise + (0.5 - f) / fall)
    return (u - a) / (rise if u > a else fall)


@bare
def elastic_tendon(M, m, length, activation, fiber):
    """Force of a tendon and velocity of the fibers that pull as it does.

        (a f_L f_V(v) + f_PE + damping v) cos(alpha) = f_SE

    Parameters
    ----------
    M : `MuscleArrays`
    m : number of the muscle
    length : of the path [m]
    activation : a
    fiber : length of the fibers [m]

    Returns
    -------
    force of the tendon [N], lengthening velocity of the fibers [m/s]
    """
    H = M.hill
    shortest = max(H.shortest[m], MIN_FIBER * H.fiber[m])
    l = max(fiber, shortest)
    sine = H.height[m] / l
    cosine = math.sqrt(max(1.0 - sine * sine, MIN_COSINE * MIN_COSINE))
    strained = (length - l * cosine) / H.tendon[m]
    pull = max(curve_value(M.curves, M.curve[m, 3], strained), 0.0)
    x = l / H.fiber[m]
    passive = max(curve_value(M.curves, M.curve[m, 2], x), 0.0)
    active = activation * max(curve_value(M.curves, M.curve[m, 0], x), 0.0)
    v = _balancing_velocity(M, m, active, pull / cosine - passive)
    scale = H.speed[m] * (1.0 - M.slowed[m] * (1.0 - activation))
    speed = v * scale
    # Fibers at their least length only lengthen.
    if fiber <= shortest and speed < 0.0:
        speed = 0.0
    return H.force[m] * pull, speed


@bare
def _balancing_velocity(M, m, active, rest):
    """Solve active f_V(v) + damping v = rest for the normalized velocity v by Newton steps."""
    damping = M.damping[m]
    curve = M.curve[m, 1]
    low = -MAX_SPEED
    high = MAX_SPEED
    v = 0.0
    for _ in range(MAX_SEARCHES):
        value, slope, _ = curve_jet(M.curves, curve, v)
        error = active * value + damping * v - rest
        if abs(error) < BALANCED:
            break
        if error > 0.0:
            high = v
        else:
            low = v
        slope = active * slope + damping
        step = v - error / slope if slope > 0.0 else high
        inside = low < step < high
        v = step if inside else 0.5 * (low + high)
    return v
