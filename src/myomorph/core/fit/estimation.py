"""An estimate: what was not known, from what it was found, how sure it is, and whether it helps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.solver import Method, Search, Solution, minimize
from myomorph.core.fit.unknowns import Unknowns
from myomorph.core.fit.verdict import Verdict, held_out
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.provenance import Source


@read_only
class Explained:
    """How well one source of residuals is explained.

    Attributes
    ----------
    name : of the residuals
    prior : whether it was known before anything was measured
    count : how many numbers were compared
    cost : sum of squares, each in units of its noise
    """

    name: str
    prior: bool
    count: int
    cost: float

    @property
    def rms(self) -> float:
        """Root mean square misfit in units of the noise; about 1 where the noise is right."""
        return float(np.sqrt(self.cost / max(self.count, 1)))


@read_only
class Estimate:
    """Unknowns that were estimated together.

    It certifies itself: how the search ended, what each source of residuals has left, and what it
    was made from.

    Attributes
    ----------
    unknowns : in the order of all vectors
    explained : each source of residuals at the solution
    search : how it ended
    posterior : where, and what is left open
    verdict : on what was held out; None where nothing was
    sources : what it was made from
    """

    unknowns: Unknowns
    explained: tuple[Explained, ...]
    search: Search
    posterior: Posterior
    verdict: Verdict | None = None
    sources: tuple[Source, ...] = ()

    @property
    def values(self) -> Mapping[str, Array]:
        """Block to its values."""
        slices = self.unknowns.slices
        return FrozenMap({name: self.posterior.x[part] for name, part in slices.items()})

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.search.converged

    @property
    def fitted(self) -> tuple[str, ...]:
        """Names of the unknowns that were searched for."""
        pairs = zip(self.unknowns.names, self.posterior.free, strict=True)
        return tuple(name for name, free in pairs if free)

    @property
    def certificate(self) -> tuple[str, ...]:
        """What a reader has to know before they believe it, one line each."""
        search = self.search
        status = f"{search.status} after {search.steps} steps, change {search.change:.1g}"
        left = [
            f"{one.name}: {one.count} numbers, misfit {one.rms:.3g} SD"
            for one in self.explained
            if not one.prior
        ]
        verdict = () if self.verdict is None else (self.verdict.sentence,)
        return (status, *left, *self.posterior.not_shown, *verdict)


def estimate(
    problem: Problem,
    fit: Sequence[str] | None = None,
    *,
    method: Method | None = None,
    hold_out: Sequence[str] = (),
    progress: Callable[[], None] = lambda: None,
) -> Estimate:
    """Estimate some unknowns of a problem, or all, from everything that is known of them.

    Parameters
    ----------
    problem : unknowns and residuals; problems that share unknowns add up by `+`
    fit : names of the blocks that are estimated together, by default all; others stay at the start
    method : when the search ends; see `Method`
    hold_out : names of residuals that are predicted, each without itself, for the verdict
    progress : called after each linearization

    Returns
    -------
    values with everything that certifies them

    Raises
    ------
    UnknownName : `fit` names what the problem does not have

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> time = np.arange(0.0, 1.0, 0.1)
    >>> unknowns = (mm.fit.Unknown(name="offset"), mm.fit.Unknown(name="slope"))
    >>> line = mm.fit.Block(name="line", unknowns=unknowns)
    >>> measured = mm.fit.Measured(
    ...     name="positions",
    ...     blocks=("line",),
    ...     function=lambda values: values["line"][0] + values["line"][1] * time - (1 + 2 * time),
    ...     sd=0.01,
    ... )
    >>> found = mm.fit.estimate(mm.fit.Problem(mm.fit.Unknowns((line,)), (measured,)))
    >>> [round(float(value), 6) for value in found.values["line"]]
    [1.0, 2.0]
    >>> found.converged
    True
    """
    solution = minimize(problem, None, fit, method, progress)
    verdict = held_out(problem, hold_out, fit, method, progress) if hold_out else None
    return estimate_of(solution, verdict=verdict)


def estimate_of(
    solution: Solution,
    *,
    posterior: Posterior | None = None,
    verdict: Verdict | None = None,
) -> Estimate:
    """Certify a solution that was found in stages of its own.

    Parameters
    ----------
    solution : of the last stage
    posterior : by default `Posterior.of`
    verdict : on what was held out; see `held_out`

    Returns
    -------
    the solution with what certifies it

    Examples
    --------
    >>> import myomorph as mm
    >>> from myomorph.core.fit.solver import minimize
    >>> from myomorph.core.fit.estimation import estimate_of
    >>> gain = mm.fit.Block(name="gain", unknowns=(mm.fit.Unknown(name="gain", mean=2.0, sd=1.0),))
    >>> solution = minimize(mm.fit.Problem(mm.fit.Unknowns((gain,)), ()))
    >>> estimate_of(solution).values["gain"].round(6).tolist()
    [2.0]
    """
    problem = solution.problem
    explained = tuple(
        Explained(name=one.name, prior=one.prior, count=part.count, cost=part.cost)
        for one, part in zip(problem.known, solution.at.parts, strict=True)
    )
    return Estimate(
        unknowns=problem.unknowns,
        explained=explained,
        search=solution.search,
        posterior=posterior or Posterior.of(solution),
        verdict=verdict,
        sources=problem.sources,
    )
