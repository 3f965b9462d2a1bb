"""Recordings predicted by what was refined from others, and whether that is worse than the model as given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from myomorph.identify.refine.options import RefineOptions
from myomorph.identify.refine.problem import Problem, Unknowns
from myomorph.identify.refine.refinement import Errors, Prediction, SubjectTrial
from myomorph.identify.refine.solve import motions_alone, settle, solve
from myomorph.identify.refine.trial_data import Opened, opened, problem_of, thinned
from myomorph.model.arrays import Array
from myomorph.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.model.model import Model
from myomorph.model.scale import scale
from myomorph.model.series import Motion
from myomorph.motion.lengths import factors_of
from myomorph.rigid.regressor import base_wrench, regressor_blocks

Kind = TypeVar("Kind")
WORSE = 1.02  # Ratio to the given model above which a prediction is worse
LEAVES_MARKERS = 1.1
"""Ratio of the marker errors of predictions to those of a body that only markers made, above which a refined body is
not taken, whatever its forces."""


def errors_on(model: Model, opened: Opened, within: np.ndarray | None = None, use: np.ndarray | None = None) -> Errors:
    """Errors of plain inverse kinematics, filtered, on a model; the residual where the plates carry all.
    `within` (frames,) of the forces' clock that count; all by default; `use` (frames,) in which the plates carry all;
    by default as the model itself says.
    """
    recording = opened.usable.recording
    counts = opened.usable.use if use is None else use
    residual = _needed(model, recording.motion) - base_wrench(model, recording.motion, recording.wrenches)
    residual = residual[counts if within is None else counts & within]
    distances = opened.distances if within is None else opened.distances[_inside(opened, within)]
    return Errors(float(np.sqrt(np.nanmean(distances**2))), rms(residual[:, 3:]), rms(residual[:, :3]))


def _inside(opened: Opened, within: np.ndarray) -> np.ndarray:
    """(frames,) of the markers' clock that lie where the frames of the forces' clock count."""
    time = opened.usable.recording.motion.time[within]
    return (opened.motion.time >= time[0] - 1e-9) & (opened.motion.time <= time[-1] + 1e-9)


def rms(vectors: Array) -> float:
    """Root mean square of the size of vectors (frames, 3)."""
    return float(np.sqrt(np.mean(np.square(vectors).sum(axis=1)))) if len(vectors) else float("nan")


def _needed(model: Model, motion: Motion) -> Array:
    parameters = inertial_parameters(model).ravel()
    return np.concatenate([block.rows @ parameters for block in regressor_blocks(model, motion)])


def predictions_of(
    model: Model,
    trials: Sequence[SubjectTrial],
    recorded: Sequence[Opened],
    options: RefineOptions,
    progress: Callable[[], None],
) -> tuple[Prediction, ...]:
    """Every trial by the others, or the halves of a single one by each other."""
    held_out: Iterator[tuple[str, Problem, tuple[SubjectTrial, Opened, np.ndarray | None]]]
    if len(trials) > 1:
        held_out = (
            (trial.name, problem_of(model, _without(trials, i), _without(recorded, i), options), (trial, on, None))
            for i, (trial, on) in enumerate(zip(trials, recorded, strict=True))
        )
    else:
        (trial,), (on,) = trials, recorded
        middle = np.cumsum(on.usable.use) * 2 >= on.usable.use.sum()
        held_out = (
            (f"{trial.name}, {half}", problem_of(model, trials, recorded, options, {0: seen}), (trial, on, ~seen))
            for half, seen in (("second half", ~middle), ("first half", middle))
        )
    return tuple(_prediction(name, model, problem, left_out, progress) for name, problem, left_out in held_out)


def _without(every: Sequence[Kind], left_out: int) -> list[Kind]:
    return [kind for i, kind in enumerate(every) if i != left_out]


def _prediction(
    name: str,
    model: Model,
    problem: Problem,
    held_out: tuple[SubjectTrial, Opened, np.ndarray | None],
    progress: Callable[[], None],
) -> Prediction:
    """What is left out of a problem, predicted.
    `held_out`: a trial, the same on the given model, and (frames,) which of the forces' clock count.
    """
    trial, on_given, within = held_out
    # All models are judged on the same frames: which ones the plates carry alone is not for a new body to say.
    use = on_given.usable.use

    def errors(made: Model) -> Errors:
        return errors_on(made, opened(made, trial, problem.options), within, use)

    before, few = errors_on(model, on_given, within, use), thinned(problem)
    first = motions_alone(few, progress)
    refined = errors(model_of(model, problem, settle(few, progress, first).at))
    alone = before.markers
    if problem.body:
        # The given model may have been calibrated from all markers, these included: as fair a body has seen the same.
        blind = replace(few, masses=False, trials=tuple(replace(trial, use=trial.use & False) for trial in few.trials))
        alone = errors(model_of(model, problem, solve(blind, first, progress).at)).markers
    return Prediction(name, before, refined, alone)


def worse(predictions: Sequence[Prediction]) -> bool:
    """Whether the refined body predicts forces worse than the given one, or lets go of the markers."""
    if not predictions:
        return False
    forces = float(np.mean([prediction.ratio for prediction in predictions]))
    markers = float(np.mean([prediction.markers_ratio for prediction in predictions]))
    return forces > WORSE or markers > LEAVES_MARKERS


def model_of(
    model: Model, problem: Problem, at: Unknowns, path_lengths: Callable[[Model], Array] | None = None
) -> Model:
    """The given model with the lengths, marker positions and masses of a point."""
    made = scale(model, factors_of(problem.lengths, at.factors), path_lengths=path_lengths) if problem.body else model
    places = dict(zip(problem.names, problem.placed(at.factors, at.shifts), strict=True))
    placed = tuple(replace(marker, location=places.get(marker.name, marker.location)) for marker in made.markers)
    return with_inertial_parameters(made.with_markers(placed), at.parameters)
