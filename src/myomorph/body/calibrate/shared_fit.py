"""The search for lengths and marker positions, in stages of noise and priors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.calibration import CalibrationOptions, Distances, SideEstimate
from myomorph.body.calibrate.frame_sums import settle, settle_anew
from myomorph.body.calibrate.mean_posture import symmetric_posture
from myomorph.body.calibrate.minimum import TOLERANCE, Minimum, minimise, minimise_in_turn
from myomorph.body.calibrate.priors import calibration_prior, usual_shifts
from myomorph.body.calibrate.shared_problem import LENGTHS, MARKERS, Point, SharedProblem, Stage
from myomorph.body.calibrate.sides import side_differences
from myomorph.core.fit.noise import residual_sd
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.motion.starts import root_coordinates
from myomorph.core.rigid.tree import compile_tree

NOISE_UNKNOWN = 0.005
MIN_NOISE = 1e-4
NOISE_AT_FIRST = 0.02
"""Of a marker along one axis: where the residual cannot show it, at least, and of the first stage
[length units].
"""
MAX_NOISE_CHANGE = (
    0.05  # Share by which the noise that the last stage shows may differ from its own
)
MAX_EXPLAINED = 0.8
"""Share of the recorded numbers from which on, explained by angles and unknowns, they do not show
the noise.
"""
ROUGH = 1e-3  # Tolerance of all stages but the last; see `minimise`
MAX_REPEATS = 3  # Of the last stage, where it shows other sides that differ
TAIL = 3.0  # Degrees of freedom of Student's t, of which shifts of markers are a sample


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """What a search assumes and begins with.

    Attributes
    ----------
    options : method, steps, what may move, and how it varies
    distances : noise of markers, 0 to take it from the residual, and how far they lie off [m]
    size : overall size that lengths begin with, relative to the given model
    """

    options: CalibrationOptions
    distances: Distances
    size: float

    @property
    def noise_at_first(self) -> float:
        """Of the first stage [m]."""
        return NOISE_AT_FIRST * self.distances.unit

    def noises(self, frames: int) -> list[float]:
        """List the noise of each stage.

        Trusting the model more at first keeps markers from following frames that are still turned
        wrongly.

        Parameters
        ----------
        frames : of all recordings; they count as `independent_frames`

        Returns
        -------
        standard deviations of a marker along one axis [m]
        """
        noise = NOISE_UNKNOWN * self.distances.unit
        if self.distances.noise:
            alike = max(1.0, frames / self.options.independent_frames)
            noise = self.distances.noise * float(np.sqrt(alike))
        first = noise if noise >= self.noise_at_first else self.noise_at_first
        # Two stages of the last noise: the first of them lets markers go and sides differ.
        return [noise, noise] if first == noise else [first, noise, noise]


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """Where the search ended, and how it came there.

    Attributes
    ----------
    stage : the last one, with its prior, noise [m], and the unknowns that were searched for
    found : the minimum
    noise_found : whether the residual could show the noise
    steps : of all stages
    sides : pairs of lengths, and whether the prior lets them differ
    """

    stage: Stage
    found: Minimum
    noise_found: bool
    steps: int
    sides: tuple[SideEstimate, ...] = ()

    @property
    def problem(self) -> SharedProblem:
        """With the prior of the last stage."""
        return self.stage.problem


@dataclass(kw_only=True)
class _Steps:
    """Steps done in all stages.

    Attributes
    ----------
    limit : at most so many
    progress : called with 1 after each step within the limit
    done : so far
    """

    limit: int
    progress: Callable[[int], None] | None
    done: int = 0

    def add(self) -> None:
        """Count a step."""
        self.done += 1
        if self.progress and self.done <= self.limit:
            self.progress(1)

    @property
    def are_left(self) -> bool:
        """Whether there may be another one."""
        return self.done < self.limit

    @property
    def left(self) -> int:
        """For the next stage, which has one at least."""
        return max(1, self.limit - self.done)


@dataclass(kw_only=True)
class _FreedSides:
    """Pairs of lengths that the prior does not hold alike.

    What was set free stays so: a thigh and its shank freed in turn would never settle.

    Attributes
    ----------
    pairs : names of both lengths
    estimates : of the last stage that looked
    repeats : of the last stage, done so far
    """

    pairs: frozenset[tuple[str, str]] = frozenset()
    estimates: tuple[SideEstimate, ...] = ()
    repeats: int = 0

    def look(
        self, stage: Stage, minimum: Minimum, options: CalibrationOptions
    ) -> frozenset[tuple[str, str]]:
        """Find pairs that are free already or differ at a minimum."""
        problem = stage.problem
        information = minimum.reduced.H / stage.variance
        self.estimates = side_differences(
            problem.lengths, minimum.point.x, information, problem.prior, options
        )
        differing = {(side.first, side.second) for side in self.estimates if side.differs}
        return self.pairs | differing

    @property
    def judged(self) -> tuple[SideEstimate, ...]:
        """The estimates, which differ where the prior let them."""
        return tuple(
            replace(side, differs=(side.first, side.second) in self.pairs)
            for side in self.estimates
        )


class _Moving(NamedTuple):
    """Unknowns that may change.

    Attributes
    ----------
    lengths : (unknowns,) those that are lengths or the size
    shifts : (unknowns,) those that are shifts of markers
    """

    lengths: Bools
    shifts: Bools

    @property
    def free(self) -> Bools:
        """(unknowns,) all of them."""
        return np.asarray(self.lengths | self.shifts)


def _may_move(problem: SharedProblem, options: CalibrationOptions) -> _Moving:
    """Select the unknowns that may change."""
    count = len(problem.lengths)
    total = problem.prior.rows.shape[1]
    lengths = np.zeros(total, np.bool_)
    lengths[:count] = LENGTHS in options.fit
    lengths[-1] = LENGTHS in options.fit
    placed = [
        MARKERS in options.fit and name not in options.fixed_markers
        for name in problem.marker_names
    ]
    shifts = np.zeros(total, np.bool_)
    shifts[count:-1] = np.repeat(placed, 3)
    return _Moving(lengths=lengths, shifts=shifts)


@dataclass(kw_only=True, eq=False)
class _Stages:
    """Stages that are still to be done, and what they have found.

    Attributes
    ----------
    settings : of the search
    moving : which unknowns may change
    noises : of the stages to come [m]
    problem : with the prior of the next one
    point : where it begins, every frame at its best angles
    steps, sides, noise_found : see `Search`
    """

    settings: SearchSettings
    moving: _Moving
    noises: list[float]
    problem: SharedProblem
    point: Point
    steps: _Steps
    sides: _FreedSides = field(default_factory=_FreedSides)
    noise_found: bool = True

    def next_stage(self, root: Sequence[int]) -> Search:
        """Do the next stage.

        Parameters
        ----------
        root : coordinates of the whole body

        Returns
        -------
        the search, were this the last stage
        """
        options = self.settings.options
        stage = Stage(problem=self.problem, noise=self.noises.pop(0), free=self.moving.free)
        begin = settle_anew(self.problem, self.point, root, stage.variance)
        if options.method == "joint":
            tolerance = ROUGH if self.noises else TOLERANCE
            minimum = minimise(stage, begin, self.steps.left, tolerance, self.steps.add)
        else:
            minimum = minimise_in_turn(
                stage, begin, self.moving.shifts, self.steps.left, self.steps.add
            )
        self.point = minimum.point
        if stage.noise < self.settings.noise_at_first:
            self._free_sides(stage, minimum)
        if self.noises:
            self._change_prior()
        elif not self.settings.distances.noise:
            self._measure_noise(stage, minimum)
        return Search(
            stage=stage,
            found=minimum,
            noise_found=self.noise_found,
            steps=self.steps.done,
            sides=self.sides.judged,
        )

    def _free_sides(self, stage: Stage, minimum: Minimum) -> None:
        """Let sides differ that the data show to; after the last stage it is done again."""
        pairs = self.sides.look(stage, minimum, self.settings.options)
        # A side set free shows in the others' evidence.
        changed = pairs != self.sides.pairs
        may_repeat = self.sides.repeats < MAX_REPEATS and self.steps.are_left
        if not self.noises and changed and may_repeat:
            self.noises = [stage.noise]
            self.sides.repeats += 1
        if self.noises:
            self.sides.pairs = pairs

    def _change_prior(self) -> None:
        """Give each marker the variance that Student's t gives it.

        One that lies far off is no longer pulled back. One on a bony landmark is not let go: it
        holds the zero angles of its body.
        """
        problem = self.problem
        names = problem.marker_names
        usual = usual_shifts(problem.model, names, self.settings.distances)
        landmark = np.array([problem.model.marker(name).fixed for name in names])
        relative = np.linalg.norm(problem.shifts(self.point.x), axis=1) / usual
        released = usual * np.sqrt((TAIL + relative**2) / (TAIL + 3.0))
        prior = calibration_prior(
            problem.lengths,
            np.where(landmark, usual, released),
            self.settings.options,
            self.settings.size,
            self.sides.pairs,
        )
        self.problem = replace(problem, prior=prior)

    def _measure_noise(self, stage: Stage, minimum: Minimum) -> None:
        """Take the noise from the residual; where it is another one, a stage with it follows."""
        shown, self.noise_found = _noise(stage, minimum)
        changed = abs(shown - stage.noise) > MAX_NOISE_CHANGE * stage.noise
        if changed and self.steps.are_left:
            self.noises = [shown]


def search_minimum(
    problem: SharedProblem,
    settings: SearchSettings,
    angles: Sequence[Array],
    progress: Callable[[int], None] | None = None,
) -> Search:
    """Search the minimum of the problem, the noise taken from its residual until both agree.

    Parameters
    ----------
    problem : with the first prior
    settings : what the search assumes and begins with
    angles : of each recording (frames, coordinates) that frames begin with [rad or m]
    progress : called with 1 after each step

    Returns
    -------
    the last minimum, with noise and sides

    Raises
    ------
    BadData : the loops of the model cannot be closed at this size
    """
    options = settings.options
    noises = settings.noises(sum(len(part) for part in angles))
    x = problem.of_size(settings.size)
    x[-1] = settings.size
    point = settle(problem, x, angles, noises[0] ** 2)
    if not np.isfinite(point.cost):
        raise BadData(
            f"calibration: the loops of model '{problem.model.name}' cannot be closed at"
            f" {settings.size:.3g} its size"
        )
    tree = compile_tree(problem.model)
    if options.method == "joint":
        posture = symmetric_posture(tree, problem.pose.free, point.angles, options.posture_sd)
        problem = replace(problem, mean_posture=posture)
    stages = _Stages(
        settings=settings,
        moving=_may_move(problem, options),
        noises=noises,
        problem=problem,
        point=point,
        steps=_Steps(limit=options.iterations, progress=progress),
    )
    root = root_coordinates(tree)
    search = stages.next_stage(root)
    while stages.noises:
        search = stages.next_stage(root)
    return search


class ShownNoise(NamedTuple):
    """Noise of a marker along one axis.

    Attributes
    ----------
    sd : standard deviation [m]
    found : whether the residual can show it
    """

    sd: float
    found: bool


def _noise(stage: Stage, minimum: Minimum) -> ShownNoise:
    """Estimate the noise of a marker along one axis from what the fit leaves.

    It does not show where angles and unknowns explain more than `MAX_EXPLAINED` of the recorded
    numbers. The unknowns explain as many as the trace of (H + variance P^T P)^-1 H, with the rows P
    of the prior.
    """
    squares = 0.0
    seen = 0
    for errors in minimum.reduced.errors:
        squares += float(np.nansum(stage.problem.pose.markers.weight * errors**2))
        seen += 3 * int(np.isfinite(errors).sum())
    rows = stage.prior_rows
    H = minimum.reduced.H[np.ix_(stage.free, stage.free)]
    regularised = H + stage.variance * rows.T @ rows
    explained = minimum.reduced.angles_free + float(np.trace(np.linalg.solve(regularised, H)))
    unit = stage.problem.unit
    if explained > MAX_EXPLAINED * seen:
        return ShownNoise(sd=NOISE_UNKNOWN * unit, found=False)
    sd = residual_sd(squares, seen, explained)
    return ShownNoise(sd=max(sd, MIN_NOISE * unit), found=True)
