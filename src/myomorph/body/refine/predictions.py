"""Recordings predicted by what was refined from others.

Also whether that is worse than the model as given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from myomorph.body.identify.recordings import needed_wrench
from myomorph.body.refine.opened import Opened
from myomorph.body.refine.options import CLOCK, LENGTHS, MASSES, RefineOptions
from myomorph.body.refine.point import Point
from myomorph.body.refine.problem import Problem
from myomorph.body.refine.refinement import Errors, Prediction
from myomorph.body.refine.search import motions_alone, settle, solve
from myomorph.body.refine.trial_data import opened, problem_of, thinned, with_shift
from myomorph.core.fit.verdict import WORSE, Verdict
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import with_inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.lengths import factors_of
from myomorph.core.rigid.regressor import base_wrench

LEAVES_MARKERS = 1.1
"""Ratio of the marker errors of predictions to those of a body that only markers made, above which
a refined body is not taken, whatever its forces.
"""


def errors_on(
    model: Model, opened: Opened, use: np.ndarray | None = None, tissue: SoftTissue | None = None
) -> Errors:
    """Compute errors of plain inverse kinematics, filtered, on a model.

    The residual is that of frames in which the plates carry all.

    Parameters
    ----------
    model : with masses
    opened : trial on this model
    use : (frames,) in which the plates carry all; by default as the model itself says
    tissue : by which markers move more than the mass

    Returns
    -------
    root mean squares of markers [m], force [N] and moment [N m]
    """
    within = opened.within
    recording = (
        opened.usable.recording if tissue is None else opened.usable.recording.moved(tissue.of)
    )
    counts = opened.usable.use if use is None else use
    residual = needed_wrench(model, recording.motion) - base_wrench(
        model, recording.motion, recording.wrenches
    )
    residual = residual[counts if within is None else counts & within]
    distances = opened.distances
    if within is not None:
        time = recording.motion.time[within]
        distances = distances[
            (opened.motion.time >= time[0] - 1e-9) & (opened.motion.time <= time[-1] + 1e-9)
        ]
    return Errors(
        float(np.sqrt(np.nanmean(distances**2))), rms(residual[:, 3:]), rms(residual[:, :3])
    )


def rms(vectors: Array) -> float:
    """Compute the root mean square of the norm of vectors.

    Parameters
    ----------
    vectors : (frames, 3)

    Returns
    -------
    root mean square; NaN without a frame
    """
    return float(np.sqrt(np.mean(np.square(vectors).sum(axis=1)))) if len(vectors) else float("nan")


def predictions_of(
    model: Model, recorded: Sequence[Opened], options: RefineOptions, progress: Callable[[], None]
) -> tuple[Prediction, ...]:
    """Predict every trial by the others, or the halves of a single one by each other.

    Parameters
    ----------
    model : as given
    recorded : trials on it
    options : what is refined
    progress : called once a step

    Returns
    -------
    one for each trial, or for both halves
    """
    if len(recorded) > 1:
        held_out = [
            (on.trial.name, [other for other in recorded if other is not on], on) for on in recorded
        ]
    else:
        (on,) = recorded
        name = on.trial.name
        use = on.usable.use
        middle = np.cumsum(use) * 2 >= use.sum()
        first = replace(on, within=~middle)
        second = replace(on, within=middle)
        held_out = [
            (f"{name}, second half", [first], second),
            (f"{name}, first half", [second], first),
        ]
    return tuple(
        _prediction(name, model, problem_of(model, rest, options), left_out, progress)
        for name, rest, left_out in held_out
    )


def _prediction(
    name: str, model: Model, problem: Problem, held_out: Opened, progress: Callable[[], None]
) -> Prediction:
    """Predict what is left out of a problem.

    Parameters
    ----------
    held_out : a trial on the given model
    """
    # All models are judged on the same frames: which ones the plates carry alone is not for a new
    # body to say.
    use = held_out.usable.use

    def errors(made: Model) -> Errors:
        on_made = opened(made, held_out.trial, problem.options)
        if held_out.shift != 0.0:
            on_made = with_shift(made, on_made, problem.options, held_out.shift)
        return errors_on(made, replace(on_made, within=held_out.within), use, problem.tissue)

    before = errors_on(model, held_out, use)
    few = thinned(problem)
    first = motions_alone(few, progress)
    refined = errors(model_of(model, problem, settle(few, progress, first).at))
    alone = before.markers
    if problem.options.fits_body:
        # The given model may have been calibrated from all markers, these included: as fair a body
        # has seen the same.
        blind = replace(
            few,
            fit=tuple(name for name in problem.fit if name not in (MASSES, CLOCK)),
            trials=tuple(replace(trial, use=trial.use & False) for trial in few.trials),
        )
        alone = errors(model_of(model, problem, solve(blind, first, progress).at)).markers
    within = held_out.within
    return Prediction(
        name=name,
        given=before,
        refined=refined,
        markers_alone=alone,
        used=int(np.sum(use if within is None else use & within)),
    )


def force_verdict(predictions: Sequence[Prediction]) -> Verdict | None:
    """Judge whether the refined body predicts forces worse than the given one.

    Parameters
    ----------
    predictions : of what was not used

    Returns
    -------
    misfits of force and moment, None where nothing was predicted
    """
    if not predictions:
        return None
    refined = [(each.refined.force, each.refined.moment) for each in predictions]
    given = [(each.given.force, each.given.moment) for each in predictions]
    return Verdict(
        kinds=(("force", "N"), ("moment", "N m")),
        parts=tuple(each.name for each in predictions),
        estimate=np.array(refined),
        generic=np.array(given),
        weights=np.array([each.used for each in predictions], np.float64),
        what="what was not used",
        limit=WORSE,
    )


def markers_verdict(predictions: Sequence[Prediction]) -> Verdict:
    """Judge whether the refined body fits markers worse than one that markers alone made.

    Parameters
    ----------
    predictions : of what was not used; one or more
    """
    refined = [(1e3 * each.refined.markers,) for each in predictions]
    alone = [(1e3 * each.markers_alone,) for each in predictions]
    return Verdict(
        kinds=(("markers", "mm"),),
        parts=tuple(each.name for each in predictions),
        estimate=np.array(refined),
        generic=np.array(alone),
        weights=np.array([each.used for each in predictions], np.float64),
        what="what was not used",
        limit=LEAVES_MARKERS,
    )


def worse(predictions: Sequence[Prediction]) -> bool:
    """Judge whether the refined body predicts forces worse or no longer fits the markers."""
    forces = force_verdict(predictions)
    if forces is None or not forces.known:
        return False
    return not (forces.better and markers_verdict(predictions).better)


def model_of(
    model: Model,
    problem: Problem,
    at: Point,
    path_lengths: Callable[[Model], Array] | None = None,
) -> Model:
    """Give a model the lengths, marker positions and masses of a point.

    Parameters
    ----------
    model : as given
    problem : with what is unknown
    at : point
    path_lengths : lets muscles keep their ratio of fiber to path, as in `scale`

    Returns
    -------
    the stretched model
    """
    made = (
        scale(model, factors_of(problem.lengths.lengths, at[LENGTHS]), path_lengths=path_lengths)
        if LENGTHS in problem.fit
        else model
    )
    places = dict(zip(problem.names, problem.placed(at), strict=True))
    placed = tuple(
        replace(marker, location=places.get(marker.name, marker.location))
        for marker in made.markers
    )
    return with_inertial_parameters(made.with_markers(placed), at[MASSES])
