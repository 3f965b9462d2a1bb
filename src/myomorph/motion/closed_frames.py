"""Inverse kinematics of models that close loops: damped Newton steps along the constraint, inside the bounds.

Every pose on the way closes its loops. With errors e(c) of the loops and their derivatives G, a step solves

    min 1/2 d^T L d + g^T d  so that  G d = -e,   L = H + sum_r lambda_r d2e_r/dc2,

by elimination of dependent coordinates (`ties`). The pose is then closed again by moving those.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.motion.least_squares import SCOUT, hold, posture_cost, resume, solve_frames, solve_in_place
from myomorph.motion.marker_cost import (
    marker_cost,
    marker_distances,
    mean_curvature,
    new_work,
    normal_equations,
    seen_weight,
)
from myomorph.motion.ties import Ties, close, eliminate, multipliers, new_closing, ties_at, ties_of
from myomorph.rigid.kernels import in_place, inner, kernel
from myomorph.rigid.tree import Tree


def frame_solver(tree: Tree) -> Callable[..., None]:
    """`solve_frames` for a tree: where it closes loops, one that keeps them closed."""
    if not tree.model.loops:
        return solve_frames
    ties = ties_of(tree)

    def solve_closed(T: Any, K: Any, observed: Array, *options: Any) -> None:
        *settings, starts, c, errors, cost, converged, iterations = options
        c[:1] = starts[0]
        solve_closed_frames(ties, T, K, observed, *settings, True, starts, c, errors, cost, converged, iterations)

    return solve_closed


def settle_closed(ties: Ties, T: Any, K: Any, observed: Array, *told: Any) -> None:
    """`settle_frames` with loops kept closed; the cost is infinite where they cannot be."""
    *settings, c, cost, converged = told
    errors, iterations = np.empty((len(c), len(K.body))), np.empty(len(c), np.int64)
    solve_closed_frames(ties, T, K, observed, *settings, False, c, c, errors, cost, converged, iterations)
    cost *= np.where(np.isfinite(errors), K.weight, 0.0).sum(axis=1)


@kernel
def solve_closed_frames(
    ties, T, K, observed, targets, posture, posture_weight, tolerance, most, chained, starts, c, errors, cost,
    converged, iterations,
):  # fmt: skip
    """`solve_frames` with loops kept closed.

    Parameters
    ----------
    chained : whether each frame starts from where those before it lead, the first from its row of c; else all
        start from their rows
    starts : (poses, coordinates) of every `SCOUT`-th frame where they are chained
    c : (frames, coordinates) starts, replaced by what is found
    errors, cost, converged, iterations : filled; the cost is infinite where loops cannot be closed
    """
    n = c.shape[1]
    work, closing = new_work(T, n), new_closing(ties, n, K.free.shape[0])
    run, unseen = 0, 0
    for frame in range(observed.shape[0]):
        now = c[frame]
        if chained and seen_weight(K, observed[frame]) == 0.0:
            run, unseen = 0, unseen + 1
            for j in range(n):
                now[j] = c[max(frame - 1, 0), j]
            converged[frame], iterations[frame], cost[frame] = False, 0, 0.0
            for m in range(errors.shape[1]):
                errors[frame, m] = np.nan
            continue
        if chained and frame > 0:
            for j in range(n):
                now[j] = 2.0 * c[frame - 1, j] - c[frame - 2, j] if run >= 2 else c[frame - 1, j]
            if unseen >= SCOUT:
                resume(K, observed, starts, frame, now)
        run, unseen = run + 1, 0
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
                ties, T, K, observed[frame], targets[frame], posture, posture_weight, tolerance, most, now, work,
                closing,
            )  # fmt: skip
        marker_distances(T, K, observed[frame], now, work, errors[frame])


@inner
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
            square = K.unit[F[i]] ** 2
            work.g[F[i]] += stiffness / square * (c[F[i]] - posture[F[i]])
            work.H[F[i], F[i]] += stiffness / square
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


@in_place
def closed_step(K, work, closing, c, damping, held_first):
    """Damped Newton step of the variables along the ties, those at a bound and pushed outwards held.

    Variables that would leave their bounds are stopped there and the rest is solved again. Returns the
    largest entry of the step, in units, or -1 where the damped Hessian is not positive definite along the ties.
    """
    F, L, step, A, taken, n = K.free, work.L, work.step, closing.A, closing.taken, K.free.shape[0]
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
        reduced_system(F, work, closing, damping, rank, index, size)
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
        largest = max(largest, abs(step[i]) / K.unit[F[i]])
    return largest


@in_place
def reduced_system(F, work, closing, damping, rank, index, size):
    """Normal equations of the independent variables `index`, into the rows of L up to `size`.

    With the basis B of the directions along the ties (a column for each independent variable) and the step s
    that is given, L = B^T (H + damping D) B and its row `size` = -B^T (g + (H + damping D) s).
    """
    H, g, D, L, Z, step = work.H, work.g, work.D, work.L, closing.Z, work.step
    A, taken, n = closing.A, closing.taken, F.shape[0]
    for i in range(n):
        for a in range(size):
            j = index[a]
            total = H[F[i], F[j]] + (damping * D[F[i]] if i == j else 0.0)
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
