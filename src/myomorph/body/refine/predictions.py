"""Recordings predicted by what was refined from others.

Also whether that is worse than the model as given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from myomorph.body.identify.determined import LINK_SD
from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.body.identify.recordings import needed_wrench
from myomorph.body.refine.equations import linearize, with_trust
from myomorph.body.refine.estimating import RecordingsAt, as_fit
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.problem import MassPrior, Problem, Unknowns
from myomorph.body.refine.refinement import Errors, Prediction
from myomorph.body.refine.trial_data import Opened, opened, problem_of, thinned
from myomorph.core.fit.banded import reduce_banded
from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import with_inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.lengths import factors_of
from myomorph.core.rigid.regressor import base_wrench

LEAST_GAIN = 1e-3  # A step that lowers the cost by a smaller share is the last


@read_only
class Solution:
    """Where the search ended.

    Attributes
    ----------
    problem : with the weights of frames that it was solved with
    at : point
    costs : after every step
    converged : whether the last step was small, or none lowers the cost
    """

    problem: Problem
    at: Unknowns
    costs: tuple[float, ...]
    converged: bool


def settle(
    problem: Problem, progress: Callable[[], None] = lambda: None, first: Unknowns | None = None
) -> Solution:
    """Find the optimum, from that of the motions alone.

    That shows the frames that nothing explains.

    Parameters
    ----------
    problem : with what is unknown
    progress : called once a step
    first : of the motions alone, see `motions_alone`; found here by default
    """
    first = motions_alone(problem, progress) if first is None else first
    return solve(with_trust(problem, first), first, progress)


def motions_alone(problem: Problem, progress: Callable[[], None] = lambda: None) -> Unknowns:
    """Find the optimum of the motions on the body as given.

    Parameters
    ----------
    problem : with what is unknown
    progress : called once a step
    """
    still = replace(problem, body=False, masses=False)
    return solve(still, still.begin(), progress).at


def solve(
    problem: Problem, start: Unknowns, progress: Callable[[], None] = lambda: None
) -> Solution:
    """Search by Levenberg-Marquardt from a start.

    Parameters
    ----------
    problem : with what is unknown
    start : point
    progress : called once a step

    Returns
    -------
    the optimum, or where steps ended
    """
    method = Method(
        iterations=problem.options.iterations,
        min_gain=LEAST_GAIN,
        min_promise=0.0,
        kink=LEAST_GAIN,
    )
    ended = minimize(as_fit(problem, start), method=method, progress=progress)
    recordings = ended.at.parts[0]
    assert isinstance(recordings, RecordingsAt)
    return Solution(
        problem=problem,
        at=recordings.at,
        costs=ended.search.costs,
        converged=ended.search.converged,
    )


def covariance(problem: Problem, at: Unknowns) -> Array:
    """Compute the covariance of the shared unknowns, all motions unknown too.

    Masses that are identified first come from the same recordings, so that they are no prior
    knowledge: links are taken to differ from the given model by `LINK_SD`, as in `identify`.

    Parameters
    ----------
    problem : with the weights of frames that it was solved with
    at : optimum

    Returns
    -------
    (shared, shared)
    """
    if not problem.count:
        return np.zeros((0, 0))
    problem = replace(problem, prior=MassPrior.of(problem.prior.reference, LINK_SD))
    equations = linearize(problem, at)
    shared = NormalEquations(H=equations.H, g=equations.g)
    reduced = reduce_banded(equations.trials, shared)
    return np.asarray(np.linalg.inv(reduced.equations.H), dtype=np.float64)


def mass_sd(problem: Problem, at: Unknowns, spread: Array) -> Array:
    """Compute standard deviations of the masses.

    Parameters
    ----------
    problem : with what is unknown
    at : optimum
    spread : (shared, shared) covariance of the shared unknowns

    Returns
    -------
    (bodies,) [kg], 0 of those that do not change
    """
    result = np.zeros(len(problem.prior.reference))
    if problem.masses:
        masses = problem.columns()[2]
        rows = tangents(at.parameters[problem.prior.moved])[:, 0]
        for index, link in enumerate(problem.prior.moved):
            columns = slice(masses.start + 10 * index, masses.start + 10 * index + 10)
            result[link] = np.sqrt(rows[index] @ spread[columns, columns] @ rows[index])
    return result


WORSE = 1.02  # Ratio to the given model above which a prediction is worse
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
        on_made = replace(opened(made, held_out.trial, problem.options), within=held_out.within)
        return errors_on(made, on_made, use, problem.tissue)

    before = errors_on(model, held_out, use)
    few = thinned(problem)
    first = motions_alone(few, progress)
    refined = errors(model_of(model, problem, settle(few, progress, first).at))
    alone = before.markers
    if problem.body:
        # The given model may have been calibrated from all markers, these included: as fair a body
        # has seen the same.
        blind = replace(
            few,
            masses=False,
            trials=tuple(replace(trial, use=trial.use & False) for trial in few.trials),
        )
        alone = errors(model_of(model, problem, solve(blind, first, progress).at)).markers
    return Prediction(name=name, given=before, refined=refined, markers_alone=alone)


def worse(predictions: Sequence[Prediction]) -> bool:
    """Judge whether the refined body predicts forces worse or no longer fits the markers."""
    if not predictions:
        return False
    forces = float(np.mean([prediction.ratio for prediction in predictions]))
    markers = float(np.mean([prediction.markers_ratio for prediction in predictions]))
    return forces > WORSE or markers > LEAVES_MARKERS


def model_of(
    model: Model,
    problem: Problem,
    at: Unknowns,
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
        scale(model, factors_of(problem.lengths, at.factors), path_lengths=path_lengths)
        if problem.body
        else model
    )
    places = dict(zip(problem.names, problem.placed(at.factors, at.shifts), strict=True))
    placed = tuple(
        replace(marker, location=places.get(marker.name, marker.location))
        for marker in made.markers
    )
    return with_inertial_parameters(made.with_markers(placed), at.parameters)
