"""Kernels of closed loops: closure errors, their derivatives in coordinates, and their rates."""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.coordinates import State, gather_dependents
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.core.rigid.kinematics import body_poses, body_rates, pose_room, rate_room, rates_at
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

# Cosine of a relative rotation below which its sine no longer shows its axis
HALF_TURN = -1.0 + 1e-12


@bare
def transposed(r):
    """Transpose a matrix."""
    return r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]


@bare
def tied_frames(loops, i, pose):
    """Poses of the two frames that loop i ties.

    Parameters
    ----------
    loops : `LoopArrays`
    i : number of the loop
    pose : of `body_poses`

    Returns
    -------
    r1 : rotation of the first frame in ground
    x2 : origin of the second in ground [m]
    Q, e : rotation and origin [m] of the second, seen from the first
    """
    b1 = loops.body_1[i]
    b2 = loops.body_2[i]
    of_body_1 = matrix(pose.R, b1)
    of_body_2 = matrix(pose.R, b2)
    r1 = product(of_body_1, matrix(loops.turn_1, i))
    x1 = plus(vector(pose.p, b1), turned(of_body_1, vector(loops.point_1, i)))
    x2 = plus(vector(pose.p, b2), turned(of_body_2, vector(loops.point_2, i)))
    Q = product(transposed(r1), product(of_body_2, matrix(loops.turn_2, i)))
    return r1, x2, Q, turned_back(r1, minus(x2, x1))


@bare
def half_rotation(Q):
    """Quaternion (a, u) of a rotation Q, with a = cos(angle / 2) >= 0, u = sin(angle / 2) axis."""
    cosine = 0.5 * (Q[0] + Q[4] + Q[8] - 1.0)
    if cosine > HALF_TURN:
        a = np.sqrt(0.5 * (1.0 + cosine))
        s = 0.25 / a
        return a, (s * (Q[7] - Q[5]), s * (Q[2] - Q[6]), s * (Q[3] - Q[1]))
    # Q + 1 = 2 axis axis^T.
    if Q[0] >= Q[4] and Q[0] >= Q[8]:
        largest = 0
    else:
        largest = 1 if Q[4] >= Q[8] else 2
    scale = 1.0 / np.sqrt(2.0 * (1.0 + Q[4 * largest]))
    u = (scale * Q[largest], scale * Q[3 + largest], scale * Q[6 + largest])
    diagonal = scale * (1.0 + Q[4 * largest])
    return 0.0, (
        diagonal if largest == 0 else u[0],
        diagonal if largest == 1 else u[1],
        diagonal if largest == 2 else u[2],
    )


@bare
def loop_errors(loops, pose, errors):
    """Closure errors of all loops.

    A point has the gap e [m]. A weld has before it the rotation 2 u [rad], with u of
    `half_rotation`. Both are those of the second tied frame seen from the first, so what moves both
    together changes nothing.

    Parameters
    ----------
    loops : `LoopArrays`
    pose : of `body_poses`
    errors : (rows,) filled
    """
    for i in range(loops.body_1.shape[0]):
        _, _, Q, gap = tied_frames(loops, i, pose)
        row = loops.row[i]
        if loops.row[i + 1] - row == 6:
            _, u = half_rotation(Q)
            put(errors, row, 2.0, u)
            row += 3
        put(errors, row, 1.0, gap)


@bare
def put(array, row, scale, x):
    """Store scale x in array (n,) from row on."""
    y = times(scale, x)
    array[row] = y[0]
    array[row + 1] = y[1]
    array[row + 2] = y[2]


@bare
def turned_error(a, u, W):
    """Rate d(2 u)/dt = a W + W x u of the quaternion (a, u) with the angular velocity W."""
    return along(cross(W, u), a, W)


@bare
def loop_rows(T, loops, c, pose, rows):
    """Differentiate `loop_errors` by the coordinates.

    An axis between a loop's second body and the bodies' common ancestor moves the second frame, one
    between the first body and the ancestor moves it the other way. A rotation about w through o
    shifts it by w x (x2 - o) and turns it as `turned_error`, a translation shifts it by w.

    Parameters
    ----------
    T, loops : `TreeArrays` and `LoopArrays`
    c : (coordinates,) consistent
    pose : of `body_poses`
    rows : (rows, coordinates) filled, with what dependent coordinates do handed on to those they
        follow (`gather_dependents`)
    """
    rows[:] = 0.0
    for i in range(loops.body_1.shape[0]):
        r1, x2, Q, _ = tied_frames(loops, i, pose)
        second = (r1, x2, half_rotation(Q))
        error_rows = rows[loops.row[i] : loops.row[i + 1]]
        b1 = loops.body_1[i]
        b2 = loops.body_2[i]
        while b1 != b2:
            # A parent has the smaller number, so the larger of both is no ancestor of the other.
            if b2 > b1:
                _add_axes(T, b2, 1.0, second, pose, error_rows)
                b2 = T.parent[b2]
            else:
                _add_axes(T, b1, -1.0, second, pose, error_rows)
                b1 = T.parent[b1]
    gather_dependents(T, c, rows)


@bare
def _add_axes(T, body, sign, second, pose, rows):
    """Add what the axes of a body do to the errors of a loop.

    Parameters
    ----------
    sign : 1 on the side of the loop's second body, -1 on that of the first
    second : r1 and x2 of `tied_frames`, and the quaternion (a, u) of Q
    pose : of `body_poses`
    rows : (3 or 6, coordinates) of the loop, added to
    """
    r1, x2, (a, u) = second
    is_weld = rows.shape[0] == 6
    first = 3 if is_weld else 0
    for axis in range(T.axis_start[body], T.axis_start[body + 1]):
        direction = vector(pose.w, axis)
        rotates = T.axis_kind[axis] == ROTATION
        shift = turned_back(
            r1, cross(direction, minus(x2, vector(pose.o, axis))) if rotates else direction
        )
        turn = turned_error(a, u, turned_back(r1, direction))
        for slot in range(2):
            j = T.axis_coordinate[axis, slot]
            if j < 0:
                continue
            speed = sign * pose.dphi[axis, slot]
            if is_weld:
                for component in range(3):
                    rows[component, j] += speed * turn[component] if rotates else 0.0
            for component in range(3):
                rows[first + component, j] += speed * shift[component]


@kernel
def loop_frames(T, loops, c, errors, rows):
    """`loop_errors` and `loop_rows` of frames.

    Parameters
    ----------
    T, loops : `TreeArrays` and `LoopArrays`
    c : (frames, coordinates) consistent
    errors : (frames, rows) filled
    rows : (frames, rows, coordinates) filled
    """
    pose = pose_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        loop_errors(loops, pose, errors[frame])
        loop_rows(T, loops, c[frame], pose, rows[frame])


@kernel
def loop_rate_frames(  # page: arrays over frames, of which each call takes a part
    T, loops, c, cdot, cddot, first, second
):
    """First and second time derivatives of the closure errors of frames.

    Parameters
    ----------
    T, loops : `TreeArrays` and `LoopArrays`
    c, cdot, cddot : (frames, coordinates) consistent
    first, second : (frames, rows) filled
    """
    pose = pose_room(T)
    rates = rate_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=cddot[frame]), pose, rates)
        loop_rates(loops, pose, rates, first[frame], second[frame])


@bare
def loop_rates(loops, pose, rates, first, second):
    """First and second time derivatives of `loop_errors`.

    Parameters
    ----------
    loops : `LoopArrays`
    pose, rates : of `body_poses` and `body_rates`
    first, second : (rows,) filled
    """
    for i in range(loops.body_1.shape[0]):
        row = loops.row[i]
        if loops.row[i + 1] - row == 6:
            _put_rotation_rates(loops, i, pose, rates, first[row:], second[row:])
            row += 3
        _put_gap_rates(loops, i, pose, rates, first[row:], second[row:])


@bare
def _put_rotation_rates(loops, i, pose, rates, first, second):
    """Store the rates of a weld's rotation 2 u.

    With W and E the angular velocity and acceleration of the second frame seen from the first, and
    (a, u) the quaternion between them,

        d(2 u)/dt = a W + W x u
        d^2(2 u)/dt^2 = a E + E x u - (W . u) W / 2 + W x (a W + W x u) / 2

    Parameters
    ----------
    pose : of `body_poses`
    rates : of `body_rates`
    first, second : (3 or more,) of which three are filled
    """
    r1, _, Q, _ = tied_frames(loops, i, pose)
    W1 = vector(rates.omega, loops.body_1[i])
    E1 = vector(rates.alpha, loops.body_1[i])
    W2 = vector(rates.omega, loops.body_2[i])
    E2 = vector(rates.alpha, loops.body_2[i])
    W = turned_back(r1, minus(W2, W1))
    E = turned_back(r1, minus(minus(E2, E1), cross(W1, W2)))
    a, u = half_rotation(Q)
    rate = turned_error(a, u, W)
    change = along(turned_error(a, u, E), -0.5 * dot(W, u), W)
    put(first, 0, 1.0, rate)
    put(second, 0, 1.0, along(change, 0.5, cross(W, rate)))


@bare
def _put_gap_rates(loops, i, pose, rates, first, second):
    """Store the rates of the gap between a loop's points, in the first frame's axes.

    Both are rates at the second point: of the body that it belongs to, less those of the first body
    carried there; the second takes off the Coriolis term 2 W_1 x gap rate.

    Parameters
    ----------
    pose, rates, first, second : as of `_put_rotation_rates`
    """
    b1 = loops.body_1[i]
    b2 = loops.body_2[i]
    r1 = tied_frames(loops, i, pose)[0]
    W1 = vector(rates.omega, b1)
    arm_2 = turned(matrix(pose.R, b2), vector(loops.point_2, i))
    arm_1 = minus(plus(vector(pose.p, b2), arm_2), vector(pose.p, b1))
    v1, a1 = _point_rates(rates, b1, arm_1)
    v2, a2 = _point_rates(rates, b2, arm_2)
    gap_rate = minus(v2, v1)
    put(first, 0, 1.0, turned_back(r1, gap_rate))
    put(second, 0, 1.0, turned_back(r1, along(minus(a2, a1), -2.0, cross(W1, gap_rate))))


@bare
def _point_rates(rates, b, arm):
    """Compute velocity and acceleration of the point at `arm` from the origin of body b."""
    W = vector(rates.omega, b)
    E = vector(rates.alpha, b)
    return rates_at(W, E, vector(rates.v, b), vector(rates.a, b), arm)
