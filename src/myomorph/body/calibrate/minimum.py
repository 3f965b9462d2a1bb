"""The minimum of one stage of the search, over all unknowns at once or in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from myomorph.body.calibrate.frame_sums import settle
from myomorph.body.calibrate.shared_problem import Point, Reduced, Stage
from myomorph.body.calibrate.shared_unknowns import MarkersAt, as_fit
from myomorph.core.fit.solver import Method, Solution, minimize
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array

MIN_GAIN = 1e-7  # A step that lowers the cost by a smaller share is the last
KINK = 1e-4
"""Where no step lowers the cost although one promised at most this share, angles at their bounds
bend it there.
"""
TOLERANCE = 1e-5  # Largest change of the last step, of a factor or in `length_unit`
STEPS_IN_TURN = 3  # For lengths, between two placements of the markers


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """Where the search ended.

    Attributes
    ----------
    solution : with the unknowns and residuals that were searched with
    costs : after every step [m^2]
    converged : whether the search ended at a minimum
    """

    solution: Solution
    costs: tuple[float, ...]
    converged: bool

    @property
    def _markers(self) -> MarkersAt:
        part = self.solution.at.parts[0]
        assert isinstance(part, MarkersAt)
        return part

    @property
    def point(self) -> Point:
        """The unknowns, and every frame at its best angles."""
        return self._markers.point

    @property
    def reduced(self) -> Reduced:
        """Normal equations without priors [m^2]."""
        return self._markers.reduced

    @property
    def change(self) -> float:
        """Largest of the last step, of a factor or in `length_unit`."""
        return self.solution.search.change


def minimise(
    stage: Stage,
    start: Point,
    iterations: int,
    tolerance: float = TOLERANCE,
    after_step: Callable[[], None] = lambda: None,
) -> Minimum:
    """Minimise the cost over the free shared unknowns, frames settled again after each step.

    Parameters
    ----------
    stage : the problem with the priors of this stage, the noise, and what may change
    start : with every frame at its best angles
    iterations : at most so many steps
    tolerance : largest change of the last step, of a factor or in `length_unit`
    after_step : called after each step

    Returns
    -------
    the point where the search ended, with its costs
    """
    # Frames settle to a tolerance of their own, so that the cost of the last small step is noise.
    method = Method(
        iterations=iterations, tolerance=tolerance, min_gain=MIN_GAIN, kink=KINK, max_step=1.0
    )
    fit = as_fit(stage, start)
    solution = minimize(fit, fit.at(start.x), method=method, progress=after_step)
    costs = tuple(stage.variance * cost for cost in solution.search.costs)
    return Minimum(solution=solution, costs=costs, converged=solution.search.converged)


def place_at_fixed_angles(stage: Stage, at: Minimum) -> Array:
    """Solve for the free unknowns that fit best while all angles stay ([D] 3.2.1 (c)).

    Parameters
    ----------
    stage : with the prior, the noise, and what may change
    at : minimum whose normal equations at fixed angles are used

    Returns
    -------
    (unknowns,) all of them
    """
    free = stage.free
    rows = stage.prior_rows
    misfit = stage.problem.prior.rows @ at.point.x - stage.problem.prior.right
    H = at.reduced.fixed_H[np.ix_(free, free)] + stage.variance * rows.T @ rows
    g = at.reduced.fixed_g[free] + stage.variance * rows.T @ misfit
    x = at.point.x.copy()
    x[free] -= np.linalg.solve(H, g)
    return x


def minimise_in_turn(
    stage: Stage, start: Point, shifts: Bools, iterations: int, after_step: Callable[[], None]
) -> Minimum:
    """Estimate lengths and marker positions in turn, as [D] 3.2.1 (b) and (c).

    First angles and lengths, then marker positions at fixed angles, until neither moves.

    Parameters
    ----------
    stage : the problem with its priors, the noise, and what may change
    start : with every frame at its best angles
    shifts : (unknowns,) which are shifts of markers
    iterations : at most so many turns
    after_step : called after each turn

    Returns
    -------
    the point where the search ended, with its costs after each turn
    """
    of_lengths = replace(stage, free=stage.free & ~shifts)
    of_shifts = replace(stage, free=stage.free & shifts)
    costs: list[float] = []
    point = start
    converged = False
    for _ in range(iterations):
        minimum = minimise(of_lengths, point, STEPS_IN_TURN)
        x = place_at_fixed_angles(of_shifts, minimum)
        point = settle(stage.problem, x, minimum.point.angles, stage.variance)
        prior_cost = stage.problem.prior_cost(x, point.angles)
        costs.append(point.cost + stage.variance * prior_cost)
        after_step()
        converged = len(costs) > 1 and costs[-2] - costs[-1] <= TOLERANCE * costs[-1]
        if converged:
            break
    # No step of all together: what both searches leave, with the equations there.
    resting = minimise(stage, point, iterations=0)
    return replace(resting, costs=tuple(costs), converged=converged)
