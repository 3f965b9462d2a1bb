"""How far a walk is from a norm: movement analysis profile, gait profile score and scaled score,
with intervals.

Of a variable the score is the root mean square of curve less norm over the cycle; the gait profile
score is the root mean square of these (Baker et al. 2009). Its logarithm, scaled so that the norm's
people have 100 with a standard deviation of 10, is what that paper calls GDI*, after the gait
deviation index (Schwartz and Rozumalski 2008), whose own features come from recordings that are not
ours to give away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np

from myomorph.core.fit.interval_rule import interval_of_errors
from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.interval import Interval
from myomorph.lab.analysis.cycles import band
from myomorph.lab.analysis.gait_curves import ANGLES, KEYS, SAMPLES, SIDES, GaitCurves, known_mean

MIN_PERSONS = 3
MIN_SCALED = 5
"""Persons from whom on a control group is a norm, and from whom on the spread of their own scores
is a scale.
"""
LEVEL = 0.9
PELVIS = 3  # Of the first variables, which both sides share
NONE = Interval(float("nan"), float("nan"), float("nan"))
MIN_SCORE = 0.1  # Below which a score is not told from the norm itself, whose logarithm is none [°]


@read_only
class GaitNorm:
    """Curves of people without complaints."""

    # mean, deviation: (SAMPLES, `KEYS`), NaN for a variable that it does not have; standard
    # deviation between people
    mean: Array
    deviation: Array
    persons: int
    source: str  # who they are, and where that comes from
    # by the names of `gait_parameters`, mean and standard deviation
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=lambda: FrozenMap({}))
    # whether angles have the definitions of those that are held against it; else scores are of
    # shape, without offsets
    same_definitions: bool = True
    # mean and standard deviation of the logarithms of their scores
    log_scores: tuple[float, float] | None = None
    # who they are, in a word or two
    group: str = ""
    # lowest and highest age [years] and walking speed [m/s] that they are a norm for
    ages: tuple[float, float] = (0.0, np.inf)
    speeds: tuple[float, float] = (0.0, np.inf)

    def __post_init__(self) -> None:
        freeze(self, mean=(SAMPLES, len(KEYS)), deviation=(SAMPLES, len(KEYS)))

    @property
    def has_curves(self) -> bool:
        """Whether it has a curve, and not parameters alone."""
        return bool(np.isfinite(self.mean).any())


@read_only
class GaitScores:
    """Scores of a walk, each with its interval."""

    profile: Mapping[tuple[str, str], Interval]  # by side and variable [°]
    score: Mapping[str, Interval]  # gait profile score by side, and "both" [°]
    scaled: Mapping[str, Interval]  # GDI*, by side, and "both"; {} where the norm has no scale
    variables: int  # of a side, that the score is of
    drawn: bool  # whether intervals hold draws of errors, rather than the mean over strides


def control_norm(persons: Sequence[GaitCurves], source: str) -> GaitNorm:
    """The norm of a control group, its legs together; raises `BadData` for fewer than
    `MIN_PERSONS`.
    """
    if len(persons) < MIN_PERSONS:
        raise BadData(
            f"{source}: {len(persons)} persons with strides: a norm takes {MIN_PERSONS} or more"
        )
    legs = np.stack([[person.mean(side) for side in SIDES] for person in persons])
    every = legs.reshape(-1, *legs.shape[2:])
    known = np.isfinite(every).sum(axis=0)
    mean = known_mean(every)
    deviation = np.sqrt(
        np.where(
            known > 1, np.nansum((every - mean) ** 2, axis=0) / np.maximum(known - 1, 1), np.nan
        )
    )
    return GaitNorm(
        mean=mean,
        deviation=deviation,
        persons=len(persons),
        source=source,
        log_scores=_log_scores(legs),
    )


def _log_scores(legs: Array) -> tuple[float, float] | None:
    """Mean and deviation of ln score of every leg held against the others: a norm does not know its
    patient.
    """
    if len(legs) < MIN_SCALED:
        return None
    logs = []
    for index in range(len(legs)):
        others = known_mean(np.delete(legs, index, axis=0).reshape(-1, *legs.shape[2:]))
        logs += [np.log(_score(_profile(leg, others))) for leg in legs[index]]
    return float(np.mean(logs)), float(np.std(logs, ddof=1))


def _profile(curves: Array, norm: Array, same_definitions: bool = True) -> Array:
    """(..., ANGLES) root mean square over the cycle of curves (..., samples, variables) less the
    norm, without their mean difference where it is one of definitions.
    """
    difference = curves[..., :ANGLES] - norm[:, :ANGLES]
    if not same_definitions:
        difference = difference - difference.mean(axis=-2, keepdims=True)
    return np.sqrt(np.mean(difference**2, axis=-2))


def _score(profile: Array) -> Array:
    """(...,) root mean square of the variables (..., n) that are known."""
    known = np.isfinite(profile)
    return np.sqrt(
        (np.where(known, profile, 0.0) ** 2).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    )


def gait_scores(
    curves: GaitCurves, norm: GaitNorm, errors: Mapping[str, Array] | None = None
) -> GaitScores:
    """Scores of each side, and of both: there the pelvis counts once, by the left side, as in the
    paper. A score is the mean over the strides of each one's; `errors` of the mean curves under
    draws, (draws, samples, variables) by side, give its interval of 90 %, else Student's t over the
    strides does. Errors of curves make a score larger, so the interval of draws may lie below it.
    """
    profiles = {side: _profile(curves.of(side), norm.mean, norm.same_definitions) for side in SIDES}
    shifted = (
        {}
        if errors is None
        else {side: _drawn_profiles(curves.of(side), errors[side], norm) for side in SIDES}
    )
    usable = {side: np.isfinite(profiles[side]).any(axis=0) for side in SIDES}
    profile = {}
    for side in SIDES:
        for index in np.flatnonzero(usable[side]):
            drawn = shifted[side][:, index] if shifted else None
            profile[side, KEYS[index]] = _estimate(profiles[side][:, index], drawn)
    score = {}
    for side in SIDES:
        drawn = _score(shifted[side]) if shifted else None
        score[side] = _estimate(_score(profiles[side]), drawn) if usable[side].any() else NONE
    count = min(len(profiles[side]) for side in SIDES)
    pairs = _both({side: profiles[side][:count] for side in SIDES})
    score["both"] = (
        _estimate(_score(pairs), _score(_both(shifted)) if shifted else None) if count else NONE
    )
    scaled = (
        {}
        if norm.log_scores is None
        else {side: _scaled(value, norm.log_scores) for side, value in score.items()}
    )
    return GaitScores(
        profile=profile,
        score=score,
        scaled=scaled,
        variables=int(max(usable[side].sum() for side in SIDES)),
        drawn=bool(shifted),
    )


def _both(profiles: Mapping[str, Array]) -> Array:
    """(n, variables) of both sides, the pelvis by the left one alone."""
    return np.concatenate([profiles["left"], profiles["right"][:, PELVIS:]], axis=1)


def _drawn_profiles(strides: Array, errors: Array, norm: GaitNorm) -> Array:
    """(draws, ANGLES): mean over the strides, all of them shifted by the error of a draw."""
    return np.stack(
        [
            known_mean(_profile(strides + error, norm.mean, norm.same_definitions))
            for error in errors
        ]
    )


def _estimate(strides: Array, drawn: Array | None) -> Interval:
    """Mean over the strides, with the interval of draws, else of the strides."""
    known = strides[np.isfinite(strides)]
    if not len(known):
        return NONE
    if drawn is not None:
        return interval_of_errors(float(known.mean()), drawn, LEVEL, distance=True)
    limits = band(known[:, None], LEVEL)
    value = float(known.mean())
    # Of the logarithm, by its first derivative: no score is below 0.
    factor = np.exp((limits.high[0] - value) / value) if value > 0.0 else 1.0
    return Interval(value, float(value / factor), float(value * factor))


def _scaled(score: Interval, log_scores: tuple[float, float]) -> Interval:
    """100 less ten standard deviations of the logarithm; a low score is a high index."""
    scores = np.maximum((score.value, score.high, score.low), MIN_SCORE)
    logs = (np.log(scores) - log_scores[0]) / log_scores[1]
    value, low, high = (100.0 - 10.0 * logs).tolist()
    return Interval(value=value, low=low, high=high)
