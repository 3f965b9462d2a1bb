"""Extremes of linear functions among solutions whose cost is near the optimum.

    least c^T x   over   A x = b,  lower <= x <= upper,  cost(x) <= level

is taken at x(s) = argmin cost(x) + s c^T x for the s at which its cost reaches the level: one more problem of the
same form, with targets moved by -s c / (2 w), whose cost grows with s. Near the optimum it grows with s^2, which
gives the next s.
"""

from __future__ import annotations

import numpy as np

from myomorph.model.spatial import Array
from myomorph.rigid.frames import over_frames
from myomorph.tension.dual import OPTIMAL, solve_separable
from myomorph.tension.separable import no_links
from myomorph.tension.solved import SolvedFrames

CLOSE = 0.02
"""Share of the allowed increase of the cost that may be left."""

MOST = 12
"""Values of s that are tried."""


def near_extremes(solved: SolvedFrames, good: np.ndarray, functions: Array, share: float) -> Array:
    """Least and greatest values of linear functions of contact amplitudes among solutions near the optimum.

    Parameters
    ----------
    good : (good frames,) places of solved frames
    functions : (good frames, groups, 3, variables), of variables whose exponent is 2 alone
    share : increase of the cost that is allowed, of the cost of the solution that was found

    Returns
    -------
    (2, good frames, groups, 3) least, greatest
    """
    frames, groups = functions.shape[:2]
    costs = np.stack([functions, -functions], axis=1).reshape(frames, -1, functions.shape[-1])
    many = costs.shape[1]
    found = solved.cost(solved.x)[good]
    alone = _solve(solved, good, np.zeros((frames, 1, costs.shape[2])))
    least = np.minimum(_costs(solved, good, alone)[:, 0], found)
    allowed = (1.0 + share) * found - least
    best = np.einsum("fkn,fn->fk", costs, solved.x[good])
    tried = np.einsum("fkn,fn->fk", costs, alone[:, 0])
    best = np.minimum(best, tried)
    # A first s from the size of each function: the cost of a body weight is of the size of the effort.
    size = np.abs(costs).max(axis=2)
    s = np.where(size > 0.0, np.sqrt(allowed)[:, None] / np.maximum(size, 1e-300), 0.0)
    under, over = np.zeros((frames, many)), np.full((frames, many), np.inf)
    done = (size == 0.0) | ~(allowed > 0.0)[:, None]
    for _ in range(MOST):
        x = _solve(solved, good, s[..., None] * costs)
        more = _costs(solved, good, x) - least[:, None]
        value = np.einsum("fkn,fkn->fk", costs, x)
        inside = (more <= allowed[:, None]) & np.isfinite(more)
        best = np.where(inside & ~done, np.minimum(best, value), best)
        done |= inside & (more >= (1.0 - CLOSE) * allowed[:, None])
        under, over = np.where(inside, np.maximum(under, s), under), np.where(inside, over, np.minimum(over, s))
        if done.all():
            break
        factor = np.sqrt((1.0 - 0.5 * CLOSE) * allowed[:, None] / np.maximum(more, 1e-12 * allowed[:, None]))
        guess = s * np.clip(np.nan_to_num(factor, nan=0.1), 0.1, 10.0)
        middle = np.where(np.isfinite(over), 0.5 * (under + over), guess)
        outside = (guess <= under) | (guess >= over)
        s = np.where(done, s, np.where(outside, middle, guess))
    ends = best.reshape(frames, 2, groups, 3)
    return np.stack([ends[:, 0], -ends[:, 1]])


def _costs(solved: SolvedFrames, good: np.ndarray, x: Array) -> Array:
    """Cost (frames, many) of x (frames, many, variables) of some frames."""
    wells = solved.wells[good][:, :, None]
    below, above = np.maximum(wells[:, 0] - x, 0.0), np.maximum(x - wells[:, 1], 0.0)
    pulled = np.where(wells[:, 2] > 0.0, wells[:, 2] * (below**2 + above**2), 0.0)
    total: Array = (solved.shared.weight * np.abs(x) ** solved.shared.exponent + pulled).sum(axis=-1)
    return total


def _solve(solved: SolvedFrames, good: np.ndarray, tilt: Array) -> Array:
    """The x of least cost(x) + tilt^T x, (frames, many, variables) of tilts alike; NaN where there is none."""
    frames, many, n = tilt.shape
    x = np.empty((frames, many, n))
    targets = -0.5 * tilt / solved.shared.weight
    still = np.zeros(many)

    def part(start: int, stop: int) -> None:
        for k in range(start, stop):
            values, right = (np.repeat(one[good[k]][None], many, axis=0) for one in (solved.values, solved.b))
            wells = np.array(solved.wells[good[k]])[None]
            status = np.empty(many, np.int8)
            solve_separable(
                solved.shared,
                values,
                right,
                targets[k],
                wells,
                no_links(),
                np.zeros(right.shape[1]),
                x[k],
                np.empty(right.shape),
                still.copy(),
                np.empty(many, np.int64),
                status,
            )
            x[k, status != OPTIMAL] = np.nan

    over_frames(part, frames, chunk=4)
    return x
