"""Loops that stay closed, as pairs of points that coincide.

Their gaps, the coordinates that they eliminate, and the multipliers of the ties:

With gaps e(c) and their derivatives G, Gauss-Jordan elimination with full pivoting turns G d = -e
into d_dependent = b - A d_independent, whatever its rank, and gives the multipliers of the ties.
All of it works on the scratch arrays of one frame.
"""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.tasks.task import add_gradient, add_pair
from myomorph.core.rigid.coordinates import Ints, couple, fold_dependents, gather_dependents
from myomorph.core.rigid.kernels import bare, in_place, inner
from myomorph.core.rigid.kinematics import body_poses
from myomorph.core.rigid.tree import ROTATION, Tree
from myomorph.core.rigid.vectors import cross, dot, matrix, minus, plus, turned, vector

CLOSED = 1e-12  # A loop is closed when no gap is larger [m]
PIVOT = 1e-8
"""Least pivot of the elimination relative to the largest entry: what is smaller is no constraint of
its own.
"""

TO_CLOSE = 40  # Newton steps that may close the loops


class Ties(NamedTuple):
    """Pairs of points in bodies that coincide where loops are closed.

    A loop that closes at a point has one tie, a weld has three.

    Attributes
    ----------
    body_1, body_2 : (ties,) numbers of the bodies
    point_1, point_2 : (ties, 3) in them [m]
    """

    body_1: Ints
    body_2: Ints
    point_1: Array
    point_2: Array


class Closing(namedtuple("Closing", "e G A taken dependent rank push H g D Z before")):
    """Scratch arrays of the elimination.

    `e`, `G`: gaps in ground (rows,) [m] and their derivatives (rows, coordinates); `A` (rows,
    variables + 1 + rows): the eliminated rows, b and the transformation of the rows; `taken`
    (rows,): the variable that each eliminated row determines; `dependent` (variables,): whether a
    row does; `rank`: how many rows there are; `push` (rows,): multipliers; `H`, `g`, `D`: what
    these add to Hessian and gradient; `Z`: Hessian times the basis of the free directions;
    `before`: pose from which a step closes the loops.
    """


def ties_of(tree: Tree, lever: float = 1.0) -> Ties | None:
    """List the ties of a tree's loops; None of an open one.

    A weld's second and third tie lie `lever` [m] along its axes.
    """
    if not tree.model.loops:
        return None
    loops = tree.loops
    ties = []
    for i in range(len(loops.body_1)):
        ends = (loops.point_1[i], loops.point_2[i])
        ties.append((loops.body_1[i], loops.body_2[i], *ends))
        if loops.row[i + 1] - loops.row[i] == 6:
            for axis in range(2):
                away = (lever * loops.turn_1[i][:, axis], lever * loops.turn_2[i][:, axis])
                ties.append(
                    (loops.body_1[i], loops.body_2[i], ends[0] + away[0], ends[1] + away[1])
                )
    body_1, body_2, point_1, point_2 = zip(*ties, strict=True)
    return Ties(
        body_1=np.array(body_1),
        body_2=np.array(body_2),
        point_1=np.array(point_1),
        point_2=np.array(point_2),
    )


@inner
def new_closing(ties, n, variables):
    """Scratch arrays for a tree of n coordinates; None of an open one."""
    if ties is None:
        return None
    rows = 3 * ties.body_1.shape[0]
    return Closing(
        e=np.empty(rows),
        G=np.empty((rows, n)),
        A=np.empty((rows, variables + 1 + rows)),
        taken=np.empty(rows, np.int64),
        dependent=np.empty(variables, np.bool_),
        rank=np.empty(1, np.int64),
        push=np.empty(rows),
        H=np.empty((n, n)),
        g=np.empty(n),
        D=np.empty(n),
        Z=np.empty((variables, variables)),
        before=np.empty(n),
    )


@bare
def ties_at(ties, T, c, work, closing):
    """Poses at c, the gaps of all ties [m] and their derivatives. Returns the largest gap."""
    couple(T, c)
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    if ties is None:
        return 0.0
    for i in range(closing.G.shape[0]):
        for j in range(closing.G.shape[1]):
            closing.G[i, j] = 0.0
    largest = 0.0
    for i in range(ties.body_1.shape[0]):
        b1 = ties.body_1[i]
        b2 = ties.body_2[i]
        x1 = plus(vector(work.p, b1), turned(matrix(work.R, b1), vector(ties.point_1, i)))
        x2 = plus(vector(work.p, b2), turned(matrix(work.R, b2), vector(ties.point_2, i)))
        gap = minus(x2, x1)
        for d in range(3):
            closing.e[3 * i + d] = gap[d]
            largest = max(largest, abs(gap[d]))
        while b1 != b2:
            # A parent has the smaller number: the larger of both cannot be an ancestor of the
            # other.
            b, sign, x = (b2, 1.0, x2) if b2 > b1 else (b1, -1.0, x1)
            for axis in range(T.axis_start[b], T.axis_start[b + 1]):
                u = vector(work.w, axis)
                moved = (
                    cross(u, minus(x, vector(work.o, axis))) if T.axis_kind[axis] == ROTATION else u
                )
                for s in range(2):
                    j = T.axis_coordinate[axis, s]
                    if j >= 0:
                        for d in range(3):
                            closing.G[3 * i + d, j] += sign * work.dphi[axis, s] * moved[d]
            if b2 > b1:
                b2 = T.parent[b2]
            else:
                b1 = T.parent[b1]
    gather_dependents(T, c, closing.G)
    return largest


@bare
def close(ties, T, P, c, work, closing):
    """Close the loops inside the bounds, by Newton steps of few variables from c in place.

    Returns whether they are closed.
    """
    if ties is None:
        couple(T, c)
        body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
        return True
    F = P.free
    variables = P.free.shape[0]
    before = closing.before
    held = work.stopped
    late = work.late
    for i in range(variables):
        held[i] = False
    gap = ties_at(ties, T, c, work, closing)
    share = 1.0
    for _ in range(TO_CLOSE):
        if gap <= CLOSED:
            return True
        for i in range(variables):
            late[i] = c[F[i]] <= P.lower[i] or c[F[i]] >= P.upper[i]
        rank = eliminate(F, closing, held, late)
        if rank == 0:
            return False
        for j in range(c.shape[0]):
            before[j] = c[j]
        largest = 0.0
        for row in range(rank):
            largest = max(largest, abs(closing.A[row, variables]))
        share = min(1.0, 0.5 / largest) if largest > 0.0 else 1.0
        reached = gap
        while share > 1e-3:
            for row in range(rank):
                i = closing.taken[row]
                moved = before[F[i]] + share * closing.A[row, variables]
                c[F[i]] = min(max(moved, P.lower[i]), P.upper[i])
            reached = ties_at(ties, T, c, work, closing)
            if reached < gap:
                break
            share *= 0.5
        if not reached < gap:
            return gap <= 1e3 * CLOSED
        gap = reached
    return gap <= CLOSED


@bare
def eliminate(F, closing, held, late):
    """Eliminate G d = -e over the variables F after Gauss and Jordan, with full pivoting.

    Variables that are `held` are not taken, those that come `late` only when no other is left.
    Afterwards d[taken[row]] = A[row, variables] - sum over the others of A[row, i] d[i]. Returns
    the rank.
    """
    A = closing.A
    taken = closing.taken
    dependent = closing.dependent
    for i in range(F.shape[0]):
        dependent[i] = False
    rows = A.shape[0]
    variables = F.shape[0]
    width = variables + 1 + rows
    largest = 0.0
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
            best = PIVOT * largest
            row = -1
            column = -1
            for i in range(variables):
                if not held[i] and late[i] == (attempt == 1) and not dependent[i]:
                    for r in range(rank, rows):
                        if abs(A[r, i]) > best:
                            best = abs(A[r, i])
                            row = r
                            column = i
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
            taken[rank] = column
            dependent[column] = True
            rank += 1
    return rank


@bare
def hold_variables(T, ties, P, c, work, closing):
    """Fill `work.held`: variables that lie at a bound and are pushed outwards.

    Loops add their curvature to work.H.
    """
    if ties is None:
        F = P.free
        g = work.g
        for i in range(F.shape[0]):
            slack = 1e-12 * (1.0 + abs(c[F[i]]))
            low = c[F[i]] <= P.lower[i] + slack
            high = c[F[i]] >= P.upper[i] - slack
            work.held[i] = (low and g[F[i]] > 0.0) or (high and g[F[i]] < 0.0)
    else:
        multipliers(T, ties, P, c, work, closing)


@bare
def multipliers(T, ties, P, c, work, closing):
    """Find the multipliers of the ties at c, and add their curvature to work.H.

    Fills `work.held`: variables that a bound keeps from moving outwards.
    """
    F = P.free
    variables = P.free.shape[0]
    push = closing.push
    held = work.held
    late = work.late
    for i in range(variables):
        held[i] = False
        slack = 1e-12 * (1.0 + abs(c[F[i]]))
        late[i] = c[F[i]] <= P.lower[i] + slack or c[F[i]] >= P.upper[i] - slack
    rank = eliminate(F, closing, held, late)
    for r in range(push.shape[0]):
        push[r] = 0.0
        for row in range(rank):
            push[r] -= closing.A[row, variables + 1 + r] * work.g[F[closing.taken[row]]]
    for i in range(variables):
        if late[i] and not closing.dependent[i]:
            slope = work.g[F[i]]
            for r in range(push.shape[0]):
                slope += push[r] * closing.G[r, F[i]]
            low = c[F[i]] <= P.lower[i] + 1e-12 * (1.0 + abs(c[F[i]]))
            held[i] = slope > 0.0 if low else slope < 0.0
    tie_curvature(T, ties, c, work, closing)
    for i in F:
        for j in F:
            work.H[i, j] += closing.H[i, j]


@in_place
def tie_curvature(T, ties, c, work, closing):
    """Second derivatives of push . gaps in the independent coordinates, into closing.H."""
    H = closing.H
    g = closing.g
    D = closing.D
    push = closing.push
    for i in range(c.shape[0]):
        g[i] = D[i] = 0.0
        for j in range(c.shape[0]):
            H[i, j] = 0.0
    for i in range(ties.body_1.shape[0]):
        f = (push[3 * i], push[3 * i + 1], push[3 * i + 2])
        top_1 = ties.body_1[i]
        top_2 = ties.body_2[i]
        while top_1 != top_2:
            if top_2 > top_1:
                top_2 = T.parent[top_2]
            else:
                top_1 = T.parent[top_1]
        for end in range(2):
            b, sign = (ties.body_1[i], -1.0) if end == 0 else (ties.body_2[i], 1.0)
            at = vector(ties.point_1, i) if end == 0 else vector(ties.point_2, i)
            x = plus(vector(work.p, b), turned(matrix(work.R, b), at))
            while b != top_1:
                for axis in range(T.axis_start[b], T.axis_start[b + 1]):
                    add_curvature(T, work, closing, axis, b, top_1, x, f, sign)
                b = T.parent[b]
    for i in range(c.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]
    fold_dependents(T, c, H, g, D)


@in_place
def add_curvature(T, work, closing, axis, b, top, x, f, sign):
    """Add the curvature of an axis of body b with all axes between it and the body `top`.

    It is that of a force f at the point x.
    """
    u = vector(work.w, axis)
    moved = cross(u, minus(x, vector(work.o, axis))) if T.axis_kind[axis] == ROTATION else u
    # `gradient_and_hessian` has left the second derivatives of the axes' motions.
    add_gradient(T, work, closing.H, closing.g, axis, sign * dot(f, moved))
    turning = cross(moved, f)
    h = b
    a = axis
    while h != top:
        while a >= T.axis_start[h]:
            if T.axis_kind[a] == ROTATION:
                add_pair(
                    T,
                    work,
                    closing.H,
                    closing.D,
                    axis,
                    a,
                    0.0,
                    sign * dot(vector(work.w, a), turning),
                )
            a -= 1
        h = T.parent[h]
        a = T.axis_start[h + 1] - 1
