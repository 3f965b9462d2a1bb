"""Frames of a solved tension problem as dense arrays, for what is asked of the solution afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.rigid.tree import Tree
from myomorph.tension.problem import TensionProblem
from myomorph.tension.separable import Separable
from myomorph.tension.tension import Tension
from myomorph.tension.terms.cones import GRAVITY


@dataclass(frozen=True, eq=False)
class SolvedFrames:
    """Some frames: minimise cost(x) subject to A x = b, lower <= x <= upper, and the x that was found.

    Unknowns are activations, controls, amplitudes of contacts, and others that terms bring in.

    Attributes
    ----------
    frames : (frames,) their numbers in the motion
    A, b : (frames, rows, variables), (frames, rows)
    x : (frames, variables), NaN where a frame was not solved
    shared : weights, exponents and bounds of all frames
    penalties : (frames, 3, variables) as of `solve_separable`
    values : entries of A as `TensionProblem.balance` gives them
    muscles, controls, amplitudes : where activations, controls, and amplitudes end among the variables
    """

    frames: NDArray[np.int64]
    A: Array
    b: Array
    x: Array
    shared: Separable
    penalties: Array
    values: Array
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
        total: Array = (self.shared.weight * np.abs(x) ** self.shared.exponent + pulled).sum(axis=-1)
        return total

    def slope(self, x: Array) -> Array:
        """Gradient of the cost, (frames, variables)."""
        w, p = self.shared.weight, self.shared.exponent
        drawn = np.where(x < self.penalties[:, 0], x - self.penalties[:, 0], np.maximum(x - self.penalties[:, 1], 0.0))
        pulled = np.where(self.penalties[:, 2] > 0.0, 2.0 * self.penalties[:, 2] * drawn, 0.0)
        found: Array = p * w * np.abs(x) ** (p - 1.0) * np.sign(x) + pulled
        return found

    def curvature(self, x: Array) -> Array:
        """Second derivatives of the cost, (frames, variables), above 0."""
        w, p = self.shared.weight, self.shared.exponent
        outside = (x <= self.penalties[:, 0]) | (x >= self.penalties[:, 1])
        pulled = np.where((self.penalties[:, 2] > 0.0) & outside, 2.0 * self.penalties[:, 2], 0.0)
        # With p other than 2 the curvature at 0 is 0 or infinite: taken a little beside it.
        found: Array = p * (p - 1.0) * w * np.maximum(np.abs(x), 1e-6) ** (p - 2.0) + pulled
        return found


def solved_frames(problem: TensionProblem, tension: Tension, frames: NDArray[np.int64]) -> SolvedFrames:
    """Frames of a problem that was solved.

    Parameters
    ----------
    tension : what the problem found, of all its frames
    frames : (frames,) which ones
    """
    shared = problem.separable
    n = len(shared.weight)
    # A run of frames at once, others one by one.
    together = len(frames) > 0 and int(frames[-1] - frames[0]) == len(frames) - 1
    spans = [(int(frames[0]), int(frames[-1]) + 1)] if together else [(int(one), int(one) + 1) for one in frames]
    given = [problem.balance(*span) for span in spans]
    values, b = (np.concatenate([getattr(one, name) for one in given]) for name in ("values", "right"))
    A = np.zeros((len(frames), b.shape[1], n))
    A[:, shared.row, np.repeat(np.arange(n), np.diff(shared.start))] = values
    muscles, first = len(tension.muscles), len(problem.unknowns)
    controls = muscles + tension.reserves.shape[1]
    # What the result says counts, and the unknowns of rows follow from the others.
    x = np.concatenate([problem.x[frames, :first], np.zeros((len(frames), n - first))], axis=1)
    x[:, :muscles] = tension.activations[frames]
    x[:, muscles:controls] = tension.reserves[frames] / problem.actuators.optimal_forces
    if problem.rows:
        left = np.einsum("frn,fn->fr", A, x) - b
        x[:, first:] = left[:, problem.assembly.extra_row] / np.concatenate([one.unit for one in problem.rows])
    penalties = np.broadcast_to(problem.penalties[frames], (len(frames), 3, n))
    amplitudes = controls + problem.amplitudes.shape[1]
    return SolvedFrames(frames, A, b, x, shared, penalties, values, muscles, controls, amplitudes)


def subject_weight(tree: Tree, body: str) -> float:
    """Weight of the subject or object that a body belongs to: all that hangs on the same joint to the ground [N]."""
    roots, mass = tree.roots, tree.arrays.mass
    mine = mass[roots == roots[tree.body_index[body]]].sum()
    return (float(np.linalg.norm(tree.arrays.gravity)) or GRAVITY) * float(mine or mass.sum())
