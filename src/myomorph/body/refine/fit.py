"""Motion, body and masses of one subject from markers and plates at once.

Also what may not be believed of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.identify.soft_tissue import Use, predicts_better
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.predictions import (
    LEAVES_MARKERS,
    WORSE,
    Solution,
    covariance,
    errors_on,
    mass_sd,
    model_of,
    predictions_of,
    rms,
    settle,
    worse,
)
from myomorph.body.refine.problem import Problem, Unknowns, generic_parameters, motion_of
from myomorph.body.refine.refinement import (
    Errors,
    Prediction,
    RefinedTrial,
    Refinement,
    SubjectTrial,
)
from myomorph.body.refine.trial_data import Opened, opened, problem_of, thinned
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.model import GROUND, Model
from myomorph.core.motion.turns import floating_coordinates

MAX_MASS_CHANGE = 0.5
MIN_MASS_SHARE = 0.003
"""Change of a link's mass, of itself, that is reported; and the share of the body under which a
link does not count.
"""


def kept_note(
    tried: Sequence[tuple[str, Sequence[Prediction]]], options: RefineOptions
) -> Iterator[str]:
    """Report that parts of the given model were kept, and how much worse refined ones predict.

    Parameters
    ----------
    tried : what was refined but not taken, with its predictions; empty where the first was taken
    options : of what was refined in the end

    Yields
    ------
    one line, or none
    """
    if not tried:
        return
    kept = "lengths and marker positions" if options.masses else "body and masses"
    texts = []
    for what, predictions in tried:
        worst = max(
            predictions,
            key=lambda each: max(each.ratio, each.markers_ratio * WORSE / LEAVES_MARKERS),
        )
        texts.append(f"refined {what} predict {_numbers(worst)}")
    yield (
        f"{kept} are those of the given model, only {refined_parts(options)} were refined:"
        f" {'; '.join(texts)}"
    )


def markers_left(trials: Sequence[RefinedTrial]) -> Iterator[str]:
    """Report refined motions that lie farther from their markers than inverse kinematics does.

    Inverse kinematics is that on the given model, and farther is `LEAVES_MARKERS` times.
    """
    left = [
        trial for trial in trials if trial.after.markers > LEAVES_MARKERS * trial.before.markers
    ]
    if left:
        listed = ", ".join(
            f"{trial.name} {1e3 * trial.after.markers:.1f} mm (before"
            f" {1e3 * trial.before.markers:.1f})"
            for trial in left[:4]
        )
        yield (
            f"forces pull {len(left)} of {len(trials)} refined motions away from their markers:"
            f" {listed}; see whether the subject's mass, the plates' zeros and clock are right, and"
            " what else touched the body"
        )


def refined_parts(options: RefineOptions) -> str:
    """Name in words what options refine beside motions."""
    words = {
        (True, True): "body and masses",
        (True, False): "lengths and marker positions",
        (False, True): "masses",
    }
    return words.get((options.body, options.masses), "motions")


def worse_note(predictions: Sequence[Prediction]) -> Iterator[str]:
    """Report recordings that are predicted worse than by the given model.

    All together they are not.
    """
    left = [
        prediction
        for prediction in predictions
        if prediction.refined.markers > LEAVES_MARKERS * prediction.given.markers
    ]
    worse = [
        prediction
        for prediction in predictions
        if max(prediction.ratios) > WORSE
        or (prediction.markers_ratio > WORSE and prediction not in left)
    ]
    if worse:
        listed = "; ".join(_numbers(prediction) for prediction in worse[:4])
        yield (
            f"{len(worse)} of {len(predictions)} predictions of what was not used are more than "
            f"{100.0 * (WORSE - 1.0):.0f} % worse than the given model's: {listed}"
        )
    if left:
        listed = "; ".join(_numbers(prediction) for prediction in left[:4])
        yield (
            f"bodies that were refined without them lie farther from the markers of {len(left)} of"
            f" {len(predictions)} predictions than the given model, which may have been calibrated"
            f" with them: {listed}; add recordings, or keep lengths and marker positions"
            " (--no-body)"
        )


def _numbers(prediction: Prediction) -> str:
    return (
        f"{prediction.name} at {prediction.refined.force:.1f} N, {prediction.refined.moment:.1f} N"
        f" m, markers {1e3 * prediction.refined.markers:.1f} mm (given model"
        f" {prediction.given.force:.1f} N, {prediction.given.moment:.1f} N m,"
        f" {1e3 * prediction.given.markers:.1f} mm; a body refined without forces"
        f" {1e3 * prediction.markers_alone:.1f} mm)"
    )


def far_from_given(problem: Problem, at: Unknowns) -> Iterator[str]:
    """Report links that got a mass that is hard to believe, as one line.

    Parameters
    ----------
    problem : with the masses before
    at : optimum

    Yields
    ------
    one line, or none
    """
    before = inertial_parameters(problem.model)[:, 0]
    after = at.parameters[:, 0]
    counts = before > MIN_MASS_SHARE * before.sum()
    far = np.flatnonzero(counts & (np.abs(after - before) > MAX_MASS_CHANGE * before))
    if not len(far):
        return
    names = problem.model.body_names
    listed = ", ".join(f"'{names[i]}' {after[i]:.2f} kg (given {before[i]:.2f})" for i in far[:4])
    swung = dict.fromkeys(name for i in far[:4] for name in _joint_above(problem.model, names[i]))
    how = f" that swings {', '.join(map(repr, swung))} fast and far" if swung else ""
    yield (
        f"{len(far)} of {len(names)} links have a mass that is hard to believe: {listed}; add a"
        f" recording{how} with nothing but plates to touch (a chair, a rail or a hand carries a"
        " part of the body), or keep the given masses (--no-masses)"
    )


def _joint_above(model: Model, body: str) -> tuple[str, ...]:
    """Return the coordinates of the nearest joint above a body that moves it.

    None where only the floating base does.
    """
    above = {joint.child: joint for joint in model.joints}
    while body in above and not above[body].coordinates:
        body = above[body].parent
    joint = above.get(body)
    return () if joint is None or joint.parent == GROUND else joint.coordinates


def refine(
    model: Model,
    trials: Sequence[SubjectTrial],
    mass: float | None = None,
    options: RefineOptions | None = None,
    path_lengths: Callable[[Model], Array] | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Refinement:
    """Fit motion, lengths, marker positions and masses of a subject in one problem.

    Over frames f of all trials, markers m, coordinates q (quintic splines), lengths s, marker
    shifts d and inertial parameters phi,

        min sum |x_m(q_f, s, d) - y_fm|^2 / noise^2
            + sum |Y(q_f, q'_f, q''_f, s) phi - w_f|^2 / noise_w^2 + priors,

    where Y phi are the six root rows of the equations of motion and w the wrench of the plates.
    Every phi is a body's: masses change by P = L (I + E / 2)^2 L^T of their pseudo-inertia. Normal
    equations are banded in the coefficients of each motion; their Schur complement leaves the
    shared unknowns.

    Where markers move more than the mass (`soft_tissue`), they are seen at q - alpha q'', by the
    alphas of `identify`.

    Where body and masses predict recordings that were not used worse than the given ones, masses
    alone are refined; where these do too, motions alone.

    Source: Werling et al. 2023 (AddBiomechanics) for the problem; Wensing, Kim and Slotine 2018 for
    the pseudo-inertia. The solver is our own.

    Parameters
    ----------
    model : calibrated to the subject, with markers
    trials : recordings with markers and plates
    mass : of the whole body [kg]; the model's by default
    options : how much each part is believed; see `RefineOptions`
    path_lengths : lets muscles keep their ratio of fiber to path, as in `scale`
    progress : called once a step

    Returns
    -------
    the model and the motions, their errors before and after, and predictions of what was left out

    Raises
    ------
    BadModel : the model's base does not float, or bodies are tied in loops
    BadData : a trial has no usable frame, or shares no marker with the model

    Examples
    --------
    >>> from dataclasses import replace
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import myomorph as mm
    >>> text = '''<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint name="root"/>
    ... <geom type="box" size=".1 .15 .3" mass="30"/><body name="arm" pos="0 .2 .3">
    ... <joint name="shoulder" axis="1 0 0"/>
    ... <geom type="box" pos="0 0 -.3" size=".05 .05 .3" mass="8"/></body></body></worldbody>
    ... </mujoco>'''
    >>> _ = Path("body.xml").write_text(text)
    >>> model, time = mm.read_model("body.xml"), np.arange(0.0, 2.0, 0.02)
    >>> corners = 0.1 * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, -1]])
    >>> markers = [
    ...     mm.model.Marker(f"{body.name}{number}", body.name, corner)
    ...     for body in model.bodies
    ...     for number, corner in enumerate(corners)
    ... ]
    >>> model = model.with_markers(tuple(markers))
    >>> middle = np.array([coordinate.default for coordinate in model.coordinates])
    >>> values = middle + np.array([0.1] * 6 + [0.8]) * np.sin(np.outer(time, np.arange(2.0, 9.0)))
    >>> motion = mm.Motion(time, model.coordinate_names, values)
    >>> moved = mm.differentiate(motion)
    >>> at = mm.joint_reactions(model, moved, None, joints=["root"], frame="ground")
    >>> wrenches = mm.Wrenches(time, ("plate",), ("trunk",), at.forces, at.points, at.moments)
    >>> trial = mm.SubjectTrial("swing", mm.marker_positions(model, motion), wrenches)
    >>> trunk, arm = model.bodies
    >>> guess = replace(model, bodies=(replace(trunk, mass=33.0), replace(arm, mass=5.0)))
    >>> result = mm.refine(guess, [trial], options=mm.RefineOptions(check=False, body=False))
    >>> bool(result.after.force < 0.01 * result.before.force)
    True
    """
    options = options or RefineOptions()
    if model.loops:
        raise BadModel(
            model.source or model.name, "bodies tied in loops cannot be refined; remove the loops"
        )
    if len(floating_coordinates(model)) < 6:
        free = "its base does not move freely in the ground, so that plates say nothing of its root"
        raise BadModel(model.source or model.name, free)
    if not trials:
        raise BadData("refine needs at least one recording with markers and forces")
    mass = model.mass if mass is None else mass
    weighed = with_inertial_parameters(model, generic_parameters(model, mass))
    with threadpool_limits(limits=1, user_api="blas"):
        recorded = [opened(weighed, trial, options) for trial in trials]
        choice = _choice(weighed, recorded, options, progress)
        problem = problem_of(weighed, recorded, choice.options)
        solution = settle(thinned(problem), progress)
    return _refinement(weighed, recorded, problem, solution, choice, path_lengths)


@dataclass(frozen=True, eq=False)
class _Choice:
    """The parts that are refined in the end.

    Attributes
    ----------
    options : with soft tissue "always" or "never"
    predictions : by what is refined, or by what was tried last where only motions are
    tried : what was not taken because it predicts worse, with its predictions
    """

    options: RefineOptions
    predictions: tuple[Prediction, ...]
    tried: tuple[tuple[str, tuple[Prediction, ...]], ...] = ()


def _choice(
    model: Model, recorded: Sequence[Opened], options: RefineOptions, progress: Callable[[], None]
) -> _Choice:
    """Choose body and masses, masses alone or motions alone: the first that predicts no worse.

    Soft tissue where `identify` has it of the same recordings, and predictions here are better with
    it too.
    """
    tried: list[tuple[str, tuple[Prediction, ...]]] = []
    predictions: tuple[Prediction, ...] = ()
    uses: tuple[Use, ...] = (options.soft_tissue,)
    if options.soft_tissue == "auto":
        checked = options.check and (options.body or options.masses)
        soft = checked and problem_of(model, recorded, options).tissue is not None
        uses = ("never", "always") if soft else ("never",)
    chosen = replace(options, soft_tissue=uses[0])
    while options.check and (options.body or options.masses):
        ways = [replace(options, soft_tissue=use) for use in uses]
        predicted = [predictions_of(model, recorded, way, progress) for way in ways]
        softer = [
            np.divide(new.ratios, old.ratios)
            for old, new in zip(predicted[0], predicted[-1], strict=True)
        ]
        taken = -1 if predicts_better(np.array(softer), len(recorded) > 1) else 0
        chosen = ways[taken]
        predictions = predicted[taken]
        if not worse(predictions):
            break
        tried.append((refined_parts(options), predictions))
        options = replace(options, body=False, masses=options.masses and options.body)
        chosen = replace(options, soft_tissue=uses[0])
    return _Choice(chosen, predictions, tuple(tried))


def _refinement(
    model: Model,
    recorded: Sequence[Opened],
    problem: Problem,
    solution: Solution,
    choice: _Choice,
    path_lengths: Callable[[Model], Array] | None,
) -> Refinement:
    """Build the result: model, motions, intervals and notes."""
    at = solution.at
    lengths = problem.columns()[0]
    spread = covariance(solution.problem, at)
    deviations = np.sqrt(np.diag(spread))
    refined = tuple(_refined_trials(model, recorded, problem, at))
    return Refinement(
        model=model_of(model, problem, at, path_lengths),
        given=model,
        trials=refined,
        lengths=tuple(length.name for length in problem.lengths),
        factors=at.factors,
        factors_sd=deviations[lengths] if problem.body else np.zeros(len(at.factors)),
        parameters=at.parameters,
        mass_sd=mass_sd(problem, at, spread),
        predictions=choice.predictions,
        body=problem.body,
        masses=problem.masses,
        soft_tissue=problem.tissue,
        kept=bool(choice.tried),
        converged=solution.converged,
        notes=(*markers_left(refined), *_notes(problem, solution, choice, recorded)),
    )


def _refined_trials(
    model: Model, recorded: Sequence[Opened], problem: Problem, at: Unknowns
) -> Iterator[RefinedTrial]:
    tree = problem.arrays(at)
    places = problem.placed(at.factors, at.shifts)
    for index, (data, trial) in enumerate(zip(problem.trials, recorded, strict=True)):
        # Against what the plates say, whatever gain they were given.
        said = replace(data, gain=1.0)
        distances, residual = problem.predict(
            tree, places, said, problem.rates(data, at.motions[index])
        )
        seen = np.isfinite(data.observed).all(axis=2)
        used = residual[data.use]
        yield RefinedTrial(
            name=data.name,
            motion=motion_of(problem, at, index),
            before=errors_on(model, replace(trial, within=np.ones(len(trial.usable.use), bool))),
            after=Errors(rms(distances[seen]), rms(used[:, 3:]), rms(used[:, :3])),
            used=int(data.use.sum()),
            frames=len(data.time),
        )


def _notes(
    problem: Problem, solution: Solution, choice: _Choice, recorded: Sequence[Opened]
) -> Iterator[str]:
    yield from kept_note(choice.tried, choice.options)
    if not choice.tried or choice.predictions is not choice.tried[-1][1]:
        yield from worse_note(choice.predictions)
    yield from far_from_given(problem, solution.at)
    if not solution.converged:
        yield f"not converged after {problem.options.iterations} steps: allow more iterations"
    for trial in recorded:
        yield from trial.usable.notes
