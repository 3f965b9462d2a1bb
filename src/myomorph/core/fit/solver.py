"""Damped Gauss-Newton with bounds (Levenberg-Marquardt): the one search of all estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from myomorph.core.fit.bounds import bounded_step
from myomorph.core.fit.problem import Damped, Evaluated, Problem
from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array, read_only

Status = Literal["converged", "no step lowers the cost", "iteration limit"]
CONVERGED: Status = "converged"
NO_LOWER: Status = "no step lowers the cost"
LIMIT: Status = "iteration limit"

DAMPING = 1e-6  # Relative to the diagonal, at first
MIN_DAMPING = 1e-9
MAX_DAMPING = 1e6
NEVER = -1.0  # A tolerance that no change meets
ROUNDING = 1e-12  # Share by which a cost may rise and count as equal
RELEASE = 0.7  # Factor on the stiffness of an unknown whose steps do not turn back


@dataclass(frozen=True, kw_only=True)
class Method:
    """When the search ends, and how far it trusts its quadratic model.

    Attributes
    ----------
    iterations : linearizations at most
    tolerance : the search ends where no unknown moves further, in its `scale`; not where residuals
        have unknowns of their own
    min_gain : it ends too where a step lowers the cost by a smaller share
    min_promise : a step that did not lower the cost is damped further only where it promised a
        larger share; `min_gain` by default
    kink : where no step lowers the cost although one promised at most this share, the search has
        converged: what is eliminated frame by frame, or a bound there, bends the cost
    max_step : a step that moves an unknown further, in its `scale`, is not tried; a reweighted one
        is shortened
    reweighted : weights are made anew at each linearization, so that costs cannot be compared:
        every Gauss-Newton step is taken
    changes_in : of reweighted steps, what `tolerance` is measured in: the unknowns' "scales", or
        the "standard deviations" that data and priors leave them
    min_iterations : reweighted steps do not end before
    calm_steps : so many reweighted steps below the tolerance, one after the other, end the search
    stiffness, max_stiffness : share of its curvature that is added to an unknown whose reweighted
        steps go back and forth, as where what is eliminated reaches a bound and leaves it in turns:
        at first, doubled as long as they do, and at most; 0 adds none
    hidden_sd : no step moves along directions whose standard deviation is larger than this, in the
        unknowns' scales: they stay where they are; see `Posterior.of`
    """

    iterations: int = 50
    tolerance: float = 1e-6
    min_gain: float = 1e-12
    min_promise: float | None = None
    kink: float = 1e-4
    max_step: float = np.inf
    reweighted: bool = False
    changes_in: Literal["scales", "standard deviations"] = "scales"
    min_iterations: int = 1
    calm_steps: int = 1
    stiffness: float = 0.0
    max_stiffness: float = 64.0
    hidden_sd: float = np.inf


@read_only
class Search:
    """How a search ended, and how sure it is that this is the minimum.

    Attributes
    ----------
    status : how it ended
    costs : at the start and after each step
    change : largest of the last step, in the unknowns' scales; 0 without a step
    """

    status: Status
    costs: tuple[float, ...]
    change: float

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.status == CONVERGED

    @property
    def cost(self) -> float:
        """Sum of squares that is left."""
        return self.costs[-1]

    @property
    def steps(self) -> int:
        """Count of the steps done."""
        return len(self.costs) - 1


@read_only
class Solution:
    """Where a search ended.

    Attributes
    ----------
    x : (unknowns,)
    free : (unknowns,) which were searched for
    at : the residuals there; after reweighted steps, one step before
    search : how it ended
    """

    x: Array
    free: Bools
    at: Evaluated
    search: Search

    @property
    def problem(self) -> Problem:
        """The problem that was solved."""
        return self.at.problem

    @property
    def data(self) -> NormalEquations:
        """Normal equations of what was measured."""
        return self.at.equations.data

    @property
    def prior(self) -> NormalEquations:
        """Normal equations of what was known before."""
        return self.at.equations.prior

    @property
    def gradient(self) -> float:
        """Largest slope of the cost that bounds leave; 0 at a minimum.

        It is that for a change of an unknown by its scale, relative to the cost.
        """
        unknowns = self.problem.unknowns
        slope = (self.data.g + self.prior.g) * self.free
        held = ((self.at.x <= unknowns.low) & (slope > 0.0)) | (
            (self.at.x >= unknowns.high) & (slope < 0.0)
        )
        scale = np.where(np.isfinite(unknowns.scale), unknowns.scale, 0.0)
        sizes = np.abs(np.where(held, 0.0, slope)) * scale
        return float(sizes.max(initial=0.0)) / max(self.at.cost, 1e-300)


@dataclass(frozen=True, eq=False)
class _Model:
    """The quadratic model of the cost at a point, over the free unknowns.

    With the projection Q on hidden directions, in the unknowns' scales S, and P = 1 - Q, slope and
    curvature g, H become

        S^-1 P S g,    S^-1 (P S H S P + m Q) S^-1

    with any m > 0, so that no step has a part in a hidden direction.
    """

    problem: Problem
    at: Evaluated
    free: Bools
    hidden_sd: float

    @classmethod
    def of(
        cls,
        problem: Problem,
        at: Evaluated,
        free: Bools,
        hidden_sd: float,
        damping: float = 0.0,
    ) -> _Model:
        """Build the model at a point.

        Parameters
        ----------
        problem : unknowns and residuals
        at : the residuals at the point
        free : (unknowns,) which are searched for
        hidden_sd : of `Method`
        damping : that is tried first; own unknowns are eliminated with it
        """
        # What nothing shows stays where it is.
        if at.follows:
            shown = np.diag(at.damped(damping).H) > 0.0
        else:
            shown = np.diag(at.equations.data.H) + np.diag(at.equations.prior.H) > 0.0
        return cls(problem=problem, at=at, free=free & shown, hidden_sd=hidden_sd)

    @cached_property
    def _H(self) -> Array:
        """Curvature (free, free) of all directions."""
        data, prior = self.at.equations
        return (data.H + prior.H)[np.ix_(self.free, self.free)]

    @cached_property
    def _scale(self) -> Array:
        """Scales (free,) S, those that are infinite as 1."""
        scale = self.problem.unknowns.scale[self.free]
        return np.where(np.isfinite(scale), scale, 1.0)

    @cached_property
    def _hidden(self) -> Array | None:
        """Projection Q (free, free); None where no direction is hidden."""
        if np.isinf(self.hidden_sd):
            return None
        levels, directions = np.linalg.eigh(self._H * self._scale[:, None] * self._scale)
        hidden = directions[:, levels <= self.hidden_sd**-2]
        return hidden @ hidden.T if hidden.shape[1] else None

    @cached_property
    def g(self) -> Array:
        """Slope of half the cost (free,)."""
        data, prior = self.at.equations
        g = (data.g + prior.g)[self.free]
        if self._hidden is None:
            return g
        scaled = self._scale * g
        return (scaled - self._hidden @ scaled) / self._scale

    @property
    def sd(self) -> Array:
        """Standard deviations (unknowns,) of the free unknowns; infinite for the others."""
        sd = np.full(len(self.free), np.inf)
        sd[self.free] = np.sqrt(np.diag(NormalEquations(H=self._H, g=self.g).covariance))
        return sd

    def damped(self, damping: float | Array) -> Array:
        """Return the curvature of half the cost (free, free), its diagonal raised.

        Parameters
        ----------
        damping : share of the diagonal that is added, of all or (free,) of each
        """
        H = self._H + damping * np.diag(np.diag(self._H))
        if self._hidden is None:
            return H
        scaled = H * self._scale[:, None] * self._scale
        shown = np.eye(len(H)) - self._hidden
        raised = shown @ scaled @ shown + np.trace(scaled) * self._hidden
        return raised / self._scale[:, None] / self._scale

    def quadratic(self, damping: float | Array) -> Damped:
        """Return curvature and slope (free, free), (free,) of half the damped cost.

        Parameters
        ----------
        damping : share of the diagonal that is added, of all or (free,) of each; of all alone where
            residuals have unknowns of their own
        """
        if not self.at.follows:
            return Damped(H=self.damped(damping), g=self.g, gain=0.0)
        H, g, gain = self.at.damped(float(damping))
        return Damped(H=H[np.ix_(self.free, self.free)], g=g[self.free], gain=gain)

    def step(self, damping: float | Array) -> Array:
        """Return the step (unknowns,) to the minimum of the damped model within bounds.

        Parameters
        ----------
        damping : share of the diagonal that is added, of all or (free,) of each
        """
        unknowns = self.problem.unknowns
        x = self.at.x
        low = (unknowns.low - x)[self.free]
        high = (unknowns.high - x)[self.free]
        step = np.zeros(len(x))
        model = self.quadratic(damping)
        step[self.free] = bounded_step(model.H, model.g, low, high)
        return step

    def promised(self, step: Array, damping: float) -> float:
        """Return the share of the cost that a step takes off by the quadratic model.

        Own unknowns of residuals count as damped, so that they are eliminated once a step.

        Parameters
        ----------
        step : (unknowns,)
        damping : with which it was found
        """
        part = step[self.free]
        model = self.quadratic(damping if self.at.follows else 0.0)
        gain = model.gain - float(2.0 * model.g @ part + part @ model.H @ part)
        return gain / max(self.at.cost, 1e-300)


@dataclass(frozen=True, eq=False)
class _Tried:
    """Result of a search for a lower cost from one point.

    Attributes
    ----------
    at : the lower point; None where no step was accepted
    change : of the last step tried, in the unknowns' scales
    damping : to go on with
    small : whether the step became smaller than the tolerance
    promised : share of the cost that it should have taken off
    """

    at: Evaluated | None
    change: float
    damping: float
    small: bool
    promised: float


def minimize(
    problem: Problem,
    start: Evaluated | None = None,
    fit: Sequence[str] | None = None,
    method: Method | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Solution:
    """Find the values of the unknowns that explain measurements and priors best.

        minimize  sum_k |r_k(x)|^2,    low <= x <= high

    over all residuals r_k in units of their noise. A step d of the damped normal equations

        (H + damping diag H) d = -g,    H = sum J_k^T J_k,   g = sum J_k^T r_k

    within bounds is taken where it lowers the sum; else the damping grows tenfold.

    Source: Marquardt 1963, An algorithm for least-squares estimation of nonlinear parameters,
    Journal of the Society for Industrial and Applied Mathematics 11(2):431.

    Parameters
    ----------
    problem : unknowns and residuals
    start : the point to begin at, by default `problem.at()`
    fit : names of the blocks that are searched for, by default all; others stay at the start
    method : when the search ends; see `Method`
    progress : called after each linearization

    Returns
    -------
    the point, its equations, how the search ended

    Raises
    ------
    UnknownName : `fit` names a block that the problem does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> from myomorph.core.fit.solver import minimize
    >>> angle = mm.fit.Unknown(name="angle", unit="rad", start=0.1, high=0.5)
    >>> block = mm.fit.Block(name="angle", unknowns=(angle,))
    >>> far = mm.fit.Measured(
    ...     name="far", blocks=("angle",), function=lambda values: values["angle"] - 0.8
    ... )
    >>> found = minimize(mm.fit.Problem(mm.fit.Unknowns((block,)), (far,)))
    >>> found.x.tolist(), found.search.status
    ([0.5], 'converged')
    """
    method = method or Method()
    free = problem.unknowns.free(fit)
    at = problem.at() if start is None else start
    if method.reweighted:
        return _reweighted(at, free, method, progress)
    if at.follows:
        # Own unknowns of residuals may move on where the shared ones stay.
        method = replace(method, tolerance=NEVER)
    costs = [at.cost]
    damping = DAMPING
    change = 0.0
    status = LIMIT
    for _ in range(method.iterations):
        tried = _lower(_Model.of(problem, at, free, method.hidden_sd, damping), damping, method)
        damping = tried.damping
        change = tried.change
        progress()
        if tried.at is None:
            status = CONVERGED if tried.small or tried.promised <= method.kink else NO_LOWER
            break
        gained = 1.0 - tried.at.cost / max(at.cost, 1e-300)
        at = tried.at
        costs.append(at.cost)
        if change <= method.tolerance or gained < method.min_gain:
            status = CONVERGED
            break
    search = Search(status=status, costs=tuple(costs), change=change)
    return Solution(x=at.x, free=free, at=at, search=search)


def _lower(model: _Model, damping: float, method: Method) -> _Tried:
    """Damp until a step lowers the cost, or until one is not worth it.

    Parameters
    ----------
    model : of the cost at the point
    damping : to begin with, share of the diagonal
    method : when the search ends
    """
    unknowns = model.problem.unknowns
    at = model.at
    change = 0.0
    promised = 1.0
    min_promise = method.min_gain if method.min_promise is None else method.min_promise
    while damping < MAX_DAMPING and promised > min_promise:
        try:
            step = model.step(damping)
        except np.linalg.LinAlgError:
            # What the rows tie together but for rounding is told apart by damping alone.
            damping = damping * 10.0
            continue
        change = float(np.abs(step / unknowns.scale).max(initial=0.0))
        small = damping <= DAMPING and change <= method.tolerance
        promised = model.promised(step, damping)
        accepted = False
        if change <= method.max_step:
            x = unknowns.within(unknowns.moved(at.x, step))
            trial = model.problem.at(x, at.stepped(damping, step))
            accepted = trial.cost <= at.cost * (1.0 + ROUNDING)
        damping = max(damping * 0.1, MIN_DAMPING) if accepted else damping * 10.0
        if accepted or small:
            return _Tried(
                at=trial if accepted else None,
                change=change,
                damping=damping,
                small=small,
                promised=promised,
            )
    return _Tried(at=None, change=change, damping=damping, small=False, promised=promised)


def _reweighted(
    at: Evaluated, free: Bools, method: Method, progress: Callable[[], None]
) -> Solution:
    """Take Gauss-Newton steps with weights that follow the residuals; see `minimize`.

    Parameters
    ----------
    at : the point to begin at
    free : (unknowns,) which are searched for
    method : how steps are held back, and when they end
    progress : called after each linearization
    """
    problem = at.problem
    unknowns = problem.unknowns
    costs = [at.cost]
    status = LIMIT
    calm = 0
    stiffness = np.zeros(len(unknowns))
    last_step = np.zeros(len(unknowns))
    for number in range(1, method.iterations + 1):
        model = _Model.of(problem, at, free, method.hidden_sd)
        wanted = _shortened(model.step(stiffness[model.free]), unknowns.scale, method.max_step)
        x = unknowns.within(unknowns.moved(at.x, wanted))
        step = unknowns.taken(wanted, at.x, x)

        units = unknowns.scale if method.changes_in == "scales" else model.sd
        change = float(np.abs(step / units).max(initial=0.0))
        calm = calm + 1 if change < method.tolerance else 0
        progress()
        if calm >= method.calm_steps and number >= method.min_iterations:
            status = CONVERGED
        if status == CONVERGED or number == method.iterations:
            break
        stiffness = _stiffened(stiffness, turned=step * last_step < 0.0, method=method)
        last_step = step
        at = problem.at(x, at)
        costs.append(at.cost)
    search = Search(status=status, costs=tuple(costs), change=change)
    return Solution(x=x, free=free, at=at, search=search)


def _shortened(step: Array, scale: Array, max_step: float) -> Array:
    """Shorten a step that moves an unknown further than trusted.

    Parameters
    ----------
    step, scale : (unknowns,)
    max_step : in scales

    Returns
    -------
    (unknowns,)
    """
    farthest = float(np.abs(step / scale).max(initial=0.0))
    return step * (max_step / farthest) if farthest > max_step else step


def _stiffened(stiffness: Array, turned: Bools, method: Method) -> Array:
    """Hold unknowns whose steps turned back, and release the others.

    Only these, for all would be slow for the sake of two.

    Parameters
    ----------
    stiffness : (unknowns,) before, shares of the curvature
    turned : (unknowns,) whether the last step went back on the one before

    Returns
    -------
    (unknowns,)
    """
    held = np.clip(2.0 * stiffness, method.stiffness, method.max_stiffness)
    return np.where(turned & (method.stiffness > 0.0), held, RELEASE * stiffness)
