"""Differences of a walk from a norm: by variable, of a side and of both, and scaled.

Of a variable the score is the root mean square of curve less norm over the cycle; that of a side
the root mean square of its variables. With all nine angles and their offsets it is the gait profile
score (Baker et al. 2009). Its logarithm, scaled so that the norm's people have 100 with a standard
deviation of 10, is what that paper calls GDI*, after the gait deviation index (Schwartz and
Rozumalski 2008), whose own features come from recordings that are not ours to give away.

One rule scores patients and controls: every stride has its score, and a person's is their mean. A
mean curve is smoother than its strides, so that a patient's strides beside mean curves of controls
would make everybody a patient.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

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
BOTH = "both"
NONE = Interval(float("nan"), float("nan"), float("nan"))
MIN_SCORE = 0.1  # A smaller score is that of the norm itself, whose logarithm is none [°].


class LogScores(NamedTuple):
    """Mean and standard deviation of the logarithms of scores."""

    mean: float
    sd: float


@dataclass(frozen=True, kw_only=True)
class ScoreScale:
    """Scores of a norm's own people, each held against the others.

    Attributes
    ----------
    side : of one side
    both : of both sides together, which differ less between people
    """

    side: LogScores
    both: LogScores

    def scaled(self, score: Interval, which: str) -> Interval:
        """Scale a score to 100 less ten standard deviations of its logarithm.

        Parameters
        ----------
        score : 0 or more
        which : "right", "left" or "both"
        """
        own = self.both if which == BOTH else self.side
        scores = np.maximum((score.value, score.high, score.low), MIN_SCORE)
        logs = (np.log(scores) - own.mean) / own.sd
        value, low, high = (100.0 - 10.0 * logs).tolist()
        return Interval(value=value, low=low, high=high)


@read_only
class GaitNorm:
    """Curves of people without complaints.

    Attributes
    ----------
    mean, deviation : (SAMPLES, `KEYS`), NaN for a variable that it does not have; standard
        deviation between people
    persons : how many, 0 where it is not known
    source : who they are, and where that comes from
    parameters : by the names of `gait_parameters`, mean and standard deviation
    same_definitions : whether angles have the definitions of those that are held against it; else
        scores are of shape, without offsets
    scale : of scores; None for fewer than `MIN_SCALED` people
    old_scale : whether a file has a scale by a rule that is not that of patients
    group : who they are, in a word or two
    ages, speeds : lowest and highest age [years] and walking speed [m/s] that they are a norm for
    """

    mean: Array
    deviation: Array
    persons: int
    source: str
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=lambda: FrozenMap({}))
    same_definitions: bool = True
    scale: ScoreScale | None = None
    old_scale: bool = False
    group: str = ""
    ages: tuple[float, float] = (0.0, np.inf)
    speeds: tuple[float, float] = (0.0, np.inf)

    def __post_init__(self) -> None:
        freeze(self, mean=(SAMPLES, len(KEYS)), deviation=(SAMPLES, len(KEYS)))

    @property
    def has_curves(self) -> bool:
        """Whether it has a curve, and not parameters alone."""
        return bool(np.isfinite(self.mean).any())

    @property
    def angles(self) -> Array:
        """(ANGLES,) whether it has each angle."""
        return np.asarray(np.isfinite(self.mean[:, :ANGLES]).any(axis=0))


@read_only
class GaitScores:
    """Scores of a walk, each with its interval.

    Attributes
    ----------
    profile : by side and variable [°]
    score : by side, and "both" [°]
    scaled : by side, and "both"; {} where the norm has no scale of the same variables
    variables : of a side, that the score is of
    offsets : whether they count, or shape alone
    drawn : whether intervals hold draws of errors, rather than the mean over strides
    """

    profile: Mapping[tuple[str, str], Interval]
    score: Mapping[str, Interval]
    scaled: Mapping[str, Interval]
    variables: int
    offsets: bool
    drawn: bool

    @property
    def is_gait_profile_score(self) -> bool:
        """Whether scores are those of Baker et al. 2009: of all nine angles, with offsets."""
        return self.offsets and self.variables == ANGLES


def control_norm(persons: Sequence[GaitCurves], source: str) -> GaitNorm:
    """Make the norm of a control group, its legs together.

    Parameters
    ----------
    persons : of the group
    source : who they are

    Raises
    ------
    BadData : fewer than `MIN_PERSONS`
    """
    if len(persons) < MIN_PERSONS:
        raise BadData(
            f"{source}: {len(persons)} persons with strides: a norm needs {MIN_PERSONS} or more"
        )
    legs = np.stack([[person.mean(side) for side in SIDES] for person in persons])
    every = legs.reshape(-1, *legs.shape[2:])
    known = np.isfinite(every).sum(axis=0)
    mean = known_mean(every)
    squares = np.nansum((every - mean) ** 2, axis=0)
    deviation = np.sqrt(np.where(known > 1, squares / np.maximum(known - 1, 1), np.nan))
    return GaitNorm(
        mean=mean,
        deviation=deviation,
        persons=len(persons),
        source=source,
        scale=_scale(persons, legs),
    )


def _scale(persons: Sequence[GaitCurves], legs: Array) -> ScoreScale | None:
    """Score every person against the others, as a norm does not know its patient.

    The others are one fewer, so that their mean is farther from a person than that of all is from
    a patient. With the squared score Q of strides and R of mean curves, both against the n - 1
    others, a patient's squared score against all n is on average Q - R / n^2.

    Parameters
    ----------
    persons : of the group
    legs : (persons, sides, SAMPLES, `KEYS`) their mean curves

    Returns
    -------
    None for too few people who have all variables of the group
    """
    has = np.isfinite(legs[..., :ANGLES]).all(axis=(1, 2))
    whole = np.flatnonzero((has == has.any(axis=0)).all(axis=1))
    if len(whole) < MIN_SCALED:
        return None
    scores: dict[str, list[float]] = {"side": [], BOTH: []}
    squares = np.zeros(2)  # Of mean curves, and of strides
    for index in whole:
        others = known_mean(np.delete(legs, index, axis=0).reshape(-1, *legs.shape[2:]))
        profiles = {side: _profile(persons[int(index)].of(side), others) for side in SIDES}
        of_strides = [_person_score(profiles[side]) for side in SIDES]
        of_curves = _score(_profile(legs[index], others))
        scores["side"] += of_strides
        scores[BOTH].append(_person_score(_both(profiles)))
        squares += [np.mean(of_curves**2), np.mean(np.square(of_strides))]
    shift = 0.5 * np.log1p(-squares[0] / (len(legs) ** 2 * squares[1]))
    return ScoreScale(
        side=_log_scores(scores["side"], float(shift)), both=_log_scores(scores[BOTH], float(shift))
    )


def _log_scores(scores: Sequence[float], shift: float) -> LogScores:
    """Take mean and deviation of the logarithms of scores, the mean shifted."""
    logs = np.log(scores)
    return LogScores(mean=float(np.mean(logs)) + shift, sd=float(np.std(logs, ddof=1)))


def _profile(curves: Array, norm: Array, same_definitions: bool = True) -> Array:
    """Take the root mean square over the cycle of curves less the norm, by variable.

    Parameters
    ----------
    curves : (..., samples, variables)
    norm : (samples, variables)
    same_definitions : else their mean difference, which is one of definitions, does not count

    Returns
    -------
    (..., ANGLES)
    """
    difference = curves[..., :ANGLES] - norm[:, :ANGLES]
    if not same_definitions:
        difference = difference - difference.mean(axis=-2, keepdims=True)
    return np.sqrt(np.mean(difference**2, axis=-2))


def _score(profile: Array) -> Array:
    """Take the root mean square of the variables that are known.

    Parameters
    ----------
    profile : (..., variables)

    Returns
    -------
    (...,)
    """
    known = np.isfinite(profile)
    squares = (np.where(known, profile, 0.0) ** 2).sum(axis=-1)
    return np.sqrt(squares / np.maximum(known.sum(axis=-1), 1))


def _person_score(profiles: Array) -> float:
    """Mean over the strides of each one's score; profiles (strides, variables)."""
    return float(_score(profiles).mean())


def gait_scores(
    curves: GaitCurves, norm: GaitNorm, errors: Mapping[str, Array] | None = None
) -> GaitScores:
    """Score each side, and both: there the pelvis counts once, by the left side, as in the paper.

    A score is the mean over the strides of each one's. Errors of curves make it larger, so the
    interval of draws may lie below it.

    Parameters
    ----------
    curves : of both sides over their strides
    norm : that they are held against
    errors : by side, (draws, samples, variables) errors of the mean curves under draws, which give
        the intervals of 90 %; without them Student's t over the strides does

    Returns
    -------
    GaitScores by side and of both, scaled where the same angles are known as in the norm
    """
    profiles = {side: _profile(curves.of(side), norm.mean, norm.same_definitions) for side in SIDES}
    shifted = None
    if errors is not None:
        shifted = {side: _drawn_profiles(curves.of(side), errors[side], norm) for side in SIDES}
    score = _scores(profiles, shifted)
    usable = {side: np.isfinite(profiles[side]).any(axis=0) for side in SIDES}
    comparable = norm.same_definitions and all(
        (usable[side] == norm.angles).all() for side in SIDES
    )
    scaled = {}
    if norm.scale is not None and comparable:
        scaled = {which: norm.scale.scaled(value, which) for which, value in score.items()}
    return GaitScores(
        profile=_by_variable(profiles, shifted),
        score=score,
        scaled=scaled,
        variables=int(max(usable[side].sum() for side in SIDES)),
        offsets=norm.same_definitions,
        drawn=shifted is not None,
    )


def _scores(
    profiles: Mapping[str, Array], shifted: Mapping[str, Array] | None
) -> dict[str, Interval]:
    """Score sides and both.

    Parameters
    ----------
    profiles : by side, (strides, ANGLES)
    shifted : by side, (draws, ANGLES) under the errors of draws
    """
    score = {}
    for side in SIDES:
        drawn = None if shifted is None else _score(shifted[side])
        known = np.isfinite(profiles[side]).any()
        score[side] = _estimate(_score(profiles[side]), drawn) if known else NONE
    pairs = _both(profiles)
    drawn = None if shifted is None else _score(_both(shifted))
    score[BOTH] = _estimate(_score(pairs), drawn) if len(pairs) else NONE
    return score


def _by_variable(
    profiles: Mapping[str, Array], shifted: Mapping[str, Array] | None
) -> dict[tuple[str, str], Interval]:
    """Score each variable of each side that is known; arguments are those of `_scores`."""
    profile = {}
    for side in SIDES:
        for index in np.flatnonzero(np.isfinite(profiles[side]).any(axis=0)):
            drawn = None if shifted is None else shifted[side][:, index]
            profile[side, KEYS[index]] = _estimate(profiles[side][:, index], drawn)
    return profile


def _both(profiles: Mapping[str, Array]) -> Array:
    """Join both sides, stride by stride, the pelvis by the left one alone.

    Parameters
    ----------
    profiles : by side, (strides, ANGLES)

    Returns
    -------
    (n, variables) of the strides that both sides have
    """
    count = min(len(profiles[side]) for side in SIDES)
    return np.concatenate([profiles["left"][:count], profiles["right"][:count, PELVIS:]], axis=1)


def _drawn_profiles(strides: Array, errors: Array, norm: GaitNorm) -> Array:
    """Mean over the strides of their profiles, all of them shifted by the error of a draw.

    Parameters
    ----------
    strides : (strides, samples, variables)
    errors : (draws, samples, variables)

    Returns
    -------
    (draws, ANGLES)
    """
    return np.stack(
        [
            known_mean(_profile(strides + error, norm.mean, norm.same_definitions))
            for error in errors
        ]
    )


def _estimate(strides: Array, drawn: Array | None) -> Interval:
    """Take the mean over the strides, with the interval of draws, else of the strides.

    Parameters
    ----------
    strides : (strides,)
    drawn : (draws,), None without draws
    """
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
