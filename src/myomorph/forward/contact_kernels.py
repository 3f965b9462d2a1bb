"""Contact of spheres with a plane of the ground, as a kernel."""

from __future__ import annotations

import math

from myomorph.core.rigid.bushing_kernels import point_velocity
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.vectors import (
    cross,
    dot,
    matrix,
    minus,
    norm,
    plus,
    put_vector,
    times,
    turned,
    vector,
)

EPS = 1e-5  # Of the smooth depth, as in OpenSim [m^2]
SLIP_EPS = 2.0**-52  # Of the slipping speed [m^2/s^2]
# Entries of a law
(
    STIFFNESS,
    DISSIPATION,
    STATIC,
    DYNAMIC,
    VISCOUS,
    TRANSITION,
    HERTZ,
    HUNT,
) = range(8)


@bare
def add_contacts(C, pose, rates, loads, contact):
    """Add the forces of contacts to the wrenches on the bodies.

    A sphere of radius R whose lowest point is x deep in the plane, going in at the rate xdot, is
    pushed by (Hunt and Crossley 1975, smoothed as by Serrancoli et al. 2019)

        f_n = f_H (1/2 + tanh(b_v (xdot + 2 / (3 d))) / 2) (1 + 3/2 d xdot),
        f_H = 4/3 k (R k)^(1/2) ((x^2 + e)^(1/2))^(3/2) (1/2 + tanh(b_h x) / 2),  k = (K / 2)^(2/3)

    and dragged by friction against the velocity v of its contact point along the plane

        f_t = f_n (min(v / v_t, 1) (mu_d + 2 (mu_s - mu_d) / (1 + (v / v_t)^2)) + mu_v v)

    Parameters
    ----------
    C : `ContactArrays`
    pose, rates : of `body_poses` and `body_rates`
    loads : (bodies, 3) force [N] and moment about the ground's origin [N m], in ground, changed
    contact : (spheres, 6) force on each [N] and where it acts [m], in ground, filled

    Returns
    -------
    power of all contacts [W]
    """
    f, m = loads
    power = 0.0
    up = (C.up[0], C.up[1], C.up[2])
    for s in range(C.body.shape[0]):
        b = C.body[s]
        R = C.radius[s]
        center = plus(vector(pose.p, b), turned(matrix(pose.R, b), vector(C.center, s)))
        depth = C.height[0] - dot(center, up) + R
        # The point of contact lies half as deep as the sphere.
        point = minus(center, times(R - 0.5 * depth, up))
        v = point_velocity(pose, rates, b, point)
        rate = -dot(v, up)
        slip = plus(v, times(rate, up))
        normal, drag = _forces(C.law, R, depth, rate, norm(slip))
        force = plus(times(normal, up), times(-drag, slip))
        put_vector(f, b, plus(vector(f, b), force))
        put_vector(m, b, plus(vector(m, b), cross(point, force)))
        for i in range(3):
            contact[s, i] = force[i]
            contact[s, 3 + i] = point[i]
        power += dot(force, v)
    return power


@bare
def _forces(law, R, depth, rate, speed):
    """Find the normal force [N], and friction by speed [N s/m]."""
    k = 0.5 * law[STIFFNESS] ** (2.0 / 3.0)
    smooth = math.sqrt(depth * depth + EPS)
    hertz = 4.0 / 3.0 * k * math.sqrt(R * k) * smooth**1.5
    hertz *= 0.5 + 0.5 * math.tanh(law[HERTZ] * depth)
    c = law[DISSIPATION]
    normal = hertz * (1.0 + 1.5 * c * rate)
    if c > 0.0:
        normal *= 0.5 + 0.5 * math.tanh(law[HUNT] * (rate + 2.0 / (3.0 * c)))
    slipping = math.sqrt(speed * speed + SLIP_EPS)
    share = slipping / law[TRANSITION]
    friction = min(share, 1.0) * (
        law[DYNAMIC] + 2.0 * (law[STATIC] - law[DYNAMIC]) / (1.0 + share * share)
    )
    return normal, normal * (friction + law[VISCOUS] * slipping) / slipping
