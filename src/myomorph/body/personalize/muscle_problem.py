"""Muscles of a person as unknowns, and recordings, people and fibers as residuals.

Activations and errors are estimated within: with every step of the parameters activations move to
their mean given the recordings, errors and what frames count are made anew. All recordings share
these (`values.shared`), so that steps are reweighted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from myomorph.body.personalize.fibers import rigid_lengths
from myomorph.body.personalize.muscle_curves import MuscleShapes
from myomorph.body.personalize.prior import OUTSIDE, PHYSIOLOGICAL, Prior
from myomorph.body.personalize.recorded import Recorded
from myomorph.body.personalize.recording_at import (
    Muscles,
    Noise,
    RecordingAt,
    recording_at,
    with_slopes,
)
from myomorph.body.personalize.recording_errors import Floors, better_noise
from myomorph.body.personalize.recordings import Windows
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import LinearPrior, NormalEquations, Rows
from myomorph.core.fit.unknowns import Block, Bools, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only

BLOCKS = ("fibers", "points", "strength", "passive", "gains")
"""What can be fitted: optimal fiber lengths, operating points, strengths, passive strains, gains of
EMG and levels of muscles without it.
"""
PEOPLE = "people"
FIBER_RANGE = "range of fibers"
"""Names of what is known before."""
MAX_STEP = 1.0  # Step of a parameter, in standard deviations before the recordings
FIRST_ERRORS = 5.0
"""Of the least errors of torques: with which the fit begins, so that it does not run after each of
them at first.
"""
FIRST_WEIGHT = 0.2  # What a frame counts at first
TRUSTING = (4, 16)
"""First steps, in which errors are what was assumed of them: at least and, while steps are still
long, at most.
"""
WIDENED = (4, 3)
"""First steps in which slopes of the spread are computed, and every how manyth step from then on.
"""
INFORMATION = 0.85
"""Share of what the misfits show that counts, as the marginal is one of first order; chosen on
simulated people.
"""
MIN_LEFT = 0.5  # Share of the misfits that is left to errors, whatever the parameters follow


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class MuscleProblem:
    """Muscles of a person and recordings of them.

    Attributes
    ----------
    prior : of the parameters
    shapes : curves of the muscles
    windows : recordings
    floors : (rows,) least standard deviation of the torques [N m or N]
    """

    prior: Prior
    shapes: MuscleShapes
    windows: tuple[Windows, ...]
    floors: Array

    @cached_property
    def muscles(self) -> Muscles:
        """What the parameters act on."""
        return Muscles(prior=self.prior, shapes=self.shapes)

    @cached_property
    def recordings(self) -> tuple[Recorded, ...]:
        """The recordings as the fit reads them."""
        return tuple(Recorded(window) for window in self.windows)

    @cached_property
    def all_floors(self) -> Floors:
        """Least errors, of passive torques too."""
        return Floors.of(self.recordings, self.floors)

    def of(self, windows: Sequence[Windows]) -> MuscleProblem:
        """Take other recordings of the same muscles."""
        return replace(self, windows=tuple(windows))

    def path_ends(self) -> Array:
        """Find the ends of the paths' ranges in frames that count.

        Returns
        -------
        (2, muscles) least and greatest lengths [m]
        """
        every = np.concatenate([window.lengths[window.counted] for window in self.windows])
        return np.array([every.min(axis=0), every.max(axis=0)])


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class FitState:
    """What is estimated beside the parameters, before a step.

    Attributes
    ----------
    step : number of the step, from 1
    activations : of each recording, (windows, frames, muscles)
    noise : errors of torques and activations
    independent : of each recording, share of the frames that count as independent
    information : share of what the misfits show that counts
    trusting : whether errors are what was assumed of them
    widenings : of each recording, (parameters,) slopes of the spread; none before the first step
    """

    step: int
    activations: tuple[Array, ...]
    noise: Noise
    independent: tuple[float, ...]
    information: float
    trusting: bool
    widenings: tuple[Array, ...]

    @property
    def weights(self) -> tuple[float, ...]:
        """What a frame of each recording counts."""
        return tuple(self.information * share for share in self.independent)


def first_state(problem: MuscleProblem) -> FitState:
    """Return what is assumed of activations and errors before the first step."""
    floors = problem.all_floors
    return FitState(
        step=1,
        activations=tuple(one.first_activations() for one in problem.recordings),
        noise=Noise(torque=FIRST_ERRORS * floors.torque, rest=FIRST_ERRORS * floors.rest),
        independent=(FIRST_WEIGHT,) * len(problem.recordings),
        information=INFORMATION,
        trusting=True,
        widenings=(),
    )


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingsAt:
    """All recordings at some parameters.

    Attributes
    ----------
    problem : muscles and recordings
    free : (parameters,) which are estimated
    p : (parameters,)
    state : what is estimated beside them
    """

    problem: MuscleProblem
    free: Bools
    p: Array
    state: FitState

    @cached_property
    def parts(self) -> tuple[RecordingAt, ...]:
        """The recordings, linearized."""
        state = self.state
        muscles = self.problem.muscles
        first, every = WIDENED
        anew = state.step <= first or state.step % every == 0
        parts = []
        for index, recorded in enumerate(self.problem.recordings):
            part = recording_at(muscles, recorded, self.p, state.activations[index], state.noise)
            widening = None if anew else state.widenings[index]
            parts.append(with_slopes(muscles, part, state.weights[index], widening))
        return tuple(parts)

    @cached_property
    def covariance(self) -> Array:
        """(parameters, parameters) after the recordings; 0 of what is not estimated."""
        prior = self.problem.prior
        information = prior.precision.copy()
        for part in self.parts:
            information += part.equations.H
        information += _fiber_range_rows(self.problem, self.p).normal().H
        inner = np.ix_(self.free, self.free)
        known = NormalEquations(H=information[inner], g=np.zeros(int(self.free.sum())))
        covariance = np.zeros_like(information)
        covariance[inner] = known.covariance
        return covariance

    def state_after(self, p: Array) -> FitState:
        """Move activations, errors and weights along with a step.

        Parameters
        ----------
        p : (parameters,) after the step

        Returns
        -------
        what is estimated beside them there
        """
        state = self.state
        step = p - self.p
        deviation = np.maximum(self.problem.prior.deviation, 1e-12)
        longest = float((np.abs(step) / deviation)[self.free].max(initial=0.0))
        state = replace(
            state,
            step=state.step + 1,
            activations=tuple(part.settled(step) for part in self.parts),
            widenings=tuple(part.widening for part in self.parts),
            # Before the parameters have found their places, misfits are theirs and not errors of
            # the recordings.
            trusting=self.state.trusting and _is_early(self.state.step, longest),
        )
        if state.trusting:
            return state
        noise = better_noise(self.parts, state.noise, self.problem.all_floors, self.covariance)
        independent = tuple(
            0.5 * (share + 1.0 / part.error_length())
            for share, part in zip(state.independent, self.parts, strict=True)
        )
        information = self._information_left(independent)
        return replace(state, noise=noise, independent=independent, information=information)

    def _information_left(self, independent: Sequence[float]) -> float:
        """Compute the share of the misfits' information that counts.

        Of independent misfits the parameters follow some. That is squared: so much less is known
        than it looks. Once because the misfits are smaller for it, and once because what is
        followed is slow: left misfits are alike over a shorter time than errors are.

        Parameters
        ----------
        independent : (recordings,) frames that count as one, as 1 / length
        """
        precision = self.problem.prior.precision
        followed = float(np.sum(self.free) - np.trace(self.covariance @ precision))
        seen = sum(
            share * part.recorded.known.sum()
            for share, part in zip(independent, self.parts, strict=True)
        )
        left = float(np.clip(1.0 - followed / max(seen, 1e-12), MIN_LEFT, 1.0))
        return left**2 * INFORMATION


def _is_early(step: int, longest: float) -> bool:
    """Tell whether errors are still those assumed after a step of so many standard deviations."""
    at_least, at_most = TRUSTING
    shortened = longest >= MAX_STEP * (1.0 - 1e-9)
    return step < at_least or (shortened and step < at_most)


@dataclass(frozen=True, eq=False)
class RecordingEvaluation:
    """One recording among all at some parameters.

    Attributes
    ----------
    every : all recordings there
    index : number of the recording
    """

    every: RecordingsAt
    index: int

    @property
    def part(self) -> RecordingAt:
        """The recording."""
        return self.every.parts[self.index]

    @property
    def cost(self) -> float:
        """Sum of squares of the whitened misfit, by what a frame counts."""
        return self.part.cost

    @property
    def count(self) -> int:
        """Of measured torques."""
        return self.part.count

    def normal(self) -> NormalEquations:
        """Return the normal equations of all parameters."""
        return self.part.equations


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingResiduals:
    """Torques of one recording as residuals, activations marginalized.

    Attributes
    ----------
    problem : muscles and all recordings, whose errors are estimated together
    free : (parameters,) which are estimated
    index : number of the recording
    blocks, prior : all blocks; no prior
    """

    problem: MuscleProblem
    free: Bools
    index: int
    blocks: tuple[str, ...] = field(default=BLOCKS, init=False)
    prior: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        """Of the source."""
        return f"torques of {self.problem.recordings[self.index].name}"

    def at(self, values: Values, before: RecordingEvaluation | None) -> RecordingEvaluation:
        """Linearize all recordings once for some values.

        Parameters
        ----------
        values : of the parameters
        before : where the search came from, with its activations and errors; None begins with
            those assumed
        """

        def all_recordings() -> RecordingsAt:
            if before is None:
                state = first_state(self.problem)
            else:
                state = before.every.state_after(values.x)
            return RecordingsAt(problem=self.problem, free=self.free, p=values.x, state=state)

        return RecordingEvaluation(values.shared("recordings", all_recordings), self.index)


@dataclass(frozen=True, eq=False, kw_only=True)
class FiberRange:
    """Fibers are expected within physiological lengths, or within the range that they had.

    How far fibers work is an assumption: it moves what recordings leave open, but they say no more
    for it.

    Attributes
    ----------
    problem : muscles and recordings
    name, blocks, prior : of these residuals; they are a prior
    """

    problem: MuscleProblem
    name: str = field(default=FIBER_RANGE, init=False)
    blocks: tuple[str, ...] = field(default=BLOCKS, init=False)
    prior: bool = field(default=True, init=False)

    def at(self, values: Values, before: Rows | None) -> Rows:
        """Compute how far fibers pass the range.

        Parameters
        ----------
        values : of the parameters
        before : not used
        """
        return values.shared(FIBER_RANGE, lambda: _fiber_range_rows(self.problem, values.x))


def _fiber_range_rows(problem: MuscleProblem, p: Array) -> Rows:
    """Build rows that pull muscles into their range.

    The normalized length x of a fiber at an end L of its path's range, the tendon at slack length,
    has the slopes

        dx/dp_fiber = -cos(alpha) (L - L_mean) / lo,   dx/dp_point = cos(alpha)

    Parameters
    ----------
    p : (parameters,)

    Returns
    -------
    (2 muscles,) residuals in standard deviations (`OUTSIDE`) and (2 muscles, parameters) slopes
    """
    prior = problem.prior
    muscles = len(prior.names)
    ends = problem.path_ends()
    sizes = prior.sizes(p)
    now = rigid_lengths(problem.shapes, sizes, ends)
    beyond = _beyond_range(now, rigid_lengths(problem.shapes, prior.start, ends))

    out = (beyond != 0.0).astype(np.float64)
    along = (ends - sizes.slack) / sizes.fiber
    cosine = np.clip(along / np.maximum(now, 1e-6), 0.0, 1.0)
    by_fiber = -out * cosine * (ends - prior.reference) / sizes.fiber / OUTSIDE
    by_point = out * cosine / OUTSIDE
    slopes = np.zeros((2, muscles, len(p)))
    muscle = np.arange(muscles)
    slopes[:, muscle, prior.parts.fibers.start + muscle] = by_fiber
    slopes[:, muscle, prior.parts.points.start + muscle] = by_point
    return Rows(residuals=beyond.ravel() / OUTSIDE, slopes=slopes.reshape(2 * muscles, -1))


def _beyond_range(now: Array, before: Array) -> Array:
    """Compute by how much normalized lengths pass what is expected.

    Parameters
    ----------
    now, before : (2, muscles) least and greatest normalized lengths, and those of the model that
        the fit began with

    Returns
    -------
    (2, muscles) below 0 where fibers are too short, above 0 where they are too long
    """
    shortest, longest = PHYSIOLOGICAL
    too_short = np.minimum(now[0] - np.minimum(shortest, before[0]), 0.0)
    too_long = np.maximum(now[1] - np.maximum(longest, before[1]), 0.0)
    return np.array([too_short, too_long])


def muscle_unknowns(prior: Prior) -> Unknowns:
    """List the parameters of a person.

    What is known of them beforehand ties both sides to each other (`people`), so that none has a
    prior of its own. Scales are standard deviations before the recordings.

    Parameters
    ----------
    prior : with spreads and bounds

    Returns
    -------
    blocks in the order of `BLOCKS`
    """
    muscles = prior.names
    without_emg = [muscles[m] for m in np.flatnonzero(prior.gain >= len(prior.gains))]
    named = (
        [f"{name} log optimal fiber length" for name in muscles],
        [f"{name} shift of the operating point" for name in muscles],
        [f"{name} log strength" for name in prior.groups],
        [f"{name} log passive strain" for name in prior.groups],
        [f"{name} log gain" for name in prior.gains]
        + [f"{name} log mean activation" for name in without_emg],
    )
    blocks = []
    for block, names, part in zip(BLOCKS, named, prior.parts, strict=True):
        pairs = zip(names, prior.deviation[part], prior.bound[part], strict=True)
        unknowns = tuple(
            Unknown(
                name=name,
                where=f"muscles: {block}",
                low=-float(bound),
                high=float(bound),
                fixed=not deviation > 0.0,
                scale=float(deviation) if deviation > 0.0 else 1.0,
            )
            for name, deviation, bound in pairs
        )
        blocks.append(Block(name=block, unknowns=unknowns))
    blocks[1] = replace(
        blocks[1], limit=lambda values: prior.with_tendons(values["fibers"], values["points"])
    )
    return Unknowns(tuple(blocks))


def people(prior: Prior) -> LinearPrior:
    """State what is known of people as residuals: W p ~ N(0, 1) with W^T W the prior's precision.

    Parameters
    ----------
    prior : with the precision
    """
    rows = np.asarray(np.linalg.cholesky(prior.precision).T, dtype=np.float64)
    return LinearPrior(name=PEOPLE, blocks=BLOCKS, rows=rows, right=np.zeros(len(rows)))


def as_fit(problem: MuscleProblem, blocks: Sequence[str] = BLOCKS) -> Problem:
    """State muscles and recordings as unknowns and residuals.

    Parameters
    ----------
    problem : muscles and recordings
    blocks : names of those that are fitted

    Returns
    -------
    residuals of each recording, of people and of the range of fibers
    """
    unknowns = muscle_unknowns(problem.prior)
    free = unknowns.free(blocks)
    torques = tuple(
        RecordingResiduals(problem=problem, free=free, index=index)
        for index in range(len(problem.windows))
    )
    return Problem(unknowns, (*torques, people(problem.prior), FiberRange(problem=problem)))
