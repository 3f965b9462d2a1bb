"""Closed loops in motion: accelerations that keep them closed, and states put back onto them.

    [M  -G^T] [cddot ]   [tau - h     ]
    [G    0 ] [lambda] = [-Gdot cdot  ]

With M = L L^T, rows s = L^-1 g of the Jacobian's rows g, and x the accelerations of opened loops,

    (S S^T) lambda = -(Gdot cdot + G x),   cddot = x + L^-T S^T lambda

What steps let drift is taken back in the same metric: the least change of kinetic energy closes the
loops, and then their rates (Eich 1993).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import bare, inner
from myomorph.core.rigid.loop_kernels import loop_errors, loop_rates, loop_rows
from myomorph.core.rigid.tree import Flags

CLOSED = 1e-12  # Error of a loop below which nothing is taken back [m or rad]
NEARLY_CLOSED = 1e-9  # Error at which a state counts as closed where steps lower it no further
MAX_STEPS = 8  # Of a projection
DEPENDENT = 1e-10  # Share of a row that is left where others state it already


class LoopRoom(NamedTuple):
    """Scratch arrays of closed loops.

    Attributes
    ----------
    errors, first, second : (rows,) of closure and its time derivatives [m or rad]
    G : (rows, coordinates) derivative of closure
    S : (rows, free) rows of G for the free coordinates, by L^-1
    A : (rows, rows) Cholesky factor of S S^T
    counts : (rows,) whether a row states what no row before it does
    multipliers : (rows,) [N or N m]
    """

    errors: Array
    first: Array
    second: Array
    G: Array
    S: Array
    A: Array
    counts: Flags
    multipliers: Array


@inner
def loop_room(S):
    """Make the scratch arrays of a `System`."""
    rows = S.loops.row[S.loops.row.shape[0] - 1]
    return LoopRoom(
        errors=np.zeros(rows),
        first=np.zeros(rows),
        second=np.zeros(rows),
        G=np.zeros((rows, S.held.shape[0])),
        S=np.zeros((rows, S.free.shape[0])),
        A=np.zeros((rows, rows)),
        counts=np.zeros(rows, np.bool_),
        multipliers=np.zeros(rows),
    )


@bare
def forward_substitute(L, x):
    """Solve L x' = x in place, with the lower triangle L (n, n)."""
    for i in range(x.shape[0]):
        value = x[i]
        for k in range(i):
            value -= L[i, k] * x[k]
        x[i] = value / L[i, i]


@bare
def back_substitute(L, x):
    """Solve L^T x' = x in place, with the lower triangle L (n, n)."""
    for i in range(x.shape[0] - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, x.shape[0]):
            value -= L[k, i] * x[k]
        x[i] = value / L[i, i]


@bare
def close_accelerations(S, room):
    """Add what closed loops do to the accelerations of a state.

    Parameters
    ----------
    S : `System`
    room : `Room`, whose accelerations are those of opened loops; changed
    """
    loop = room.loop
    pose = room.path.frame.bodies
    loop_rates(S.loops, pose, room.rates, loop.first, loop.second)
    _factor(S, room)
    x = room.acceleration
    for row in range(loop.G.shape[0]):
        missing = -loop.second[row]
        for i in range(x.shape[0]):
            missing -= loop.G[row, S.free[i]] * x[i]
        loop.multipliers[row] = missing
    _solve(loop, loop.multipliers)
    _add(room, loop.multipliers, x)


@bare
def close_positions(S, room):
    """Find the nearest closed coordinates by one Newton step, in the metric of the mass matrix.

    Parameters
    ----------
    S : `System`
    room : `Room` of a state, with its mass matrix factored

    Returns
    -------
    largest error before the step [m or rad]; `room.acceleration` holds the step (free,)
    """
    loop = room.loop
    loop_errors(S.loops, room.path.frame.bodies, loop.errors)
    return _step(S, room, loop.errors)


@bare
def close_velocities(S, room):
    """Find the nearest velocities that keep loops closed; returns as `close_positions`."""
    loop = room.loop
    loop_rates(S.loops, room.path.frame.bodies, room.rates, loop.first, loop.second)
    return _step(S, room, loop.first)


@bare
def _step(S, room, errors):
    """Fill the step of least kinetic energy that takes errors (rows,) back; the largest error."""
    loop = room.loop
    _factor(S, room)
    largest = 0.0
    for row in range(errors.shape[0]):
        # Of an error that is not a number, too.
        if not abs(errors[row]) <= largest:
            largest = abs(errors[row])
        loop.multipliers[row] = -errors[row]
    _solve(loop, loop.multipliers)
    for i in range(room.acceleration.shape[0]):
        room.acceleration[i] = 0.0
    _add(room, loop.multipliers, room.acceleration)
    return largest


@bare
def _factor(S, room):
    """Fill G, S and the factor A, in which rows that others state already do not count."""
    loop = room.loop
    pose = room.path.frame.bodies
    loop_rows(S.tree, S.loops, room.motion.coordinates[0], pose, loop.G)
    rows = loop.G.shape[0]
    largest = 0.0
    for row in range(rows):
        for i in range(S.free.shape[0]):
            loop.S[row, i] = loop.G[row, S.free[i]]
        forward_substitute(room.L, loop.S[row])
        square = 0.0
        for i in range(S.free.shape[0]):
            square += loop.S[row, i] * loop.S[row, i]
        largest = max(largest, square)
    for row in range(rows):
        for other in range(row + 1):
            value = 0.0
            for i in range(S.free.shape[0]):
                value += loop.S[row, i] * loop.S[other, i]
            for k in range(other):
                value -= loop.A[row, k] * loop.A[other, k]
            if other < row:
                loop.A[row, other] = value / loop.A[other, other] if loop.counts[other] else 0.0
                continue
            loop.counts[row] = value > DEPENDENT * largest
            loop.A[row, row] = math.sqrt(value) if loop.counts[row] else 1.0


@bare
def _solve(loop, x):
    """Solve (S S^T) x' = x in place, 0 in rows that do not count."""
    for row in range(x.shape[0]):
        if not loop.counts[row]:
            x[row] = 0.0
            continue
        value = x[row]
        for k in range(row):
            value -= loop.A[row, k] * x[k]
        x[row] = value / loop.A[row, row]
    for row in range(x.shape[0] - 1, -1, -1):
        if not loop.counts[row]:
            continue
        value = x[row]
        for k in range(row + 1, x.shape[0]):
            if loop.counts[k]:
                value -= loop.A[k, row] * x[k]
        x[row] = value / loop.A[row, row]


@bare
def _add(room, multipliers, x):
    """Add L^-T S^T multipliers to x (free,)."""
    loop = room.loop
    shift = room.shift
    for i in range(x.shape[0]):
        value = 0.0
        for row in range(multipliers.shape[0]):
            value += loop.S[row, i] * multipliers[row]
        shift[i] = value
    back_substitute(room.L, shift)
    for i in range(x.shape[0]):
        x[i] += shift[i]
