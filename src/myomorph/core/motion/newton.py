"""The Newton loop of inverse kinematics: damped steps inside the bounds, loops closed.

In each frame the cost

    sum_t cost_t(c) + sum_j (stiffness + pull_j) ((c_j - posture_j) / unit_j)^2

is minimised over the free coordinates c_j: the costs of all tasks, and a weak pull towards a
posture, which determines what no task shows. Its stiffness is `posture_weight` times
`mean_curvature` where the frame starts. The pull_j are 0 but for coordinates that markers hardly
show (`myomorph.core.motion.unseen`). A step d of the free coordinates solves

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
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.pose_problem import (
    PoseProblem,
    gradient_and_hessian,
    mean_curvature,
    row_of,
)
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.tasks.loops import (
    close,
    eliminate,
    find_late,
    hold_variables,
    new_closing,
    ties_at,
)
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
INDEPENDENT = 16  # Frames that a thread solves in turn where none waits for another

MAX_DAMPING = 1e6  # Beyond it no step lowers the cost
FIRST_DAMPING = 1e-4  # The least above 0
ROUNDING = 1e-13  # Share of the cost below which a fall is rounding


class Settings(NamedTuple):
    """Settings of the Newton loop.

    Attributes
    ----------
    posture_weight : of the posture, relative to the mean curvature
    tolerance : largest last step, in units of the coordinates
    max_steps : of a frame
    chained : whether a frame begins where those before it lead
    """

    posture_weight: float
    tolerance: float
    max_steps: int
    chained: bool = True


class PoseRoom(NamedTuple):
    """Arrays that the kernel fills.

    Attributes
    ----------
    values : (frames, coordinates) starts, then poses [rad or m]
    cost : (frames,) [m^2]
    converged : (frames,)
    iterations : (frames,) steps
    """

    values: Array
    cost: Array
    converged: np.ndarray
    iterations: Ints

    @staticmethod
    def of(starts: Array) -> PoseRoom:
        """Make room for frames with their starts.

        Parameters
        ----------
        starts : (frames, coordinates) copied [rad or m]

        Returns
        -------
        the arrays, those of results undefined
        """
        frames = len(starts)
        return PoseRoom(
            values=np.array(starts, order="C"),
            cost=np.empty(frames),
            converged=np.empty(frames, np.bool_),
            iterations=np.empty(frames, np.int64),
        )


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
    progress: Callable[[int], None] | None = None,
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
    settings : posture weight, tolerance, most steps, and whether frames are chained
    progress : called with the number of frames just done

    Returns
    -------
    poses, (frames, ...), with their cost and convergence
    """
    room = PoseRoom.of(starts)

    def part(first: int, last: int) -> None:
        solve_chunk(tree.arrays, problem, (first, last), settings, room)

    chunk = CHUNK if settings.chained else INDEPENDENT
    over_frames(part, len(starts), progress, chunk)
    return SolvedPoses(
        values=room.values,
        cost=room.cost,
        converged=room.converged,
        iterations=room.iterations,
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
def fill_shown(problem, result):
    """Fill `result` (frames,) of `frames_shown`."""
    for frame in range(result.shape[0]):
        result[frame] = shown(problem.tasks, frame)


@kernel
def solve_chunk(T, problem, frames, settings, room):
    """Solve frames in turn, for `solve_poses`.

    Parameters
    ----------
    T : arrays of the tree
    problem : `PoseProblem`
    frames : the first, and the one behind the last
    settings : `Settings`
    room : `PoseRoom`; of these frames, starts become poses, and all else is filled
    """
    first, last = frames
    values = room.values
    n = values.shape[1]
    work = new_work(T, n)
    closing = new_closing(problem.ties, n, problem.free.shape[0])
    before = values[first].copy()
    run = 0
    unseen = 0
    for frame in range(first, last):
        room.converged[frame] = False
        room.iterations[frame] = 0
        if settings.chained and not shown(problem.tasks, frame):
            run = 0
            unseen = unseen + 1
            room.cost[frame] = 0.0
            for j in range(n):
                values[frame, j] = np.nan
            continue
        if settings.chained and frame > first:
            resumed = unseen >= SCOUT and resume(problem, frame, last, values)
            if not resumed:
                _continue(values, frame, before, run)
        run = run + 1
        unseen = 0
        closed = _begin(T, problem, frame, values[frame], work, closing)
        if not closed and settings.chained and frame > first:
            _copy(before, values[frame])
            closed = _begin(T, problem, frame, values[frame], work, closing)
        room.cost[frame] = np.inf
        if closed:
            room.converged[frame], room.iterations[frame], room.cost[frame] = _descend(
                T, problem, frame, settings, values[frame], work, closing
            )
        keep_residuals(problem.tasks, values[frame], frame, work)
        _copy(values[frame], before)


@bare
def _copy(source, target):
    """Copy an array (n,).

    Entry by entry: an assignment of a slice would bring in the compilation of its error's text.
    """
    for j in range(source.shape[0]):
        target[j] = source[j]


@bare
def _continue(values, frame, before, run):
    """Start a frame on the straight line through the last two, or from the last one.

    On the line the start is nearer, and the step count smaller.

    Parameters
    ----------
    values : (frames, coordinates) the frame's row is filled
    frame : number of it
    before : (coordinates,) the last pose
    run : how many frames without a gap are behind
    """
    if run >= 2:
        for j in range(values.shape[1]):
            values[frame, j] = 2.0 * before[j] - values[frame - 2, j]
    else:
        _copy(before, values[frame])


@bare
def resume(problem, frame, last, values):
    """Start a frame from the next scout, where that is in the chunk and shown.

    Returns whether it is.
    """
    scout = -(-frame // SCOUT) * SCOUT
    if scout >= last or not shown(problem.tasks, scout):
        return False
    _copy(values[scout], values[frame])
    return True


@bare
def _begin(T, problem, frame, c, work, closing):
    """Put c inside its bounds, what is not solved for at its value, and close the loops.

    Returns whether they are closed.
    """
    i = 0
    for j in range(c.shape[0]):
        if i < problem.free.shape[0] and problem.free[i] == j:
            c[j] = min(max(c[j], problem.lower[i]), problem.upper[i])
            i += 1
        else:
            c[j] = problem.fixed[frame, j]
    return close(T, problem, c, work, closing)


@bare
def _descend(T, problem, frame, settings, c, work, closing):
    """Take damped Newton steps from c in place.

    Poses and gaps in `work` and `closing` are those of c, as `close` has left them, before and
    afterwards. Returns whether c has converged (see `solve_poses`), the number of steps, and the
    cost of all tasks and the posture.
    """
    trial = work.trial
    damping = 0.0
    cost = gradient_and_hessian(T, problem, frame, c, work)
    stiffness = settings.posture_weight * mean_curvature(problem, work)
    cost += posture_cost(problem, frame, c, stiffness)
    for count in range(1, settings.max_steps + 1):
        _add_posture(problem, frame, c, stiffness, work)
        hold_variables(T, problem, c, work, closing)
        accepted = False
        reached = cost
        while not accepted and damping < MAX_DAMPING:
            size = newton_step(problem, work, closing, c, damping)
            if size < 0.0:
                damping = max(damping * 10.0, FIRST_DAMPING)
                continue
            closed = _try_step(T, problem, c, work, closing)
            if closed and _is_last(size, damping, settings.tolerance):
                _copy(trial, c)
                return True, count, cost
            reached = np.inf
            if closed:
                reached = sum_of_costs(problem.tasks, trial, frame, work) + posture_cost(
                    problem, frame, trial, stiffness
                )
            if reached <= cost:
                accepted = True
                damping = damping * 0.1 if damping > 1e-6 else 0.0
            else:
                damping = max(damping * 10.0, FIRST_DAMPING)
                ties_at(T, problem, c, work, closing)
        if not accepted:
            return False, count, cost
        _copy(trial, c)
        flat = cost - reached <= ROUNDING * cost
        cost = gradient_and_hessian(T, problem, frame, c, work)
        cost += posture_cost(problem, frame, c, stiffness)
        if flat:
            return True, count, cost
    return False, settings.max_steps, cost


@bare
def _add_posture(problem, frame, c, stiffness, work):
    """Add half of `posture_cost` to gradient and Hessian."""
    free = problem.free
    posture = row_of(problem.posture, frame)
    pull = row_of(problem.pull, frame)
    for i in range(free.shape[0]):
        j = free[i]
        weight = (stiffness + problem.pull[pull, j]) / problem.unit[j] ** 2
        work.g[j] += weight * (c[j] - problem.posture[posture, j])
        work.H[j, j] += weight


@bare
def _try_step(T, problem, c, work, closing):
    """Step from c to `work.trial` and close the loops there; returns whether they are closed."""
    _copy(c, work.trial)
    for i in range(problem.free.shape[0]):
        work.trial[problem.free[i]] += work.step[i]
    return close(T, problem, work.trial, work, closing)


@bare
def _is_last(size, damping, tolerance):
    """Return whether a step of a size, in units, leaves an error below the tolerance.

    An undamped Newton step of size s leaves an error of the order of s^2.
    """
    return size <= tolerance or (damping == 0.0 and size * size <= 0.01 * tolerance)


@bare
def posture_cost(problem, frame, c, stiffness):
    """Cost of the pull towards the posture, which determines what no task shows."""
    posture = row_of(problem.posture, frame)
    pull = row_of(problem.pull, frame)
    total = 0.0
    for j in problem.free:
        away = (c[j] - problem.posture[posture, j]) / problem.unit[j]
        total += (stiffness + problem.pull[pull, j]) * away**2
    return total


@bare
def newton_step(problem, work, closing, c, damping):
    """Find the damped Newton step of the free coordinates along the loops' ties.

    It is left in `work.step`. Coordinates of `work.held` stay where they are; those that would
    leave their bounds are stopped there and the rest is solved again. Returns the largest entry of
    the step, in units, or -1 where the damped Hessian is not positive definite along the ties.
    """
    free = problem.free
    L = work.L
    step = work.step
    stopped = work.stopped
    index = work.solved
    n = problem.free.shape[0]
    for i in range(n):
        step[i] = 0.0
        stopped[i] = work.held[i]
    while True:
        size = reduced_system(problem, work, closing, c, damping)
        if not solve_in_place(L, size):
            return -1.0
        for a in range(size):
            step[index[a]] = L[size, a]
        close_step(work, closing, size)
        left = False
        for i in range(n):
            reached = c[free[i]] + step[i]
            if not stopped[i] and (reached < problem.lower[i] or reached > problem.upper[i]):
                step[i] = (
                    problem.lower[i] if reached < problem.lower[i] else problem.upper[i]
                ) - c[free[i]]
                stopped[i] = True
                left = True
        if not left:
            break
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(step[i]) / problem.unit[free[i]])
    return largest


@bare
def reduced_system(problem, work, closing, c, damping):
    """Write the equations of the independent free coordinates that are not stopped into `work.L`.

    They fill the rows up to their number, which is returned; their places in `free` are in
    `work.solved`. With the basis B of the directions along the ties (a column for each independent
    variable; the identity without loops) and the step s of the others, L = B^T (H + damping D) B
    and the row behind it is -B^T (g + (H + damping D) s).
    """
    if closing is None:
        return _open_system(problem, work, damping)
    find_late(problem, c, 0.0, work.late)
    closing.rank[0] = eliminate(problem.free, closing, work.stopped, work.late)
    size = 0
    for i in range(problem.free.shape[0]):
        if not work.stopped[i] and not closing.dependent[i]:
            work.solved[size] = i
            size += 1
    _known_step(problem, work, closing, size)
    _project_columns(problem, work, closing, size, damping)
    _project_rows(problem, work, closing, size)
    return size


@bare
def _open_system(problem, work, damping):
    """Write `reduced_system` of a model without loops; returns its size."""
    free = problem.free
    H = work.H
    L = work.L
    index = work.solved
    size = 0
    for i in range(free.shape[0]):
        if not work.stopped[i]:
            index[size] = i
            size += 1
    for a in range(size):
        i = free[index[a]]
        for b in range(a + 1):
            L[a, b] = H[i, free[index[b]]]
        L[a, a] += damping * work.D[i]
        right = -work.g[i]
        for j in range(free.shape[0]):
            if work.stopped[j] and work.step[j] != 0.0:
                right -= H[i, free[j]] * work.step[j]
        L[size, a] = right
    return size


@bare
def _known_step(problem, work, closing, size):
    """Fill the part s of the step that is known before the system is solved.

    Bounded variables go to their bounds, dependent ones close the gap for them, those that are
    solved for are 0.
    """
    A = closing.A
    n = problem.free.shape[0]
    for row in range(closing.rank[0]):
        total = A[row, n]
        for i in range(n):
            if work.stopped[i]:
                total -= A[row, i] * work.step[i]
        work.step[closing.taken[row]] = total
    for a in range(size):
        work.step[work.solved[a]] = 0.0


@bare
def _project_columns(problem, work, closing, size, damping):
    """Fill Z = (H + damping D) B; a column of B is 1 at its variable and -A at dependent ones."""
    free = problem.free
    H = work.H
    D = work.D
    for i in range(free.shape[0]):
        for a in range(size):
            j = work.solved[a]
            total = H[free[i], free[j]] + (damping * D[free[i]] if i == j else 0.0)
            for row in range(closing.rank[0]):
                d = closing.taken[row]
                entry = H[free[i], free[d]] + (damping * D[free[i]] if i == d else 0.0)
                total -= entry * closing.A[row, j]
            closing.Z[i, a] = total


@bare
def _project_rows(problem, work, closing, size):
    """Fill L = B^T Z, lower triangle, and the row -B^T g - Z^T s behind it."""
    free = problem.free
    A = closing.A
    Z = closing.Z
    taken = closing.taken
    rank = closing.rank[0]
    for a in range(size):
        i = work.solved[a]
        for b in range(a + 1):
            total = Z[i, b]
            for row in range(rank):
                total -= A[row, i] * Z[taken[row], b]
            work.L[a, b] = total
        right = -work.g[free[i]]
        for row in range(rank):
            right += A[row, i] * work.g[free[taken[row]]]
        for j in range(free.shape[0]):
            if work.step[j] != 0.0:
                right -= Z[j, a] * work.step[j]
        work.L[size, a] = right


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
