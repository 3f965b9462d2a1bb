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
from myomorph.core.motion.tasks.task import HalfCost, add_gradient, add_pair
from myomorph.core.rigid.coordinates import Ints, couple, fold_dependents, gather_dependents
from myomorph.core.rigid.kernels import bare, in_place, inner
from myomorph.core.rigid.kinematics import PoseArrays, body_poses
from myomorph.core.rigid.tree import ROTATION, Tree
from myomorph.core.rigid.vectors import cross, dot, matrix, minus, plus, times, turned, vector

CLOSED = 1e-12  # A loop is closed when no gap is larger [m]
PIVOT = 1e-8
"""Least pivot of the elimination relative to the largest entry: what is smaller is no constraint of
its own.
"""

TO_CLOSE = 40  # Newton steps that may close the loops
# A variable lies at a bound that is no farther than this share of 1 plus its size.
AT_BOUND = 1e-12


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
def ties_at(T, problem, c, work, closing):
    """Poses at c, the gaps of all ties [m] and their derivatives. Returns the largest gap."""
    couple(T, c)
    body_poses(T, c, PoseArrays(R=work.R, p=work.p, w=work.w, o=work.o, dphi=work.dphi))
    if closing is None:
        return 0.0
    ties = problem.ties
    for i in range(closing.G.shape[0]):
        for j in range(closing.G.shape[1]):
            closing.G[i, j] = 0.0
    largest = 0.0
    for i in range(ties.body_1.shape[0]):
        x1 = _end(work, ties.body_1[i], ties.point_1, i)
        x2 = _end(work, ties.body_2[i], ties.point_2, i)
        gap = minus(x2, x1)
        for d in range(3):
            closing.e[3 * i + d] = gap[d]
            largest = max(largest, abs(gap[d]))
        b1 = ties.body_1[i]
        b2 = ties.body_2[i]
        while b1 != b2:
            # A parent has the smaller number: the larger of both cannot be an ancestor of the
            # other.
            if b2 > b1:
                _add_slopes(T, work, closing.G, i, b2, x2, 1.0)
                b2 = T.parent[b2]
            else:
                _add_slopes(T, work, closing.G, i, b1, x1, -1.0)
                b1 = T.parent[b1]
    gather_dependents(T, c, closing.G)
    return largest


@bare
def _end(work, body, points, i):
    """Position in ground of a tie's end: row i of `points` (ties, 3), in a body [m]."""
    return plus(vector(work.p, body), turned(matrix(work.R, body), vector(points, i)))


@bare
def _add_slopes(T, work, G, tie, body, x, sign):
    """Add how the axes of one body move a point.

    Parameters
    ----------
    T : arrays of the tree
    work : with the poses
    G : (3 ties, coordinates) the rows of the tie are added to [m/rad or 1]
    tie : number of it
    body : number of the body
    x : the point, in ground [m]
    sign : 1, or -1 for what is subtracted
    """
    for axis in range(T.axis_start[body], T.axis_start[body + 1]):
        moved = _moved(T, work, axis, x)
        for s in range(2):
            j = T.axis_coordinate[axis, s]
            if j >= 0:
                for d in range(3):
                    G[3 * tie + d, j] += sign * work.dphi[axis, s] * moved[d]


@bare
def _moved(T, work, axis, x):
    """Velocity of a point x in ground [m] as an axis moves at rate 1."""
    u = vector(work.w, axis)
    if T.axis_kind[axis] == ROTATION:
        return cross(u, minus(x, vector(work.o, axis)))
    return u


@bare
def close(T, problem, c, work, closing):
    """Close the loops inside the bounds, by Newton steps of few variables from c in place.

    Returns whether they are closed.
    """
    if closing is None:
        couple(T, c)
        body_poses(T, c, PoseArrays(R=work.R, p=work.p, w=work.w, o=work.o, dphi=work.dphi))
        return True
    for i in range(problem.free.shape[0]):
        work.stopped[i] = False
    gap = ties_at(T, problem, c, work, closing)
    for _ in range(TO_CLOSE):
        if gap <= CLOSED:
            return True
        find_late(problem, c, 0.0, work.late)
        rank = eliminate(problem.free, closing, work.stopped, work.late)
        if rank == 0:
            return False
        reached = _step_together(T, problem, c, work, closing, gap, rank)
        if not reached < gap:
            return gap <= 1e3 * CLOSED
        gap = reached
    return gap <= CLOSED


@bare
def find_late(problem, c, slack, late):
    """Flag the variables at a bound: others are to close the loops.

    Parameters
    ----------
    problem : `PoseProblem`
    c : (coordinates,) [rad or m]
    slack : relative distance at which a variable still counts as at its bound
    late : (free,) filled
    """
    free = problem.free
    for i in range(free.shape[0]):
        room = slack * (1.0 + abs(c[free[i]]))
        late[i] = c[free[i]] <= problem.lower[i] + room or c[free[i]] >= problem.upper[i] - room


@bare
def _step_together(T, problem, c, work, closing, gap, rank):
    """Move c along the step that would close the gaps, shortened until the largest one falls.

    No variable moves by more than 0.5 at once, and none beyond its bounds. Returns the largest gap
    that is reached [m].
    """
    free = problem.free
    A = closing.A
    variables = free.shape[0]
    for j in range(c.shape[0]):
        closing.before[j] = c[j]
    largest = 0.0
    for row in range(rank):
        largest = max(largest, abs(A[row, variables]))
    share = min(1.0, 0.5 / largest) if largest > 0.0 else 1.0
    reached = gap
    while share > 1e-3:
        for row in range(rank):
            i = closing.taken[row]
            moved = closing.before[free[i]] + share * A[row, variables]
            c[free[i]] = min(max(moved, problem.lower[i]), problem.upper[i])
        reached = ties_at(T, problem, c, work, closing)
        if reached < gap:
            break
        share *= 0.5
    return reached


@bare
def eliminate(free, closing, held, late):
    """Eliminate G d = -e over the free variables after Gauss and Jordan, with full pivoting.

    Variables that are `held` are not taken, those that come `late` only when no other is left.
    Afterwards d[taken[row]] = A[row, variables] - sum over the others of A[row, i] d[i]. Returns
    the rank.
    """
    A = closing.A
    rows = A.shape[0]
    for i in range(free.shape[0]):
        closing.dependent[i] = False
    least = PIVOT * _write_equations(free, closing.G, closing.e, A)
    rank = 0
    for attempt in range(2):
        while rank < rows:
            row, column = _find_pivot(closing, held, late, rank, attempt == 1, least)
            if row < 0:
                break
            for t in range(A.shape[1]):
                A[rank, t], A[row, t] = A[row, t], A[rank, t]
            _clear_column(A, rank, column)
            closing.taken[rank] = column
            closing.dependent[column] = True
            rank += 1
    return rank


@bare
def _write_equations(free, G, e, A):
    """Write G d = -e over the free variables, and the identity behind it, into A.

    Returns the largest entry of G.
    """
    variables = free.shape[0]
    largest = 0.0
    for r in range(A.shape[0]):
        for i in range(variables):
            A[r, i] = G[r, free[i]]
            largest = max(largest, abs(A[r, i]))
        A[r, variables] = -e[r]
        for s in range(A.shape[0]):
            A[r, variables + 1 + s] = 1.0 if r == s else 0.0
    return largest


@bare
def _find_pivot(closing, held, late, rank, of_late, least):
    """Find the largest entry of the rows that are left, in a column that may be taken.

    Parameters
    ----------
    closing : with the equations, of which the first `rank` are done
    held, late : (free,) of `eliminate`
    rank : number of rows that are done
    of_late : whether late variables are taken, or the others
    least : what is not larger is no pivot

    Returns
    -------
    row and column, -1 where there is no pivot
    """
    A = closing.A
    best = least
    row = -1
    column = -1
    for i in range(closing.dependent.shape[0]):
        if not held[i] and late[i] == of_late and not closing.dependent[i]:
            for r in range(rank, A.shape[0]):
                if abs(A[r, i]) > best:
                    best = abs(A[r, i])
                    row = r
                    column = i
    return row, column


@bare
def _clear_column(A, rank, column):
    """Scale row `rank` of A to 1 in a column, and subtract it from the others to 0 there."""
    pivot = 1.0 / A[rank, column]
    for t in range(A.shape[1]):
        A[rank, t] *= pivot
    for r in range(A.shape[0]):
        factor = A[r, column]
        if r != rank and factor != 0.0:
            for t in range(A.shape[1]):
                A[r, t] -= factor * A[rank, t]


@bare
def hold_variables(T, problem, c, work, closing):
    """Fill `work.held`: variables that lie at a bound and are pushed outwards.

    Loops add their curvature to work.H.
    """
    if closing is None:
        free = problem.free
        g = work.g
        for i in range(free.shape[0]):
            slack = AT_BOUND * (1.0 + abs(c[free[i]]))
            low = c[free[i]] <= problem.lower[i] + slack
            high = c[free[i]] >= problem.upper[i] - slack
            work.held[i] = (low and g[free[i]] > 0.0) or (high and g[free[i]] < 0.0)
    else:
        multipliers(T, problem, c, work, closing)


@bare
def multipliers(T, problem, c, work, closing):
    """Find the multipliers of the ties at c, and add their curvature to work.H.

    Fills `work.held`: variables that a bound keeps from moving outwards.
    """
    free = problem.free
    variables = problem.free.shape[0]
    push = closing.push
    held = work.held
    late = work.late
    for i in range(variables):
        held[i] = False
    find_late(problem, c, AT_BOUND, late)
    rank = eliminate(free, closing, held, late)
    for r in range(push.shape[0]):
        push[r] = 0.0
        for row in range(rank):
            push[r] -= closing.A[row, variables + 1 + r] * work.g[free[closing.taken[row]]]
    for i in range(variables):
        if late[i] and not closing.dependent[i]:
            slope = work.g[free[i]]
            for r in range(push.shape[0]):
                slope += push[r] * closing.G[r, free[i]]
            low = c[free[i]] <= problem.lower[i] + AT_BOUND * (1.0 + abs(c[free[i]]))
            held[i] = slope > 0.0 if low else slope < 0.0
    tie_curvature(T, problem.ties, c, work, closing)
    for i in free:
        for j in free:
            work.H[i, j] += closing.H[i, j]


@in_place
def tie_curvature(T, ties, c, work, closing):
    """Second derivatives of push . gaps in the independent coordinates, into closing.H."""
    half = HalfCost(H=closing.H, g=closing.g, D=closing.D)
    for i in range(c.shape[0]):
        half.g[i] = half.D[i] = 0.0
        for j in range(c.shape[0]):
            half.H[i, j] = 0.0
    for i in range(ties.body_1.shape[0]):
        push = (closing.push[3 * i], closing.push[3 * i + 1], closing.push[3 * i + 2])
        top = _common_body(T, ties.body_1[i], ties.body_2[i])
        x1 = _end(work, ties.body_1[i], ties.point_1, i)
        x2 = _end(work, ties.body_2[i], ties.point_2, i)
        _add_chain(T, work, half, ties.body_1[i], top, x1, times(-1.0, push))
        _add_chain(T, work, half, ties.body_2[i], top, x2, push)
    for i in range(c.shape[0]):
        for j in range(i):
            half.H[j, i] = half.H[i, j]
    fold_dependents(T, c, half.H, half.g, half.D)


@bare
def _common_body(T, first, second):
    """Find the last body that two bodies both hang from; a parent has the smaller number."""
    while first != second:
        if second > first:
            second = T.parent[second]
        else:
            first = T.parent[first]
    return first


@bare
def _add_chain(T, work, half, body, top, x, force):
    """Add the curvature of all axes between a body and the body `top` it hangs from.

    It is that of a force on the body at the point x [m] in ground.
    """
    b = body
    while b != top:
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            _add_curvature(T, work, half, axis, b, top, x, force)
        b = T.parent[b]


@bare
def _add_curvature(T, work, half, axis, b, top, x, force):
    """Add the curvature of an axis of body b with all axes between it and the body `top`."""
    moved = _moved(T, work, axis, x)
    # `gradient_and_hessian` has left the second derivatives of the axes' motions.
    add_gradient(T, work, half, axis, dot(force, moved))
    turning = cross(moved, force)
    h = b
    nearer = axis
    while h != top:
        while nearer >= T.axis_start[h]:
            if T.axis_kind[nearer] == ROTATION:
                curved = dot(vector(work.w, nearer), turning)
                add_pair(T, work, half, (axis, nearer), (0.0, curved))
            nearer -= 1
        h = T.parent[h]
        nearer = T.axis_start[h + 1] - 1
