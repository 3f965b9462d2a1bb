"""Unknowns and what is known of them: parts that add up to one problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.fit.residuals import (
    Evaluation,
    Following,
    NormalEquations,
    Residuals,
    own_prior,
)
from myomorph.core.fit.unknowns import Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.provenance import Source


@dataclass(frozen=True)
class Problem:
    """What is to be estimated, and from what.

    Attributes
    ----------
    unknowns : in blocks, some of which may be held; priors of their own count as known
    residuals : measurements, and priors that tie unknowns to each other
    sources : what the residuals were made from
    """

    unknowns: Unknowns
    residuals: tuple[Residuals, ...]
    sources: tuple[Source, ...] = ()

    def __post_init__(self) -> None:
        for one in self.residuals:
            for block in one.blocks:
                check_name("unknowns", block, self.unknowns.slices, f"the problem of '{one.name}'")

    def __add__(self, other: Problem) -> Problem:
        """One problem of both: what both do not know is there once."""
        return Problem(
            unknowns=self.unknowns + other.unknowns,
            residuals=self.residuals + other.residuals,
            sources=tuple(dict.fromkeys(self.sources + other.sources)),
        )

    @cached_property
    def known(self) -> tuple[Residuals, ...]:
        """The residuals, and the priors of the unknowns themselves."""
        own = own_prior(self.unknowns)
        return (*self.residuals, own) if len(own.right) else self.residuals

    @cached_property
    def columns(self) -> tuple[NDArray[np.intp], ...]:
        """Of each of `known`, which unknowns its equations are of."""
        return tuple(self.unknowns.index(one.blocks) for one in self.known)

    def at(self, x: Array | None = None, before: Evaluated | None = None) -> Evaluated:
        """Evaluate all residuals.

        Parameters
        ----------
        x : (unknowns,) the point; by default the start
        before : the point that the search came from; see `Residuals.at`

        Returns
        -------
        what each residual leaves
        """
        x = np.array(self.unknowns.start if x is None else x)
        values = Values(self.unknowns, x)
        begin: Sequence[Evaluation | None] = (
            [None] * len(self.known) if before is None else before.parts
        )
        parts = [one.at(values, last) for one, last in zip(self.known, begin, strict=True)]
        return Evaluated(problem=self, x=x, parts=tuple(parts))


class Equations(NamedTuple):
    """Normal equations of all unknowns: of what was measured, and of what was known before."""

    data: NormalEquations
    prior: NormalEquations

    @property
    def all(self) -> NormalEquations:
        """Of both together."""
        return NormalEquations(H=self.data.H + self.prior.H, g=self.data.g + self.prior.g)


class Damped(NamedTuple):
    """Normal equations of all unknowns together, their diagonals raised.

    Attributes
    ----------
    H, g : (unknowns, unknowns), (unknowns,); own unknowns of residuals are eliminated
    gain : what these alone take off the cost
    """

    H: Array
    g: Array
    gain: float


@read_only
class Evaluated:
    """All residuals of a problem at one point.

    Attributes
    ----------
    problem : with the residuals
    x : (unknowns,)
    parts : of each of the problem's `known`
    """

    problem: Problem
    x: Array
    parts: tuple[Evaluation, ...]

    @property
    def cost(self) -> float:
        """Sum of squares, each in units of its noise."""
        return float(sum(part.cost for part in self.parts))

    @cached_property
    def equations(self) -> Equations:
        """Normal equations there, made once."""
        problem = self.problem
        count = len(problem.unknowns)
        H = {prior: np.zeros((count, count)) for prior in (False, True)}
        g = {prior: np.zeros(count) for prior in (False, True)}
        for one, part, index in zip(problem.known, self.parts, problem.columns, strict=True):
            equations = part.normal()
            H[one.prior][np.ix_(index, index)] += equations.H
            g[one.prior][index] += equations.g
        return Equations(
            data=NormalEquations(H=H[False], g=g[False]),
            prior=NormalEquations(H=H[True], g=g[True]),
        )

    @property
    def follows(self) -> bool:
        """Whether residuals have unknowns of their own that step with the others."""
        return any(isinstance(part, Following) for part in self.parts)

    def damped(self, damping: float) -> Damped:
        """Add up the equations of all residuals, each with its diagonal raised.

        Parameters
        ----------
        damping : share of the diagonals that is added
        """
        problem = self.problem
        H = np.zeros((len(self.x), len(self.x)))
        g = np.zeros(len(self.x))
        gain = 0.0
        for part, index in zip(self.parts, problem.columns, strict=True):
            if isinstance(part, Following):
                equations, own_gain = part.damped(damping)
                raised = equations.H
                gain += own_gain
            else:
                equations = part.normal()
                raised = equations.H + damping * np.diag(np.diag(equations.H))
            H[np.ix_(index, index)] += raised
            g[index] += equations.g
        return Damped(H=H, g=g, gain=gain)

    def without(self, name: str) -> Evaluated:
        """Leave out residuals that moved the estimate but are no information about it.

        Parameters
        ----------
        name : of the residuals
        """
        kept = [index for index, one in enumerate(self.problem.known) if one.name != name]
        residuals = tuple(one for one in self.problem.residuals if one.name != name)
        return Evaluated(
            problem=replace(self.problem, residuals=residuals),
            x=self.x,
            parts=tuple(self.parts[index] for index in kept),
        )

    def stepped(self, damping: float, step: Array) -> Evaluated:
        """Move the own unknowns of residuals along with a step.

        Parameters
        ----------
        damping : with which the step was found
        step : (unknowns,)

        Returns
        -------
        where the evaluation of the next point begins
        """
        parts = [
            part.stepped(damping, step[index]) if isinstance(part, Following) else part
            for part, index in zip(self.parts, self.problem.columns, strict=True)
        ]
        return replace(self, parts=tuple(parts))
