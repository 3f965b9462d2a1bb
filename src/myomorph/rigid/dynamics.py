"""Inverse dynamics over frames: generalized forces from motion and external wrenches."""

from __future__ import annotations

import numpy as np
from numba import njit

from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series, Wrenches
from myomorph.model.spatial import Array
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.frames import over_frames
from myomorph.rigid.kinematics import body_poses, body_rates, couple_rates_frames
from myomorph.rigid.tree import ROTATION, Tree, compile_tree


def inverse_dynamics(model: Model, motion: Motion, wrenches: Wrenches | None = None) -> Series:
    """Generalized force of every coordinate that makes the model move as given.

    tau = Phi^T (M a + h - gravity - external), by the recursive Newton-Euler algorithm
    (Featherstone 2008, ch. 5) over elementary axes. As in OpenSim's tool, every coordinate has its
    own column and couplers transmit no force; `coupled_forces` folds the dependent ones in.

    Parameters
    ----------
    motion : with velocities and accelerations; coordinates it lacks rest at their default
    wrenches : external forces in ground at the motion's times, each with its body's name

    Returns
    -------
    Series of (frames, coordinates) [N m or N], NaN in frames where the motion is NaN

    Raises
    ------
    BadData
        where derivatives are missing, or the wrenches' clock is not the motion's
    UnknownName
        where a wrench acts on a body that the model does not have
    """
    tree = compile_tree(model)
    c, cdot, cddot = motion_arrays(tree, motion)
    bodies, forces, points, torques = _external(tree, motion, wrenches)
    tau = np.empty_like(c)

    def part(start: int, stop: int) -> None:
        part = slice(start, stop)
        _inverse_dynamics(
            tree.arrays, c[part], cdot[part], cddot[part], bodies, forces[part], points[part], torques[part], tau[part]
        )

    over_frames(part, len(c))
    return Series(motion.time, model.coordinate_names, tau)


def motion_arrays(tree: Tree, motion: Motion) -> tuple[Array, Array, Array]:
    """Values, velocities and accelerations (frames, coordinates) in the model's order.

    Raises
    ------
    BadData
        where the motion carries no derivatives
    """
    if motion.velocities is None or motion.accelerations is None:
        raise BadData("inverse dynamics needs velocities and accelerations: differentiate the motion first")
    c = tree.coordinates_of(motion)
    cdot, cddot = np.zeros_like(c), np.zeros_like(c)
    columns = {name: i for i, name in enumerate(motion.names)}
    for j, name in enumerate(tree.model.coordinate_names):
        if name in columns:
            cdot[:, j] = motion.velocities[:, columns[name]]
            cddot[:, j] = motion.accelerations[:, columns[name]]
    couple_rates_frames(tree.arrays, c, cdot, cddot)
    return c, cdot, cddot


def _external(tree: Tree, motion: Motion, wrenches: Wrenches | None) -> tuple[Ints, Array, Array, Array]:
    if wrenches is None:
        empty = np.zeros((len(motion), 0, 3))
        return np.zeros(0, np.int64), empty, empty, empty
    if len(wrenches) != len(motion) or np.max(np.abs(wrenches.time - motion.time), initial=0.0) > 1e-6:
        raise BadData(
            f"external forces have {len(wrenches)} frames from {wrenches.time[:1]} s, the motion {len(motion)} from "
            f"{motion.time[:1]} s: resample the forces to the motion's times first"
        )
    for body in wrenches.bodies:
        if body not in tree.body_index:
            raise UnknownName("body", body, tuple(tree.body_index))
    bodies = np.array([tree.body_index[body] for body in wrenches.bodies], np.int64)
    # A point of application is unknown (NaN) where nothing touches, and then does not matter.
    points = np.where(np.isnan(wrenches.points) & (wrenches.forces == 0.0).all(axis=2)[..., None], 0.0, wrenches.points)
    return bodies, np.ascontiguousarray(wrenches.forces), points, np.ascontiguousarray(wrenches.torques)


@njit(cache=True, nogil=True)
def _inverse_dynamics(T, c, cdot, cddot, bodies, forces, points, torques, tau):
    n, axes = T.parent.shape[0], T.axis_kind.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    w, o, dphi = np.empty((axes, 3)), np.empty((axes, 3)), np.empty((axes, 2))
    omega, v, alpha, a = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    f, m = np.empty((n, 3)), np.empty((n, 3))
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R, p, w, o, dphi)
        body_rates(T, c[frame], cdot[frame], cddot[frame], p, w, o, omega, v, alpha, a)
        body_wrenches(T, R, p, omega, alpha, a, f, m)
        for e in range(bodies.shape[0]):
            b = bodies[e]
            F, P, M = forces[frame, e], points[frame, e], torques[frame, e]
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                f[b, i] -= F[i]
                m[b, i] -= M[i] + P[j] * F[k] - P[k] * F[j]
        project(T, w, o, dphi, f, m, tau[frame])


@njit(cache=True, nogil=True)
def body_wrenches(T, R, p, omega, alpha, a, f, m):
    """Force and moment about the ground's origin that each body needs, gravity taken off.

    f, m (bodies, 3) are filled [N], [N m], in ground.
    """
    for b in range(T.parent.shape[0]):
        I, w, e = T.inertia[b], omega[b], alpha[b]
        # Angular velocity and acceleration in the body's frame, where the inertia is constant.
        w0, w1, w2 = _turned_back(R[b], w)
        e0, e1, e2 = _turned_back(R[b], e)
        h0 = I[0, 0] * w0 + I[0, 1] * w1 + I[0, 2] * w2
        h1 = I[1, 0] * w0 + I[1, 1] * w1 + I[1, 2] * w2
        h2 = I[2, 0] * w0 + I[2, 1] * w1 + I[2, 2] * w2
        n0 = I[0, 0] * e0 + I[0, 1] * e1 + I[0, 2] * e2 + w1 * h2 - w2 * h1
        n1 = I[1, 0] * e0 + I[1, 1] * e1 + I[1, 2] * e2 + w2 * h0 - w0 * h2
        n2 = I[2, 0] * e0 + I[2, 1] * e1 + I[2, 2] * e2 + w0 * h1 - w1 * h0
        r0, r1, r2 = _turned(R[b], T.mass_center[b])
        t0, t1, t2 = w[1] * r2 - w[2] * r1, w[2] * r0 - w[0] * r2, w[0] * r1 - w[1] * r0
        f0 = T.mass[b] * (a[b, 0] + e[1] * r2 - e[2] * r1 + w[1] * t2 - w[2] * t1 - T.gravity[0])
        f1 = T.mass[b] * (a[b, 1] + e[2] * r0 - e[0] * r2 + w[2] * t0 - w[0] * t2 - T.gravity[1])
        f2 = T.mass[b] * (a[b, 2] + e[0] * r1 - e[1] * r0 + w[0] * t1 - w[1] * t0 - T.gravity[2])
        x0, x1, x2 = p[b, 0] + r0, p[b, 1] + r1, p[b, 2] + r2
        f[b, 0], f[b, 1], f[b, 2] = f0, f1, f2
        m[b, 0] = R[b, 0, 0] * n0 + R[b, 0, 1] * n1 + R[b, 0, 2] * n2 + x1 * f2 - x2 * f1
        m[b, 1] = R[b, 1, 0] * n0 + R[b, 1, 1] * n1 + R[b, 1, 2] * n2 + x2 * f0 - x0 * f2
        m[b, 2] = R[b, 2, 0] * n0 + R[b, 2, 1] * n1 + R[b, 2, 2] * n2 + x0 * f1 - x1 * f0


@njit(cache=True, nogil=True)
def project(T, w, o, dphi, f, m, tau):
    """Generalized forces tau (coordinates,) of wrenches on the bodies, summed from the leaves.

    f, m (bodies, 3): force and moment about the ground's origin in ground, added up on the way.
    """
    for j in range(tau.shape[0]):
        tau[j] = 0.0
    for b in range(T.parent.shape[0] - 1, 0, -1):
        for k in range(T.axis_start[b], T.axis_start[b + 1]):
            if T.axis_kind[k] == ROTATION:
                t = (
                    w[k, 0] * (m[b, 0] - o[k, 1] * f[b, 2] + o[k, 2] * f[b, 1])
                    + w[k, 1] * (m[b, 1] - o[k, 2] * f[b, 0] + o[k, 0] * f[b, 2])
                    + w[k, 2] * (m[b, 2] - o[k, 0] * f[b, 1] + o[k, 1] * f[b, 0])
                )
            else:
                t = w[k, 0] * f[b, 0] + w[k, 1] * f[b, 1] + w[k, 2] * f[b, 2]
            for s in range(2):
                j = T.axis_coordinate[k, s]
                if j >= 0:
                    tau[j] += dphi[k, s] * t
        h = T.parent[b]
        for i in range(3):
            f[h, i] += f[b, i]
            m[h, i] += m[b, i]


@njit(cache=True, nogil=True)
def _turned(R, x):
    return (
        R[0, 0] * x[0] + R[0, 1] * x[1] + R[0, 2] * x[2],
        R[1, 0] * x[0] + R[1, 1] * x[1] + R[1, 2] * x[2],
        R[2, 0] * x[0] + R[2, 1] * x[1] + R[2, 2] * x[2],
    )


@njit(cache=True, nogil=True)
def _turned_back(R, x):
    return (
        R[0, 0] * x[0] + R[1, 0] * x[1] + R[2, 0] * x[2],
        R[0, 1] * x[0] + R[1, 1] * x[1] + R[2, 1] * x[2],
        R[0, 2] * x[0] + R[1, 2] * x[1] + R[2, 2] * x[2],
    )
