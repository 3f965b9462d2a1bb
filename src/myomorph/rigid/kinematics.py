"""Poses, velocities and Jacobians of bodies over frames, and what couplers make of coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from myomorph.model.spatial import Array
from myomorph.rigid.coordinates import Ints, evaluate
from myomorph.rigid.frames import over_frames
from myomorph.rigid.tree import ROTATION, Tree


@njit(cache=True, nogil=True)
def couple(T, c):
    """Set the dependent coordinates in c (coordinates,) from those they follow."""
    for k in range(T.coupler_coordinate.shape[0]):
        i, j = T.coupler_source[k, 0], T.coupler_source[k, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        c[T.coupler_coordinate[k]] = evaluate(T.functions, T.coupler_function[k], x1, x2)[0]


@njit(cache=True, nogil=True)
def couple_rates(T, c, cdot, cddot):
    """Set the dependent velocities and accelerations by the chain rule; c is consistent already."""
    for k in range(T.coupler_coordinate.shape[0]):
        i, j = T.coupler_source[k, 0], T.coupler_source[k, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        v1 = cdot[i] if i >= 0 else 0.0
        v2 = cdot[j] if j >= 0 else 0.0
        a1 = cddot[i] if i >= 0 else 0.0
        a2 = cddot[j] if j >= 0 else 0.0
        _, d1, d2, d11, d12, d22 = evaluate(T.functions, T.coupler_function[k], x1, x2)
        cdot[T.coupler_coordinate[k]] = d1 * v1 + d2 * v2
        cddot[T.coupler_coordinate[k]] = d1 * a1 + d2 * a2 + d11 * v1 * v1 + 2.0 * d12 * v1 * v2 + d22 * v2 * v2


@njit(cache=True, nogil=True)
def gather_dependents(T, c, rows):
    """Turn derivatives in all coordinates into derivatives in the independent ones, in place.

    Each row of `rows` (n, coordinates) holds df/dc; afterwards the entry of an independent
    coordinate includes what reaches f through the coordinates that follow it, and the entries of
    dependent coordinates are left as they were.
    """
    for k in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        i, j = T.coupler_source[k, 0], T.coupler_source[k, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        _, d1, d2, _, _, _ = evaluate(T.functions, T.coupler_function[k], x1, x2)
        for row in range(rows.shape[0]):
            if i >= 0:
                rows[row, i] += d1 * rows[row, T.coupler_coordinate[k]]
            if j >= 0:
                rows[row, j] += d2 * rows[row, T.coupler_coordinate[k]]


@njit(cache=True, nogil=True)
def couple_frames(T, values):
    """`couple` for every row of values (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple(T, values[frame])


@njit(cache=True, nogil=True)
def couple_rates_frames(T, values, velocities, accelerations):
    """`couple_rates` for every row of three arrays (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple_rates(T, values[frame], velocities[frame], accelerations[frame])


@njit(cache=True, nogil=True)
def body_poses(T, c, R, p, w, o, dphi):
    """Poses of all bodies and the moving axes in ground, for one frame.

    Parameters
    ----------
    c : (coordinates,) all coordinates, dependent ones consistent
    R, p : (bodies, 3, 3), (bodies, 3) filled with poses in ground
    w, o : (axes, 3) filled with each axis's direction and a point on it, in ground
    dphi : (axes, 2) filled with the derivative of the axis's motion in its two coordinates
    """
    for i in range(3):
        for j in range(3):
            R[0, i, j] = 1.0 if i == j else 0.0
        p[0, i] = 0.0
    r = np.empty((3, 3))
    t = np.empty((3, 3))
    m = np.empty((3, 3))
    x = np.empty(3)
    for b in range(1, T.parent.shape[0]):
        a = T.parent[b]
        for i in range(3):
            x[i] = p[a, i]
            for j in range(3):
                r[i, j] = R[a, i, j]
        for k in range(T.axis_start[b], T.axis_start[b + 1]):
            for i in range(3):
                x[i] += r[i, 0] * T.pre_p[k, 0] + r[i, 1] * T.pre_p[k, 1] + r[i, 2] * T.pre_p[k, 2]
            if not T.pre_is_shift[k]:
                for i in range(3):
                    for j in range(3):
                        t[i, j] = r[i, 0] * T.pre_R[k, 0, j] + r[i, 1] * T.pre_R[k, 1, j] + r[i, 2] * T.pre_R[k, 2, j]
                for i in range(3):
                    for j in range(3):
                        r[i, j] = t[i, j]
            c1, c2 = T.axis_coordinate[k, 0], T.axis_coordinate[k, 1]
            q, d1, d2, _, _, _ = evaluate(
                T.functions, T.axis_function[k], c[c1] if c1 >= 0 else 0.0, c[c2] if c2 >= 0 else 0.0
            )
            dphi[k, 0], dphi[k, 1] = d1, d2
            u0, u1, u2 = T.axis_vector[k, 0], T.axis_vector[k, 1], T.axis_vector[k, 2]
            for i in range(3):
                w[k, i] = r[i, 0] * u0 + r[i, 1] * u1 + r[i, 2] * u2
                o[k, i] = x[i]
            if T.axis_kind[k] == ROTATION:
                s, e = np.sin(q), np.cos(q)
                v = 1.0 - e
                m[0, 0], m[0, 1], m[0, 2] = e + u0 * u0 * v, u0 * u1 * v - u2 * s, u0 * u2 * v + u1 * s
                m[1, 0], m[1, 1], m[1, 2] = u0 * u1 * v + u2 * s, e + u1 * u1 * v, u1 * u2 * v - u0 * s
                m[2, 0], m[2, 1], m[2, 2] = u0 * u2 * v - u1 * s, u1 * u2 * v + u0 * s, e + u2 * u2 * v
                for i in range(3):
                    for j in range(3):
                        t[i, j] = r[i, 0] * m[0, j] + r[i, 1] * m[1, j] + r[i, 2] * m[2, j]
                for i in range(3):
                    for j in range(3):
                        r[i, j] = t[i, j]
            else:
                for i in range(3):
                    x[i] += q * w[k, i]
        for i in range(3):
            p[b, i] = x[i] + r[i, 0] * T.post_p[b, 0] + r[i, 1] * T.post_p[b, 1] + r[i, 2] * T.post_p[b, 2]
            for j in range(3):
                R[b, i, j] = r[i, 0] * T.post_R[b, 0, j] + r[i, 1] * T.post_R[b, 1, j] + r[i, 2] * T.post_R[b, 2, j]


@njit(cache=True, nogil=True)
def axis_rates(T, k, c, cdot, cddot):
    """Velocity and acceleration of axis k's motion: Phi cdot and Phi cddot + Phidot cdot."""
    i, j = T.axis_coordinate[k, 0], T.axis_coordinate[k, 1]
    _, d1, d2, d11, d12, d22 = evaluate(
        T.functions, T.axis_function[k], c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0
    )
    v1 = cdot[i] if i >= 0 else 0.0
    v2 = cdot[j] if j >= 0 else 0.0
    a1 = cddot[i] if i >= 0 else 0.0
    a2 = cddot[j] if j >= 0 else 0.0
    return d1 * v1 + d2 * v2, d1 * a1 + d2 * a2 + d11 * v1 * v1 + 2.0 * d12 * v1 * v2 + d22 * v2 * v2


@njit(cache=True, nogil=True)
def body_rates(T, c, cdot, cddot, p, w, o, omega, v, alpha, a):
    """Angular and linear velocity and acceleration of all body frames in ground, for one frame.

    Gravity is not included. `p`, `w`, `o` come from `body_poses`; omega, v, alpha, a (bodies, 3)
    are filled: [rad/s], [m/s] of the body's origin, [rad/s^2], [m/s^2].
    """
    for i in range(3):
        omega[0, i] = v[0, i] = alpha[0, i] = a[0, i] = 0.0
    for b in range(1, T.parent.shape[0]):
        h = T.parent[b]
        W0, W1, W2 = omega[h, 0], omega[h, 1], omega[h, 2]
        A0, A1, A2 = alpha[h, 0], alpha[h, 1], alpha[h, 2]
        # Velocity and acceleration of the point of the moving frame that coincides with (x0, x1, x2).
        x0, x1, x2 = p[h, 0], p[h, 1], p[h, 2]
        V0, V1, V2 = v[h, 0], v[h, 1], v[h, 2]
        B0, B1, B2 = a[h, 0], a[h, 1], a[h, 2]
        for k in range(T.axis_start[b], T.axis_start[b + 1] + 1):
            last = k == T.axis_start[b + 1]
            y0 = p[b, 0] if last else o[k, 0]
            y1 = p[b, 1] if last else o[k, 1]
            y2 = p[b, 2] if last else o[k, 2]
            r0, r1, r2 = y0 - x0, y1 - x1, y2 - x2
            t0, t1, t2 = W1 * r2 - W2 * r1, W2 * r0 - W0 * r2, W0 * r1 - W1 * r0
            V0, V1, V2 = V0 + t0, V1 + t1, V2 + t2
            B0 += A1 * r2 - A2 * r1 + W1 * t2 - W2 * t1
            B1 += A2 * r0 - A0 * r2 + W2 * t0 - W0 * t2
            B2 += A0 * r1 - A1 * r0 + W0 * t1 - W1 * t0
            x0, x1, x2 = y0, y1, y2
            if last:
                break
            q1, q2 = axis_rates(T, k, c, cdot, cddot)
            u0, u1, u2 = w[k, 0], w[k, 1], w[k, 2]
            e0, e1, e2 = W1 * u2 - W2 * u1, W2 * u0 - W0 * u2, W0 * u1 - W1 * u0
            if T.axis_kind[k] == ROTATION:
                A0 += u0 * q2 + e0 * q1
                A1 += u1 * q2 + e1 * q1
                A2 += u2 * q2 + e2 * q1
                W0, W1, W2 = W0 + u0 * q1, W1 + u1 * q1, W2 + u2 * q1
            else:
                # The moved frame's velocity field is the old one plus u qdot everywhere, so the point
                # at which both are compared need not move along.
                V0, V1, V2 = V0 + u0 * q1, V1 + u1 * q1, V2 + u2 * q1
                B0 += u0 * q2 + 2.0 * e0 * q1
                B1 += u1 * q2 + 2.0 * e1 * q1
                B2 += u2 * q2 + 2.0 * e2 * q1
        omega[b, 0], omega[b, 1], omega[b, 2] = W0, W1, W2
        alpha[b, 0], alpha[b, 1], alpha[b, 2] = A0, A1, A2
        v[b, 0], v[b, 1], v[b, 2] = V0, V1, V2
        a[b, 0], a[b, 1], a[b, 2] = B0, B1, B2


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of all bodies in ground; body 0 is the ground.

    Attributes
    ----------
    rotations : (frames, bodies, 3, 3)
    origins : (frames, bodies, 3) [m]
    axis_directions, axis_points : (frames, axes, 3) of the tree's moving axes
    axis_slopes : (frames, axes, 2) d(axis motion)/d(its coordinates)
    """

    tree: Tree
    rotations: Array
    origins: Array
    axis_directions: Array
    axis_points: Array
    axis_slopes: Array

    def points(self, bodies: Ints, locations: Array) -> Array:
        """Points fixed to bodies, in ground.

        Parameters
        ----------
        bodies : (points,) body numbers
        locations : (points, 3) in the bodies' frames [m]

        Returns
        -------
        (frames, points, 3) [m]
        """
        moved: Array = np.einsum("fpij,pj->fpi", self.rotations[:, bodies], locations) + self.origins[:, bodies]
        return moved

    def jacobian(self, frame: int, body: int, point: Array) -> Array:
        """d(twist)/d(coordinates) of a body, (6, coordinates): angular, then linear at `point`.

        Both rows are in ground; `point` (3,) is given in ground [m]. Dependent coordinates keep
        columns of their own.
        """
        arrays = self.tree.arrays
        columns = np.zeros((6, len(self.tree.model.coordinates)))
        for k in np.flatnonzero(self.tree.supports[body]):
            w = self.axis_directions[frame, k]
            if arrays.axis_kind[k] == ROTATION:
                twist = np.concatenate([w, np.cross(w, point - self.axis_points[frame, k])])
            else:
                twist = np.concatenate([np.zeros(3), w])
            for slope, j in zip(self.axis_slopes[frame, k], arrays.axis_coordinate[k], strict=True):
                if j >= 0:
                    columns[:, j] += slope * twist
        return columns


def forward_kinematics(tree: Tree, coordinates: Array) -> Poses:
    """Poses of all bodies.

    Parameters
    ----------
    coordinates : (frames, coordinates) in the model's order [rad or m], dependent ones consistent
        (`Tree.coordinates_of` makes them so)
    """
    coordinates = np.ascontiguousarray(coordinates, dtype=np.float64)
    arrays = tree.arrays
    frames, bodies, axes = len(coordinates), len(arrays.parent), len(arrays.axis_kind)
    R, p = np.empty((frames, bodies, 3, 3)), np.empty((frames, bodies, 3))
    w, o = np.empty((frames, axes, 3)), np.empty((frames, axes, 3))
    dphi = np.empty((frames, axes, 2))

    def part(start: int, stop: int) -> None:
        _poses(
            arrays,
            coordinates[start:stop],
            R[start:stop],
            p[start:stop],
            w[start:stop],
            o[start:stop],
            dphi[start:stop],
        )

    over_frames(part, frames)
    return Poses(tree, R, p, w, o, dphi)


@njit(cache=True, nogil=True)
def _poses(T, c, R, p, w, o, dphi):
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R[frame], p[frame], w[frame], o[frame], dphi[frame])


def center_of_mass(tree: Tree, poses: Poses) -> Array:
    """Center of mass of the whole model in ground, (frames, 3) [m]."""
    arrays = tree.arrays
    centers = poses.points(np.arange(len(arrays.mass)), arrays.mass_center)
    weighted: Array = np.einsum("b,fbi->fi", arrays.mass, centers) / arrays.mass.sum()
    return weighted
