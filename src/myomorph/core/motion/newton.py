"""The Newton loop of inverse kinematics: damped steps inside the bounds, loops closed.

In each frame the cost

    sum_t cost_t(c) + stiffness sum_j ((c_j - posture_j) / unit_j)^2

is minimised over the free coordinates c_j: the costs of all tasks, and a weak pull towards a
posture, which determines what no task shows. Its stiffness is `posture_weight` times
`mean_curvature` where the frame starts. A step d of the free coordinates solves

    min 1/2 d^T (H + damping D) d + g^T d  so that  G d = -e,  lower <= c + d <= upper

with gradient g and Hessian H of half the cost (`gradient_and_hessian`, and the posture's share),
the diagonal D of the tasks' Gauss-Newton part, the gaps e of the loops, their derivatives G and the
curvature of their multipliers in H (`tasks.loops`). Coordinates that the loops determine are
eliminated; every pose on the way closes the loops. An open model has none of these, and the same
steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.pose_problem import PoseProblem, gradient_and_hessian, mean_curvature
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.tasks.loops import close, eliminate, hold_variables, new_closing, ties_at
from myomorph.core.motion.tasks.markers import MarkerTask
from myomorph.core.motion.tasks.orientations import OrientationTask
from myomorph.core.motion.tasks.task import (
    TASKS,
    Task,
    keep_residuals,
    new_work,
    shown,
    sum_of_costs,
)
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import CHUNK, over_frames
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.core.rigid.tree import Tree

# Frames between the poses that are tracked first; a gap of so many frames ends at one of them
SCOUT = 16


Settings: TypeAlias = tuple[float, float, int]
"""Weight of the posture relative to the mean curvature; tolerance, the largest last step in units
of the coordinates; the most steps of a frame.
"""


@dataclass(frozen=True, eq=False)
class SolvedPoses:
    """Poses where the steps of each frame ended.

    Attributes
    ----------
    values : (frames, coordinates) [rad or m], NaN in frames that were left out
    cost : (frames,) of all tasks and the posture [m^2], 0 in frames that were left out, infinite
        where loops cannot be closed
    converged : (frames,) see `solve_poses`
    iterations : (frames,) steps
    errors : by kind of task, (frames, ...) the residuals that it stores, as for markers (frames,
        markers) distances [m]. They are arrays of the problem, which the next solution of the same
        problem overwrites
    """

    values: Array
    cost: Array
    converged: np.ndarray
    iterations: Ints
    errors: Mapping[type[Task], Array] = field(default_factory=dict)


def task_arrays(tasks: Sequence[Task], tree: Tree, targets: Array) -> tuple[Any, ...]:
    """Compile the values of all tasks, kind by kind.

    Parameters
    ----------
    tasks : in any order
    tree : of the model
    targets : (frames, coordinates) of `coordinate_targets` [rad or m]

    Returns
    -------
    arrays of each kind: those of `TASK_KINDS`, be they empty, and behind them kinds from elsewhere
    """
    kinds = dict.fromkeys((*TASK_KINDS, *(type(task) for task in tasks)))
    return tuple(
        kind.together([task for task in tasks if type(task) is kind], tree, targets)
        for kind in kinds
    )


def solve_poses(
    tree: Tree,
    problem: PoseProblem,
    starts: Array,
    settings: Settings,
    chained: bool = True,
    progress: Callable[[int], None] | None = None,
    chunk: int = CHUNK,
) -> SolvedPoses:
    """Minimise the cost of every frame.

    *Where a frame begins.* Threads share a recording in chunks of frames, and a chunk cannot wait
    for the end of the one before it. So `starts.scout_poses` first tracks every `SCOUT`-th frame,
    the scouts, one after another through the whole recording; `inverse_kinematics` gives each frame
    the pose of the scout at or before it as its start. Here one thread solves the frames of a chunk
    in turn. Chained, the first frame of a chunk begins at its start, the second where the first
    ended, all others on the straight line through the last two. After frames that no task shows,
    which are left out, the next begins where the last one before them ended; after `SCOUT` or more
    of them at the start of the next scout, if that is in the chunk and shown. A frame whose loops
    cannot be closed from where it should begin tries again from the frame before it. Not chained,
    every frame begins at its own start and none is left out.

    *When a frame has converged.* It has where loops are closed and the last step moved no
    coordinate by more than the tolerance, in units, or where the last step was an undamped Newton
    step of size s with s^2 <= tolerance / 100, since that leaves an error of the order of s^2. It
    has, too, where a step was accepted but the cost fell by less than 1e-13 of itself: rounding
    lets it fall no further. It has not after the most steps, where no damping lowers the cost, and
    where loops cannot be closed; nor do frames that are left out count as converged.

    Parameters
    ----------
    tree : of the model
    problem : what is minimised; its arrays of errors are filled
    starts : (frames, coordinates) [rad or m]
    settings : posture weight, tolerance and most steps
    chained : whether a frame begins where those before it lead
    progress : called with the number of frames just done
    chunk : frames that a thread solves in turn

    Returns
    -------
    poses, (frames, ...), with their cost and convergence
    """
    frames = len(starts)
    values = np.array(starts, order="C")
    cost = np.empty(frames)
    converged = np.empty(frames, np.bool_)
    iterations = np.empty(frames, np.int64)

    def part(first: int, last: int) -> None:
        solve_chunk(
            tree.arrays,
            problem,
            first,
            last,
            *settings,
            chained,
            values,
            cost,
            converged,
            iterations,
        )

    over_frames(part, frames, progress, chunk)
    return SolvedPoses(
        values=values,
        cost=cost,
        converged=converged,
        iterations=iterations,
        errors={
            TASKS[type(part)]: part.errors for part in problem.tasks if hasattr(part, "errors")
        },
    )


def frames_shown(problem: PoseProblem) -> np.ndarray:
    """Find the frames that any task shows.

    Parameters
    ----------
    problem : with its tasks

    Returns
    -------
    (frames,) whether any task has a measurement
    """
    result = np.empty(len(problem.fixed), np.bool_)
    fill_shown(problem, result)
    return result


@kernel
def fill_shown(P, result):
    """Fill `result` (frames,) of `frames_shown`."""
    for frame in range(result.shape[0]):
        result[frame] = shown(P.tasks, frame)


@kernel
def solve_chunk(
    T,
    P,
    first,
    last,
    posture_weight,
    tolerance,
    max_steps,
    chained,
    values,
    cost,
    converged,
    iterations,
):
    """Solve the frames from `first` up to `last` in turn, for `solve_poses`.

    Their rows of `values` (frames, coordinates) hold their starts and then their poses; `cost`,
    `converged` and `iterations` (frames,) are filled.
    """
    n = values.shape[1]
    work = new_work(T, n)
    closing = new_closing(P.ties, n, P.free.shape[0])
    before = values[first].copy()
    run = 0
    unseen = 0
    for frame in range(first, last):
        c = values[frame]
        if chained and not shown(P.tasks, frame):
            run = 0
            unseen = unseen + 1
            converged[frame] = False
            iterations[frame] = 0
            cost[frame] = 0.0
            for j in range(n):
                c[j] = np.nan
            continue
        if chained and run >= 2:
            # Straight on from the last two frames: the start is nearer, the step count smaller.
            for j in range(n):
                c[j] = 2.0 * before[j] - values[frame - 2, j]
        elif chained and frame > first and not (unseen >= SCOUT and resume(P, frame, last, values)):
            for j in range(n):
                c[j] = before[j]
        run = run + 1
        unseen = 0
        closed = begin(T, P, frame, c, work, closing)
        if not closed and chained and frame > first:
            for j in range(n):
                c[j] = before[j]
            closed = begin(T, P, frame, c, work, closing)
        converged[frame] = False
        iterations[frame] = 0
        cost[frame] = np.inf
        if closed:
            converged[frame], iterations[frame], cost[frame] = descend(
                T, P, frame, posture_weight, tolerance, max_steps, c, work, closing
            )
        keep_residuals(P.tasks, c, frame, work)
        for j in range(n):
            before[j] = c[j]


@bare
def resume(P, frame, last, values):
    """Start a frame from the next scout, where that is in the chunk and shown.

    Returns whether it is.
    """
    scout = -(-frame // SCOUT) * SCOUT
    if scout >= last or not shown(P.tasks, scout):
        return False
    # Entry by entry: an assignment of a slice would bring in the compilation of its error's text.
    for j in range(values.shape[1]):
        values[frame, j] = values[scout, j]
    return True


@bare
def begin(T, P, frame, c, work, closing):
    """Put c inside its bounds, what is not solved for at its value, and close the loops.

    Returns whether they are closed.
    """
    i = 0
    for j in range(c.shape[0]):
        if i < P.free.shape[0] and P.free[i] == j:
            c[j] = min(max(c[j], P.lower[i]), P.upper[i])
            i += 1
        else:
            c[j] = P.fixed[frame, j]
    return close(P.ties, T, P, c, work, closing)


@bare
def descend(T, P, frame, posture_weight, tolerance, max_steps, c, work, closing):
    """Take damped Newton steps from c in place.

    Poses and gaps in `work` and `closing` are those of c, as `close` has left them, before and
    afterwards. Returns whether c has converged (see `solve_poses`), the number of steps, and the
    cost of all tasks and the posture.
    """
    F = P.free
    trial = work.trial
    damping = 0.0
    cost = gradient_and_hessian(T, P, frame, c, work)
    stiffness = posture_weight * mean_curvature(P, work)
    cost += posture_cost(P, c, stiffness)
    for count in range(1, max_steps + 1):
        for i in range(F.shape[0]):
            square = P.unit[F[i]] ** 2
            work.g[F[i]] += stiffness / square * (c[F[i]] - P.posture[F[i]])
            work.H[F[i], F[i]] += stiffness / square
        hold_variables(T, P.ties, P, c, work, closing)
        accepted = False
        reached = cost
        while not accepted and damping < 1e6:
            size = newton_step(P, work, closing, c, damping)
            if size < 0.0:
                damping = max(damping * 10.0, 1e-4)
                continue
            for j in range(c.shape[0]):
                trial[j] = c[j]
            for i in range(F.shape[0]):
                trial[F[i]] += work.step[i]
            closed = close(P.ties, T, P, trial, work, closing)
            # An undamped Newton step of size s leaves an error of the order of s^2.
            if closed and (
                size <= tolerance or (damping == 0.0 and size * size <= 0.01 * tolerance)
            ):
                for j in range(c.shape[0]):
                    c[j] = trial[j]
                return True, count, cost
            reached = np.inf
            if closed:
                reached = sum_of_costs(P.tasks, trial, frame, work) + posture_cost(
                    P, trial, stiffness
                )
            if reached <= cost:
                accepted = True
                damping = damping * 0.1 if damping > 1e-6 else 0.0
            else:
                damping = max(damping * 10.0, 1e-4)
                ties_at(P.ties, T, c, work, closing)
        if not accepted:
            return False, count, cost
        for j in range(c.shape[0]):
            c[j] = trial[j]
        flat = cost - reached <= 1e-13 * cost
        cost = gradient_and_hessian(T, P, frame, c, work)
        cost += posture_cost(P, c, stiffness)
        if flat:
            return True, count, cost
    return False, max_steps, cost


@bare
def posture_cost(P, c, stiffness):
    """Cost of the pull towards the posture, which determines what no task shows."""
    total = 0.0
    for j in P.free:
        total += stiffness * ((c[j] - P.posture[j]) / P.unit[j]) ** 2
    return total


@bare
def newton_step(P, work, closing, c, damping):
    """Find the damped Newton step of the free coordinates along the loops' ties.

    It is left in `work.step`. Coordinates of `work.held` stay where they are; those that would
    leave their bounds are stopped there and the rest is solved again. Returns the largest entry of
    the step, in units, or -1 where the damped Hessian is not positive definite along the ties.
    """
    F = P.free
    L = work.L
    step = work.step
    stopped = work.stopped
    index = work.solved
    n = P.free.shape[0]
    for i in range(n):
        step[i] = 0.0
        stopped[i] = work.held[i]
    while True:
        size = reduced_system(P, work, closing, c, damping)
        if not solve_in_place(L, size):
            return -1.0
        for a in range(size):
            step[index[a]] = L[size, a]
        close_step(work, closing, size)
        left = False
        for i in range(n):
            reached = c[F[i]] + step[i]
            if not stopped[i] and (reached < P.lower[i] or reached > P.upper[i]):
                step[i] = (P.lower[i] if reached < P.lower[i] else P.upper[i]) - c[F[i]]
                stopped[i] = True
                left = True
        if not left:
            break
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(step[i]) / P.unit[F[i]])
    return largest


@bare
def reduced_system(P, work, closing, c, damping):
    """Write the equations of the independent free coordinates that are not stopped into `work.L`.

    They fill the rows up to their number, which is returned; their places in `free` are in
    `work.solved`. With the basis B of the directions along the ties (a column for each independent
    variable; the identity without loops) and the step s of the others, L = B^T (H + damping D) B
    and the row behind it is -B^T (g + (H + damping D) s).
    """
    F = P.free
    H = work.H
    g = work.g
    D = work.D
    L = work.L
    step = work.step
    n = P.free.shape[0]
    held = work.stopped
    index = work.solved
    size = 0
    if closing is None:
        for i in range(n):
            if not held[i]:
                index[size] = i
                size += 1
        for a in range(size):
            i = F[index[a]]
            for b in range(a + 1):
                L[a, b] = H[i, F[index[b]]]
            L[a, a] += damping * D[i]
            right = -g[i]
            for j in range(n):
                if held[j] and step[j] != 0.0:
                    right -= H[i, F[j]] * step[j]
            L[size, a] = right
    else:
        A = closing.A
        taken = closing.taken
        Z = closing.Z
        late = work.late
        for i in range(n):
            late[i] = c[F[i]] <= P.lower[i] or c[F[i]] >= P.upper[i]
        rank = eliminate(F, closing, held, late)
        closing.rank[0] = rank
        for i in range(n):
            if not held[i] and not closing.dependent[i]:
                index[size] = i
                size += 1
        # What is known of the step: bounded variables go to their bounds, dependent ones close the
        # gap for them.
        for row in range(rank):
            total = A[row, n]
            for i in range(n):
                if held[i]:
                    total -= A[row, i] * step[i]
            step[taken[row]] = total
        for a in range(size):
            step[index[a]] = 0.0
        for i in range(n):
            for a in range(size):
                j = index[a]
                total = H[F[i], F[j]] + (damping * D[F[i]] if i == j else 0.0)
                for row in range(rank):
                    d = taken[row]
                    total -= (H[F[i], F[d]] + (damping * D[F[i]] if i == d else 0.0)) * A[row, j]
                Z[i, a] = total
        for a in range(size):
            i = index[a]
            for b in range(a + 1):
                total = Z[i, b]
                for row in range(rank):
                    total -= A[row, i] * Z[taken[row], b]
                L[a, b] = total
            right = -g[F[i]]
            for row in range(rank):
                right += A[row, i] * g[F[taken[row]]]
            for j in range(n):
                if step[j] != 0.0:
                    right -= Z[j, a] * step[j]
            L[size, a] = right
    return size


@bare
def close_step(work, closing, size):
    """Let the dependent coordinates follow the others along the ties."""
    if closing is not None:
        for row in range(closing.rank[0]):
            for a in range(size):
                work.step[closing.taken[row]] -= closing.A[row, work.solved[a]] * work.L[size, a]


@bare
def solve_in_place(L, n):
    """Factor the lower triangle of L (n, n) by Cholesky and solve for row n, in place.

    A variable that nothing determines (an empty pivot from the start) stays at zero. Returns False
    where another pivot is not positive.
    """
    for j in range(n):
        diagonal = L[j, j]
        pivot = diagonal
        for t in range(j):
            pivot -= L[j, t] * L[j, t]
        if diagonal == 0.0:
            # An infinite pivot makes the variable's column, and so its part of the solution,
            # vanish.
            root = np.inf
        elif pivot <= 1e-14 * diagonal:
            return False
        else:
            root = np.sqrt(pivot)
        L[j, j] = root
        for i in range(j + 1, n + 1):
            total = L[i, j]
            for t in range(j):
                total -= L[i, t] * L[j, t]
            L[i, j] = total / root
    for j in range(n - 1, -1, -1):
        total = L[n, j]
        for t in range(j + 1, n):
            total -= L[t, j] * L[n, t]
        L[n, j] = total / L[j, j]
    return True


TASK_KINDS: tuple[type[Task], ...] = (MarkerTask, CoordinateTask, OrientationTask)
"""Every problem has arrays of these in this order, be they empty, so that one compiled loop serves
all of them.
"""
