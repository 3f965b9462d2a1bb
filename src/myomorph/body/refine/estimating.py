"""The problem of motion, body and masses as unknowns and residuals of `core/fit`.

Motions are unknowns of the recordings' own: their coefficients are banded, are eliminated, and step
with lengths, marker positions and masses. What is not fitted is held.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from myomorph.body.refine.equations import Equations, data_cost, linearize_data, prior_rows
from myomorph.body.refine.problem import Problem, Unknowns, moved_masses
from myomorph.core.fit.banded import Reduced, reduce_banded
from myomorph.core.fit.problem import Problem as FitProblem
from myomorph.core.fit.residuals import NormalEquations, Rows
from myomorph.core.fit.unknowns import Block, Unknown, Values
from myomorph.core.fit.unknowns import Unknowns as FitUnknowns
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import PARAMETERS

LENGTHS = "lengths"
MARKERS = "markers"
MASSES = "masses"
MIN_FACTOR = 0.3  # Of a length: below it nothing that was computed means anything


@dataclass(frozen=True, eq=False)
class MassChart:
    """A step of masses: small changes of pseudo-inertias, so that every link stays some body's.

    Attributes
    ----------
    problem : with the links that move
    """

    problem: Problem

    def __call__(self, values: Array, step: Array) -> Array:
        """Change the parameters of all links.

        Parameters
        ----------
        values : (10 bodies,) inertial parameters
        step : (10 bodies,) scaled triangles of E, of the links that move

        Returns
        -------
        (10 bodies,) with the same whole mass
        """
        links = self.problem.prior.moved
        entries = step.reshape(-1, 10)[links]
        return moved_masses(self.problem, values.reshape(-1, 10), entries).ravel()


def unknowns_of(problem: Problem, at: Unknowns) -> FitUnknowns:
    """List what is fitted, beginning at a point.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    blocks of lengths, markers and masses, in the order of `Problem.columns`
    """
    blocks = []
    if problem.body:
        lengths = [
            Unknown(
                name=f"{length.name} length",
                where=f"model: length {length.name}",
                start=float(factor),
                low=MIN_FACTOR,
            )
            for length, factor in zip(problem.lengths, at.factors, strict=True)
        ]
        axes = [(name, axis) for name in problem.names for axis in "xyz"]
        shifts = [
            Unknown(
                name=f"{name} {axis}",
                unit="m",
                where=f"marker {name}: {axis} on its body",
                start=float(shift),
            )
            for (name, axis), shift in zip(axes, at.shifts.ravel(), strict=True)
        ]
        blocks.append(Block(name=LENGTHS, unknowns=tuple(lengths)))
        blocks.append(Block(name=MARKERS, unknowns=tuple(shifts)))
    if problem.masses:
        blocks.append(_mass_block(problem, at))
    return FitUnknowns(tuple(blocks))


def _mass_block(problem: Problem, at: Unknowns) -> Block:
    """List the inertial parameters of all links; those without a mass worth changing are fixed."""
    moves = np.zeros(len(at.parameters), bool)
    moves[problem.prior.moved] = True
    unknowns = [
        Unknown(
            name=f"{body} {parameter}",
            where=f"body {body}: inertial parameter {parameter}",
            start=float(at.parameters[link, number]),
            fixed=not moves[link],
        )
        for link, body in enumerate(problem.model.body_names)
        for number, parameter in enumerate(PARAMETERS)
    ]
    return Block(name=MASSES, unknowns=tuple(unknowns), chart=MassChart(problem))


def point_of(at: Unknowns, values: Values) -> Unknowns:
    """Put fitted values into a point; the rest of it is held.

    Parameters
    ----------
    at : point
    values : of what is fitted
    """
    fitted = values.unknowns.slices
    if LENGTHS in fitted:
        at = replace(at, factors=values[LENGTHS])
    if MARKERS in fitted:
        at = replace(at, shifts=values[MARKERS].reshape(at.shifts.shape))
    if MASSES in fitted:
        at = replace(at, parameters=values[MASSES].reshape(at.parameters.shape))
    return at


def columns_of(problem: Problem) -> np.ndarray:
    """Find where the shared unknowns of the equations stand among those of the blocks.

    Parameters
    ----------
    problem : with what is unknown

    Returns
    -------
    (shared,) the equations have the links that move alone
    """
    first = problem.columns()[2].start
    links = (10 * problem.prior.moved[:, None] + np.arange(10)).ravel()
    masses = first + links if problem.masses else np.zeros(0, np.int64)
    return np.concatenate([np.arange(first), masses])


def _widened(problem: Problem, equations: NormalEquations) -> NormalEquations:
    """Spread equations of the shared unknowns over the unknowns of the blocks."""
    index = columns_of(problem)
    count = problem.columns()[2].start + (problem.prior.reference.size if problem.masses else 0)
    H = np.zeros((count, count))
    g = np.zeros(count)
    H[np.ix_(index, index)] = equations.H
    g[index] = equations.g
    return NormalEquations(H=H, g=g)


@dataclass(frozen=True, eq=False)
class RecordingsAt:
    """Markers and plates of all trials at a point, with motions of their own.

    Attributes
    ----------
    problem : with the trials
    at : point, motions included
    """

    problem: Problem
    at: Unknowns
    _reductions: dict[float, Reduced] = field(default_factory=dict)

    @cached_property
    def cost(self) -> float:
        """Sum of squares, each in units of its noise."""
        return data_cost(self.problem, self.at)

    @property
    def count(self) -> int:
        """Count of recorded numbers."""
        seen = sum(int(np.isfinite(trial.observed).sum()) for trial in self.problem.trials)
        return seen + 6 * sum(int(trial.use.sum()) for trial in self.problem.trials)

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
        return _widened(self.problem, reduced.equations), reduced.gain

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
        steps = self.reduced(damping).own_steps(step[columns_of(self.problem)])
        motions = tuple(
            motion + change.reshape(motion.shape)
            for motion, change in zip(self.at.motions, steps, strict=True)
        )
        return RecordingsAt(problem=self.problem, at=replace(self.at, motions=motions))


@dataclass(frozen=True, eq=False)
class RecordingResiduals:
    """Markers and plates of all trials as residuals of lengths, marker positions and masses.

    Attributes
    ----------
    problem : with the trials
    begin : point whose motions the search begins with
    blocks : that are fitted
    name, prior : of these residuals; they are no prior
    """

    problem: Problem
    begin: Unknowns
    blocks: tuple[str, ...]
    name: str = field(default="markers and plates", init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: RecordingsAt | None = None) -> RecordingsAt:
        """Evaluate markers and plates with the motions of the evaluation before.

        Parameters
        ----------
        values : of what is fitted
        before : with motions that stepped along; None begins with `begin`
        """
        motions = (self.begin if before is None else before.at).motions
        point = replace(point_of(self.begin, values), motions=motions)
        return RecordingsAt(problem=self.problem, at=point)


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """What is held likely beforehand of lengths, marker positions and masses.

    Attributes
    ----------
    problem : with the priors
    begin : point with what is held
    blocks : that are fitted
    name, prior : of these residuals; they are a prior
    """

    problem: Problem
    begin: Unknowns
    blocks: tuple[str, ...]
    name: str = field(default="body as given", init=False)
    prior: bool = field(default=True, init=False)

    def at(self, values: Values, before: Rows | None = None) -> Rows:
        """Compute misfits in standard deviations.

        Parameters
        ----------
        values : of what is fitted
        before : not needed
        """
        known = prior_rows(self.problem, point_of(self.begin, values))
        misses = np.concatenate([np.zeros(0), *(miss for _, _, miss in known)])
        slopes = np.zeros((len(misses), len(values.x)))
        index = columns_of(self.problem)
        first = 0
        for columns, rows, miss in known:
            slopes[first : first + len(miss), index[columns]] = rows
            first += len(miss)
        return Rows(residuals=misses, slopes=slopes[:, values.unknowns.index(self.blocks)])


def as_fit(problem: Problem, begin: Unknowns) -> FitProblem:
    """State the problem as unknowns and residuals, beginning at a point.

    Parameters
    ----------
    problem : with what is unknown
    begin : point
    """
    unknowns = unknowns_of(problem, begin)
    blocks = tuple(unknowns.slices)
    recordings = RecordingResiduals(problem=problem, begin=begin, blocks=blocks)
    prior = BodyPrior(problem=problem, begin=begin, blocks=blocks)
    return FitProblem(unknowns, (recordings, prior))
