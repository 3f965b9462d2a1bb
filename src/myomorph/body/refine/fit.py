"""Motion, body and masses of one subject from markers and plates at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.causes import SEARCH
from myomorph.body.identify.soft_tissue import Use, predicts_better
from myomorph.body.refine.alignment import aligned
from myomorph.body.refine.kinds import check_fit
from myomorph.body.refine.notes import (
    clock_notes,
    far_from_given,
    kept_note,
    markers_left,
    refined_parts,
    worse_note,
)
from myomorph.body.refine.opened import Opened
from myomorph.body.refine.options import LENGTHS, MARKERS, MASSES, RefineOptions
from myomorph.body.refine.point import Point
from myomorph.body.refine.predictions import (
    errors_on,
    force_verdict,
    model_of,
    predictions_of,
    rms,
    worse,
)
from myomorph.body.refine.problem import Problem, generic_parameters
from myomorph.body.refine.refinement import Errors, Prediction, RefinedTrial, Refinement
from myomorph.body.refine.search import Solution, certified, settle
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.body.refine.trial_data import opened, problem_of, thinned
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.inertia import with_inertial_parameters
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.motion.turns import floating_coordinates


def refine(  # page: called as `calibrate`, with the mass that plates weigh
    model: Model,
    trials: Sequence[SubjectTrial],
    mass: float | None = None,
    options: RefineOptions | None = None,
    path_lengths: Callable[[Model], Array] | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Refinement:
    """Fit motion, lengths, marker positions, masses and clocks of a subject in one problem.

    Any subset of them is estimated (`RefineOptions.fit`). Over frames f of all trials, markers m,
    coordinates q (quintic splines), lengths s, marker shifts d, inertial parameters phi and offsets
    e of the forces' clocks,

        min sum |x_m(q_f, s, d) - y_fm|^2 / noise^2
            + sum |Y(q_f, q'_f, q''_f, s) phi - w(t_f - e)|^2 / noise_w^2 + priors,

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
    UnknownName : `fit` has a name that nothing has

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
    >>> result = mm.refine(guess, [trial], options=mm.RefineOptions(check=False, fit=("masses",)))
    >>> bool(result.after.force < 0.01 * result.before.force)
    True
    """
    options = options or RefineOptions()
    check_fit(options)
    _check_model(model)
    if not trials:
        raise BadData("refine needs at least one recording with markers and forces")
    mass = model.mass if mass is None else mass
    weighed = with_inertial_parameters(model, generic_parameters(model, mass))
    with threadpool_limits(limits=1, user_api="blas"):
        recorded = [opened(weighed, trial, options) for trial in trials]
        used = aligned(weighed, recorded, options, progress)
        choice = _choice(weighed, used, options, progress)
        problem = problem_of(weighed, used, choice.options)
        solution = settle(thinned(problem), progress)
    return _refinement(weighed, recorded, problem, solution, choice, path_lengths)


def _check_model(model: Model) -> None:
    """Raise `BadModel` for closed loops, or a base that does not move freely in the ground."""
    if model.loops:
        raise BadModel(
            model.source or model.name,
            "models with closed loops cannot be refined; remove the loops",
        )
    if len(floating_coordinates(model)) < 6:
        free = (
            "its base does not move freely in the ground, so that plates do not determine the"
            " forces at its root"
        )
        raise BadModel(model.source or model.name, free)


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
        soft = _is_checked(options) and problem_of(model, recorded, options).tissue is not None
        uses = ("never", "always") if soft else ("never",)
    chosen = replace(options, soft_tissue=uses[0])
    while _is_checked(options):
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
        tried.append((refined_parts(options.fit), predictions))
        options = replace(options, fit=_fewer(options))
        chosen = replace(options, soft_tissue=uses[0])
    return _Choice(options=chosen, predictions=predictions, tried=tuple(tried))


def _is_checked(options: RefineOptions) -> bool:
    """Judge whether anything of the body is estimated that recordings left out can refuse."""
    return options.check and (options.fits_body or options.fits_masses)


def _fewer(options: RefineOptions) -> tuple[str, ...]:
    """Leave out what predicts worse: lengths and positions first, then masses too."""
    left_out = {LENGTHS, MARKERS} if options.fits_body else {MASSES}
    return tuple(name for name in options.fit if name not in left_out)


def _refinement(
    model: Model,
    recorded: Sequence[Opened],
    problem: Problem,
    solution: Solution,
    choice: _Choice,
    path_lengths: Callable[[Model], Array] | None,
) -> Refinement:
    """Build the result: model, motions, intervals and notes.

    Parameters
    ----------
    recorded : trials with their forces as recorded
    problem : with all frames, and forces that stand at the times of the markers
    solution : on fewer frames
    """
    at = solution.at
    estimate = certified(solution, force_verdict(choice.predictions))
    refined = tuple(_refined_trials(model, recorded, problem, at))
    refinement = Refinement(
        model=model_of(model, problem, at, path_lengths),
        given=model,
        trials=refined,
        lengths=tuple(length.name for length in problem.lengths.lengths),
        factors=at[LENGTHS],
        parameters=at[MASSES],
        predictions=choice.predictions,
        fit=tuple(kind.name for kind in problem.fitted),
        soft_tissue=problem.tissue,
        kept=bool(choice.tried),
        estimate=estimate,
    )
    notes = _notes(refinement, problem, solution, choice)
    of_recordings = [note for trial in recorded for note in trial.usable.notes]
    return replace(refinement, notes=(*markers_left(refined), *notes, *of_recordings))


def _refined_trials(
    model: Model, recorded: Sequence[Opened], problem: Problem, at: Point
) -> Iterator[RefinedTrial]:
    """Evaluate the motions of all trials, and their errors before and after."""
    setting = problem.setting(at)
    # Against what the plates say, whatever gain they were given.
    said = replace(problem, trials=tuple(replace(trial, gain=1.0) for trial in problem.trials))
    for number, (data, trial) in enumerate(zip(problem.trials, recorded, strict=True)):
        errors, residual = problem.predict(setting, said.state(at, number))
        used = residual[data.use]
        every = np.ones(len(trial.usable.use), bool)
        yield RefinedTrial(
            name=data.name,
            motion=problem.motion(at, number),
            before=errors_on(model, replace(trial, within=every)),
            after=Errors(rms(errors[data.seen]), rms(used[:, 3:]), rms(used[:, :3])),
            used=int(data.use.sum()),
            frames=len(data.time),
        )


def _notes(
    refinement: Refinement, problem: Problem, solution: Solution, choice: _Choice
) -> Iterator[Message]:
    """Report what may not be believed of the result."""
    yield from kept_note(choice.tried, choice.options)
    if not choice.tried or choice.predictions is not choice.tried[-1][1]:
        yield from worse_note(choice.predictions)
    yield from far_from_given(problem, solution.at)
    yield from clock_notes(refinement.clocks)
    if not solution.converged:
        yield SEARCH.message(
            f"not converged after {problem.options.iterations} steps: allow more iterations"
        )
