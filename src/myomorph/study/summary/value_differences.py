"""Differences of values between conditions or groups, with what draws of errors leave open in their intervals."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.special import stdtrit as student_quantile

from myomorph.model.arrays import Array
from myomorph.report.study.study_given import ValueDifference
from myomorph.study.trial.trial_inputs import Value
from myomorph.uncertainty.value_errors import ValueErrors, of_subject

CONFIDENCE = 0.95
"""Of the intervals, as of those of curves and of parameters of strides."""
Row = tuple[str, ...]
_Name = tuple[str, str]
"""Step and quantity."""


@dataclass
class _Own:
    """A quantity of one subject in one condition: values of its trials, and their errors (draws,) where drawn."""

    values: list[float] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)

    @property
    def mean(self) -> float:
        return float(np.mean(self.values))

    @property
    def drawn(self) -> bool:
        """Whether all trials have errors of as many draws."""
        return len(self.errors) == len(self.values) and len({len(one) for one in self.errors}) == 1

    @property
    def error(self) -> Array:
        """Of the mean (draws,)."""
        return np.asarray(np.mean(self.errors, axis=0))


class MeasuredValues:
    """Values of all trials and their errors under draws, by condition, quantity and subject."""

    def __init__(self) -> None:
        self.units: dict[_Name, str] = {}
        self._values: dict[str, dict[_Name, dict[str, _Own]]] = {}

    def add(self, whose: tuple[str, str, str], values: Sequence[Value], drawn: ValueErrors | None) -> None:
        """One more trial: subject, condition and trial."""
        subject, condition, _ = whose
        errors = None if drawn is None else of_subject(drawn.errors, subject).astype(np.float32)
        at = {} if drawn is None else {name: k for k, name in enumerate(drawn.names)}
        own = self._values.setdefault(condition, {})
        for one in values:
            name = (one.step, one.quantity)
            self.units[name] = one.unit
            found = own.setdefault(name, {}).setdefault(subject, _Own())
            found.values.append(one.value)
            if errors is not None and name in at:
                found.errors.append(errors[:, at[name]])

    def of(self, condition: str) -> dict[_Name, dict[str, _Own]]:
        """By quantity and subject."""
        return self._values.get(condition, {})

    @property
    def subjects(self) -> set[str]:
        """All of them."""
        return {name for own in self._values.values() for found in own.values() for name in found}


def differences(values: MeasuredValues, conditions: Sequence[str]) -> list[ValueDifference]:
    """Every quantity in every pair of conditions.

    Of several subjects, those with both conditions are compared within themselves; where nobody has both, as groups by
    Welch. Of one subject, trials are. Spreads between subjects hold errors that are each subject's own, so the draws
    only keep the interval from being narrower than they are; errors that all trials of an only subject share do not
    show in the spread of these, and add to it.
    """
    alone = len(values.subjects) < 2
    found = []
    for first, second in itertools.combinations(conditions, 2):
        one, other = values.of(first), values.of(second)
        for name in one:
            if name in other:
                pair = _of_one(one[name], other[name]) if alone else _of_many(one[name], other[name])
                if pair is not None:
                    found.append(ValueDifference(first, second, *name, values.units[name], *pair))
    return found


class _Pair(NamedTuple):
    paired: bool
    unit_of: str
    count: tuple[int, int]
    means: tuple[float, float]
    low: float
    high: float
    measured_sd: float
    low_all: float
    high_all: float


def _of_many(one: dict[str, _Own], other: dict[str, _Own]) -> _Pair | None:
    shared = [name for name in one if name in other]
    if len(shared) >= 2:
        d = np.array([other[name].mean - one[name].mean for name in shared])
        errors = [other[name].error - one[name].error for name in shared if one[name].drawn and other[name].drawn]
        freedom, square = len(d) - 1.0, float(d.var(ddof=1)) / len(d)
        before, after = (float(np.mean([own[name].mean for name in shared])) for own in (one, other))
        drawn = _mean_variance(errors, len(d))
        found = _intervals(after - before, square, freedom, drawn, held=True)
        return _Pair(True, "subjects", (len(d), len(d)), (before, after), *found)
    if shared:
        return None
    groups = [np.array([each.mean for each in own.values()]) for own in (one, other)]
    before, after = (float(group.mean()) for group in groups)
    square, freedom = _welch(groups)
    drawn = 0.0
    for own, group in zip((one, other), groups, strict=True):
        drawn += _mean_variance([each.error for each in own.values() if each.drawn], len(group))
    found = _intervals(after - before, square, freedom, drawn, held=True)
    return _Pair(False, "subjects", (len(groups[0]), len(groups[1])), (before, after), *found)


def _of_one(one: dict[str, _Own], other: dict[str, _Own]) -> _Pair | None:
    first, second = (next(iter(own.values())) for own in (one, other))
    trials = [np.array(own.values) for own in (first, second)]
    square, freedom = _welch(trials)
    drawn = np.nan
    if first.drawn and second.drawn and len(first.errors[0]) == len(second.errors[0]):
        drawn = float(np.nanvar(second.error - first.error, ddof=1))
        if np.isfinite(square):
            # What differs between trials shows in their spread already.
            scatter = [np.nanmean(np.var(own.errors, axis=0, ddof=1)) / len(own.errors) for own in (first, second)]
            drawn = max(drawn - float(sum(scatter)), 0.0)
    found = _intervals(second.mean - first.mean, square, freedom, drawn, held=False)
    return _Pair(False, "trials", (len(trials[0]), len(trials[1])), (first.mean, second.mean), *found)


def _welch(groups: Sequence[Array]) -> tuple[float, float]:
    """Squared standard error of the difference of two means, NaN with fewer than two in one, and its freedom."""
    squares = [float(one.var(ddof=1)) / len(one) if len(one) > 1 else np.nan for one in groups]
    square = float(sum(squares))
    if not square > 0.0:
        return square, 1.0
    return square, square**2 / sum(part**2 / (len(one) - 1) for part, one in zip(squares, groups, strict=True))


def _mean_variance(errors: Sequence[Array], count: int) -> float:
    """Variance of the mean over `count` subjects who err each by itself; NaN where one has no draws."""
    if len(errors) < count or not count:
        return float("nan")
    return float(sum(np.nanvar(one, ddof=1) for one in errors)) / count**2


def _intervals(
    difference: float, square: float, freedom: float, drawn: float, held: bool
) -> tuple[float, float, float, float, float]:
    """Interval by the spread, standard deviation by draws, and interval with both.

    Parameters
    ----------
    square : squared standard error by the spread, NaN where there is none
    drawn : variance of the difference by draws, NaN where nothing was drawn
    held : whether the spread holds the errors of the draws, else they add to it
    """
    student = float(student_quantile(freedom, 0.5 + 0.5 * CONFIDENCE)) if np.isfinite(square) else np.nan
    normal = float(ndtri(0.5 + 0.5 * CONFIDENCE))
    half = student * np.sqrt(square)
    open_ = normal * np.sqrt(drawn)
    if np.isnan(half) or np.isnan(open_):
        whole = open_ if np.isnan(half) else half
    else:
        whole = max(half, open_) if held else float(np.hypot(half, open_))
    return difference - half, difference + half, float(np.sqrt(drawn)), difference - whole, difference + whole


def difference_rows(found: Sequence[ValueDifference]) -> Iterator[Row]:
    """One row a pair and quantity; the heading first."""
    yield (
        *("first", "second", "step", "quantity", "unit", "paired", "of", "n_first", "n_second", "first_mean"),
        *("second_mean", "difference", "low", "high", "measured_sd", "low_all", "high_all"),
    )
    for one in found:
        numbers = (*one.means, one.difference, one.low, one.high, one.measured_sd, one.low_all, one.high_all)
        yield (
            *(one.first, one.second, one.step, one.quantity, one.unit, "yes" if one.paired else "no", one.unit_of),
            *map(str, one.count),
            *(f"{value:.6g}" if np.isfinite(value) else "" for value in numbers),
        )
