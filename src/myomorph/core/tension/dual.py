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

The first variables may lie under a common bound besides, which costs something (`separable.py`).

A tiny slack eps y in the balance makes the solution exist always: where no activations can
balance the torques it is, nearly, the one that misses them least, and the frame says so.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.kernels import in_place, inner, kernel
from myomorph.core.tension.separable import (
    add_common_motion,
    back_substitute,
    ceiling,
    factorize,
    response,
)

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


@inner
def _assemble(S, values, slope, slack, M):
    """Fill M = A diag(slope) A^T + diag(slack) inside its envelope."""
    n = M.shape[0]
    for i in range(n):
        for j in range(S.first[i], i):
            M[i, j] = 0.0
        M[i, i] = slack[i]
    for i in range(slope.shape[0]):
        if slope[i] == 0.0:
            continue
        for a in range(S.start[i], S.start[i + 1]):
            left = slope[i] * values[a]
            if left == 0.0:
                continue
            row = S.row[a]
            for b in range(S.start[i], a + 1):
                M[row, S.row[b]] += left * values[b]


@inner
def _ascent(S, targets, penalty, s, ds, t, constant, linear):
    """Slope of the dual along a direction ds at step t; it never grows with t.

    constant - t linear - sum_i x_i(s_i + t ds_i) ds_i
    """
    # Taken out of the loop: fetched inside it, each would be counted as a new reference.
    weight = S.weight
    exponent = S.exponent
    lower = S.lower
    upper = S.upper
    low = penalty[0]
    high = penalty[1]
    pull = penalty[2]
    roof = ceiling(S, targets, penalty, s, ds, t)
    total = constant - t * linear
    for i in range(s.shape[0]):
        if ds[i] != 0.0:
            top = min(upper[i], roof) if i < S.capped else upper[i]
            now = s[i] + t * ds[i]
            x, _ = response(
                weight[i], exponent[i], lower[i], top, low[i], high[i], pull[i], targets[i], now
            )
            total -= x * ds[i]
    return total


@inner
def _step(S, targets, penalty, s, ds, constant, linear):
    """Find the step that maximises the dual along a direction.

    It ends where the slope has fallen to a tenth of what it was.
    """
    t = 0.0
    low = 0.0
    high = np.inf
    enough = 0.0
    # One call of `_ascent` in the code: it is inlined, and each copy takes time to compile.
    for trial in range(62):
        now = _ascent(S, targets, penalty, s, ds, t, constant, linear)
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


@inner
def _multiply_transposed(S, A, y, s):
    """Fill s with A^T y."""
    for i in range(s.shape[0]):
        s[i] = 0.0
        for a in range(S.start[i], S.start[i + 1]):
            s[i] += A[a] * y[S.row[a]]


@inner
def _free_stiffness(S, values, slope, diagonal):
    """Diagonal of A D A^T with no variable on a bound, at |x| = 1; `slope` gets that D."""
    for j in range(diagonal.shape[0]):
        diagonal[j] = 0.0
    for i in range(slope.shape[0]):
        p = S.exponent[i]
        slope[i] = 1.0 / (p * (p - 1.0) * S.weight[i])
        for a in range(S.start[i], S.start[i + 1]):
            diagonal[S.row[a]] += slope[i] * values[a] * values[a]


@in_place
def _newton(S, A, b, targets, penalty, relative, max_steps, cold, x, y, by_variable, by_row, M):
    """Maximise the dual of one frame with a slack; y is where it begins and ends.

    Parameters
    ----------
    S : `Separable`
    A : (entries,) of the frame
    b : (rows,)
    targets : (variables,) t
    penalty : (3, variables) l, h and k
    relative : slack per multiplier, relative to the row's stiffness
    max_steps : maximum number of steps; 0 only finds the x of y
    cold : whether the first step is that of the problem without bounds
    x, y : (variables,) and (rows,) filled
    by_variable, by_row, M : room to work in, (3, variables), (5, rows) and (rows, rows)

    Returns
    -------
    max |b - A x|, max |b - A x - slack y| and the number of steps; infinite and NaN where the
    multipliers have overflowed
    """
    n = b.shape[0]
    variables = x.shape[0]
    slope = by_variable[0]
    s = by_variable[1]
    ds = by_variable[2]
    slack = by_row[0]
    floor = by_row[1]
    residual = by_row[2]
    z = by_row[3]
    weight = S.weight
    exponent = S.exponent
    lower = S.lower
    upper = S.upper
    low = penalty[0]
    high = penalty[1]
    pull = penalty[2]
    _free_stiffness(S, A, slope, slack)
    scale = 1.0
    for j in range(n):
        slack[j] = relative * max(slack[j], 1.0)
        floor[j] = 10.0 * slack[j]
        scale = max(scale, 1.0 + abs(b[j]))
    _multiply_transposed(S, A, y, s)
    iteration = 0
    checked = False
    before = 0.0
    while True:
        for j in range(n):
            residual[j] = b[j]
        roof = ceiling(S, targets, penalty, s, s, 0.0)
        for i in range(variables):
            top = min(upper[i], roof) if i < S.capped else upper[i]
            x[i], d = response(
                weight[i], exponent[i], lower[i], top, low[i], high[i], pull[i], targets[i], s[i]
            )
            # The very first step of a cold start is that of the problem without bounds.
            if iteration > 0 or not cold:
                slope[i] = d
            for a in range(S.start[i], S.start[i + 1]):
                residual[S.row[a]] -= A[a] * x[i]
        worst = 0.0
        left = 0.0
        for j in range(n):
            worst = max(worst, abs(residual[j]))
            z[j] = residual[j] - slack[j] * y[j]
            if not abs(z[j]) < np.inf:
                # The multipliers have overflowed; `max` ignores NaN.
                return np.inf, np.nan, iteration
            left = max(left, abs(z[j]))
        if checked and left <= SETTLED * worst:
            return worst, before, iteration
        if left <= TOLERANCE * scale or iteration == max_steps:
            if checked or iteration == 0 or worst <= TOLERANCE * scale:
                return worst, left, iteration
            # s is updated step by step: multipliers that were huge for a while leave rounding
            # errors in it.
            checked = True
            before = left
            _multiply_transposed(S, A, y, s)
            continue
        checked = False
        iteration += 1
        _assemble(S, A, slope, slack, M)
        if S.peak > 0.0:
            add_common_motion(S, A, targets, penalty, s, roof, M)
        factorize(M, S.first, floor)
        back_substitute(M, S.first, z)
        constant = 0.0
        linear = 0.0
        for j in range(n):
            constant += (b[j] - slack[j] * y[j]) * z[j]
            linear += slack[j] * z[j] * z[j]
        _multiply_transposed(S, A, z, ds)
        t = _step(S, targets, penalty, s, ds, constant, linear)
        for j in range(n):
            y[j] += t * z[j]
        for i in range(variables):
            s[i] += t * ds[i]


@inner
def _unknown(A, b, targets, penalty):
    """Tell frames that lack input: 0 where all is finite that the solution needs, else NaN.

    A difference of a number from itself is 0 unless it is infinite or NaN; a k of 0 leaves l and h
    unread.
    """
    unknown = 0.0
    for index in range(A.shape[0]):
        unknown += A[index] - A[index]
    for i in range(targets.shape[0]):
        unknown += targets[i] - targets[i]
        if penalty[2, i] > 0.0:
            unknown += penalty[0, i] - penalty[0, i] + (penalty[1, i] - penalty[1, i])
        else:
            unknown += penalty[2, i] - penalty[2, i]
    for j in range(b.shape[0]):
        unknown += b[j] - b[j]
    return unknown


@in_place
def _solve_frame(S, A, b, targets, penalty, accepted, x, y, by_variable, by_row, M):
    """Solve one frame from the multipliers y; x and y are filled.

    A frame that the plain iteration does not solve is solved again with a large slack that then
    shrinks. Where no slack can be small, the frame is infeasible and x misses the balance least.

    Parameters
    ----------
    S, A, b, targets, penalty, x, y, by_variable, by_row, M : as of `_newton`
    accepted : equilibrium residual at which the frame is optimal, relative to 1 + max |b|

    Returns
    -------
    equilibrium residual, number of steps and status
    """
    unknown = _unknown(A, b, targets, penalty)
    if unknown != 0.0:
        for i in range(x.shape[0]):
            x[i] = np.nan
        for j in range(b.shape[0]):
            y[j] = np.nan
        return np.nan, 0, MISSING

    scale = 1.0
    # Not the literal True, for which `_newton` would be compiled a second time.
    cold = unknown == 0.0
    for j in range(b.shape[0]):
        scale = max(scale, 1.0 + abs(b[j]))
        cold = cold and y[j] == 0.0
    worst = np.inf
    before = np.inf
    steps = 0
    stuck = False
    index = 0
    max_steps = 40
    while index < len(SLACKS):
        worst, left, more = _newton(
            S, A, b, targets, penalty, SLACKS[index], max_steps, cold, x, y, by_variable, by_row, M
        )
        steps += more
        if max_steps == 0:
            break
        if index == 0 and left <= TOLERANCE * scale:
            stuck = True
            break
        settled = left <= TOLERANCE * scale or left <= SETTLED * worst
        cold = index == 0
        if index > 1 and not settled:
            # The last slack that could be solved for is the answer: x again, without a step.
            index = index - 1
            max_steps = 0
            for j in range(b.shape[0]):
                y[j] = by_row[4, j]
            continue
        for j in range(b.shape[0]):
            if index == 0 or not worst < np.inf:
                y[j] = 0.0
            by_row[4, j] = y[j]
        if index > 0:
            # Less slack, but the same residual: nothing is left that could take it.
            stuck = settled and worst > 0.5 * before
            before = worst
        index = index + 1
        max_steps = 150
    if worst <= accepted * scale:
        return worst, steps, OPTIMAL
    return worst, steps, INFEASIBLE if stuck else STALLED


@inner
def _drawn(S, links, frame, status, penalties, penalty):
    """Fill the interval penalties of a frame: its own, and the pull of neighbouring frames.

    A linked variable x of amount scale x is drawn to the amounts a_n of the frames n beside it,

        sum_n k_n (scale x - a_n)^2 = (sum_n k_n) scale^2 (x - m)^2 + constant,
        m = sum_n k_n a_n / (scale sum_n k_n)

    Parameters
    ----------
    S, links : `Separable`, `FrameLinks`
    frame, status : number of the frame, status of all frames
    penalties : (3, variables) l, h and k of its own
    penalty : (3, variables) filled
    """
    for i in range(penalty.shape[1]):
        for index in range(3):
            penalty[index, i] = penalties[index, i]
    for g in range(links.scale.shape[1]):
        scale = links.scale[frame, g]
        pull = 0.0
        weighted_sum = 0.0
        for neighbour in (frame - 1, frame + 1):
            if (
                0 <= neighbour < status.shape[0]
                and links.scale[neighbour, g] > 0.0
                and status[neighbour] == OPTIMAL
            ):
                stiffness = links.stiffness[min(frame, neighbour)] * S.weight[links.first + g]
                pull += stiffness
                weighted_sum += stiffness * links.amount[neighbour, g]
        if scale > 0.0 and pull > 0.0:
            middle = weighted_sum / (pull * scale)
            penalty[0, links.first + g] = middle
            penalty[1, links.first + g] = middle
            penalty[2, links.first + g] = pull * scale * scale


@kernel
def solve_separable(
    S, values, balance, targets, penalties, links, warm, x, y, residual, iterations, status
):
    """Solve frame after frame, each starting from the multipliers of the one before.

    Where frames are linked, the solution of each alone is where passes over all of them begin, each
    frame drawn to its neighbours: projected successive over-relaxation by blocks (Young 1954, Cryer
    1971) towards the joint optimum.

    Parameters
    ----------
    S, links : `Separable`, `FrameLinks`
    values : (frames, entries) of A
    balance : (frames, rows) b, rows in the order of elimination
    targets : (1 or frames, variables) t
    penalties : (1 or frames, 3, variables) l, h and k; a k of 0 leaves l and h unread
    warm : (rows,) multipliers to begin with, 0 for none; afterwards those of the last frame
    x, y : (frames, variables) and (frames, rows) filled with the solution and its multipliers
    residual : (frames,) filled with the equilibrium residual max |b - A x|
    iterations, status : (frames,) filled
    """
    frames = balance.shape[0]
    n = balance.shape[1]
    variables = x.shape[1]
    M = np.zeros((n, n))
    by_variable = np.zeros((3, variables))
    by_row = np.zeros((5, n))
    penalty = np.zeros((3, variables))
    steepest = 0.0
    for i in range(variables):
        steepest = max(steepest, S.exponent[i])
    # With p > 2 the multipliers of a variable near 0 fall under the rounding of the others.
    accepted = 10.0 * TOLERANCE if steepest <= 2.0 else 1e-6
    linked = links.scale.shape[1]
    min_change = np.inf
    min_change_sweep = 0
    over = links.over
    # How far what a frame is drawn to has moved since it was solved: where little, its solution
    # stands.
    drift = np.zeros(frames)
    for sweep in range(links.sweeps + 1 if linked else 1):
        moved = 0.0
        for frame in range(frames):
            penalties_here = penalties[min(frame, penalties.shape[0] - 1)]
            if sweep == 0:
                iterations[frame] = 0
                for j in range(n):
                    y[frame, j] = warm[j]
            elif status[frame] == OPTIMAL:
                _drawn(S, links, frame, status, penalties_here, penalty)
                penalties_here = penalty
            else:
                continue
            if sweep < 2 or drift[frame] > 0.1 * links.tolerance:
                residual[frame], more, status[frame] = _solve_frame(
                    S,
                    values[frame],
                    balance[frame],
                    targets[min(frame, targets.shape[0] - 1)],
                    penalties_here,
                    accepted,
                    x[frame],
                    y[frame],
                    by_variable,
                    by_row,
                    M,
                )
                iterations[frame] += more
                drift[frame] = 0.0
            if sweep == 0 and status[frame] != MISSING:
                for j in range(n):
                    warm[j] = y[frame, j] if status[frame] == OPTIMAL else 0.0
            max_change = 0.0
            for g in range(linked):
                change = links.scale[frame, g] * x[frame, links.first + g] - links.amount[frame, g]
                max_change = max(max_change, abs(change))
                relaxed = links.amount[frame, g] + (change if sweep == 0 else over * change)
                # Projected (Cryer 1971): what is beyond a bound of 0 would be handed round for
                # ever.
                links.amount[frame, g] = (
                    max(relaxed, 0.0) if S.lower[links.first + g] == 0.0 else relaxed
                )
            moved = max(moved, max_change)
            for neighbour in (frame - 1, frame + 1):
                if sweep > 0 and 0 <= neighbour < frames:
                    drift[neighbour] += over * max_change
        if sweep > 0 and moved <= links.tolerance:
            break
        # Over-relaxation that does not pay is given up: plain passes always approach the optimum.
        if sweep > 0 and moved < min_change:
            min_change = moved
            min_change_sweep = sweep
        elif sweep > min_change_sweep + PATIENCE:
            over = 1.0
