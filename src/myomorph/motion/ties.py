"""Loops as pairs of points that coincide: their gaps, elimination of the coordinates that close them, multipliers.

With gaps e(c) and their derivatives G, Gauss-Jordan elimination with full pivoting turns G d = -e into
d_dependent = b - A d_independent, whatever its rank, and gives the multipliers of the ties. All of it works on the
scratch arrays of one frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.motion.marker_cost import fold_couplers
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.couplers import couple, gather_dependents
from myomorph.rigid.kernels import in_place, inner
from myomorph.rigid.kinematics import body_poses
from myomorph.rigid.tree import ROTATION, Tree
from myomorph.rigid.vectors import cross, dot, matrix, minus, plus, turned, vector

CLOSED = 1e-12
"""A loop is closed when no gap is larger [m]."""

PIVOT = 1e-8
"""Least pivot of the elimination relative to the largest entry: what is smaller is no constraint of its own."""

TO_CLOSE = 40
"""Newton steps that may close the loops."""


class Ties(NamedTuple):
    """Pairs of points that coincide where loops are closed: one of a point constraint, three of a weld.

    Attributes
    ----------
    body_1, body_2 : (ties,)
    point_1, point_2 : (ties, 3) in those bodies [m]
    """

    body_1: Ints
    body_2: Ints
    point_1: Array
    point_2: Array


class Closing(NamedTuple):
    """Scratch arrays of the elimination.

    Attributes
    ----------
    e, G : (rows,), (rows, coordinates) gaps in ground [m] and their derivatives
    A : (rows, variables + 1 + rows) the eliminated rows: A, b and the transformation of the rows
    taken, given : (rows,) the variable that each eliminated row gives; (variables,) whether a row gives it
    push : (rows,) multipliers
    H, g, D : (coordinates, coordinates), (coordinates,) twice: what the multipliers add to Hessian and gradient
    Z : (variables, variables) Hessian times the basis of the free directions
    """

    e: Array
    G: Array
    A: Array
    taken: Ints
    given: np.ndarray
    push: Array
    H: Array
    g: Array
    D: Array
    Z: Array


def ties_of(tree: Tree, lever: float = 1.0) -> Ties:
    """The ties of a tree's loops; a weld's second and third lie `lever` [m] along its frame's axes."""
    loops = tree.loops
    ties = []
    for i in range(len(loops.body_1)):
        ends = (loops.point_1[i], loops.point_2[i])
        ties.append((loops.body_1[i], loops.body_2[i], *ends))
        if loops.row[i + 1] - loops.row[i] == 6:
            for axis in range(2):
                away = (lever * loops.turn_1[i][:, axis], lever * loops.turn_2[i][:, axis])
                ties.append((loops.body_1[i], loops.body_2[i], ends[0] + away[0], ends[1] + away[1]))
    one, two, first, second = zip(*ties, strict=True)
    return Ties(np.array(one), np.array(two), np.array(first), np.array(second))


@inner
def new_closing(ties, n, variables):
    """Scratch arrays for a tree of n coordinates."""
    rows = 3 * ties.body_1.shape[0]
    return Closing(
        np.empty(rows),
        np.empty((rows, n)),
        np.empty((rows, variables + 1 + rows)),
        np.empty(rows, np.int64),
        np.empty(variables, np.bool_),
        np.empty(rows),
        np.empty((n, n)),
        np.empty(n),
        np.empty(n),
        np.empty((variables, variables)),
    )


@inner
def ties_at(ties, T, c, work, closing):
    """Poses at c, the gaps of all ties [m] and their derivatives. Returns the largest gap."""
    couple(T, c)
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    closing.G[:] = 0.0
    largest = 0.0
    for i in range(ties.body_1.shape[0]):
        b1, b2 = ties.body_1[i], ties.body_2[i]
        x1 = plus(vector(work.p, b1), turned(matrix(work.R, b1), vector(ties.point_1, i)))
        x2 = plus(vector(work.p, b2), turned(matrix(work.R, b2), vector(ties.point_2, i)))
        gap = minus(x2, x1)
        for d in range(3):
            closing.e[3 * i + d] = gap[d]
            largest = max(largest, abs(gap[d]))
        while b1 != b2:
            # A parent has the smaller number: the larger of both cannot be an ancestor of the other.
            b, sign, x = (b2, 1.0, x2) if b2 > b1 else (b1, -1.0, x1)
            for k in range(T.axis_start[b], T.axis_start[b + 1]):
                u = vector(work.w, k)
                moved = cross(u, minus(x, vector(work.o, k))) if T.axis_kind[k] == ROTATION else u
                for s in range(2):
                    j = T.axis_coordinate[k, s]
                    if j >= 0:
                        for d in range(3):
                            closing.G[3 * i + d, j] += sign * work.dphi[k, s] * moved[d]
            if b2 > b1:
                b2 = T.parent[b2]
            else:
                b1 = T.parent[b1]
    gather_dependents(T, c, closing.G)
    return largest


@inner
def close(ties, T, K, c, work, closing):
    """Newton steps of as few variables as close the loops, inside the bounds, from c in place.

    Leaves poses, gaps and their derivatives at c. Returns whether the loops are closed.
    """
    F, variables = K.free, K.free.shape[0]
    held = np.zeros(variables, np.bool_)
    late = np.zeros(variables, np.bool_)
    before = c.copy()
    gap = ties_at(ties, T, c, work, closing)
    share = 1.0
    for _ in range(TO_CLOSE):
        if gap <= CLOSED:
            return True
        for i in range(variables):
            late[i] = c[F[i]] <= K.lower[i] or c[F[i]] >= K.upper[i]
        rank = eliminate(F, closing, held, late)
        if rank == 0:
            return False
        for j in range(c.shape[0]):
            before[j] = c[j]
        largest = 0.0
        for k in range(rank):
            largest = max(largest, abs(closing.A[k, variables]))
        share = min(1.0, 0.5 / largest) if largest > 0.0 else 1.0
        reached = gap
        while share > 1e-3:
            for k in range(rank):
                i = closing.taken[k]
                moved = before[F[i]] + share * closing.A[k, variables]
                c[F[i]] = min(max(moved, K.lower[i]), K.upper[i])
            reached = ties_at(ties, T, c, work, closing)
            if reached < gap:
                break
            share *= 0.5
        if not reached < gap:
            return gap <= 1e3 * CLOSED
        gap = reached
    return gap <= CLOSED


@inner
def eliminate(F, closing, held, late):
    """Gauss-Jordan elimination of G d = -e over the variables F, with full pivoting; returns the rank.

    Variables that are `held` are not taken, those that come `late` only when no other is left. Afterwards
    d[taken[k]] = A[k, variables] - sum over the others of A[k, i] d[i].
    """
    A, taken, given = closing.A, closing.taken, closing.given
    given[:] = False
    rows, variables = A.shape[0], F.shape[0]
    width, largest = variables + 1 + rows, 0.0
    for r in range(rows):
        for i in range(variables):
            A[r, i] = closing.G[r, F[i]]
            largest = max(largest, abs(A[r, i]))
        A[r, variables] = -closing.e[r]
        for s in range(rows):
            A[r, variables + 1 + s] = 1.0 if r == s else 0.0
    rank = 0
    for attempt in range(2):
        while rank < rows:
            best, row, column = PIVOT * largest, -1, -1
            for i in range(variables):
                if not held[i] and late[i] == (attempt == 1) and not given[i]:
                    for r in range(rank, rows):
                        if abs(A[r, i]) > best:
                            best, row, column = abs(A[r, i]), r, i
            if row < 0:
                break
            for t in range(width):
                A[rank, t], A[row, t] = A[row, t], A[rank, t]
            pivot = 1.0 / A[rank, column]
            for t in range(width):
                A[rank, t] *= pivot
            for r in range(rows):
                factor = A[r, column]
                if r != rank and factor != 0.0:
                    for t in range(width):
                        A[r, t] -= factor * A[rank, t]
            taken[rank], given[column] = column, True
            rank += 1
    return rank


@inner
def multipliers(T, ties, K, c, work, closing):
    """Multipliers of the ties at c, and their curvature added to work.H.

    Returns which variables lie at a bound and are pushed outwards (variables,).
    """
    F, variables, push = K.free, K.free.shape[0], closing.push
    held, late = np.zeros(variables, np.bool_), np.zeros(variables, np.bool_)
    for i in range(variables):
        slack = 1e-12 * (1.0 + abs(c[F[i]]))
        late[i] = c[F[i]] <= K.lower[i] + slack or c[F[i]] >= K.upper[i] - slack
    rank = eliminate(F, closing, held, late)
    for r in range(push.shape[0]):
        push[r] = 0.0
        for k in range(rank):
            push[r] -= closing.A[k, variables + 1 + r] * work.g[F[closing.taken[k]]]
    for i in range(variables):
        if late[i] and not closing.given[i]:
            slope = work.g[F[i]]
            for r in range(push.shape[0]):
                slope += push[r] * closing.G[r, F[i]]
            low = c[F[i]] <= K.lower[i] + 1e-12 * (1.0 + abs(c[F[i]]))
            held[i] = slope > 0.0 if low else slope < 0.0
    tie_curvature(T, ties, c, work, closing)
    for i in F:
        for j in F:
            work.H[i, j] += closing.H[i, j]
    return held


@in_place
def tie_curvature(T, ties, c, work, closing):
    """Second derivatives of push . gaps in the independent coordinates, into closing.H."""
    H, g, D, push = closing.H, closing.g, closing.D, closing.push
    H[:] = 0.0
    g[:] = 0.0
    D[:] = 0.0
    for i in range(ties.body_1.shape[0]):
        f = (push[3 * i], push[3 * i + 1], push[3 * i + 2])
        one, two = ties.body_1[i], ties.body_2[i]
        top_1, top_2 = one, two
        while top_1 != top_2:
            if top_2 > top_1:
                top_2 = T.parent[top_2]
            else:
                top_1 = T.parent[top_1]
        for end in range(2):
            b, sign = (one, -1.0) if end == 0 else (two, 1.0)
            at = vector(ties.point_1, i) if end == 0 else vector(ties.point_2, i)
            x = plus(vector(work.p, b), turned(matrix(work.R, b), at))
            while b != top_1:
                for k in range(T.axis_start[b], T.axis_start[b + 1]):
                    add_curvature(T, work, closing, k, b, top_1, x, f, sign)
                b = T.parent[b]
    for i in range(c.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]
    fold_couplers(T, c, H, g, D)


@in_place
def add_curvature(T, work, closing, k, b, top, x, f, sign):
    """What axis k of body b, with all axes between it and the body `top`, adds for a force f at the point x."""
    H, g = closing.H, closing.g
    u = vector(work.w, k)
    rotates = T.axis_kind[k] == ROTATION
    moved = cross(u, minus(x, vector(work.o, k))) if rotates else u
    i, j = T.axis_coordinate[k, 0], T.axis_coordinate[k, 1]
    # `normal_equations` has left the second derivatives of the axes' motions.
    d11, d12, d22 = work.curvature[k, 0], work.curvature[k, 1], work.curvature[k, 2]
    along = sign * dot(f, moved)
    if i >= 0:
        g[i] += work.dphi[k, 0] * along
        H[i, i] += d11 * along
    if j >= 0:
        g[j] += work.dphi[k, 1] * along
        H[j, j] += d22 * along
        H[max(i, j), min(i, j)] += d12 * along
    turning = cross(moved, f)
    h, a = b, k
    while h != top:
        while a >= T.axis_start[h]:
            if T.axis_kind[a] == ROTATION:
                curved = sign * dot(vector(work.w, a), turning)
                for s in range(2):
                    for t in range(2):
                        i, j = T.axis_coordinate[k, s], T.axis_coordinate[a, t]
                        if i >= 0 and j >= 0 and not (a == k and i < j):
                            both = 2.0 if i == j and a != k else 1.0
                            H[max(i, j), min(i, j)] += both * work.dphi[k, s] * work.dphi[a, t] * curved
            a -= 1
        h = T.parent[h]
        a = T.axis_start[h + 1] - 1
