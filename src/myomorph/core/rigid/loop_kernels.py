"""What closed loops ask of one pose: errors, their derivatives in the coordinates, and their rates."""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.coordinates import gather_dependents
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.core.rigid.kinematics import body_poses, body_rates, carried, pose_room
from myomorph.core.rigid.tree import ROTATION
from myomorph.core.rigid.vectors import (
    along,
    cross,
    dot,
    matrix,
    minus,
    plus,
    product,
    times,
    turned,
    turned_back,
    vector,
)

HALF_TURN = -1.0 + 1e-12
"""Cosine below which two frames stand turned by half a turn, where the sine no longer shows the
axis.
"""


@bare
def transposed(r):
    """The transpose of a matrix."""
    return r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]


@bare
def tied_frames(L, i, R, p):
    """In ground the first tied frame of loop i and its second point; in that frame the pose (Q, e)
    of the second.
    """
    b1 = L.body_1[i]
    b2 = L.body_2[i]
    r1 = product(matrix(R, b1), matrix(L.turn_1, i))
    x1 = plus(vector(p, b1), turned(matrix(R, b1), vector(L.point_1, i)))
    x2 = plus(vector(p, b2), turned(matrix(R, b2), vector(L.point_2, i)))
    Q = product(transposed(r1), product(matrix(R, b2), matrix(L.turn_2, i)))
    return r1, x2, Q, turned_back(r1, minus(x2, x1))


@bare
def half_rotation(Q):
    """The quaternion (a, u) of a rotation, a = cos(angle / 2) >= 0, u = sin(angle / 2) axis."""
    cosine = 0.5 * (Q[0] + Q[4] + Q[8] - 1.0)
    if cosine > HALF_TURN:
        a = np.sqrt(0.5 * (1.0 + cosine))
        s = 0.25 / a
        return a, (s * (Q[7] - Q[5]), s * (Q[2] - Q[6]), s * (Q[3] - Q[1]))
    # Q + 1 = 2 axis axis^T.
    largest = 0 if Q[0] >= Q[4] and Q[0] >= Q[8] else (1 if Q[4] >= Q[8] else 2)
    scale = 1.0 / np.sqrt(2.0 * (1.0 + Q[4 * largest]))
    u = (scale * Q[largest], scale * Q[3 + largest], scale * Q[6 + largest])
    grown = scale * (1.0 + Q[4 * largest])
    return 0.0, (
        grown if largest == 0 else u[0],
        grown if largest == 1 else u[1],
        grown if largest == 2 else u[2],
    )


@bare
def loop_errors(L, R, p, errors):
    """Errors (rows,) of all loops at the poses R, p: of a weld first the turning 2 u [rad], then
    the gap e [m]. Both are those of the second tied frame seen from the first, so what moves both
    together changes nothing.
    """
    for i in range(L.body_1.shape[0]):
        _, _, Q, gap = tied_frames(L, i, R, p)
        row = L.row[i]
        if L.row[i + 1] - row == 6:
            _, u = half_rotation(Q)
            put(errors, row, 2.0, u)
            row += 3
        put(errors, row, 1.0, gap)


@bare
def put(array, row, scale, x):
    """Store scale x in array (n,) from row on."""
    array[row], array[row + 1], array[row + 2] = times(scale, x)


@bare
def turned_error(a, u, W):
    """d(2 u)/dt of the quaternion (a, u) that turns with the angular velocity W: a W + W x u."""
    return along(cross(W, u), a, W)


@bare
def loop_rows(T, L, c, R, p, w, o, dphi, rows):
    """Derivatives (rows, coordinates) of `loop_errors`, dependent coordinates folded into what they
    follow.
    """
    rows[:] = 0.0
    for i in range(L.body_1.shape[0]):
        r1, x2, Q, _ = tied_frames(L, i, R, p)
        a, u = half_rotation(Q)
        row = L.row[i]
        turns = L.row[i + 1] - row == 6
        b1 = L.body_1[i]
        b2 = L.body_2[i]
        while b1 != b2:
            # A parent has the smaller number: the larger of both cannot be an ancestor of the
            # other.
            b, sign = (b2, 1.0) if b2 > b1 else (b1, -1.0)
            for axis in range(T.axis_start[b], T.axis_start[b + 1]):
                direction = vector(w, axis)
                rotates = T.axis_kind[axis] == ROTATION
                shift = turned_back(
                    r1, cross(direction, minus(x2, vector(o, axis))) if rotates else direction
                )
                turn = turned_error(a, u, turned_back(r1, direction))
                for s in range(2):
                    j = T.axis_coordinate[axis, s]
                    if j >= 0:
                        speed = sign * dphi[axis, s]
                        first = row
                        if turns:
                            for d in range(3):
                                rows[row + d, j] += speed * turn[d] if rotates else 0.0
                            first = row + 3
                        for d in range(3):
                            rows[first + d, j] += speed * shift[d]
            if b2 > b1:
                b2 = T.parent[b2]
            else:
                b1 = T.parent[b1]
    gather_dependents(T, c, rows)


@kernel
def loop_frames(T, L, c, errors, rows):
    """`loop_errors` and `loop_rows` of frames: errors (frames, rows), rows (frames, rows,
    coordinates).
    """
    R, p, w, o, dphi = pose_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R, p, w, o, dphi)
        loop_errors(L, R, p, errors[frame])
        loop_rows(T, L, c[frame], R, p, w, o, dphi, rows[frame])


@kernel
def loop_rate_frames(T, L, c, cdot, cddot, first, second):
    """First and second time derivative (frames, rows) of the loops' errors; c, cdot, cddot
    consistent.
    """
    R, p, w, o, dphi = pose_room(T)
    omega = np.empty_like(p)
    v = np.empty_like(p)
    alpha = np.empty_like(p)
    acc = np.empty_like(p)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R, p, w, o, dphi)
        body_rates(T, c[frame], cdot[frame], cddot[frame], p, w, o, omega, v, alpha, acc)
        for i in range(L.body_1.shape[0]):
            b1 = L.body_1[i]
            b2 = L.body_2[i]
            row = L.row[i]
            r1, _, Q, _ = tied_frames(L, i, R, p)
            W1 = vector(omega, b1)
            E1 = vector(alpha, b1)
            W2 = vector(omega, b2)
            E2 = vector(alpha, b2)
            if L.row[i + 1] - row == 6:
                W = turned_back(r1, minus(W2, W1))
                E = turned_back(r1, minus(minus(E2, E1), cross(W1, W2)))
                a, u = half_rotation(Q)
                rate = turned_error(a, u, W)
                change = along(turned_error(a, u, E), -0.5 * dot(W, u), W)
                put(first[frame], row, 1.0, rate)
                put(second[frame], row, 1.0, along(change, 0.5, cross(W, rate)))
                row += 3
            # Both rates at the second point: of the body it belongs to, and of the first body
            # carried there.
            x2 = turned(matrix(R, b2), vector(L.point_2, i))
            x1 = minus(plus(vector(p, b2), x2), vector(p, b1))
            v1, a1 = carried(W1, E1, vector(v, b1), vector(acc, b1), x1)
            v2, a2 = carried(W2, E2, vector(v, b2), vector(acc, b2), x2)
            gap = minus(v2, v1)
            put(first[frame], row, 1.0, turned_back(r1, gap))
            put(
                second[frame], row, 1.0, turned_back(r1, along(minus(a2, a1), -2.0, cross(W1, gap)))
            )
