"""Kernels of bushings: wrenches on the bodies that they hold together, and their powers."""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.vectors import (
    cross,
    dot,
    matrix,
    minus,
    plus,
    product,
    put_vector,
    turned,
    turned_back,
    vector,
)


class BushingArrays(NamedTuple):
    """Bushings as kernels read them.

    Attributes
    ----------
    body_1, body_2 : (bushings,) numbers of the bodies held together
    point_1, point_2 : (bushings, 3) origins of the frames in their bodies [m]
    turn_1, turn_2 : (bushings, 3, 3) rotations of the frames in their bodies
    stiffness, damping : (bushings, 6) along the angles [N m/rad], [N m s/rad], then the
        translations [N/m], [N s/m]
    """

    body_1: Ints
    body_2: Ints
    point_1: Array
    point_2: Array
    turn_1: Array
    turn_2: Array
    stiffness: Array
    damping: Array


@bare
def add_bushings(B, pose, rates, f, m):
    """Add the wrenches of bushings to those on the bodies.

    With q the body-fixed x-y-z angles and the origin e of the second frame seen from the first, the
    force along each is -(K q + D qdot). The rates of the angles are E^-1 W of the relative angular
    velocity W, so the moment along the first frame's axes is -E^-T (K q + D qdot).

    Source: OpenSim's `BushingForce` (Seth et al. 2018).

    Parameters
    ----------
    B : `BushingArrays`
    pose, rates : of `body_poses` and `body_rates`
    f, m : (bodies, 3) force [N] and moment about the ground's origin [N m], in ground, changed

    Returns
    -------
    power of the springs, power of the dampers [W]
    """
    springs = 0.0
    dampers = 0.0
    for i in range(B.body_1.shape[0]):
        b1 = B.body_1[i]
        b2 = B.body_2[i]
        r1, x2, sines, q, qdot = _deflection(B, pose, rates, i)
        spring, damper = _forces_along(B, i, q, qdot)
        springs += dot(spring[0], qdot[0]) + dot(spring[1], qdot[1])
        dampers += dot(damper[0], qdot[0]) + dot(damper[1], qdot[1])
        force = turned(r1, plus(spring[1], damper[1]))
        moment = turned(r1, _moment(sines, plus(spring[0], damper[0])))
        moment = plus(moment, cross(x2, force))
        put_vector(f, b2, plus(vector(f, b2), force))
        put_vector(m, b2, plus(vector(m, b2), moment))
        put_vector(f, b1, minus(vector(f, b1), force))
        put_vector(m, b1, minus(vector(m, b1), moment))
    return springs, dampers


@bare
def _deflection(B, pose, rates, i):
    """Find how bushing i is deflected.

    Returns
    -------
    r1 : rotation of the first frame in ground
    x2 : origin of the second [m]
    sines : of the angles, see `_angles`
    q, qdot : angles and translations, and their rates
    """
    b1 = B.body_1[i]
    b2 = B.body_2[i]
    r1 = product(matrix(pose.R, b1), matrix(B.turn_1, i))
    r2 = product(matrix(pose.R, b2), matrix(B.turn_2, i))
    x1 = plus(vector(pose.p, b1), turned(matrix(pose.R, b1), vector(B.point_1, i)))
    x2 = plus(vector(pose.p, b2), turned(matrix(pose.R, b2), vector(B.point_2, i)))
    angles, sines = _angles(r1, r2)
    W = turned_back(r1, minus(vector(rates.omega, b2), vector(rates.omega, b1)))
    V = turned_back(
        r1, minus(point_velocity(pose, rates, b2, x2), point_velocity(pose, rates, b1, x2))
    )
    return r1, x2, sines, (angles, turned_back(r1, minus(x2, x1))), (_angle_rates(sines, W), V)


@bare
def _forces_along(B, i, q, qdot):
    """Find forces of springs, and of dampers, along angles and translations."""
    K = B.stiffness[i]
    D = B.damping[i]
    angles, gap = q
    turning, moving = qdot
    spring = (
        (-K[0] * angles[0], -K[1] * angles[1], -K[2] * angles[2]),
        (-K[3] * gap[0], -K[4] * gap[1], -K[5] * gap[2]),
    )
    damper = (
        (-D[0] * turning[0], -D[1] * turning[1], -D[2] * turning[2]),
        (-D[3] * moving[0], -D[4] * moving[1], -D[5] * moving[2]),
    )
    return spring, damper


@bare
def _angles(r1, r2):
    """Body-fixed angles x, y, z between two frames, and (sin x, cos x, sin y, cos y)."""
    Q = product((r1[0], r1[3], r1[6], r1[1], r1[4], r1[7], r1[2], r1[5], r1[8]), r2)
    x = math.atan2(-Q[5], Q[8])
    y = math.asin(min(max(Q[2], -1.0), 1.0))
    z = math.atan2(-Q[1], Q[0])
    return (x, y, z), (math.sin(x), math.cos(x), math.sin(y), math.cos(y))


@bare
def _angle_rates(sines, W):
    """Rates u of the angles of an angular velocity W = E u, see `bushings.angular_velocities`."""
    sx, cx, sy, cy = sines
    z = (cx * W[2] - sx * W[1]) / cy
    return W[0] - sy * z, cx * W[1] + sx * W[2], z


@bare
def _moment(sines, along_angles):
    """Moment E^-T g whose components along the angles are g."""
    sx, cx, sy, cy = sines
    z = (along_angles[2] - sy * along_angles[0]) / cy
    y = along_angles[1]
    return along_angles[0], cx * y - sx * z, sx * y + cx * z


@bare
def point_velocity(pose, rates, b, x):
    """Velocity of the point of body b that is at x."""
    lever = minus(x, vector(pose.p, b))
    return plus(vector(rates.v, b), cross(vector(rates.omega, b), lever))
