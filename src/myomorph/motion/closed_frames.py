"""Inverse kinematics of models that close loops: damped Newton steps along the constraint, inside the bounds.

Every pose on the way closes its loops. With errors e(c) of the loops and their derivatives G, a step solves

    min 1/2 d^T L d + g^T d  so that  G d = -e,   L = H + sum_r lambda_r d2e_r/dc2,

by elimination: Gauss-Jordan with full pivoting turns G d = -e into d_dependent = b - A d_independent, whatever
its rank, and gives the multipliers lambda. The pose is then closed again by moving the dependent coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from myomorph.model.spatial import Array
from myomorph.motion.least_squares import hold, posture_cost, solve_frame, solve_frames, solve_in_place
from myomorph.motion.marker_cost import (
    fold_couplers,
    marker_cost,
    marker_distances,
    mean_curvature,
    new_work,
    normal_equations,
)
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.kinematics import body_poses, couple, gather_dependents
from myomorph.rigid.tree import ROTATION, Tree
from myomorph.rigid.vectors import cross, dot, in_place, matrix, minus, plus, turned, vector

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


def solvers(tree: Tree) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """`solve_frame` and `solve_frames` for a tree: where it closes loops, those that keep them closed."""
    if not tree.model.loops:
        return solve_frame, solve_frames
    ties = ties_of(tree)

    def one(T: Any, K: Any, observed: Array, target: Array, *told: Any) -> tuple[bool, int, float]:
        *settings, c, _ = told
        errors, cost = np.empty((1, len(K.body))), np.empty(1)
        converged, iterations = np.empty(1, np.bool_), np.empty(1, np.int64)
        frames = (observed[None], target[None], *settings, False, c[None], errors, cost, converged, iterations)
        solve_closed_frames(ties, T, K, *frames)
        return bool(converged[0]), int(iterations[0]), float(cost[0])

    def all_frames(T: Any, K: Any, observed: Array, *told: Any) -> None:
        *settings, start, c, errors, converged, iterations = told
        c[:1] = start
        cost = np.empty(len(c))
        solve_closed_frames(ties, T, K, observed, *settings, True, c, errors, cost, converged, iterations)

    return one, all_frames


def settle_closed(ties: Ties, T: Any, K: Any, observed: Array, *told: Any) -> None:
    """`settle_frames` with loops kept closed; the cost is infinite where they cannot be."""
    *settings, c, cost, converged = told
    errors, iterations = np.empty((len(c), len(K.body))), np.empty(len(c), np.int64)
    solve_closed_frames(ties, T, K, observed, *settings, False, c, errors, cost, converged, iterations)
    cost *= np.where(np.isfinite(errors), K.weight, 0.0).sum(axis=1)


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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def solve_closed_frames(
    ties, T, K, observed, targets, posture, posture_weight, tolerance, most, chained, c, errors, cost, converged,
    iterations,
):  # fmt: skip
    """`solve_frames` with loops kept closed.

    Parameters
    ----------
    chained : whether each frame starts from where those before it lead, the first from its row of c; else all
        start from their rows
    c : (frames, coordinates) starts, replaced by what is found
    errors, cost, converged, iterations : filled; the cost is infinite where loops cannot be closed
    """
    n = c.shape[1]
    work, closing = new_work(T, n), new_closing(ties, n, K.free.shape[0])
    for frame in range(observed.shape[0]):
        now = c[frame]
        if chained and frame > 0:
            for j in range(n):
                now[j] = 2.0 * c[frame - 1, j] - c[frame - 2, j] if frame >= 2 else c[frame - 1, j]
        hold(K, targets[frame], now)
        begin(K, now)
        whole = close(ties, T, K, now, work, closing)
        if not whole and chained and frame > 0:
            for j in range(n):
                now[j] = c[frame - 1, j]
            hold(K, targets[frame], now)
            begin(K, now)
            whole = close(ties, T, K, now, work, closing)
        converged[frame], iterations[frame], cost[frame] = False, 0, np.inf
        if whole:
            converged[frame], iterations[frame], cost[frame] = descend(
                ties,
                T,
                K,
                observed[frame],
                targets[frame],
                posture,
                posture_weight,
                tolerance,
                most,
                now,
                work,
                closing,
            )
        marker_distances(T, K, observed[frame], now, work, errors[frame])


@njit(cache=True, nogil=True)
def begin(K, c):
    """Put the variables inside their bounds."""
    for i in range(K.free.shape[0]):
        c[K.free[i]] = min(max(c[K.free[i]], K.lower[i]), K.upper[i])


@in_place
def descend(ties, T, K, observed, target, posture, posture_weight, tolerance, most, c, work, closing):
    """`solve_frame` from a closed pose, of which `close` has left poses and gaps, along the ties.

    Returns whether the last step was within `tolerance`, the iterations, and the cost.
    """
    F, D, trial = K.free, work.D, work.trial
    damping = 0.0
    cost = normal_equations(T, K, observed, target, c, work)
    stiffness = posture_weight * mean_curvature(K, D)
    cost += posture_cost(K, c, posture, stiffness)
    for count in range(1, most + 1):
        for i in range(F.shape[0]):
            work.g[F[i]] += stiffness * (c[F[i]] - posture[F[i]])
            work.H[F[i], F[i]] += stiffness
        # `close` and an accepted trial leave the gaps, their derivatives and the poses at c.
        held = multipliers(T, ties, K, c, work, closing)
        accepted, reached = False, cost
        while not accepted and damping < 1e6:
            size = closed_step(K, work, closing, c, damping, held)
            if size < 0.0:
                damping = max(damping * 10.0, 1e-4)
                continue
            for j in range(c.shape[0]):
                trial[j] = c[j]
            for i in range(F.shape[0]):
                trial[F[i]] += work.step[i]
            whole = close(ties, T, K, trial, work, closing)
            if whole and (size <= tolerance or (damping == 0.0 and size * size <= 0.01 * tolerance)):
                for j in range(c.shape[0]):
                    c[j] = trial[j]
                return True, count, cost
            reached = np.inf
            if whole:
                reached = marker_cost(K, observed, target, trial, work.R, work.p)
                reached += posture_cost(K, trial, posture, stiffness)
            if reached <= cost:
                accepted = True
                damping = damping * 0.1 if damping > 1e-6 else 0.0
            else:
                damping = max(damping * 10.0, 1e-4)
                ties_at(ties, T, c, work, closing)
        if not accepted:
            return False, count, cost
        for j in range(c.shape[0]):
            c[j] = trial[j]
        flat = cost - reached <= 1e-13 * cost
        cost = normal_equations(T, K, observed, target, c, work)
        cost += posture_cost(K, c, posture, stiffness)
        if flat:
            return True, count, cost
    return False, most, cost


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@in_place
def closed_step(K, work, closing, c, damping, held_first):
    """Damped Newton step of the variables along the ties, those at a bound and pushed outwards held.

    Variables that would leave their bounds are stopped there and the rest is solved again. Returns the
    largest entry of the step, or -1 where the damped Hessian is not positive definite along the ties.
    """
    F, H, g, D, L, Z, step = K.free, work.H, work.g, work.D, work.L, closing.Z, work.step
    A, taken, n = closing.A, closing.taken, K.free.shape[0]
    held, late = held_first.copy(), np.zeros(n, np.bool_)
    for i in range(n):
        step[i] = 0.0
        late[i] = c[F[i]] <= K.lower[i] or c[F[i]] >= K.upper[i]
    index = np.empty(n, np.int64)
    while True:
        rank = eliminate(F, closing, held, late)
        size = 0
        for i in range(n):
            if not held[i] and not closing.given[i]:
                index[size] = i
                size += 1
        # The step that is given: bounded variables to their bounds, dependent ones closing the gap for them.
        for k in range(rank):
            total = A[k, n]
            for i in range(n):
                if held[i]:
                    total -= A[k, i] * step[i]
            step[taken[k]] = total
        for a in range(size):
            step[index[a]] = 0.0
        # Z = (H + damping D) (basis of the free directions), one column an independent variable.
        for i in range(n):
            for a in range(size):
                j = index[a]
                total = H[F[i], F[j]]
                if i == j:
                    total += damping * D[F[i]]
                for k in range(rank):
                    d = taken[k]
                    total -= (H[F[i], F[d]] + (damping * D[F[i]] if i == d else 0.0)) * A[k, j]
                Z[i, a] = total
        for a in range(size):
            i = index[a]
            for b in range(a + 1):
                total = Z[i, b]
                for k in range(rank):
                    total -= A[k, i] * Z[taken[k], b]
                L[a, b] = total
            right = -g[F[i]]
            for k in range(rank):
                right += A[k, i] * g[F[taken[k]]]
            for j in range(n):
                if step[j] != 0.0:
                    right -= Z[j, a] * step[j]
            L[size, a] = right
        if not solve_in_place(L, size):
            return -1.0
        for a in range(size):
            step[index[a]] = L[size, a]
        for k in range(rank):
            for a in range(size):
                step[taken[k]] -= A[k, index[a]] * L[size, a]
        left = False
        for i in range(n):
            reached = c[F[i]] + step[i]
            if not held[i] and (reached < K.lower[i] or reached > K.upper[i]):
                step[i] = (K.lower[i] if reached < K.lower[i] else K.upper[i]) - c[F[i]]
                held[i] = True
                left = True
        if not left:
            break
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(step[i]))
    return largest
