"""EMG gains as an estimate: unknowns, residuals and posterior of the regression on torques.

Gains g, offsets o and weights w are the parameters x = (g, o, w) of the whitened regression of
`emg_tracking`, whose squares are

    |A x - tau|^2 = x^T M x - 2 b^T x + tau^T tau,   M = A^T A,   b = A^T tau

Unknown are the logarithms u of the gains, whose prior is normal, offsets and weights:

    x = (exp u, o, w),   dx/du = diag(g),   u <= upper,   o >= 0,   w >= 0
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import LinearPrior, NormalEquations
from myomorph.core.fit.solver import Method, Solution
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only

GAINS = "gains"
OFFSETS = "offsets"
WEIGHTS = "weights"
"""Blocks of unknowns; the first are logarithms."""
METHOD = Method(iterations=50, tolerance=1e-6, max_step=float(np.log(3.0)))
"""A gain moves by a factor of 3 at most: the squares are no parabola of its logarithm."""
LEVEL = 0.4
COMMON = 1.0
SHARED = 0.7
APART = 0.5
"""Prior of gains: median of the activation at a channel's largest envelope where every channel is
in units of its own; median of the gain where all are in common units, as of maximum contractions;
standard deviations of the logarithm of what all channels share, and of each about it. Torque
decides where it says anything; this decides where it does not.
"""
ALIKE = 1.5
"""Largest envelopes that differ by no more than this factor are each channel's own unit."""
AT_MAXIMUM = 0.9
NEAR_MAXIMUM = 0.2
"""Median of the activation in a maximum voluntary contraction, and standard deviation of its
logarithm.
"""


class Prior(NamedTuple):
    """Normal prior of the logarithms of gains.

    Attributes
    ----------
    mean : (channels,)
    precision : (channels, channels)
    upper : (channels,) bounds
    """

    mean: Array
    precision: Array
    upper: Array


def gain_prior(peaks: Array, maxima: Array, shared: float = SHARED) -> Prior:
    """Prior of the logarithms of gains.

    Parameters
    ----------
    peaks : (channels,) largest envelope over all trials
    maxima : (channels,) envelope in a maximum voluntary contraction, NaN where none was measured
    shared : standard deviation of what all channels share

    Returns
    -------
    mean, precision and upper bound
    """
    known = np.isfinite(maxima)
    alive = peaks > 0.0
    largest = np.where(known, maxima, np.where(alive, peaks, 1.0))
    alike_units = np.ptp(np.log(peaks[alive])) < np.log(ALIKE) if alive.any() else True
    if alike_units:
        usual = np.log(LEVEL) - np.log(largest)
    else:
        usual = np.full(len(peaks), np.log(COMMON))
    upper = -np.log(largest)
    mean = np.where(known, np.log(AT_MAXIMUM) + upper, np.minimum(usual, upper))
    level = np.where(known, 0.0, shared)
    spread = np.where(known, NEAR_MAXIMUM, APART)
    covariance = np.diag(spread**2) + np.outer(level, level)
    return Prior(mean=mean, precision=np.linalg.inv(covariance), upper=upper)


class Squares(NamedTuple):
    """Squares that are a parabola of gains, offsets and weights x: x^T M x - 2 b^T x + constant.

    Attributes
    ----------
    matrix : (parameters, parameters) M
    slope : (parameters,) b
    square : the constant
    compared : how many independent numbers
    """

    matrix: Array
    slope: Array
    square: float
    compared: int


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class SquaresOfParameters:
    """Residuals, known by their squares, that are linear in gains, offsets and weights.

    Attributes
    ----------
    name, blocks, prior : see `Residuals` of `core/fit`; the blocks are all that there are
    squares : of the parameters
    bent : whether the bend of the logarithms counts as curvature: for steps, not for what is known
    """

    name: str
    blocks: tuple[str, ...]
    squares: Squares
    prior: bool = False
    bent: bool = True

    def at(self, values: Values, before: Any = None) -> _SquaresAt:
        """Evaluate the squares.

        Parameters
        ----------
        values : of the unknowns
        before : not used
        """
        gains = len(values[GAINS])
        x = parameters_of(values.unknowns, values.x)
        return _SquaresAt(squares=self.squares, x=x, gains=gains, bent=self.bent)


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class _SquaresAt:
    """Squares at some parameters.

    Attributes
    ----------
    squares : of the parameters
    x : (parameters,)
    gains : number of the first parameters, whose logarithms are unknown
    bent : see `SquaresOfParameters`
    """

    squares: Squares
    x: Array
    gains: int
    bent: bool

    @cached_property
    def _half_slope(self) -> Array:
        """Half the slope (parameters,) of the squares over x, M x - b."""
        return self.squares.matrix @ self.x - self.squares.slope

    @cached_property
    def cost(self) -> float:
        """The squares, x (M x - b) - b x + constant."""
        changing = self.x @ self._half_slope - self.squares.slope @ self.x
        return float(changing) + self.squares.square

    @property
    def count(self) -> int:
        """Count of the numbers that were compared."""
        return self.squares.compared

    def normal(self) -> NormalEquations:
        """Return the curvature and half the slope over the unknowns, g = D (M x - b).

        With D = diag(gains, 1, 1) the curvature is H = D M D, and of the logarithms' bend

            H_ii = (D M D)_ii + g_i

        as far as that is above 0: without it steps would go back and forth about the minimum.
        """
        rates = np.ones(len(self.x))
        rates[: self.gains] = self.x[: self.gains]
        g = rates * self._half_slope
        H = self.squares.matrix * rates[:, None] * rates
        if self.bent:
            gains = np.arange(self.gains)
            H[gains, gains] += np.maximum(g[: self.gains], 0.0)
        return NormalEquations(H=H, g=g)


def parameters_of(unknowns: Unknowns, x: Array) -> Array:
    """Gains, offsets and weights of values of the unknowns.

    Parameters
    ----------
    unknowns : of `gain_unknowns`
    x : (unknowns,)

    Returns
    -------
    (parameters,)
    """
    parameters = np.array(x)
    gains = unknowns.slices[GAINS]
    parameters[gains] = np.exp(parameters[gains])
    return parameters


def gain_unknowns(
    channels: Sequence[str], prior: Prior, offsets: bool, weights: Sequence[str]
) -> Unknowns:
    """State what is not known: logarithms of gains, offsets, weights of unmeasured muscles.

    Parameters
    ----------
    channels : names
    prior : of the gains, with their upper bounds
    offsets : whether channels may have an activation at rest
    weights : names of the weights

    Returns
    -------
    blocks, each where it has any unknown
    """
    first = np.minimum(prior.mean, prior.upper)
    gains = tuple(
        Unknown(
            name=f"log gain of {name}",
            where=f"EMG channel {name}: gain",
            start=float(start),
            high=float(upper),
        )
        for name, start, upper in zip(channels, first, prior.upper, strict=True)
    )
    blocks = [Block(name=GAINS, unknowns=gains)]
    if offsets:
        names = [f"offset of {name}" for name in channels]
        blocks.append(Block(name=OFFSETS, unknowns=_positive(names)))
    if weights:
        blocks.append(Block(name=WEIGHTS, unknowns=_positive(weights)))
    return Unknowns(tuple(blocks))


def _positive(names: Sequence[str]) -> tuple[Unknown, ...]:
    """Activations of 0 or more. The search ends where gains settle: these follow in one step."""
    return tuple(Unknown(name=name, low=0.0, scale=np.inf) for name in names)


def gain_problem(unknowns: Unknowns, torques: Squares, ridge: Array, prior: Prior) -> Problem:
    """State what is known of gains: torques, usual gains, usual offsets and weights.

    Parameters
    ----------
    unknowns : of `gain_unknowns`
    torques : squares of what is left of the torques, in units of their errors
    ridge : (parameters, parameters) precision of the prior of offsets and weights
    prior : of the logarithms of gains

    Returns
    -------
    the problem, torques first among its residuals
    """
    blocks = tuple(unknowns.slices)
    size = len(unknowns)
    usual = Squares(matrix=ridge, slope=np.zeros(size), square=0.0, compared=size - len(prior.mean))
    root = np.asarray(np.linalg.cholesky(prior.precision).T, np.float64)
    return Problem(
        unknowns=unknowns,
        residuals=(
            SquaresOfParameters(name="joint torques", blocks=blocks, squares=torques),
            SquaresOfParameters(
                name="usual offsets and weights", blocks=blocks, squares=usual, prior=True
            ),
            LinearPrior(name="usual gains", blocks=(GAINS,), rows=root, right=root @ prior.mean),
        ),
    )


def gain_posterior(solution: Solution, prior: Prior) -> Posterior:
    """State what torques leave open of gains, given offsets and weights that are 0.

    Muscles that do nothing say nothing: a weight at its bound is taken for 0.

    Parameters
    ----------
    solution : of `gain_problem`
    prior : of the logarithms of gains

    Returns
    -------
    covariance of the unknowns that are off their lower bounds
    """
    problem = solution.problem
    unknowns = problem.unknowns
    expected = tuple(
        replace(one, bent=False) if isinstance(one, SquaresOfParameters) else one
        for one in problem.residuals
    )
    at = replace(problem, residuals=expected).at(solution.x)
    off_bound = solution.x > unknowns.low
    posterior = Posterior.of(replace(solution, at=at, free=off_bound))
    before = np.array(posterior.before)
    before[unknowns.slices[GAINS]] = np.diag(np.linalg.inv(prior.precision))
    return replace(posterior, before=before)
