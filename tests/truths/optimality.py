"""Whether solved frames of a tension problem are optima.

The conditions are those of Karush, Kuhn and Tucker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    near = ON_BOUND * (1.0 + np.abs(solved.x))
    at_low = solved.x <= solved.shared.lower + near
    at_high = solved.x >= solved.shared.upper - near
    result = np.full((4, len(chosen)), np.nan)
    for number in np.flatnonzero(tension.status[chosen] == OPTIMAL):
        at = _Bounds(low=at_low[number], high=at_high[number])
        result[:, number] = _conditions(solved, number, slope[number], at)
    stationarity, balance, bounds, complementarity = result
    return Optimality(
        frames=chosen,
        stationarity=stationarity,
        balance=balance,
        bounds=bounds,
        complementarity=complementarity,
    )


def _conditions(solved: SolvedFrames, number: int, slope: Array, at: _Bounds) -> list[float]:
    """Return stationarity, balance, bounds and complementarity of a frame, as in `Optimality`."""
    low = solved.shared.lower
    high = solved.shared.upper
    x = solved.x[number]
    left = _left_over(solved.A[number], slope, at)
    unexplained = at.unexplained(left)
    pressed = left - np.where(at.inside, left, unexplained)
    away = np.where(np.isfinite(low) & at.low, x - low, np.where(at.high, high - x, 0.0))
    miss = solved.A[number] @ x - solved.b[number]
    cost = float(solved.cost(solved.x[number : number + 1])[0])
    return [
        np.abs(unexplained).max() / (1.0 + np.abs(slope).max()),
        np.abs(miss).max() / (1.0 + np.abs(solved.b[number]).max()),
        max(np.maximum(low - x, 0.0).max(), np.maximum(x - high, 0.0).max()),
        np.abs(pressed * away).max() / (1e-6 + cost),
    ]


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Which variables of a frame are at a bound.

    Attributes
    ----------
    low, high : (variables,)
    """

    low: NDArray[np.bool_]
    high: NDArray[np.bool_]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(variables,) at neither."""
        return ~(self.low | self.high)

    def unexplained(self, slope: Array) -> Array:
        """Return the part of a slope (variables,) that bounds do not explain by their push."""
        rest = np.where(self.low, np.minimum(slope, 0.0), slope)
        rest = np.where(self.high, np.maximum(rest, 0.0), rest)
        return np.where(self.low & self.high, 0.0, rest)


def _left_over(A: Array, slope: Array, at: _Bounds) -> Array:
    """Return what the multipliers that fit best inside leave of a slope (variables,)."""
    multipliers = np.linalg.lstsq(A[:, at.inside].T, slope[at.inside], rcond=None)[0]
    return slope - A.T @ multipliers


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
