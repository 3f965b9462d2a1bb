"""Recordings predicted by what was refined from others, and whether that is worse than the model as
given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from myomorph.body.identify.determined import LINK_SD
from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.body.identify.recordings import needed_wrench
from myomorph.body.refine.equations import Equations, cost, linearize, with_trust
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.problem import MassPrior, Problem, Unknowns, moved
from myomorph.body.refine.refinement import Errors, Prediction
from myomorph.body.refine.trial_data import Opened, opened, problem_of, thinned
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
    """Where the search ended."""

    problem: Problem  # with the weights of frames that it was solved with
    at: Unknowns
    costs: tuple[float, ...]  # after every step
    converged: bool


def settle(
    problem: Problem, progress: Callable[[], None] = lambda: None, first: Unknowns | None = None
) -> Solution:
    """The optimum, from that of the motions alone, which shows the frames that nothing explains.
    `first`: of the motions alone, see `motions_alone`; found here by default.
    """
    first = motions_alone(problem, progress) if first is None else first
    return solve(with_trust(problem, first), first, progress)


def motions_alone(problem: Problem, progress: Callable[[], None] = lambda: None) -> Unknowns:
    """The optimum of the motions on the body as given."""
    still = replace(problem, body=False, masses=False)
    return solve(still, still.begin(), progress).at


def solve(
    problem: Problem, start: Unknowns, progress: Callable[[], None] = lambda: None
) -> Solution:
    """Levenberg-Marquardt from a start."""
    at = start
    damping = 1e-6
    costs = [cost(problem, at)]
    converged = False
    for _ in range(problem.options.iterations):
        equations = linearize(problem, at)
        accepted = False
        while not accepted and damping < 1e4:
            motions, shared = step(problem, equations, damping)
            trial = moved(problem, at, motions, shared)
            accepted = (
                bool(trial.factors.min(initial=1.0) > 0.3) and cost(problem, trial) <= costs[-1]
            )
            damping = max(damping * 0.1, 1e-9) if accepted else damping * 10.0
        progress()
        if not accepted:
            converged = True
            break
        at = trial
        costs.append(cost(problem, at))
        if costs[-2] - costs[-1] < LEAST_GAIN * costs[-2]:
            converged = True
            break
    return Solution(problem=problem, at=at, costs=tuple(costs), converged=converged)


def step(problem: Problem, equations: Equations, damping: float) -> tuple[tuple[Array, ...], Array]:
    """Changes of each trial's coefficients, and of the shared unknowns."""
    reduced, right, solved = _reduce(equations, damping)
    shared = (
        -scipy.linalg.cho_solve(scipy.linalg.cho_factor(reduced), right)
        if len(right)
        else np.zeros(0)
    )
    n = len(problem.pose.free)
    motions = tuple((-block[:, 0] - block[:, 1:] @ shared).reshape(-1, n) for block in solved)
    return motions, shared


def _reduce(equations: Equations, damping: float) -> tuple[Array, Array, list[Array]]:
    """Normal equations of the shared unknowns with all motions eliminated, and what eliminates
    them.
    """
    H = equations.H.copy()
    g = equations.g.copy()
    H[np.diag_indices_from(H)] *= 1.0 + damping
    solved = []
    for trial in equations.trials:
        band = trial.band.copy()
        band[0] = band[0] * (1.0 + damping) + 1e-12 * band[0].max()
        factor = scipy.linalg.cholesky_banded(band, lower=True, overwrite_ab=True)
        reduced = scipy.linalg.cho_solve_banded(
            (factor, True), np.column_stack([trial.right, trial.cross])
        )
        H -= trial.cross.T @ reduced[:, 1:]
        g -= trial.cross.T @ reduced[:, 0]
        solved.append(reduced)
    return H, g, solved


def covariance(problem: Problem, at: Unknowns) -> Array:
    """(shared, shared) of the shared unknowns, all motions unknown too.
    Masses that are identified first come from the same recordings, so that they are no prior
    knowledge: links are taken to differ from the given model by `LINK_SD`, as in `identify`.
    """
    if not problem.count:
        return np.zeros((0, 0))
    problem = replace(problem, prior=MassPrior.of(problem.prior.reference, LINK_SD))
    return np.asarray(np.linalg.inv(_reduce(linearize(problem, at), 0.0)[0]), dtype=np.float64)


def mass_sd(problem: Problem, at: Unknowns, spread: Array) -> Array:
    """(bodies,) standard deviation of the masses [kg], 0 of those that do not change."""
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
    """Errors of plain inverse kinematics, filtered, on a model; the residual where the plates carry
    all. `use` (frames,) in which the plates carry all; by default as the model itself says;
    `tissue`: by which markers move more than the mass.
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
    """Root mean square of the size of vectors (frames, 3)."""
    return float(np.sqrt(np.mean(np.square(vectors).sum(axis=1)))) if len(vectors) else float("nan")


def predictions_of(
    model: Model, recorded: Sequence[Opened], options: RefineOptions, progress: Callable[[], None]
) -> tuple[Prediction, ...]:
    """Every trial by the others, or the halves of a single one by each other."""
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
    """What is left out of a problem, predicted. `held_out`: a trial on the given model."""
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
    """Whether the refined body predicts forces worse or no longer fits the markers."""
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
    """The given model with the lengths, marker positions and masses of a point."""
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
