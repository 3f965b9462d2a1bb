"""The search for lengths and marker positions: stages of noise, unknowns at once or in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.body.calibrate.calibration import CalibrationOptions, Distances, SideEstimate
from myomorph.body.calibrate.frame_sums import settle, settle_anew
from myomorph.body.calibrate.priors import (
    calibration_prior,
    side_differences,
    symmetric_posture,
    usual_shifts,
)
from myomorph.body.calibrate.shared_problem import (
    LENGTHS,
    MARKERS,
    Point,
    Reduced,
    SharedProblem,
)
from myomorph.body.calibrate.shared_unknowns import MarkersAt, as_fit
from myomorph.core.fit.noise import residual_sd
from myomorph.core.fit.solver import Method, Solution, minimize
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.motion.starts import root_coordinates
from myomorph.core.rigid.tree import compile_tree

MIN_GAIN = 1e-7  # A step that lowers the cost by a smaller share is the last
KINK = 1e-4
"""Where no step lowers the cost although one promised at most this share, angles at their bounds
bend it there.
"""


@dataclass(frozen=True, eq=False)
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
    problem: SharedProblem,
    start: Point,
    variance: float,
    free: Bools,
    iterations: int,
    tolerance: float = 1e-5,
    after_step: Callable[[], None] = lambda: None,
) -> Minimum:
    """Minimise the cost over the `free` shared unknowns, frames settled again after each step.

    Parameters
    ----------
    problem : with the priors of this stage
    start : with every frame at its best angles
    variance : of a marker along one axis [m^2]
    free : (unknowns,)
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
    fit = as_fit(problem, start, variance, free)
    solution = minimize(fit, fit.at(start.x), method=method, progress=after_step)
    costs = tuple(variance * cost for cost in solution.search.costs)
    return Minimum(solution=solution, costs=costs, converged=solution.search.converged)


def place_at_fixed_angles(
    problem: SharedProblem, at: Minimum, variance: float, free: Bools
) -> Array:
    """Solve for the free unknowns that fit best while all angles stay ([D] 3.2.1 (c)).

    Parameters
    ----------
    problem : with the prior
    at : minimum whose normal equations at fixed angles are used
    variance : of a marker along one axis [m^2]
    free : (unknowns,) which may change

    Returns
    -------
    (unknowns,) all of them
    """
    rows = problem.prior.rows[:, free]
    H = at.reduced.fixed_H[np.ix_(free, free)] + variance * rows.T @ rows
    g = at.reduced.fixed_g[free] + variance * rows.T @ (
        problem.prior.rows @ at.point.x - problem.prior.right
    )
    x = at.point.x.copy()
    x[free] -= np.linalg.solve(H, g)
    return x


NOISE_UNKNOWN = 0.005
NOISE_LEAST = 1e-4
NOISE_AT_FIRST = 0.02
"""Of a marker along one axis: where the residual cannot show it, at least, and of the first stage
[length units].
"""

SIDE_REPEATS = 3  # Stages done again where the last one shows other sides that differ
TAIL = 3.0  # Degrees of freedom of Student's t, of which shifts of markers are a sample


@dataclass(frozen=True, eq=False)
class Search:
    """Where the search ended, and how it came there.

    Attributes
    ----------
    problem : with the prior of the last stage
    found : the minimum
    noise : standard deviation of a marker along one axis [m]
    noise_found : whether the residual could show the noise
    steps : of all stages
    free : (unknowns,) which were searched for
    sides : pairs of lengths, and whether the prior lets them differ
    """

    problem: SharedProblem
    found: Minimum
    noise: float
    noise_found: bool
    steps: int
    free: Bools
    sides: tuple[SideEstimate, ...] = ()


def search_minimum(
    problem: SharedProblem,
    names: Sequence[str],
    size: float,
    angles: Sequence[Array],
    options: CalibrationOptions,
    distances: Distances,
    progress: Callable[[int], None] | None,
) -> Search:
    """Search the minimum of the problem, the noise taken from its residual until both agree.

    Parameters
    ----------
    problem : with the first prior
    names : of the markers
    size : overall size that lengths begin with
    angles : of each recording (frames, coordinates) that frames begin with [rad or m]
    options : method, steps, and what may move
    distances : noise of markers, 0 to take it from the residual, and how far they lie off [m]
    progress : called with 1 after each step

    Returns
    -------
    the last minimum, with noise and sides

    Raises
    ------
    BadData : the loops of the model cannot be closed at this size
    """
    lengths, shifts = _may_move(problem, names, options)
    free = lengths | shifts
    x = np.zeros(problem.prior.rows.shape[1])
    x[: len(problem.lengths)] = size
    x[-1] = size
    steps = 0

    def one_more() -> None:
        nonlocal steps
        steps += 1
        if progress and steps <= options.iterations:
            progress(1)

    frames = sum(len(angle) for angle in angles)
    noise = distances.noise or NOISE_UNKNOWN * distances.unit
    at_first = NOISE_AT_FIRST * distances.unit
    if distances.noise:
        noise *= float(np.sqrt(max(1.0, frames / options.independent_frames)))
    root = root_coordinates(compile_tree(problem.model))
    # Trusting the model more at first keeps markers from following frames that are still turned
    # wrongly.
    stages = [noise] if noise >= at_first else [at_first, noise]
    point = settle(problem, x, angles, stages[0] ** 2)
    if not np.isfinite(point.cost):
        raise BadData(
            f"calibration: the loops of model '{problem.model.name}' cannot be closed at {size:.3g}"
            " its size"
        )
    known = True
    usual = usual_shifts(problem.model, names, distances)
    repeats = 0
    sides: tuple[SideEstimate, ...] = ()
    landmark = np.array([problem.model.marker(name).fixed for name in names])
    differing: frozenset[tuple[str, str]] = frozenset()
    if options.method == "joint":
        tree = compile_tree(problem.model)
        problem = replace(
            problem,
            mean_posture=symmetric_posture(
                tree, problem.pose.free, point.angles, options.posture_sd
            ),
        )
    stages.append(noise)
    while stages:
        noise = stages.pop(0)
        point = settle_anew(problem, point, root, noise**2)
        left = max(1, options.iterations - steps)
        if options.method == "joint":
            minimum = minimise(
                problem, point, noise**2, free, left, 1e-3 if stages else 1e-5, one_more
            )
        else:
            minimum = _alternate(problem, point, noise**2, lengths, shifts, left, one_more)
        point = minimum.point
        if noise < at_first:
            sides = side_differences(
                problem.lengths, point.x, minimum.reduced.H / noise**2, problem.prior, options
            )
            # What was set free stays so: a thigh and its shank freed in turn would never settle.
            now = differing | {(side.first, side.second) for side in sides if side.differs}
            # A side set free shows in the others' evidence: the last stage is done again.
            if (
                not stages
                and now != differing
                and repeats < SIDE_REPEATS
                and steps < options.iterations
            ):
                stages = [noise]
                repeats = repeats + 1
            differing = now if stages else differing
        if stages:
            # The variance that Student's t gives each marker: one that lies far off is no longer
            # pulled back.
            shifts_now = np.linalg.norm(point.x[len(problem.lengths) : -1].reshape(-1, 3), axis=1)
            released = usual * np.sqrt((TAIL + (shifts_now / usual) ** 2) / (TAIL + 3.0))
            # One on a bony landmark is not let go: it holds the zero angles of its body.
            released = np.where(landmark, usual, released)
            prior = calibration_prior(problem.lengths, released, options, size, differing)
            problem = replace(problem, prior=prior)
        if not stages and not distances.noise:
            shown_noise, known = _noise(problem, minimum, free, noise**2)
            if abs(shown_noise - noise) > 0.05 * noise and steps < options.iterations:
                stages = [shown_noise]
    sides = tuple(replace(side, differs=(side.first, side.second) in differing) for side in sides)
    return Search(
        problem=problem,
        found=minimum,
        noise=noise,
        noise_found=known,
        steps=steps,
        free=free,
        sides=sides,
    )


def _may_move(
    problem: SharedProblem, names: Sequence[str], options: CalibrationOptions
) -> tuple[Bools, Bools]:
    """Select the unknowns that may change.

    Returns
    -------
    (unknowns,) those that are lengths or the size, and (unknowns,) shifts of markers
    """
    n = len(problem.lengths)
    total = problem.prior.rows.shape[1]
    lengths = np.zeros(total, np.bool_)
    shifts = np.zeros(total, np.bool_)
    lengths[:n] = lengths[-1] = LENGTHS in options.fit
    for m, name in enumerate(names):
        moves = MARKERS in options.fit and name not in options.fixed_markers
        shifts[n + 3 * m : n + 3 * m + 3] = moves
    return lengths, shifts


def _noise(
    problem: SharedProblem, minimum: Minimum, free: Bools, variance: float
) -> tuple[float, bool]:
    """Estimate the noise of a marker along one axis from what the fit leaves.

    Parameters
    ----------
    free : (unknowns,) that were estimated
    variance : that the fit was weighed by [m^2]

    Returns
    -------
    standard deviation [m], and whether the residual can show it: no where angles and unknowns
        explain more than 80 % of the recorded numbers
    """
    squares = 0.0
    seen = 0
    for errors in minimum.reduced.errors:
        squares += float(np.nansum(problem.pose.markers.weight * errors**2))
        seen += 3 * int(np.isfinite(errors).sum())
    rows = problem.prior.rows[:, free]
    H = minimum.reduced.H[np.ix_(free, free)]
    used = float(np.trace(np.linalg.solve(H + variance * rows.T @ rows, H)))
    explained = minimum.reduced.angles_free + used
    if explained > 0.8 * seen:
        return NOISE_UNKNOWN * problem.unit, False
    return max(residual_sd(squares, seen, explained), NOISE_LEAST * problem.unit), True


def _alternate(
    problem: SharedProblem,
    point: Point,
    variance: float,
    lengths: Bools,
    shifts: Bools,
    most: int,
    after_step: Callable[[], None],
) -> Minimum:
    """Estimate lengths and marker positions in turn, as [D] 3.2.1 (b) and (c).

    First angles and lengths, then marker positions at fixed angles, until neither moves.

    Parameters
    ----------
    variance : of a marker along one axis [m^2]
    lengths, shifts : (unknowns,) which are estimated in each turn
    most : at most so many turns
    """
    costs: list[float] = []
    for _ in range(most):
        minimum = minimise(problem, point, variance, lengths, 3)
        x = place_at_fixed_angles(problem, minimum, variance, shifts)
        point = settle(problem, x, minimum.point.angles, variance)
        costs.append(point.cost + variance * problem.prior_cost(x, point.angles))
        after_step()
        converged = len(costs) > 1 and costs[-2] - costs[-1] <= 1e-5 * costs[-1]
        if converged:
            break
    # No step of all together: what both searches leave, with the equations there.
    still = minimise(problem, point, variance, lengths | shifts, 0)
    return replace(still, costs=tuple(costs), converged=converged)
