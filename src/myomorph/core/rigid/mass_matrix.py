"""The mass matrix of a model by composite bodies, over elementary axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import evaluate_at
from myomorph.core.rigid.kernels import bare, inner, kernel
from myomorph.core.rigid.kinematics import body_poses, pose_room
from myomorph.core.rigid.tree import ROTATION
from myomorph.core.rigid.vectors import (
    along,
    cross,
    dot,
    matrix,
    minus,
    plus,
    product,
    put_matrix,
    put_vector,
    times,
    turned,
    vector,
)


class CompositeArrays(NamedTuple):
    """Bodies with all that hangs on each, in one frame.

    Attributes
    ----------
    mass : (bodies,) [kg]
    moment : (bodies, 3) mass times mass center, in ground [kg m]
    inertia : (bodies, 3, 3) about the ground's origin, in ground [kg m^2]
    """

    mass: Array
    moment: Array
    inertia: Array


@inner
def composite_room(T):
    """Make the `CompositeArrays` that `mass_matrix` fills."""
    bodies = T.parent.shape[0]
    return CompositeArrays(
        mass=np.empty(bodies), moment=np.empty((bodies, 3)), inertia=np.empty((bodies, 3, 3))
    )


@bare
def mass_matrix(T, c, pose, composite, M):
    """Mass matrix of a frame, with what dependent coordinates do handed on to those they follow.

    A unit rate of axis k gives the composite body beyond it, of mass m, first moment h and inertia
    I, the momentum

        p = m v + w x h,   L = I w + h x v,   v = o x w      (a rotation about w through o)
        p = m w,           L = h x w                         (a translation along w)

    about the ground's origin. An axis l between the ground and it takes w_l . (L - o_l x p), or
    w_l . p (Featherstone 2008, ch. 6), and axes become coordinates by their slopes:

        M = sum_kl Phi_k^T A_kl Phi_l

    Parameters
    ----------
    T : `TreeArrays`
    c : (coordinates,) consistent
    pose : of `body_poses`
    composite : `CompositeArrays`, filled
    M : (coordinates, coordinates) filled; rows and columns of dependent coordinates hold their own
        share
    """
    _composites(T, pose, composite)
    M[:, :] = 0.0
    for b in range(1, T.parent.shape[0]):
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            w = vector(pose.w, axis)
            h = vector(composite.moment, b)
            if T.axis_kind[axis] == ROTATION:
                v = cross(vector(pose.o, axis), w)
                p = along(cross(w, h), composite.mass[b], v)
                L = plus(turned(matrix(composite.inertia, b), w), cross(h, v))
            else:
                p = times(composite.mass[b], w)
                L = cross(h, w)
            _put_momentum(T, pose, axis, p, L, M)
    _gather(T, c, M)


@bare
def _composites(T, pose, composite):
    """Add up the bodies from the leaves to the ground."""
    for b in range(T.parent.shape[0]):
        r = matrix(pose.R, b)
        center = plus(vector(pose.p, b), turned(r, vector(T.mass_center, b)))
        mass = T.mass[b]
        composite.mass[b] = mass
        put_vector(composite.moment, b, times(mass, center))
        transposed = (r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8])
        put_matrix(composite.inertia, b, product(product(r, matrix(T.inertia, b)), transposed))
        square = mass * dot(center, center)
        for i in range(3):
            composite.inertia[b, i, i] += square
            for j in range(3):
                composite.inertia[b, i, j] -= mass * center[i] * center[j]
    for b in range(T.parent.shape[0] - 1, 0, -1):
        h = T.parent[b]
        composite.mass[h] += composite.mass[b]
        for i in range(3):
            composite.moment[h, i] += composite.moment[b, i]
            for j in range(3):
                composite.inertia[h, i, j] += composite.inertia[b, i, j]


@bare
def _put_momentum(T, pose, axis, p, L, M):
    """Add to M what all axes up to the ground take of the momentum of a unit rate of one."""
    body = T.axis_body[axis]
    last = axis + 1
    while body > 0:
        for other in range(T.axis_start[body], last):
            acts = p
            if T.axis_kind[other] == ROTATION:
                acts = minus(L, cross(vector(pose.o, other), p))
            share = dot(vector(pose.w, other), acts)
            for slot in range(2):
                i = T.axis_coordinate[axis, slot]
                for other_slot in range(2):
                    j = T.axis_coordinate[other, other_slot]
                    if i < 0 or j < 0:
                        continue
                    value = pose.dphi[axis, slot] * pose.dphi[other, other_slot] * share
                    M[i, j] += value
                    if other != axis:
                        M[j, i] += value
        body = T.parent[body]
        last = T.axis_start[body + 1]


@bare
def _gather(T, c, M):
    """Add rows and columns of dependent coordinates to those they follow, last couplers first."""
    for coupler in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d = T.coupler_coordinate[coupler]
        i = T.coupler_source[coupler, 0]
        j = T.coupler_source[coupler, 1]
        _, d1, d2, _, _, _ = evaluate_at(T.functions, T.coupler_function[coupler], i, j, c)
        for slot in range(2):
            source = i if slot == 0 else j
            slope = d1 if slot == 0 else d2
            if source < 0:
                continue
            for other in range(M.shape[0]):
                M[source, other] += slope * M[d, other]
            for other in range(M.shape[0]):
                M[other, source] += slope * M[other, d]


@kernel
def mass_matrix_frames(T, c, M):
    """`mass_matrix` of frames.

    Parameters
    ----------
    T : `TreeArrays`
    c : (frames, coordinates) consistent
    M : (frames, coordinates, coordinates) filled
    """
    pose = pose_room(T)
    composite = composite_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        mass_matrix(T, c[frame], pose, composite, M[frame])
