"""Whether solved frames of a tension problem are optima.

The conditions are those of Karush, Kuhn and Tucker.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.tension.certificates import ON_BOUND, SolvedFrames, solved_frames
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import TensionProblem
from myomorph.core.tension.tension import Tension


@read_only
class Optimality:
    """Conditions of an optimum (Karush, Kuhn and Tucker).

    Each is from the problem's own arrays and not by the solver.
    """

    frames: np.ndarray  # (frames,) numbers in the motion
    # greatest slope of the cost that neither balance nor a bound explains, as a share of 1 + the
    # greatest slope
    stationarity: Array
    balance: Array  # greatest |A x - b|, as a share of 1 + max |b|
    bounds: Array  # greatest violation of a bound
    # greatest product of a multiplier of a bound and the distance from it, as a share of the cost
    complementarity: Array


def optimality(
    problem: TensionProblem, tension: Tension, frames: Sequence[int] | None = None
) -> Optimality:
    """Compute whether frames fulfill the conditions of an optimum.

    Smoothness between frames takes part as it is in the cost.
    """
    chosen = np.arange(len(tension)) if frames is None else np.asarray(frames, np.int64)
    solved = solved_frames(problem, tension, chosen)
    slope = cost_slope(solved, solved.x) + _smooth_slope(problem, tension, solved)
    low = solved.shared.lower
    high = solved.shared.upper
    near = ON_BOUND * (1.0 + np.abs(solved.x))
    at_low = solved.x <= low + near
    at_high = solved.x >= high - near
    inside = ~(at_low | at_high)
    result = np.full((4, len(chosen)), np.nan)
    for number in np.flatnonzero(tension.status[chosen] == OPTIMAL):
        A = solved.A[number]
        x = solved.x[number]
        multipliers = np.linalg.lstsq(
            A[:, inside[number]].T, slope[number, inside[number]], rcond=None
        )[0]
        left = slope[number] - A.T @ multipliers
        unexplained = np.where(at_low[number], np.minimum(left, 0.0), left)
        unexplained = np.where(at_high[number], np.maximum(unexplained, 0.0), unexplained)
        unexplained = np.where(at_low[number] & at_high[number], 0.0, unexplained)
        pressed = left - np.where(inside[number], left, unexplained)
        away = np.where(
            np.isfinite(low) & at_low[number], x - low, np.where(at_high[number], high - x, 0.0)
        )
        result[0, number] = np.abs(unexplained).max() / (1.0 + np.abs(slope[number]).max())
        result[1, number] = np.abs(A @ x - solved.b[number]).max() / (
            1.0 + np.abs(solved.b[number]).max()
        )
        result[2, number] = max(np.maximum(low - x, 0.0).max(), np.maximum(x - high, 0.0).max())
        result[3, number] = np.abs(pressed * away).max() / (
            1e-6 + float(solved.cost(solved.x[number : number + 1])[0])
        )
    stationarity, balance, bounds, complementarity = result
    return Optimality(
        frames=chosen,
        stationarity=stationarity,
        balance=balance,
        bounds=bounds,
        complementarity=complementarity,
    )


def cost_slope(solved: SolvedFrames, x: Array) -> Array:
    """Return the gradient of the cost.

    Parameters
    ----------
    solved : frames with their costs and penalties
    x : (frames, variables)

    Returns
    -------
    (frames, variables)
    """
    w = solved.shared.weight
    p = solved.shared.exponent
    (low, high, stiff) = solved.penalties.swapaxes(0, 1)
    drawn = np.where(x < low, x - low, np.maximum(x - high, 0.0))
    pulled = np.where(stiff > 0.0, 2.0 * stiff * drawn, 0.0)
    return p * w * np.abs(x) ** (p - 1.0) * np.sign(x) + pulled


def _smooth_slope(problem: TensionProblem, tension: Tension, solved: SolvedFrames) -> Array:
    """Gradient of the smoothness between frames, (frames, variables)."""
    result = np.zeros(solved.x.shape)
    if problem.smooth is None or problem.contacts is None:
        return result
    scale = problem.smooth.scale
    z = problem.amplitudes
    for index, frame in enumerate(solved.frames):
        for beside in (frame - 1, frame + 1):
            if 0 <= beside < len(tension) and tension.status[beside] == OPTIMAL:
                linked = (scale[frame] > 0.0) & (scale[beside] > 0.0)
                apart = scale[frame] * z[frame] - scale[beside] * np.nan_to_num(z[beside])
                stiffness = problem.smooth.stiffness[min(frame, beside)] * problem.contacts.cost
                pull = np.where(linked, 2.0 * stiffness * scale[frame] * apart, 0.0)
                result[index, solved.controls : solved.amplitudes] += pull
    return result
