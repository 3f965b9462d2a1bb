"""Gauss-Newton steps of the one problem: motions eliminated trial by trial, so that time grows with frames only;
standard deviations of body and masses at the optimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from myomorph.identify.determined import LINK_SD
from myomorph.identify.refine.equations import Equations, cost, linearize, with_trust
from myomorph.identify.refine.problem import MassPrior, Problem, Unknowns, moved, tangents
from myomorph.model.arrays import Array, read_only

LEAST_GAIN = 1e-3  # A step that lowers the cost by a smaller share is the last


@read_only
class Solution:
    """Where the search ended."""

    problem: Problem  # with the weights of frames that it was solved with
    at: Unknowns
    costs: tuple[float, ...]  # after every step
    converged: bool


def settle(problem: Problem, progress: Callable[[], None] = lambda: None, first: Unknowns | None = None) -> Solution:
    """The optimum, from that of the motions alone, which shows the frames that nothing explains.
    `first`: of the motions alone, see `motions_alone`; found here by default.
    """
    first = motions_alone(problem, progress) if first is None else first
    return solve(with_trust(problem, first), first, progress)


def motions_alone(problem: Problem, progress: Callable[[], None] = lambda: None) -> Unknowns:
    """The optimum of the motions on the body as given."""
    still = replace(problem, body=False, masses=False)
    return solve(still, still.begin(), progress).at


def solve(problem: Problem, start: Unknowns, progress: Callable[[], None] = lambda: None) -> Solution:
    """Levenberg-Marquardt from a start."""
    at, damping = start, 1e-6
    costs = [cost(problem, at)]
    converged = False
    for _ in range(problem.options.iterations):
        equations = linearize(problem, at)
        accepted = False
        while not accepted and damping < 1e4:
            motions, shared = step(problem, equations, damping)
            trial = moved(problem, at, motions, shared)
            accepted = bool(trial.factors.min(initial=1.0) > 0.3) and cost(problem, trial) <= costs[-1]
            damping = max(damping * 0.1, 1e-9) if accepted else damping * 10.0
        progress()
        if not accepted:
            converged = True
            break
        at = trial
        costs.append(cost(problem, at))
        if costs[-2] - costs[-1] < LEAST_GAIN * costs[-2]:
            converged = True
            break
    return Solution(problem, at, tuple(costs), converged)


def step(problem: Problem, equations: Equations, damping: float) -> tuple[tuple[Array, ...], Array]:
    """Changes of each trial's coefficients, and of the shared unknowns."""
    reduced, right, solved = _reduce(equations, damping)
    shared = -cho_solve(cho_factor(reduced), right) if len(right) else np.zeros(0)
    n = len(problem.pose.free)
    motions = tuple((-block[:, 0] - block[:, 1:] @ shared).reshape(-1, n) for block in solved)
    return motions, shared


def _reduce(equations: Equations, damping: float) -> tuple[Array, Array, list[Array]]:
    """Normal equations of the shared unknowns with all motions eliminated, and what eliminates them."""
    H, g = equations.H.copy(), equations.g.copy()
    H[np.diag_indices_from(H)] *= 1.0 + damping
    solved = []
    for trial in equations.trials:
        band = trial.band.copy()
        band[0] = band[0] * (1.0 + damping) + 1e-12 * band[0].max()
        factor = cholesky_banded(band, lower=True, overwrite_ab=True)
        reduced = cho_solve_banded((factor, True), np.column_stack([trial.right, trial.cross]))
        H -= trial.cross.T @ reduced[:, 1:]
        g -= trial.cross.T @ reduced[:, 0]
        solved.append(reduced)
    return H, g, solved


def reduced_information(equations: Equations) -> Array:
    """(shared, shared) what is known of the shared unknowns, with all motions eliminated."""
    return _reduce(equations, 0.0)[0]


def covariance(problem: Problem, at: Unknowns) -> Array:
    """(shared, shared) of the shared unknowns, all motions unknown too.
    Masses that are identified first come from the same recordings, so that they are no prior knowledge: links are
    taken to differ from the given model by `LINK_SD`, as in `identify`.
    """
    if not problem.count:
        return np.zeros((0, 0))
    problem = replace(problem, prior=MassPrior.of(problem.prior.reference, LINK_SD))
    return np.asarray(np.linalg.inv(reduced_information(linearize(problem, at))), dtype=np.float64)


def mass_sd(problem: Problem, at: Unknowns, spread: Array) -> Array:
    """(bodies,) standard deviation of the masses [kg], 0 of those that do not change."""
    result = np.zeros(len(problem.prior.reference))
    if problem.masses:
        masses = problem.columns()[2]
        rows = tangents(at.parameters[problem.prior.moved])[:, 0]
        for index, link in enumerate(problem.prior.moved):
            columns = slice(masses.start + 10 * index, masses.start + 10 * index + 10)
            result[link] = np.sqrt(rows[index] @ spread[columns, columns] @ rows[index])
    return result
