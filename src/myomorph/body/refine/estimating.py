"""The problem of motion, body and masses as unknowns and residuals of `core/fit`.

Motions are unknowns of the recordings' own: their coefficients are banded, are eliminated, and step
with all others. What is not fitted is held.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from myomorph.body.refine.equations import Equations, data_cost, linearize_data
from myomorph.body.refine.kind import Kind
from myomorph.body.refine.point import Point
from myomorph.body.refine.problem import Problem
from myomorph.core.fit.banded import Reduced, reduce_banded
from myomorph.core.fit.problem import Problem as FitProblem
from myomorph.core.fit.residuals import NormalEquations, Rows
from myomorph.core.fit.unknowns import Block, Unknowns, Values
from myomorph.core.model.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """How shared steps of the equations stand among unknowns of the blocks.

    Attributes
    ----------
    problem : whose fitted kinds are estimated
    in_units : unknowns step in their own units, as intervals need it; else kinds choose, as the
        search does
    at : point at which units are converted
    """

    problem: Problem
    in_units: bool
    at: Point

    @cached_property
    def unknowns(self) -> Unknowns:
        """Blocks of the fitted kinds, which begin at the point."""
        return Unknowns(tuple(map(self._block, self.problem.fitted)))

    def _block(self, kind: Kind) -> Block:
        values = self.at[kind.name]
        return kind.block_in_units(values) if self.in_units else kind.block(values)

    @cached_property
    def columns(self) -> np.ndarray:
        """(shared,) places of the steps among the unknowns."""
        slices = self.unknowns.slices
        places = [slices[kind.name].start + kind.columns for kind in self.problem.fitted]
        return np.concatenate([np.zeros(0, np.int64), *places])

    @cached_property
    def _steps(self) -> Array | None:
        """(shared, shared) steps of the equations in those of the unknowns; None for the same."""
        if not self.in_units:
            return None
        blocks = []
        for kind in self.problem.fitted:
            units = kind.units(self.at[kind.name])
            same = np.eye(len(kind.columns))
            blocks.append(same if units is None else np.linalg.inv(units))
        return np.asarray(scipy.linalg.block_diag(*blocks)) if blocks else np.zeros((0, 0))

    def spread(self, equations: NormalEquations) -> NormalEquations:
        """Turn equations of the shared steps into those of the blocks' unknowns.

        Parameters
        ----------
        equations : (shared, shared), (shared,)
        """
        H = equations.H
        g = equations.g
        if self._steps is not None:
            H = self._steps.T @ H @ self._steps
            g = self._steps.T @ g
        count = len(self.unknowns)
        all_H = np.zeros((count, count))
        all_g = np.zeros(count)
        all_H[np.ix_(self.columns, self.columns)] = H
        all_g[self.columns] = g
        return NormalEquations(H=all_H, g=all_g)

    def shared_step(self, step: Array) -> Array:
        """Take the shared steps of a step of the blocks.

        Parameters
        ----------
        step : (unknowns,)

        Returns
        -------
        (shared,)
        """
        shared = step[self.columns]
        return shared if self._steps is None else self._steps @ shared

    def point(self, values: Values) -> Point:
        """Put fitted values into the point; the rest of it is held."""
        fitted = values.unknowns.slices
        return self.at.with_values(
            {name: values[name].reshape(self.at[name].shape) for name in fitted}
        )


@dataclass(frozen=True, eq=False)
class RecordingsAt:
    """Markers and plates of all trials at a point, with motions of their own.

    Attributes
    ----------
    layout : of the unknowns
    at : point, motions included
    """

    layout: Layout
    at: Point
    _reductions: dict[float, Reduced] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """With the trials."""
        return self.layout.problem

    @cached_property
    def cost(self) -> float:
        """Sum of squares, each in units of its noise."""
        return data_cost(self.problem, self.at)

    @property
    def count(self) -> int:
        """Count of recorded numbers."""
        trials = self.problem.trials
        seen = sum(int(np.isfinite(trial.observed).sum()) for trial in trials)
        return seen + 6 * sum(int(trial.use.sum()) for trial in trials)

    @cached_property
    def equations(self) -> Equations:
        """Normal equations of motions and shared unknowns."""
        return linearize_data(self.problem, self.at)

    def reduced(self, damping: float) -> Reduced:
        """Eliminate motions.

        Parameters
        ----------
        damping : share of the diagonals that is added
        """
        if damping not in self._reductions:
            shared = NormalEquations(H=self.equations.H, g=self.equations.g)
            self._reductions.clear()
            self._reductions[damping] = reduce_banded(self.equations.trials, shared, damping)
        return self._reductions[damping]

    def normal(self) -> NormalEquations:
        """Return the equations of the blocks' unknowns, motions eliminated."""
        return self.damped(0.0)[0]

    def damped(self, damping: float) -> tuple[NormalEquations, float]:
        """Return the same with raised diagonals, and what motions alone take off the cost.

        Parameters
        ----------
        damping : share of the diagonals that is added
        """
        reduced = self.reduced(damping)
        return self.layout.spread(reduced.equations), reduced.gain

    def stepped(self, damping: float, step: Array) -> RecordingsAt:
        """Move the motions along with a step.

        Parameters
        ----------
        damping : with which it was found
        step : (unknowns of the blocks,)

        Returns
        -------
        the point with these motions
        """
        steps = self.reduced(damping).own_steps(self.layout.shared_step(step))
        motions = tuple(
            motion + change.reshape(motion.shape)
            for motion, change in zip(self.at.motions, steps, strict=True)
        )
        return RecordingsAt(layout=self.layout, at=replace(self.at, motions=motions))


@dataclass(frozen=True, eq=False)
class RecordingResiduals:
    """Markers and plates of all trials as residuals of the fitted kinds.

    Attributes
    ----------
    layout : of the unknowns, with the point whose motions the search begins with
    name, prior : of these residuals; they are no prior
    """

    layout: Layout
    name: str = field(default="markers and plates", init=False)
    prior: bool = field(default=False, init=False)

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the fitted kinds."""
        return tuple(self.layout.unknowns.slices)

    def at(self, values: Values, before: RecordingsAt | None = None) -> RecordingsAt:
        """Evaluate markers and plates with the motions of the evaluation before.

        Parameters
        ----------
        values : of what is fitted
        before : with motions that stepped along; None begins with those of the layout's point
        """
        motions = (self.layout.at if before is None else before.at).motions
        point = replace(self.layout.point(values), motions=motions)
        return RecordingsAt(layout=self.layout, at=point)


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """What is held likely beforehand of all fitted kinds.

    Attributes
    ----------
    layout : of the unknowns
    name, prior : of these residuals; they are a prior
    """

    layout: Layout
    name: str = field(default="body as given", init=False)
    prior: bool = field(default=True, init=False)

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the fitted kinds."""
        return tuple(self.layout.unknowns.slices)

    def at(self, values: Values, before: PriorAt | None = None) -> PriorAt:
        """Compute misfits in standard deviations.

        Parameters
        ----------
        values : of what is fitted
        before : not needed
        """
        problem = self.layout.problem
        point = self.layout.point(values)
        known = [kind.prior_rows(point[kind.name]) for kind in problem.fitted]
        misses = np.concatenate([np.zeros(0), *(each.misses for each in known)])
        slopes = np.zeros((len(misses), problem.count))
        first = 0
        for kind, each in zip(problem.fitted, known, strict=True):
            last = first + len(each.misses)
            slopes[first:last, problem.columns[kind.name]] = each.rows
            first = last
        return PriorAt(layout=self.layout, rows=Rows(residuals=misses, slopes=slopes))


@dataclass(frozen=True, eq=False)
class PriorAt:
    """What is known beforehand, at some values.

    Attributes
    ----------
    layout : of the unknowns
    rows : in the shared steps
    """

    layout: Layout
    rows: Rows

    @property
    def cost(self) -> float:
        """Sum of squares, each in standard deviations."""
        return self.rows.cost

    @property
    def count(self) -> int:
        """Count of rows."""
        return self.rows.count

    def normal(self) -> NormalEquations:
        """Return the equations of the blocks' unknowns."""
        return self.layout.spread(self.rows.normal())


def as_fit(problem: Problem, begin: Point, in_units: bool = False) -> FitProblem:
    """State the problem as unknowns and residuals, beginning at a point.

    Parameters
    ----------
    problem : with what is unknown
    begin : point
    in_units : unknowns step in their own units, as intervals need it
    """
    layout = Layout(problem=problem, in_units=in_units, at=begin)
    residuals = (RecordingResiduals(layout), BodyPrior(layout))
    return FitProblem(unknowns=layout.unknowns, residuals=residuals)
