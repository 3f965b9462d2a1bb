"""Coverage of intervals of numbers that are no linear function of curves.

These are extremes, ranges, and distances from a norm.

The truths are the joint angles of a recorded walk. What is measured is off by a constant of each
coordinate, as of misplaced markers, and by skin that is alike for a while; draws add errors of the
same sizes once more, as `--draws` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

import myomorph as mm
from benchmarks.accuracy.intervals.covered import Covered, joined
from benchmarks.recordings import RECORDINGS
from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES, SIDES, GaitCurves
from myomorph.lab.analysis.gait_scores import GaitNorm, gait_scores
from myomorph.lab.study.trial.steps.uncertainty import AGAIN
from myomorph.lab.study.trial.trial_inputs import statistics_of
from myomorph.lab.uncertainty.spread import ValueErrors

RATE = 50.0
SECONDS = 4.0
"""Of curves, as poses are drawn [Hz], and their length [s]."""
CONSTANT = np.radians(2.0)
SKIN = np.radians(1.5)
ALIKE = 0.1
"""Errors of a joint angle that last, and that change [rad], and the time over which these are alike
[s].
"""
DRAWS = 100
CURVES = 40
WALKERS = 150
"""Draws, and truths of curves and of gait scores."""
AWAY = 4.0
"""By how much the mean of a walker's variable differs from the norm, standard deviation [°]."""
SCORE_ERRORS = (1.5, 3.0)
"""Constant errors of every variable of gait [°]."""


def numbers_of_curves(folder: Path, first: int) -> dict[str, Covered]:
    """Compare intervals of numbers of joint angles with the truth.

    Parameters
    ----------
    folder : of the data
    first : seed of the first truth

    Returns
    -------
    by number: minimum, maximum, range, mean
    """
    truth = _walk(folder)
    parts: dict[str, list[Covered]] = {}
    for seed in range(first, first + CURVES):
        for what, covered in _numbers(truth, np.random.default_rng(seed)).items():
            parts.setdefault(what, []).append(covered)
    return {what: joined(own) for what, own in parts.items()}


def _walk(folder: Path) -> Array:
    """Joint angles of a recorded walk, (frames, coordinates) [rad]."""
    files = RECORDINGS["treadmill"]
    model = mm.read_model(folder / files.model)
    motion = mm.read_motion(folder / files.motion, model)
    time = motion.time[0] + np.arange(0.0, SECONDS, 1.0 / RATE)
    columns = [np.interp(time, motion.time, column) for column in motion.values.T]
    moving = [column for column in columns if 0.1 < np.ptp(column) < np.pi]
    return np.column_stack(moving)


def _numbers(truth: Array, rng: np.random.Generator) -> dict[str, Covered]:
    """Measure curves (frames, coordinates) once, draw their errors, and compare."""
    measured = truth + _errors(rng, truth.shape)
    known = statistics_of(measured)
    errors = np.array([_errors(rng, truth.shape) for _ in range(DRAWS)])
    drawn = statistics_of(measured + errors, axis=1)
    twice = [
        statistics_of(measured + errors + np.roll(errors, shift + 1, axis=0), axis=1)
        for shift in range(AGAIN)
    ]
    result = {}
    for what, value in statistics_of(truth).items():
        names = tuple((what, str(column)) for column in range(len(value)))
        again = np.array([one[what] for one in twice]) - known[what]
        low, high, _ = ValueErrors(names, drawn[what] - known[what], again=again).limits()
        result[what] = Covered.of_limits(value, known[what] + low, known[what] + high)
    return result


def _errors(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Errors of joint angles (frames, coordinates): a constant, and skin [rad]."""
    frames, columns = shape
    width = ALIKE * RATE / np.sqrt(2.0)
    margin = int(np.ceil(4.0 * width))
    white = rng.standard_normal((frames + 2 * margin, columns))
    # A Gaussian of unit sum makes white noise this much smaller.
    smaller = np.sqrt(2.0 * np.sqrt(np.pi) * width)
    skin = smaller * gaussian_filter1d(white, width, axis=0)[margin:-margin]
    return np.asarray(CONSTANT * rng.standard_normal(columns) + SKIN * skin)


def gait_profile_scores(error: float, first: int) -> Covered:
    """Compare intervals of gait profile scores with those of the true curves.

    Parameters
    ----------
    error : constant, of each variable [°]
    first : seed of the first walker

    Returns
    -------
    of both sides and of both together
    """
    norm = GaitNorm(
        mean=np.zeros((SAMPLES, len(KEYS))),
        deviation=np.ones((SAMPLES, len(KEYS))),
        persons=1,
        source="simulated",
    )
    parts = [_score(norm, error, seed) for seed in range(first, first + WALKERS)]
    return joined(parts)


def _score(norm: GaitNorm, error: float, seed: int) -> Covered:
    """Compare the scores of one walker."""
    rng = np.random.default_rng(seed)
    own = {side: AWAY * rng.standard_normal((1, 1, len(KEYS))) for side in SIDES}
    off = {side: error * rng.standard_normal((1, 1, len(KEYS))) for side in SIDES}
    errors = {side: error * rng.standard_normal((DRAWS, 1, len(KEYS))) for side in SIDES}
    whole = {side: np.repeat(errors[side], SAMPLES, axis=1) for side in SIDES}
    truth = gait_scores(_walker(own), norm).score
    found = gait_scores(_walker({side: own[side] + off[side] for side in SIDES}), norm, whole).score
    return Covered.of_limits(
        np.array([truth[name].value for name in found]),
        np.array([interval.low for interval in found.values()]),
        np.array([interval.high for interval in found.values()]),
    )


def _walker(strides: Mapping[str, Array]) -> GaitCurves:
    """Make a walker of whom each side has one stride, (1, 1, variables) the same all along."""
    curves = {side: np.repeat(values, SAMPLES, axis=1) for side, values in strides.items()}
    return GaitCurves(
        right=Cycles(KEYS, curves["right"]),
        left=Cycles(KEYS, curves["left"]),
        strides=dict.fromkeys(SIDES, ()),
    )
