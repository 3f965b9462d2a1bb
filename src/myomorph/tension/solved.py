"""Frames of a solved tension problem as dense arrays, for what is asked of the solution afterwards.

Extremes of linear functions among solutions whose cost is near the optimum,

    least c^T x   over   A x = b,  lower <= x <= upper,  cost(x) <= level

are taken at x(s) = argmin cost(x) + s c^T x for the s at which its cost reaches the level: one more problem of the
same form, with targets moved by -s c / (2 w), whose cost grows with s. Near the optimum it grows with s^2, which
gives the next s.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.rigid.frames import over_frames
from myomorph.rigid.tree import Tree
from myomorph.tension.dual import OPTIMAL
from myomorph.tension.problem import TensionProblem, solve_frames
from myomorph.tension.separable import Separable
from myomorph.tension.tension import Tension
from myomorph.tension.terms.cones import GRAVITY


@read_only
class SolvedFrames:
    """Some frames: minimise cost(x) subject to A x = b, lower <= x <= upper, and the x that was found.
    Unknowns are activations, controls, amplitudes of contacts, and others that terms bring in.
    """

    frames: NDArray[np.int64]  # (frames,) their numbers in the motion
    A: Array  # (frames, rows, variables)
    b: Array  # (frames, rows)
    x: Array  # (frames, variables), NaN where a frame was not solved
    shared: Separable  # weights, exponents and bounds of all frames
    penalties: Array  # (frames, 3, variables) as of `solve_separable`
    values: Array  # entries of A as `TensionProblem.balance` gives them
    # muscles, controls, amplitudes: where activations, controls, and amplitudes end among the variables
    muscles: int
    controls: int
    amplitudes: int

    def __len__(self) -> int:
        return len(self.frames)

    def of(self, places: NDArray[np.int64]) -> SolvedFrames:
        """Some of these frames."""
        parts = {name: getattr(self, name)[places] for name in ("frames", "A", "b", "x", "penalties", "values")}
        return replace(self, **parts)

    def cost(self, x: Array) -> Array:
        """Cost (frames, ...) of variables (frames, ..., n), smoothness between frames apart."""
        penalties = self.penalties.reshape(len(self), 3, *(1,) * (x.ndim - 2), x.shape[-1])
        below, above = np.maximum(penalties[:, 0] - x, 0.0), np.maximum(x - penalties[:, 1], 0.0)
        pulled = np.where(penalties[:, 2] > 0.0, penalties[:, 2] * (below**2 + above**2), 0.0)
        return (self.shared.weight * np.abs(x) ** self.shared.exponent + pulled).sum(axis=-1)

    def curvature(self, x: Array) -> Array:
        """Second derivatives of the cost, (frames, variables), above 0."""
        w, p = self.shared.weight, self.shared.exponent
        outside = (x <= self.penalties[:, 0]) | (x >= self.penalties[:, 1])
        pulled = np.where((self.penalties[:, 2] > 0.0) & outside, 2.0 * self.penalties[:, 2], 0.0)
        # With p other than 2 the curvature at 0 is 0 or infinite: taken a little beside it.
        return p * (p - 1.0) * w * np.maximum(np.abs(x), 1e-6) ** (p - 2.0) + pulled


def solved_frames(problem: TensionProblem, tension: Tension, frames: NDArray[np.int64]) -> SolvedFrames:
    """Frames of a problem that was solved."""
    shared = problem.separable
    n = len(shared.weight)
    # A run of frames at once, others one by one.
    together = len(frames) > 0 and int(frames[-1] - frames[0]) == len(frames) - 1
    spans = [(int(frames[0]), int(frames[-1]) + 1)] if together else [(int(frame), int(frame) + 1) for frame in frames]
    balance = [problem.balance(*span) for span in spans]
    values, b = (np.concatenate([getattr(array, name) for array in balance]) for name in ("values", "right"))
    A = shared.dense(values)
    muscles, first = len(tension.muscles), len(problem.unknowns)
    controls = muscles + tension.reserves.shape[1]
    # What the result says counts, and the unknowns of rows follow from the others.
    x = np.concatenate([problem.x_of(frames)[:, :first], np.zeros((len(frames), n - first))], axis=1)
    x[:, :muscles] = tension.activations[frames]
    x[:, muscles:controls] = tension.reserves[frames] / problem.actuators.optimal_forces
    if problem.rows:
        left = np.einsum("frn,fn->fr", A, x) - b
        x[:, first:] = left[:, problem.assembly.extra_row] / np.concatenate([row.unit for row in problem.rows])
    penalties = np.broadcast_to(problem.penalties[frames], (len(frames), 3, n))
    amplitudes = controls + problem.amplitudes.shape[1]
    return SolvedFrames(frames, A, b, x, shared, penalties, values, muscles, controls, amplitudes)


def subject_weight(tree: Tree, body: str) -> float:
    """Weight of the subject or object that a body belongs to: all that hangs on the same joint to the ground [N]."""
    roots, mass = tree.roots, tree.arrays.mass
    mine = mass[roots == roots[tree.body_index[body]]].sum()
    return (float(np.linalg.norm(tree.arrays.gravity)) or GRAVITY) * float(mine or mass.sum())


CLOSE = 0.02  # Share of the allowed increase of the cost that may be left
MAX_COUNT = 12  # Values of s that are tried


def near_extremes(solved: SolvedFrames, bounds: tuple[Array, Array], functions: Array, share: float) -> Array:
    """Least and greatest values of linear functions of contact amplitudes among solutions near the optimum.
    `solved`: frames that were solved; `bounds` (frames, variables) least and greatest, with what was found between
    them; `functions` (frames, groups, 3, variables), of variables whose exponent is 2 alone; `share`: increase of the
    cost that is allowed, of the cost of the solution that was found. Returns (2, frames, groups, 3) least, greatest.
    """
    frames, groups = functions.shape[:2]
    costs = np.stack([functions, -functions], axis=1).reshape(frames, -1, functions.shape[-1])
    result = solved.cost(solved.x)
    # What was found may be dearer than each frame alone has to be, for the sake of the frames beside it.
    alone = _solve(solved, bounds, np.zeros((frames, 1, costs.shape[2])))
    least = np.fmin(solved.cost(alone)[:, 0], result)
    allowed = ((1.0 + share) * result - least)[:, None]
    best = np.fmin(np.einsum("fkn,fn->fk", costs, solved.x), np.einsum("fkn,fn->fk", costs, alone[:, 0]))
    # A first s from the size of each function: the cost of a body weight is of the size of the effort.
    size = np.abs(costs).max(axis=2)
    s = np.where(size > 0.0, np.sqrt(allowed) / np.maximum(size, 1e-300), 0.0)
    under, over = np.zeros(s.shape), np.full(s.shape, np.inf)
    done = (size == 0.0) | ~(allowed > 0.0)
    for _ in range(MAX_COUNT):
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

    def part(start: int, stop: int) -> None:
        for index in range(start, stop):
            values, right = (np.repeat(values[index][None], many, axis=0) for values in (solved.values, solved.b))
            lower, upper = (frozen_array(bound[index]) for bound in bounds)
            shared = solved.shared._replace(lower=lower, upper=upper)
            penalties = np.array(solved.penalties[index])[None]
            x[index], *_, status = solve_frames(shared, values, right, penalties, targets=targets[index])
            x[index, status != OPTIMAL] = np.nan

    over_frames(part, frames, chunk=4)
    return x
