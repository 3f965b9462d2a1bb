"""Differences of values between conditions or groups.

Their intervals contain what draws of errors leave open.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.report.study.study_input import ValueDifference
from myomorph.lab.study.summary.condition_values import RunningMeans
from myomorph.lab.study.trial.trial_inputs import Value
from myomorph.lab.uncertainty.spread import ValueErrors, of_subject

CONFIDENCE = 0.95  # Of the intervals, as of those of curves and of parameters of strides.
KEPT_DRAWS = 100
"""Of each trial so many draws at most are kept for differences, which know their deviation to 7 %
by them.
"""
Row = tuple[str, ...]
NAMES = attrgetter("first", "second", "step", "quantity", "unit")
NUMBERS = attrgetter("difference", "low", "high", "measured_sd", "low_all", "high_all")
_Name = tuple[str, str]  # Step and quantity.


@dataclass(frozen=True, kw_only=True)
class _Limits:
    """Intervals of a difference, as `ValueDifference` has them."""

    low: float
    high: float
    measured_sd: float
    low_all: float
    high_all: float


@dataclass(frozen=True, kw_only=True)
class _Pair:
    """One quantity in two conditions, as `ValueDifference` has it."""

    paired: bool
    unit_of: str
    count: tuple[int, int]
    means: tuple[float, float]
    limits: _Limits


@read_only
@dataclass(frozen=True)
class _Own:
    """A quantity of one subject in one condition.

    It has the mean over its trials and, of two or more, the squared standard error, else NaN;
    (draws,) errors of the mean, None where not all trials were drawn; and the mean over the draws
    of the squared standard error by which errors of trials differ.
    """

    mean: float
    square: float
    count: int
    error: Array | None
    scatter: float


class _Trials:
    """Values of a subject's trials in one condition, and their errors.

    They are summed without storing the trials.
    """

    def __init__(self) -> None:
        self.values: RunningMeans[_Name] = RunningMeans(1)
        self._columns: dict[_Name, int] = {}
        # By quantity: trials that were drawn, sum of their errors by draw, sum of their mean
        # squares.
        self._drawn = np.zeros(0)
        self._squares = np.zeros(0)
        self._sum = np.zeros((0, 0), np.float32)

    def add(self, values: Sequence[Value], drawn: ValueErrors | None, subject: str) -> None:
        """One more trial."""
        names = tuple((value.step, value.quantity) for value in values)
        self.values.add(names, np.array([[value.value for value in values]]))
        if drawn is None:
            return
        errors = of_subject(drawn.errors, subject)[:KEPT_DRAWS].astype(np.float32)
        if not self._columns:
            self._columns = {name: index for index, name in enumerate(drawn.names)}
            self._drawn = np.zeros(len(drawn.names))
            self._squares = np.zeros(len(drawn.names))
            self._sum = np.zeros(errors.shape, np.float32)
        if len(errors) != len(self._sum):
            return
        pairs = [
            (index, self._columns[name])
            for index, name in enumerate(drawn.names)
            if name in self._columns
        ]
        here, there = np.array(pairs, np.int64).reshape(-1, 2).T
        self._drawn[there] += 1.0
        self._sum[:, there] += errors[:, here]
        self._squares[there] += np.nanmean(errors[:, here].astype(np.float64) ** 2, axis=0)

    def of(self, name: _Name) -> _Own | None:
        """Return a quantity, None where no trial has it."""
        column = self.values.columns.get(name)
        if column is None:
            return None
        count = self.values.count[0, column]
        squares = self.values.squares[0, column]
        square = float(squares / (count - 1.0) / count) if count > 1 else float("nan")
        error = None
        scatter = float("nan")
        at = self._columns.get(name)
        if at is not None and self._drawn[at] == count:
            # A draw that has no solution in one of the trials counts in none.
            error = self._sum[:, at].astype(np.float64) / count
            if count > 1:
                within = self._squares[at] - count * float(np.nanmean(error**2))
                scatter = max(within, 0.0) / (count - 1.0) / count
        return _Own(float(self.values.mean[0, column]), square, int(count), error, scatter)


class MeasuredValues:
    """Values of all trials and their errors under draws, summed by condition and subject."""

    def __init__(self) -> None:
        self.units: dict[_Name, str] = {}
        self._trials: dict[str, dict[str, _Trials]] = {}

    def add(
        self, whose: tuple[str, str, str], values: Sequence[Value], drawn: ValueErrors | None
    ) -> None:
        """One more trial: subject, condition and trial."""
        subject, condition, _ = whose
        self.units |= {(value.step, value.quantity): value.unit for value in values}
        self._trials.setdefault(condition, {}).setdefault(subject, _Trials()).add(
            values, drawn, subject
        )

    def of(self, condition: str, name: _Name) -> dict[str, _Own]:
        """Return a quantity by subject."""
        trial_means = {
            subject: trials.of(name) for subject, trials in self._trials.get(condition, {}).items()
        }
        return {subject: mean for subject, mean in trial_means.items() if mean is not None}

    @property
    def subjects(self) -> set[str]:
        """All of them."""
        return {subject for trial in self._trials.values() for subject in trial}


def differences(values: MeasuredValues, conditions: Sequence[str]) -> list[ValueDifference]:
    """Compare every quantity in every pair of conditions.

    A difference is the first less the second as in `differences.csv`.

    Of several subjects, those with both conditions are compared within themselves; where nobody has
    both, as groups by Welch. Of one subject, trials are. Spreads between subjects hold errors that
    are each subject's own, so the draws only keep the interval from being narrower than they are;
    errors that all trials of an only subject share do not show in the spread of these, and add to
    it.
    """
    alone = len(values.subjects) < 2
    result = []
    for first, second in itertools.combinations(conditions, 2):
        for name, unit in values.units.items():
            one = values.of(first, name)
            other = values.of(second, name)
            if one and other:
                pair = _of_one(one, other) if alone else _of_many(one, other)
                if pair is not None:
                    step, quantity = name
                    result.append(
                        ValueDifference(
                            first=first,
                            second=second,
                            step=step,
                            quantity=quantity,
                            unit=unit,
                            paired=pair.paired,
                            unit_of=pair.unit_of,
                            count=pair.count,
                            means=pair.means,
                            low=pair.limits.low,
                            high=pair.limits.high,
                            measured_sd=pair.limits.measured_sd,
                            low_all=pair.limits.low_all,
                            high_all=pair.limits.high_all,
                        )
                    )
    return result


def _of_many(first: dict[str, _Own], other: dict[str, _Own]) -> _Pair | None:
    shared = [name for name in first if name in other]
    if len(shared) >= 2:
        return _within_subjects([first[name] for name in shared], [other[name] for name in shared])
    return None if shared else _between_groups(list(first.values()), list(other.values()))


def _within_subjects(first: Sequence[_Own], other: Sequence[_Own]) -> _Pair:
    """Compare the same two or more subjects in two conditions."""
    own = list(zip(first, other, strict=True))
    d = np.array([one.mean - another.mean for one, another in own])
    errors = [_less(one.error, another.error) for one, another in own]
    means = (_mean(first), _mean(other))
    square = float(d.var(ddof=1)) / len(d)
    limits = _intervals(
        means[0] - means[1], square, len(d) - 1.0, _mean_variance(errors), held=True
    )
    return _Pair(
        paired=True, unit_of="subjects", count=(len(d), len(d)), means=means, limits=limits
    )


def _mean(subjects: Sequence[_Own]) -> float:
    return float(np.mean([subject.mean for subject in subjects]))


def _between_groups(first: Sequence[_Own], other: Sequence[_Own]) -> _Pair:
    """Compare two groups that have no subject in common, by Welch."""
    means = (_mean(first), _mean(other))
    counts = (len(first), len(other))
    squares = [_squared_error(subjects) for subjects in (first, other)]
    drawn = sum(
        _mean_variance([subject.error for subject in subjects]) for subjects in (first, other)
    )
    limits = _intervals(means[0] - means[1], *_welch(squares, counts), drawn, held=True)
    return _Pair(paired=False, unit_of="subjects", count=counts, means=means, limits=limits)


def _squared_error(subjects: Sequence[_Own]) -> float:
    """Return the squared standard error of the mean over subjects, NaN for an only one."""
    means = np.array([subject.mean for subject in subjects])
    return float(means.var(ddof=1)) / len(means) if len(means) > 1 else np.nan


def _of_one(one: dict[str, _Own], other: dict[str, _Own]) -> _Pair | None:
    first = next(iter(one.values()))
    second = next(iter(other.values()))
    counts = (first.count, second.count)
    square, freedom = _welch((first.square, second.square), counts)
    drawn = _mean_variance([_less(first.error, second.error)])
    if np.isfinite(square):
        # What differs between trials shows in their spread already.
        drawn = float(np.maximum(drawn - first.scatter - second.scatter, 0.0))
    return _Pair(
        paired=False,
        unit_of="trials",
        count=counts,
        means=(first.mean, second.mean),
        limits=_intervals(first.mean - second.mean, square, freedom, drawn, held=False),
    )


def _less(first: Array | None, other: Array | None) -> Array | None:
    return (
        None
        if first is None or other is None or len(first) != len(other)
        else np.asarray(first - other)
    )


def _welch(squares: Sequence[float], counts: Sequence[int]) -> tuple[float, float]:
    """Return the squared standard error of the difference of two means, and its degrees of freedom.

    The squared error is NaN with fewer than two in one.
    """
    square = float(sum(squares))
    if not square > 0.0:
        return square, 1.0
    return square, square**2 / sum(
        part**2 / (count - 1) for part, count in zip(squares, counts, strict=True)
    )


def _mean_variance(errors: Sequence[Array | None]) -> float:
    """Variance of the mean over subjects who err each by itself; NaN where one has no draws."""
    known = [error for error in errors if error is not None]
    if not known or len(known) < len(errors):
        return float("nan")
    return float(sum(np.nanvar(error, ddof=1) for error in known)) / len(known) ** 2


def _intervals(
    difference: float, square: float, freedom: float, drawn: float, held: bool
) -> _Limits:
    """Return interval bounds by the spread, by the draws, and by both.

    They are the interval by the spread (squared standard error, NaN for none), the standard
    deviation by draws (their variance, NaN for none), and the interval with both. Where `held`, the
    spread holds the errors of the draws, else they add to it.
    """
    student = (
        float(scipy.special.stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))
        if np.isfinite(square)
        else np.nan
    )
    normal = float(scipy.special.ndtri(0.5 + 0.5 * CONFIDENCE))
    half = student * np.sqrt(square)
    open_ = normal * np.sqrt(drawn)
    if np.isnan(half) or np.isnan(open_):
        whole = open_ if np.isnan(half) else half
    else:
        whole = max(half, open_) if held else float(np.hypot(half, open_))
    return _Limits(
        low=difference - half,
        high=difference + half,
        measured_sd=float(np.sqrt(drawn)),
        low_all=difference - whole,
        high_all=difference + whole,
    )


def difference_rows(value_differences: Sequence[ValueDifference]) -> Iterator[Row]:
    """One row a pair and quantity; the heading first."""
    yield (
        *(
            "first",
            "second",
            "step",
            "quantity",
            "unit",
            "paired",
            "of",
            "n_first",
            "n_second",
            "first_mean",
        ),
        *("second_mean", "difference", "low", "high", "measured_sd", "low_all", "high_all"),
    )
    for difference in value_differences:
        numbers = (*difference.means, *NUMBERS(difference))
        yield (
            *NAMES(difference),
            "yes" if difference.paired else "no",
            difference.unit_of,
            *map(str, difference.count),
            *(f"{value:.6g}" if np.isfinite(value) else "" for value in numbers),
        )
