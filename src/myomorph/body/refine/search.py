"""The search for motion, body and masses in `core/fit`, and what is known at its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from myomorph.body.identify.link_prior import LINK_SD
from myomorph.body.refine.equations import with_trust
from myomorph.body.refine.estimating import RecordingsAt, as_fit
from myomorph.body.refine.mass_prior import MassPrior
from myomorph.body.refine.point import Point
from myomorph.body.refine.problem import Problem
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.solver import Method, Search, minimize
from myomorph.core.fit.solver import Solution as FitSolution
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import read_only

LEAST_GAIN = 1e-3  # A step that lowers the cost by a smaller share is the last


@read_only
class Solution:
    """Where the search ended.

    Attributes
    ----------
    problem : with the weights of frames that it was solved with
    at : point
    search : how it ended
    """

    problem: Problem
    at: Point
    search: Search

    @property
    def converged(self) -> bool:
        """Whether the last step was small, or none lowers the cost."""
        return self.search.converged


def settle(
    problem: Problem, progress: Callable[[], None] = lambda: None, first: Point | None = None
) -> Solution:
    """Find the optimum, from that of the motions alone.

    That shows the frames that nothing explains.

    Parameters
    ----------
    problem : with what is unknown
    progress : called once a step
    first : of the motions alone, see `motions_alone`; found here by default
    """
    first = motions_alone(problem, progress) if first is None else first
    return solve(with_trust(problem, first), first, progress)


def motions_alone(problem: Problem, progress: Callable[[], None] = lambda: None) -> Point:
    """Find the optimum of the motions on the body as given.

    Parameters
    ----------
    problem : with what is unknown
    progress : called once a step
    """
    still = replace(problem, fit=())
    return solve(still, still.begin(), progress).at


def solve(problem: Problem, start: Point, progress: Callable[[], None] = lambda: None) -> Solution:
    """Search by Levenberg-Marquardt from a start.

    Parameters
    ----------
    problem : with what is unknown
    start : point
    progress : called once a step

    Returns
    -------
    the optimum, or where steps ended
    """
    method = Method(
        iterations=problem.options.iterations,
        min_gain=LEAST_GAIN,
        min_promise=0.0,
        kink=LEAST_GAIN,
    )
    ended = minimize(as_fit(problem, start), method=method, progress=progress)
    recordings = ended.at.parts[0]
    assert isinstance(recordings, RecordingsAt)
    return Solution(problem=problem, at=recordings.at, search=ended.search)


def certified(solution: Solution, verdict: Verdict | None = None) -> Estimate:
    """Judge what recordings leave open of all fitted unknowns, motions unknown too.

    Masses that are identified first come from the same recordings, so that they are no prior
    knowledge: links are taken to differ from the given model by `LINK_SD`, as in `identify`.

    Parameters
    ----------
    solution : of the search
    verdict : on what was held out

    Returns
    -------
    the estimate, whose covariance is that of lengths, positions and parameters in their own units
    """
    problem = solution.problem
    masses = problem.masses
    loose = MassPrior.of(masses.mass_prior.reference, LINK_SD)
    problem = problem.with_kind(replace(masses, mass_prior=loose))
    fit = as_fit(problem, solution.at, in_units=True)
    at = fit.at()
    ended = FitSolution(x=at.x, free=fit.unknowns.free(), at=at, search=solution.search)
    return estimate_of(ended, verdict=verdict)
