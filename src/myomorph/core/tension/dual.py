"""The separable problem over frames: least effort in balance, by a semismooth Newton on its dual.

    minimise    sum_i w_i |x_i - t_i|^p_i + k_i dist(x_i, [l_i, h_i])^2
    subject to  A x = b,  lower <= x <= upper

For given multipliers y every x_i has a closed form. With s = A^T y and where nothing pulls it
(k_i = 0) it is

    x_i = clip(t_i + sign(s_i) (|s_i| / (p_i w_i))^(1/(p_i - 1))),

so stationarity and bounds hold exactly and only the balance b - A x is left to solve for: it is the
gradient of the concave dual. Its generalized Jacobian is A D A^T with a diagonal D = dx/ds, of the
size of the coordinates and not of the muscles, and sparse where muscles cross few joints (Qi and
Sun 1993; Hintermueller, Ito and Kunisch 2002 for the p = 2 case).

The first variables may lie under a common bound besides, which costs something (`response.py`).

A tiny slack eps y in the balance makes the solution exist always: where no activations can
balance the torques it is, nearly, the one that misses them least, and the frame says so.

A frame's solution in steps: `_respond` finds x at the multipliers, `_misfits` what of the balance
is left, `_direction` the Newton step of the multipliers, `_step` how far to go along it
(`_newton`). `_solve_frame` tries slacks, `solve_separable` goes from frame to frame, and
`_solve_linked` repeats that where frames are linked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import bare, in_place, inner, kernel
from myomorph.core.tension.envelope import add_outer, back_substitute, factorize
from myomorph.core.tension.response import ceiling, common_motion, response
from myomorph.core.tension.separable import SeparableFrame

OPTIMAL = 0
INFEASIBLE = 1
STALLED = 2
MISSING = 3
NOT_DETERMINED = 4
STATUS_NAMES = ("optimal", "infeasible", "not converged", "missing input", "not determined")
TOLERANCE = 1e-9
"""Equilibrium residual, relative to 1 + max |b|, at which a frame is solved."""
SETTLED = 1e-3
"""The same of a frame that cannot balance, relative to what it misses."""
PATIENCE = 25
"""Passes over linked frames without a new least change, after which over-relaxation ends."""
SLACKS = (1e-16, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12, 1e-15)
"""Slack per multiplier, relative to the row's stiffness: first try, then from large to small."""
FIRST_STEPS = 40
MAX_STEPS = 150
"""Newton steps at most with the first slack, and with each of the others."""


class Point(NamedTuple):
    """Where the solver of a frame stands.

    Attributes
    ----------
    x : (variables,)
    y : (rows,) multipliers
    """

    x: Array
    y: Array


class Line(NamedTuple):
    """The dual along a direction z of the multipliers, y + t z.

    Attributes
    ----------
    s : (variables,) A^T y
    ds : (variables,) A^T z
    constant, linear : slope of all that x has no part in, constant - t linear
    """

    s: Array
    ds: Array
    constant: float
    linear: float


class Room(NamedTuple):
    """Arrays that a solver works in.

    Attributes
    ----------
    slope : (variables,) D = dx/ds
    s, ds : (variables,) A^T y, and what a step adds to it
    slack : (rows,) eps
    floor : (rows,) least pivots
    residual : (rows,) b - A x
    z : (rows,) gradient b - A x - eps y of the dual, then the Newton step of y
    kept : (rows,) multipliers of the slack before
    together : (rows,) generalized force of all variables on the common bound
    penalty : (3, variables) l, h and k of a frame that is drawn to its neighbours
    M : (rows, rows) A D A^T + eps, then its factor
    """

    slope: Array
    s: Array
    ds: Array
    slack: Array
    floor: Array
    residual: Array
    z: Array
    kept: Array
    together: Array
    penalty: Array
    M: Array


@inner
def _new_room(variables, rows):
    """Make room for a problem of so many variables and rows."""
    return Room(
        slope=np.zeros(variables),
        s=np.zeros(variables),
        ds=np.zeros(variables),
        slack=np.zeros(rows),
        floor=np.zeros(rows),
        residual=np.zeros(rows),
        z=np.zeros(rows),
        kept=np.zeros(rows),
        together=np.zeros(rows),
        penalty=np.zeros((3, variables)),
        M=np.zeros((rows, rows)),
    )


@bare
def _assemble(shared, values, room):
    """Fill M = A diag(slope) A^T + diag(slack) inside its envelope.

    Parameters
    ----------
    shared : `Separable`
    values : (entries,) of A
    room : `Room`
    """
    slope = room.slope
    M = room.M
    for i in range(M.shape[0]):
        for j in range(shared.first[i], i):
            M[i, j] = 0.0
        M[i, i] = room.slack[i]
    for i in range(slope.shape[0]):
        if slope[i] == 0.0:
            continue
        for a in range(shared.start[i], shared.start[i + 1]):
            left = slope[i] * values[a]
            if left == 0.0:
                continue
            row = shared.row[a]
            for b in range(shared.start[i], a + 1):
                M[row, shared.row[b]] += left * values[b]


@bare
def _variable(shared, frame, i, roof, s):
    """Value of a variable at s = (A^T y)_i, and its slope there.

    Parameters
    ----------
    shared, frame : `Separable`, `SeparableFrame`
    i : the variable
    roof : the common bound of the first variables
    s : its reduced multiplier
    """
    top = min(shared.upper[i], roof) if i < shared.capped else shared.upper[i]
    return response(
        shared.weight[i],
        shared.exponent[i],
        shared.lower[i],
        top,
        frame.low[i],
        frame.high[i],
        frame.pull[i],
        frame.targets[i],
        s,
    )


@bare
def _ascent(shared, frame, line, t):
    """Slope of the dual along a direction at step t; it never grows with t.

    constant - t linear - sum_i x_i(s_i + t ds_i) ds_i

    Parameters
    ----------
    shared, frame, line : `Separable`, `SeparableFrame`, `Line`
    t : the step
    """
    roof = ceiling(shared, frame, line.s, line.ds, t)
    total = line.constant - t * line.linear
    for i in range(line.s.shape[0]):
        if line.ds[i] != 0.0:
            x, _ = _variable(shared, frame, i, roof, line.s[i] + t * line.ds[i])
            total -= x * line.ds[i]
    return total


@bare
def _step(shared, frame, line):
    """Find the step that maximises the dual along a direction.

    It ends where the slope has fallen to a tenth of what it was.

    Parameters
    ----------
    shared, frame, line : as of `_ascent`
    """
    t = 0.0
    low = 0.0
    high = np.inf
    enough = 0.0
    # One call of `_ascent` in the code: it is inlined, and each copy takes time to compile.
    for trial in range(62):
        now = _ascent(shared, frame, line, t)
        if trial == 0:
            enough = 0.1 * now
            t = 1.0
            continue
        if abs(now) <= enough or t > 1e6:
            break
        if now > 0.0:
            low = t
            t = 4.0 * t if high == np.inf else 0.5 * (low + high)
        else:
            high = t
            t = 0.1 * t if low == 0.0 else 0.5 * (low + high)
    return t


@bare
def _multiply_transposed(shared, values, y, s):
    """Fill s with A^T y.

    Parameters
    ----------
    shared : `Separable`
    values : (entries,) of A
    y, s : (rows,), (variables,)
    """
    for i in range(s.shape[0]):
        s[i] = 0.0
        for a in range(shared.start[i], shared.start[i + 1]):
            s[i] += values[a] * y[shared.row[a]]


@bare
def _free_stiffness(shared, values, slope, diagonal):
    """Diagonal of A D A^T with no variable on a bound, at |x| = 1; `slope` gets that D.

    Parameters
    ----------
    shared : `Separable`
    values : (entries,) of A
    slope, diagonal : (variables,), (rows,) filled
    """
    for j in range(diagonal.shape[0]):
        diagonal[j] = 0.0
    for i in range(slope.shape[0]):
        p = shared.exponent[i]
        slope[i] = 1.0 / (p * (p - 1.0) * shared.weight[i])
        for a in range(shared.start[i], shared.start[i + 1]):
            diagonal[shared.row[a]] += slope[i] * values[a] * values[a]


@bare
def _scale(right):
    """Measure of the right-hand side b: 1 + max |b|."""
    scale = 1.0
    for j in range(right.shape[0]):
        scale = max(scale, 1.0 + abs(right[j]))
    return scale


@bare
def _set_slack(shared, values, relative, room):
    """Fill slack and floor of the pivots, and the slope of a problem without bounds.

    Parameters
    ----------
    shared : `Separable`
    values : (entries,) of A
    relative : slack per multiplier, relative to the row's stiffness
    room : `Room`
    """
    slack = room.slack
    _free_stiffness(shared, values, room.slope, slack)
    for j in range(slack.shape[0]):
        slack[j] = relative * max(slack[j], 1.0)
        room.floor[j] = 10.0 * slack[j]


@bare
def _respond(shared, frame, x, room, with_slope):
    """Fill x at the multipliers s = A^T y, and the residual b - A x.

    Parameters
    ----------
    shared, frame : `Separable`, `SeparableFrame`
    x : (variables,) filled
    room : `Room`
    with_slope : whether D = dx/ds is filled, too

    Returns
    -------
    the common bound of the first variables
    """
    residual = room.residual
    _copy(frame.right, residual)
    roof = ceiling(shared, frame, room.s, room.s, 0.0)
    for i in range(x.shape[0]):
        x[i], slope = _variable(shared, frame, i, roof, room.s[i])
        if with_slope:
            room.slope[i] = slope
        for a in range(shared.start[i], shared.start[i + 1]):
            residual[shared.row[a]] -= frame.values[a] * x[i]
    return roof


@bare
def _misfits(y, room):
    """Fill z with the gradient of the dual, the balance less its slack.

    Parameters
    ----------
    y : (rows,) multipliers
    room : `Room`

    Returns
    -------
    max |b - A x| and max |b - A x - slack y|; infinite and NaN where the multipliers have
    overflowed
    """
    residual = room.residual
    slack = room.slack
    z = room.z
    worst = 0.0
    left = 0.0
    for j in range(z.shape[0]):
        worst = max(worst, abs(residual[j]))
        z[j] = residual[j] - slack[j] * y[j]
        # `max` ignores NaN.
        if not abs(z[j]) < np.inf:
            return np.inf, np.nan
        left = max(left, abs(z[j]))
    return worst, left


@bare
def _direction(shared, frame, roof, room):
    """Turn the gradient z into the Newton step of the multipliers, (A D A^T + eps)^-1 z.

    Parameters
    ----------
    shared, frame : `Separable`, `SeparableFrame`
    roof : the common bound
    room : `Room`
    """
    _assemble(shared, frame.values, room)
    if shared.peak > 0.0:
        curvature = common_motion(shared, frame, room.s, roof, room.together)
        if curvature > 0.0:
            add_outer(room.together, curvature, shared.first, room.M)
    factorize(room.M, shared.first, room.floor)
    back_substitute(room.M, shared.first, room.z)


@bare
def _line(shared, frame, y, room):
    """Prepare the dual along the Newton step z.

    Parameters
    ----------
    shared, frame : `Separable`, `SeparableFrame`
    y : (rows,) multipliers
    room : `Room`
    """
    right = frame.right
    slack = room.slack
    z = room.z
    constant = 0.0
    linear = 0.0
    for j in range(z.shape[0]):
        constant += (right[j] - slack[j] * y[j]) * z[j]
        linear += slack[j] * z[j] * z[j]
    _multiply_transposed(shared, frame.values, z, room.ds)
    return Line(s=room.s, ds=room.ds, constant=constant, linear=linear)


@bare
def _move(y, t, room):
    """Step the multipliers, and with them s = A^T y.

    Parameters
    ----------
    y : (rows,) multipliers
    t : the step along z
    room : `Room`
    """
    for j in range(y.shape[0]):
        y[j] += t * room.z[j]
    for i in range(room.s.shape[0]):
        room.s[i] += t * room.ds[i]


@in_place
def _newton(shared, frame, point, room, relative, max_steps, cold):
    """Maximise the dual of one frame with a slack; the multipliers are where it begins and ends.

    Parameters
    ----------
    shared, frame, point, room : `Separable`, `SeparableFrame`, `Point`, `Room`
    relative : slack per multiplier, relative to the row's stiffness
    max_steps : maximum number of steps; 0 only finds the x of the multipliers
    cold : whether the first step is that of the problem without bounds

    Returns
    -------
    max |b - A x|, max |b - A x - slack y| and the number of steps; infinite and NaN where the
    multipliers have overflowed
    """
    _set_slack(shared, frame.values, relative, room)
    enough = TOLERANCE * _scale(frame.right)
    _multiply_transposed(shared, frame.values, point.y, room.s)
    iteration = 0
    checked = False
    before = 0.0
    while True:
        roof = _respond(shared, frame, point.x, room, iteration > 0 or not cold)
        worst, left = _misfits(point.y, room)
        if not left < np.inf:
            return worst, left, iteration
        if checked and left <= SETTLED * worst:
            return worst, before, iteration
        if left <= enough or iteration == max_steps:
            if checked or iteration == 0 or worst <= enough:
                return worst, left, iteration
            # s is updated step by step: multipliers that were huge for a while leave rounding
            # errors in it.
            checked = True
            before = left
            _multiply_transposed(shared, frame.values, point.y, room.s)
            continue
        checked = False
        iteration += 1
        _direction(shared, frame, roof, room)
        line = _line(shared, frame, point.y, room)
        _move(point.y, _step(shared, frame, line), room)


@bare
def _unknown(frame):
    """Tell frames that lack input: 0 where all is finite that the solution needs, else NaN.

    A difference of a number from itself is 0 unless it is infinite or NaN; a k of 0 leaves l and h
    unread.

    Parameters
    ----------
    frame : `SeparableFrame`
    """
    values = frame.values
    right = frame.right
    targets = frame.targets
    low = frame.low
    high = frame.high
    pull = frame.pull
    unknown = 0.0
    for a in range(values.shape[0]):
        unknown += values[a] - values[a]
    for i in range(targets.shape[0]):
        unknown += targets[i] - targets[i]
        if pull[i] > 0.0:
            unknown += low[i] - low[i] + (high[i] - high[i])
        else:
            unknown += pull[i] - pull[i]
    for j in range(right.shape[0]):
        unknown += right[j] - right[j]
    return unknown


@bare
def _is_zero(values):
    """Whether all values are 0, as of multipliers where a start is cold."""
    zero = True
    for j in range(values.shape[0]):
        if values[j] != 0.0:
            zero = False
    return zero


@bare
def _fill(values, value):
    """Set all values."""
    for j in range(values.shape[0]):
        values[j] = value


@bare
def _copy(values, target):
    """Copy values into a target."""
    for j in range(values.shape[0]):
        target[j] = values[j]


@bare
def _solve_frame(shared, frame, point, room, accepted):
    """Solve one frame from the multipliers that the point has.

    A frame that the plain iteration does not solve is solved again with a large slack that then
    shrinks. Where no slack can be small, the frame is infeasible and x misses the balance least.

    Parameters
    ----------
    shared, frame, point, room : as of `_newton`
    accepted : equilibrium residual at which the frame is optimal, relative to 1 + max |b|

    Returns
    -------
    equilibrium residual, number of steps and status
    """
    if _unknown(frame) != 0.0:
        _fill(point.x, np.nan)
        _fill(point.y, np.nan)
        return np.nan, 0, MISSING

    scale = _scale(frame.right)
    cold = _is_zero(point.y)
    worst = np.inf
    before = np.inf
    steps = 0
    stuck = False
    index = 0
    max_steps = FIRST_STEPS
    while index < len(SLACKS):
        worst, left, more = _newton(shared, frame, point, room, SLACKS[index], max_steps, cold)
        steps += more
        if max_steps == 0:
            break
        solved = left <= TOLERANCE * scale
        if index == 0 and solved:
            stuck = True
            break
        settled = solved or left <= SETTLED * worst
        cold = index == 0
        if index > 1 and not settled:
            # The last slack that could be solved for is the answer: x again, without a step.
            index = index - 1
            max_steps = 0
            _copy(room.kept, point.y)
            continue
        if index == 0 or not worst < np.inf:
            _fill(point.y, 0.0)
        _copy(point.y, room.kept)
        if index > 0:
            # Less slack, but the same residual: nothing is left that could take it.
            stuck = settled and worst > 0.5 * before
            before = worst
        index = index + 1
        max_steps = MAX_STEPS
    if worst <= accepted * scale:
        return worst, steps, OPTIMAL
    return worst, steps, INFEASIBLE if stuck else STALLED


@bare
def _draw(shared, links, status, number, own, penalty):
    """Fill the interval penalties of a frame: its own, and the pull of neighbouring frames.

    A linked variable x of amount scale x is drawn to the amounts a_n of the frames n beside it,

        sum_n k_n (scale x - a_n)^2 = (sum_n k_n) scale^2 (x - m)^2 + constant,
        m = sum_n k_n a_n / (scale sum_n k_n)

    Parameters
    ----------
    shared, links : `Separable`, `FrameLinks`
    status : (frames,)
    number : of the frame
    own : (3, variables) l, h and k of its own
    penalty : (3, variables) filled
    """
    for i in range(penalty.shape[1]):
        for index in range(3):
            penalty[index, i] = own[index, i]
    for g in range(links.scale.shape[1]):
        scale = links.scale[number, g]
        pull = 0.0
        weighted_sum = 0.0
        for neighbour in (number - 1, number + 1):
            if (
                0 <= neighbour < status.shape[0]
                and links.scale[neighbour, g] > 0.0
                and status[neighbour] == OPTIMAL
            ):
                stiffness = links.stiffness[min(number, neighbour)]
                stiffness *= shared.weight[links.first + g]
                pull += stiffness
                weighted_sum += stiffness * links.amount[neighbour, g]
        if scale > 0.0 and pull > 0.0:
            middle = weighted_sum / (pull * scale)
            penalty[0, links.first + g] = middle
            penalty[1, links.first + g] = middle
            penalty[2, links.first + g] = pull * scale * scale


@inner
def _frame_of(frames, number, penalty):
    """Take one frame out of all.

    Parameters
    ----------
    frames : `SeparableFrames`
    number : of the frame
    penalty : (3, variables) its interval penalties
    """
    return SeparableFrame(
        values=frames.values[number],
        right=frames.right[number],
        targets=frames.targets[min(number, frames.targets.shape[0] - 1)],
        low=penalty[0],
        high=penalty[1],
        pull=penalty[2],
    )


@bare
def _relax(shared, links, number, x, over):
    """Move the amounts of a frame, as its neighbours see them, to its solution and beyond.

    Parameters
    ----------
    shared, links : `Separable`, `FrameLinks`
    number : of the frame
    x : (variables,) its solution
    over : factor of over-relaxation

    Returns
    -------
    largest change of an amount
    """
    max_change = 0.0
    for g in range(links.scale.shape[1]):
        change = links.scale[number, g] * x[links.first + g] - links.amount[number, g]
        max_change = max(max_change, abs(change))
        relaxed = links.amount[number, g] + over * change
        # Projected (Cryer 1971): what is beyond a bound of 0 would be handed round for ever.
        bounded = shared.lower[links.first + g] == 0.0
        links.amount[number, g] = max(relaxed, 0.0) if bounded else relaxed
    return max_change


@bare
def _accepted(shared):
    """Equilibrium residual at which a frame is optimal, relative to 1 + max |b|.

    With p > 2 the multipliers of a variable near 0 fall under the rounding of the others.
    """
    steepest = 0.0
    for i in range(shared.exponent.shape[0]):
        steepest = max(steepest, shared.exponent[i])
    return 10.0 * TOLERANCE if steepest <= 2.0 else 1e-6


@bare
def _keep_warm(y, status, warm):
    """Keep the multipliers of a frame for the next one: 0 where they are no optimum's.

    Parameters
    ----------
    y, warm : (rows,)
    status : of the frame; one that lacks input leaves those of the frame before
    """
    if status == OPTIMAL:
        _copy(y, warm)
    elif status != MISSING:
        _fill(warm, 0.0)


@bare
def _add_drift(drift, number, moved):
    """Add to the drift of the frames beside one what it has moved.

    Parameters
    ----------
    drift : (frames,)
    number : of the frame
    moved : at most
    """
    for neighbour in (number - 1, number + 1):
        if 0 <= neighbour < drift.shape[0]:
            drift[neighbour] += moved


@inner
def _solve_one(shared, frames, number, penalty, solved, room):
    """Solve one of the frames from the multipliers that it has.

    Parameters
    ----------
    shared, frames : `Separable`, `SeparableFrames`
    number : of the frame
    penalty : (3, variables) its interval penalties
    solved : `SolvedSeparable`, filled at the frame
    room : `Room`
    """
    frame = _frame_of(frames, number, penalty)
    point = Point(x=solved.x[number], y=solved.multipliers[number])
    residual, steps, status = _solve_frame(shared, frame, point, room, _accepted(shared))
    solved.residual[number] = residual
    solved.iterations[number] += steps
    solved.status[number] = status


@inner
def _solve_linked(shared, frames, links, solved, room):
    """Solve frames again, each drawn to its neighbours, until no amount moves.

    Parameters
    ----------
    shared, frames, links : `Separable`, `SeparableFrames`, `FrameLinks`
    solved : `SolvedSeparable` of the frames by themselves, improved
    room : `Room`
    """
    count = frames.right.shape[0]
    min_change = np.inf
    min_change_sweep = 0
    over = links.over
    # How far what a frame is drawn to has moved since it was solved: where little, its solution
    # stands.
    drift = np.zeros(count)
    for sweep in range(1, links.sweeps + 1):
        moved = 0.0
        for number in range(count):
            if solved.status[number] != OPTIMAL:
                continue
            if sweep == 1 or drift[number] > 0.1 * links.tolerance:
                own = frames.penalties[min(number, frames.penalties.shape[0] - 1)]
                _draw(shared, links, solved.status, number, own, room.penalty)
                _solve_one(shared, frames, number, room.penalty, solved, room)
                drift[number] = 0.0
            max_change = _relax(shared, links, number, solved.x[number], over)
            moved = max(moved, max_change)
            _add_drift(drift, number, over * max_change)
        if moved <= links.tolerance:
            break
        # Over-relaxation that does not pay is given up: plain passes always approach the optimum.
        if moved < min_change:
            min_change = moved
            min_change_sweep = sweep
        elif sweep > min_change_sweep + PATIENCE:
            over = 1.0


@kernel
def solve_separable(shared, frames, links, warm, solved):
    """Solve frame after frame, each starting from the multipliers of the one before.

    Where frames are linked, the solution of each alone is where passes over all of them begin, each
    frame drawn to its neighbours: projected successive over-relaxation by blocks (Young 1954, Cryer
    1971) towards the joint optimum.

    Parameters
    ----------
    shared, frames, links : `Separable`, `SeparableFrames`, `FrameLinks`
    warm : (rows,) multipliers to begin with, 0 for none; afterwards those of the last frame
    solved : `SolvedSeparable`, filled
    """
    room = _new_room(solved.x.shape[1], frames.right.shape[1])
    for number in range(frames.right.shape[0]):
        penalty = frames.penalties[min(number, frames.penalties.shape[0] - 1)]
        multipliers = solved.multipliers[number]
        _copy(warm, multipliers)
        solved.iterations[number] = 0
        _solve_one(shared, frames, number, penalty, solved, room)
        _keep_warm(multipliers, solved.status[number], warm)
        _relax(shared, links, number, solved.x[number], 1.0)
    if links.scale.shape[1]:
        _solve_linked(shared, frames, links, solved, room)
