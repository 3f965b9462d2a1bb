"""Extremes of linear functions among solutions whose cost is near the optimum.

    least c^T x   over   A x = b,  lower <= x <= upper,  cost(x) <= level

is taken at x(s) = argmin cost(x) + s c^T x for the s at which its cost reaches the level: one more problem of the
same form, with targets moved by -s c / (2 w), whose cost grows with s. Near the optimum it grows with s^2, which
gives the next s.
"""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.rigid.frames import over_frames
from myomorph.tension.dual import OPTIMAL, solve_separable
from myomorph.tension.separable import no_links
from myomorph.tension.solved import SolvedFrames

CLOSE = 0.02
"""Share of the allowed increase of the cost that may be left."""

MOST = 12
"""Values of s that are tried."""


def near_extremes(solved: SolvedFrames, bounds: tuple[Array, Array], functions: Array, share: float) -> Array:
    """Least and greatest values of linear functions of contact amplitudes among solutions near the optimum.

    Parameters
    ----------
    solved : frames that were solved
    bounds : (frames, variables) least and greatest, with what was found between them
    functions : (frames, groups, 3, variables), of variables whose exponent is 2 alone
    share : increase of the cost that is allowed, of the cost of the solution that was found

    Returns
    -------
    (2, frames, groups, 3) least, greatest
    """
    frames, groups = functions.shape[:2]
    costs = np.stack([functions, -functions], axis=1).reshape(frames, -1, functions.shape[-1])
    found = solved.cost(solved.x)
    # What was found may be dearer than each frame alone has to be, for the sake of the frames beside it.
    alone = _solve(solved, bounds, np.zeros((frames, 1, costs.shape[2])))
    least = np.fmin(solved.cost(alone)[:, 0], found)
    allowed = ((1.0 + share) * found - least)[:, None]
    best = np.fmin(np.einsum("fkn,fn->fk", costs, solved.x), np.einsum("fkn,fn->fk", costs, alone[:, 0]))
    # A first s from the size of each function: the cost of a body weight is of the size of the effort.
    size = np.abs(costs).max(axis=2)
    s = np.where(size > 0.0, np.sqrt(allowed) / np.maximum(size, 1e-300), 0.0)
    under, over = np.zeros(s.shape), np.full(s.shape, np.inf)
    done = (size == 0.0) | ~(allowed > 0.0)
    for _ in range(MOST):
        x = _solve(solved, bounds, s[..., None] * costs)
        more = solved.cost(x) - least[:, None]
        value = np.einsum("fkn,fkn->fk", costs, x)
        inside = (more <= allowed) & np.isfinite(more)
        best = np.where(inside & ~done, np.minimum(best, value), best)
        done |= inside & (more >= (1.0 - CLOSE) * allowed)
        under, over = np.where(inside, np.maximum(under, s), under), np.where(inside, over, np.minimum(over, s))
        if done.all():
            break
        factor = np.sqrt((1.0 - 0.5 * CLOSE) * allowed / np.maximum(more, 1e-12 * allowed))
        guess = s * np.clip(np.nan_to_num(factor, nan=0.1), 0.1, 10.0)
        middle = np.where(np.isfinite(over), 0.5 * (under + over), guess)
        s = np.where(done, s, np.where((guess <= under) | (guess >= over), middle, guess))
    ends = best.reshape(frames, 2, groups, 3)
    return np.stack([ends[:, 0], -ends[:, 1]])


def _solve(solved: SolvedFrames, bounds: tuple[Array, Array], tilt: Array) -> Array:
    """The x of least cost(x) + tilt^T x, (frames, many, variables) of tilts alike; NaN where there is none."""
    frames, many, n = tilt.shape
    x = np.empty((frames, many, n))
    targets = -0.5 * tilt / solved.shared.weight
    still = np.zeros(many)

    def part(start: int, stop: int) -> None:
        for k in range(start, stop):
            values, right = (np.repeat(one[k][None], many, axis=0) for one in (solved.values, solved.b))
            penalties = np.array(solved.penalties[k])[None]
            status = np.empty(many, np.int8)
            solve_separable(
                solved.shared._replace(lower=bounds[0][k].copy(), upper=bounds[1][k].copy()),
                values,
                right,
                targets[k],
                penalties,
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
