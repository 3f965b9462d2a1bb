"""Motion, body and masses of one subject from markers and plates at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.identify.recordings import RecordingOptions, Usable, usable
from myomorph.identify.refine.masses import MassPrior, tangents
from myomorph.identify.refine.options import RefineOptions
from myomorph.identify.refine.problem import Problem, TrialData, Unknowns, generic_parameters, motion_of
from myomorph.identify.refine.solve import Solution, settle
from myomorph.identify.refine.spline import Basis
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData, BadModel
from myomorph.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.model.model import GROUND, Model
from myomorph.model.scale import scale
from myomorph.model.series import Markers, Motion, Wrenches
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics, marker_arrays, tracked_markers
from myomorph.motion.lengths import factors_of, length_unit, lengths_of
from myomorph.motion.root import floating_coordinates
from myomorph.motion.stretch import skeleton
from myomorph.rigid.regressor import base_wrench, regressor_blocks
from myomorph.rigid.tree import compile_tree

MAX_MASS_CHANGE, MIN_MASS_SHARE = 0.5, 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a link does not count."""

KNOTS = 4.0
"""Knots a period of the cutoff frequency."""

FRAMES_A_KNOT = 2.0
"""Frames between knots that are enough."""


@dataclass(frozen=True, eq=False)
class SubjectTrial:
    """One recording of a subject.

    Attributes
    ----------
    wrenches : external forces as recorded, each with its body
    tracking : options of its inverse kinematics; weights of markers count here too
    """

    name: str
    markers: Markers
    wrenches: Wrenches
    tracking: InverseKinematicsOptions = field(default_factory=InverseKinematicsOptions)
    time: tuple[float, float] | None = None


@dataclass(frozen=True)
class Errors:
    """Root mean squares of a motion on a model.

    Attributes
    ----------
    markers : distance of the markers [m]
    force, moment : of the root's residual vector [N], [N m]; the moment is about the base's origin
    """

    markers: float
    force: float
    moment: float


@dataclass(frozen=True, eq=False)
class RefinedTrial:
    """A motion before and after.

    Attributes
    ----------
    motion : refined, with derivatives that belong to it
    before : of inverse kinematics, low-pass filtered, on the model as given at the subject's mass
    after : of the refined motion on the refined model
    used : frames in which the plates carry all, of all
    """

    name: str
    motion: Motion
    before: Errors
    after: Errors
    used: int
    frames: int


@dataclass(frozen=True)
class Prediction:
    """A recording, or a part of one, predicted by the body and masses refined on the others: plain inverse kinematics.

    Attributes
    ----------
    given, refined : errors of the model as given, and of the refined one
    """

    name: str
    given: Errors
    refined: Errors

    @property
    def ratio(self) -> float:
        """Refined to given: root mean square of the ratios of force and moment."""
        ratios = (self.refined.force / self.given.force, self.refined.moment / self.given.moment)
        return float(np.sqrt(np.mean(np.square(ratios))))


@read_only
@dataclass(frozen=True, eq=False)
class Refinement:
    """A subject's model and motions that agree with markers and plates.

    Attributes
    ----------
    model : stretched, markers placed, with its masses
    given : model it began with, at the subject's mass
    trials : by name
    factors : (lengths,) of the given model's, and their standard deviations
    lengths : names of the lengths
    parameters : (bodies, 10) inertial
    mass_sd : (bodies,) standard deviation of the masses [kg]
    predictions : of what was left out, empty where not asked for
    kept : whether the given body and masses were kept because they predict better
    converged : whether the last step was small
    notes : what looks wrong, one line each
    """

    model: Model
    given: Model
    trials: tuple[RefinedTrial, ...]
    lengths: tuple[str, ...]
    factors: Array
    factors_sd: Array
    parameters: Array
    mass_sd: Array
    predictions: tuple[Prediction, ...]
    kept: bool
    converged: bool
    notes: tuple[str, ...]

    @property
    def before(self) -> Errors:
        """Of all trials together."""
        return _together([one.before for one in self.trials], [one.used for one in self.trials], self._frames)

    @property
    def after(self) -> Errors:
        """Of all trials together."""
        return _together([one.after for one in self.trials], [one.used for one in self.trials], self._frames)

    @property
    def _frames(self) -> list[int]:
        return [one.frames for one in self.trials]


def refine(
    model: Model,
    trials: Sequence[SubjectTrial],
    mass: float | None = None,
    options: RefineOptions | None = None,
    path_lengths: Callable[[Model], Array] | None = None,
    told: Callable[[], None] = lambda: None,
) -> Refinement:
    """Motion, lengths, marker positions and masses of a subject in one problem over all trials.

    Over frames f of all trials, markers m, coordinates q (quintic splines), lengths s, marker shifts d and
    inertial parameters phi,

    min sum |x_m(q_f, s, d) - y_fm|^2 / noise^2 + sum |Y(q_f, q'_f, q''_f, s) phi - w_f|^2 / noise_w^2 + priors,

    where Y phi are the six root rows of the equations of motion and w the wrench of the plates. Every phi is a
    body's: masses change by P = L (I + E / 2)^2 L^T of their pseudo-inertia. Normal equations are banded in the
    coefficients of each motion; their Schur complement leaves the shared unknowns.

    Source: Werling et al. 2023 (AddBiomechanics) for the problem; Wensing, Kim and Slotine 2018 for the
    pseudo-inertia. The solver is our own.

    Parameters
    ----------
    model : calibrated to the subject, with markers
    trials : recordings with markers and plates
    mass : of the whole body [kg]; the model's by default
    path_lengths : lets muscles keep their ratio of fiber to path, as in `scale`
    told : called once a step

    Returns
    -------
    the model and the motions, their errors before and after, and predictions of what was left out

    Raises
    ------
    BadModel : the model's base does not float, or bodies are tied in loops
    BadData : a trial has no usable frame, or shares no marker with the model
    """
    options = options or RefineOptions()
    _check_model(model)
    if not trials:
        raise BadData("refine needs at least one recording with markers and forces")
    mass = model.mass if mass is None else mass
    given = with_inertial_parameters(model, generic_parameters(model, mass))
    with threadpool_limits(limits=1, user_api="blas"):
        recorded = [_opened(given, one, options) for one in trials]
        predictions = _predictions(given, trials, recorded, options, told) if options.check else ()
        kept = bool(predictions) and _worse(predictions)
        problem = problem_of(given, trials, recorded, options, shared=not kept)
        solution = settle(thinned(problem), told)
    return _refinement(given, trials, recorded, problem, solution, predictions, kept, path_lengths)


@dataclass(frozen=True, eq=False)
class _Opened:
    """A trial through inverse kinematics: on the markers' clock, and with the frames that count."""

    motion: Motion
    usable: Usable


def _check_model(model: Model) -> None:
    if model.loops:
        raise BadModel(model.source or model.name, "bodies tied in loops cannot be refined; remove the loops")
    if len(floating_coordinates(model)) < 6:
        raise BadModel(
            model.source or model.name,
            "its base does not move freely in the ground, so that plates say nothing of its root",
        )


def _opened(model: Model, trial: SubjectTrial, options: RefineOptions) -> _Opened:
    motion = inverse_kinematics(model, trial.markers, trial.tracking).motion
    found = usable(
        model, motion, trial.wrenches, time=trial.time, name=trial.name, options=RecordingOptions(cutoff=options.cutoff)
    )
    return _Opened(motion, found)


def problem_of(
    model: Model,
    trials: Sequence[SubjectTrial],
    opened: Sequence[_Opened],
    options: RefineOptions,
    shared: bool = True,
    within: Mapping[int, np.ndarray] | None = None,
) -> Problem:
    """The problem of some trials.

    Parameters
    ----------
    shared : whether body and masses are unknown
    within : by trial (frames,) which frames of its forces' clock count
    """
    names: tuple[str, ...] = ()
    weights: dict[str, float] = {}
    for trial in trials:
        found, weight = tracked_markers(model, trial.markers, trial.tracking)
        weights |= dict(zip(found, weight, strict=True))
        names = tuple(name for name in model.marker_names if name in weights)
    bare = skeleton(model)
    tree = compile_tree(bare)
    arrays = marker_arrays(tree, names, np.array([weights[name] for name in names]), trials[0].tracking)
    data = [
        _trial_data(model, names, trial, one, options, None if within is None else within.get(k))
        for k, (trial, one) in enumerate(zip(trials, opened, strict=True))
    ]
    return Problem(
        bare,
        lengths_of(model),
        names,
        arrays,
        arrays.location.copy(),
        tuple(data),
        MassPrior.of(inertial_parameters(model), options.mass_sd),
        model.mass * float(np.linalg.norm(model.gravity)),
        length_unit(tree),
        options,
        shared,
        shared,
    )


def thinned(problem: Problem) -> Problem:
    """The problem with as many frames as its knots need: skin stays alike for longer, and forces are filtered."""
    rate = FRAMES_A_KNOT * KNOTS * problem.options.cutoff
    trials = []
    for one in problem.trials:
        step = max(1, int(1.0 / (rate * float(np.median(np.diff(one.time)))) + 1e-6))
        every, span = slice(None, None, step), (float(one.time[0]), float(one.time[-1]))
        basis = Basis.of(one.time[every], 1.0 / (KNOTS * problem.options.cutoff), span)
        trials.append(
            replace(
                one, time=one.time[every], observed=one.observed[every], measured=one.measured[every],
                use=one.use[every], trust=one.trust[every], start=one.start[every], basis=basis,
            )
        )  # fmt: skip
    return replace(problem, trials=tuple(trials))


def _trial_data(
    model: Model,
    names: Sequence[str],
    trial: SubjectTrial,
    opened: _Opened,
    options: RefineOptions,
    within: np.ndarray | None,
) -> TrialData:
    recording = opened.usable.recording
    use = opened.usable.use if within is None else opened.usable.use & within
    wrench = base_wrench(model, recording.motion, recording.wrenches, np.zeros(3))
    time = opened.motion.time
    frames = (time >= recording.motion.time[0] - 1e-9) & (time <= recording.motion.time[-1] + 1e-9)
    if within is not None:
        # Markers outside of the part are not seen either.
        inside = np.flatnonzero(frames)[within]
        frames = np.zeros(len(time), bool)
        frames[inside[0] : inside[-1] + 1] = True
    chosen = np.isin(np.round(recording.motion.time, 9), np.round(time[frames], 9))
    columns = {name: i for i, name in enumerate(trial.markers.names)}
    observed = np.full((int(frames.sum()), len(names), 3), np.nan)
    for i, name in enumerate(names):
        if name in columns:
            observed[:, i] = trial.markers.values[frames, columns[name]]
    start = _without_gaps(compile_tree(model).coordinates_of(opened.motion)[frames])
    return TrialData(
        trial.name, time[frames], observed, np.nan_to_num(wrench[chosen]), use[chosen], np.ones(len(start)), start,
        Basis.of(time[frames], 1.0 / (KNOTS * options.cutoff)),
    )  # fmt: skip


def _without_gaps(values: Array) -> Array:
    """Frames that saw no marker, straight between those that did."""
    known = np.isfinite(values).all(axis=1)
    at = np.arange(len(values))
    return np.column_stack([np.interp(at, at[known], one[known]) for one in values.T])


def errors_of(model: Model, trial: SubjectTrial, options: RefineOptions, within: np.ndarray | None = None) -> Errors:
    """Errors of plain inverse kinematics, filtered, on a model; the residual where the plates carry all.

    Parameters
    ----------
    within : (frames,) of the forces' clock that count; all by default
    """
    fit = inverse_kinematics(model, trial.markers, trial.tracking)
    found = usable(
        model, fit.motion, trial.wrenches, time=trial.time, name=trial.name,
        options=RecordingOptions(cutoff=options.cutoff),
    )  # fmt: skip
    return _errors(model, found, fit.errors, found.use if within is None else found.use & within)


def _errors(model: Model, found: Usable, distances: Array, use: np.ndarray) -> Errors:
    recording = found.recording
    needed = base_wrench(model, recording.motion, recording.wrenches)
    residual = _needed(model, recording.motion) - needed
    residual = residual[use]
    halves = [float(np.sqrt(np.mean(np.square(one).sum(axis=1)))) for one in (residual[:, 3:], residual[:, :3])]
    return Errors(float(np.sqrt(np.nanmean(distances**2))), *halves)


def _needed(model: Model, motion: Motion) -> Array:
    parameters = inertial_parameters(model).ravel()
    return np.concatenate([block.rows @ parameters for block in regressor_blocks(model, motion)])


def _predictions(
    model: Model,
    trials: Sequence[SubjectTrial],
    opened: Sequence[_Opened],
    options: RefineOptions,
    told: Callable[[], None],
) -> tuple[Prediction, ...]:
    """Every trial by the others, or the halves of a single one by each other."""
    found = []
    if len(trials) > 1:
        for k, trial in enumerate(trials):
            others = [i for i in range(len(trials)) if i != k]
            problem = problem_of(model, [trials[i] for i in others], [opened[i] for i in others], options)
            solution = settle(thinned(problem), told)
            found.append(_prediction(trial.name, model, trial, problem, solution, options, None))
        return tuple(found)
    middle = np.cumsum(opened[0].usable.use) * 2 >= opened[0].usable.use.sum()
    for name, seen in (("second half", ~middle), ("first half", middle)):
        problem = problem_of(model, trials, opened, options, within={0: seen})
        solution = settle(thinned(problem), told)
        title = f"{trials[0].name}, {name}"
        found.append(_prediction(title, model, trials[0], problem, solution, options, ~seen))
    return tuple(found)


def _prediction(
    name: str,
    model: Model,
    trial: SubjectTrial,
    problem: Problem,
    solution: Solution,
    options: RefineOptions,
    within: np.ndarray | None,
) -> Prediction:
    made = model_of(model, problem, solution.at)
    return Prediction(name, errors_of(model, trial, options, within), errors_of(made, trial, options, within))


def _worse(predictions: Sequence[Prediction]) -> bool:
    """Whether the refined body predicts worse than the given one by more than two percent."""
    return float(np.mean([one.ratio for one in predictions])) > 1.02


def model_of(
    model: Model, problem: Problem, at: Unknowns, path_lengths: Callable[[Model], Array] | None = None
) -> Model:
    """The given model with the lengths, marker positions and masses of a point."""
    made = scale(model, factors_of(problem.lengths, at.factors), path_lengths=path_lengths) if problem.body else model
    places = dict(zip(problem.names, problem.placed(at.factors, at.shifts), strict=True))
    placed = tuple(replace(one, location=places.get(one.name, one.location)) for one in made.markers)
    return with_inertial_parameters(made.with_markers(placed), at.parameters)


def _refinement(
    model: Model,
    trials: Sequence[SubjectTrial],
    opened: Sequence[_Opened],
    problem: Problem,
    solution: Solution,
    predictions: tuple[Prediction, ...],
    kept: bool,
    path_lengths: Callable[[Model], Array] | None,
) -> Refinement:
    at = solution.at
    at = replace(at, parameters=at.parameters * (model.mass / at.parameters[:, 0].sum()))
    done = []
    for k, trial in enumerate(trials):
        data = problem.trials[k]
        tree, places = problem.arrays(at), problem.placed(at.factors, at.shifts)
        distances, residual = problem.predict(tree, places, data, problem.rates(data, at.motions[k]))
        seen = np.isfinite(data.observed).all(axis=2)
        done.append(
            RefinedTrial(
                trial.name,
                motion_of(problem, at, k),
                errors_of(model, trial, problem.options),
                Errors(
                    float(np.sqrt(np.mean(np.square(distances[seen]).sum(axis=1)))),
                    *(
                        float(np.sqrt(np.mean(np.square(r[data.use]).sum(axis=1))))
                        for r in (residual[:, 3:], residual[:, :3])
                    ),
                ),
                int(data.use.sum()),
                len(data.time),
            )
        )
    lengths = problem.columns()[0]
    deviations = np.sqrt(np.diag(solution.covariance)) if problem.count else np.zeros(0)
    return Refinement(
        model=model_of(model, problem, at, path_lengths),
        given=model,
        trials=tuple(done),
        lengths=tuple(one.name for one in problem.lengths),
        factors=at.factors,
        factors_sd=deviations[lengths] if problem.body else np.zeros(len(at.factors)),
        parameters=at.parameters,
        mass_sd=_mass_sd(problem, solution),
        predictions=predictions,
        kept=kept,
        converged=solution.converged,
        notes=_notes(problem, solution, predictions, kept, opened),
    )


def _mass_sd(problem: Problem, solution: Solution) -> Array:
    found = np.zeros(len(problem.prior.reference))
    if problem.masses:
        masses = problem.columns()[2]
        covariance = solution.covariance[masses, masses]
        rows = tangents(solution.at.parameters[problem.prior.moved])[:, 0]
        for k, link in enumerate(problem.prior.moved):
            own = slice(10 * k, 10 * k + 10)
            found[link] = np.sqrt(rows[k] @ covariance[own, own] @ rows[k])
    return found


def _notes(
    problem: Problem,
    solution: Solution,
    predictions: Sequence[Prediction],
    kept: bool,
    opened: Sequence[_Opened],
) -> tuple[str, ...]:
    notes = []
    if kept:
        worst = max(predictions, key=lambda one: one.ratio)
        notes.append(
            f"body and masses are those of the given model, only motions were refined: refined ones predict "
            f"{worst.name} at {worst.refined.force:.1f} N, {worst.refined.moment:.1f} N m, the given model at "
            f"{worst.given.force:.1f} N, {worst.given.moment:.1f} N m"
        )
    notes += _far_from_given(problem, solution.at)
    if not solution.converged:
        notes.append(f"not converged after {problem.options.iterations} steps: allow more iterations")
    return (*notes, *(note for one in opened for note in one.usable.notes))


def _far_from_given(problem: Problem, at: Unknowns) -> list[str]:
    """Links that got a mass that is hard to believe, as one line."""
    before, after = problem.prior.reference[:, 0], at.parameters[:, 0]
    counts = before > MIN_MASS_SHARE * before.sum()
    far = np.flatnonzero(counts & (np.abs(after - before) > MAX_MASS_CHANGE * before))
    if not len(far):
        return []
    names = problem.model.body_names
    listed = ", ".join(f"'{names[i]}' {after[i]:.2f} kg (given {before[i]:.2f})" for i in far[:4])
    swung = dict.fromkeys(name for i in far[:4] for name in _joint_above(problem.model, names[i]))
    how = f" that swings {', '.join(map(repr, swung))} fast and far" if swung else ""
    return [
        f"{len(far)} of {len(names)} links have a mass that is hard to believe: {listed}; add a recording{how} with "
        "nothing but plates to touch (a chair, a rail or a hand carries a part of the body), or hold masses with a "
        "smaller mass_sd"
    ]


def _joint_above(model: Model, body: str) -> tuple[str, ...]:
    """Coordinates of the nearest joint above a body that moves it; none where only the floating base does."""
    above = {one.child: one for one in model.joints}
    while body in above and not above[body].coordinates:
        body = above[body].parent
    joint = above.get(body)
    return () if joint is None or joint.parent == GROUND else joint.coordinates


def _together(errors: Sequence[Errors], used: Sequence[int], frames: Sequence[int]) -> Errors:
    def mean(values: Sequence[float], counts: Sequence[int]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=counts)))

    return Errors(
        mean([one.markers for one in errors], frames),
        mean([one.force for one in errors], used),
        mean([one.moment for one in errors], used),
    )
