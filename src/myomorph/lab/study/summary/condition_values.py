"""What the trials of each condition have in common, as tables.

Trials that lie far from the others are named. Values are gathered trial by trial, in memory that
does not grow with them.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Generic, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Series
from myomorph.lab.analysis.conditions import (
    OUTLIER_SCORE,
    Condition,
    MeanCurves,
    mean_curves,
    modified_z,
)
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.groups import Animal, Comparison
from myomorph.lab.causes import GROUPS
from myomorph.lab.report.study.study_input import Described, Outlier
from myomorph.lab.study.trial.tidy import OF_STRIDE
from myomorph.lab.study.trial.trial_inputs import IN_STRIDE, Value
from myomorph.lab.study.trial.trial_strides import PARAMETERS

Curve = tuple[str, str]  # Family and name.
Name = TypeVar("Name", bound=Hashable)
PER_STRIDE = tuple(name for name, *_ in PARAMETERS)
# Curves whose distance to the mean of the condition is looked at.
COMPARED = ("joint angle", "joint torque")
DISTANCE = "distance of its curve from the mean, RMS"
_Key = tuple[str, str, str]  # Condition, quantity and unit.
Row = tuple[str, ...]
# Of a parameter or a curve in two conditions.
EFFECT = attrgetter("difference", "low", "high", "g", "g_low", "g_high")


class RunningMeans(Generic[Name]):
    """Number, mean and sum of squared deviations (samples, columns).

    Values are added one after the other (Welford 1962).
    """

    def __init__(self, samples: int) -> None:
        self.columns: dict[Name, int] = {}
        self.count = np.zeros((samples, 0))
        self.mean = np.zeros((samples, 0))
        self.squares = np.zeros((samples, 0))
        self._places: dict[tuple[Name, ...], Array] = {}

    def places(self, names: tuple[Name, ...]) -> Array:
        """Return the columns of names; new ones are made.

        Parameters
        ----------
        names : of the columns

        Returns
        -------
        (names,) indices of columns
        """
        if names not in self._places:
            for name in names:
                self.columns.setdefault(name, len(self.columns))
            more = np.zeros((len(self.count), len(self.columns) - self.count.shape[1]))
            self.count = np.hstack([self.count, more])
            self.mean = np.hstack([self.mean, more])
            self.squares = np.hstack([self.squares, more])
            self._places[names] = np.array([self.columns[name] for name in names], dtype=np.int64)
        return self._places[names]

    def add(self, names: tuple[Name, ...], values: Array) -> None:
        """Add one more of each column.

        Parameters
        ----------
        names : of the columns
        values : (samples, names), NaN where not known
        """
        columns = self.places(names)
        known = np.isfinite(values)
        count = self.count[:, columns] + known
        away = np.where(known, values - self.mean[:, columns], 0.0)
        mean = self.mean[:, columns] + away / np.maximum(count, 1.0)
        self.squares[:, columns] += away * np.where(known, values - mean, 0.0)
        self.count[:, columns] = count
        self.mean[:, columns] = mean

    def means(self) -> Array:
        """Return the means.

        Returns
        -------
        (samples, columns), NaN where nothing is known
        """
        return np.where(self.count > 0, self.mean, np.nan)


def families_of(curves: RunningMeans[Curve]) -> dict[str, list[str]]:
    """Names of curves by family, in their first order."""
    return grouped(curves.columns)


@dataclass
class _Subject:
    """What the trials of a subject add up to."""

    curves: RunningMeans[Curve] = field(default_factory=lambda: RunningMeans(SAMPLES))
    values: RunningMeans[str] = field(default_factory=lambda: RunningMeans(1))
    strides: float = 0.0


class GrowingCondition:
    """One condition while its trials are read."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.trials = 0
        self.cycle = ""
        self.units: dict[str, str] = {}
        self.notes: list[Message] = []
        self.each: RunningMeans[Curve] = RunningMeans(SAMPLES)
        self._values: RunningMeans[str] = RunningMeans(1)
        self._subjects: dict[str, _Subject] = {}
        self._alone: tuple[str, str] | None = None

    def add(
        self,
        subject: str,
        trial: str,
        values: Sequence[Value],
        cycle: str,
        curves: Mapping[str, Series],
    ) -> None:
        """Add one more trial.

        Only curves over strides are averaged: whole trials are not aligned with each other, and
        their mean would be that of different parts of the motion. The curves of an only trial
        without strides are stored as they are.
        """
        self.trials += 1
        subject_means = self._subjects.setdefault(subject, _Subject())
        self.units |= {value.quantity: value.unit for value in values}
        quantities = tuple(value.quantity for value in values)
        numbers = np.array([[value.value for value in values]])
        for sums in (subject_means.values, self._values):
            sums.add(quantities, numbers)
        subject_means.strides += max(
            (value.value for value in values if value.quantity.startswith("strides, ")), default=0.0
        )
        if self.trials > 1:
            self.without_whole_trials()
        self._alone = (subject, trial) if self.trials == 1 and cycle != OF_STRIDE else None
        if self.trials > 1 and cycle != OF_STRIDE:
            self._left_out(subject, trial)
            self.cycle = self.cycle if self.cycle == OF_STRIDE else ""
            return
        self.cycle = cycle
        names, joined = joined_curves(curves)
        if names:
            subject_means.curves.add(names, joined)
            self.each.add(names, joined)

    def _left_out(self, subject: str, trial: str) -> None:
        self.notes.append(
            GROUPS.message(
                f"{subject}, {trial}: has no stride, so its curves are aligned with no other's and"
                " are left out"
            )
        )

    def without_whole_trials(self) -> None:
        """Drop the curves over a whole trial: beside others they are not shown."""
        if self.cycle == OF_STRIDE:
            return
        if self._alone:
            self._left_out(*self._alone)
        self._alone = None
        self.each = RunningMeans(SAMPLES)
        for subject in self._subjects.values():
            subject.curves = RunningMeans(SAMPLES)

    @property
    def subjects(self) -> tuple[str, ...]:
        """Who has trials in this condition."""
        return tuple(self._subjects)

    def described(self, of_subjects: bool) -> dict[str, tuple[float, float, int]]:
        """Return mean, standard deviation (ddof = 1) and number by quantity.

        They are of subjects' means, or of trials.
        """
        whole = self._values
        if of_subjects:
            whole = RunningMeans(1)
            for subject in self._subjects.values():
                whole.add(tuple(subject.values.columns), subject.values.means())
        count = whole.count[0]
        spread = np.where(
            count > 1, np.sqrt(whole.squares[0] / np.maximum(count - 1.0, 1.0)), np.nan
        )
        return {
            quantity: (float(whole.mean[0, column]), float(spread[column]), int(count[column]))
            for quantity, column in whole.columns.items()
        }

    def finished(self, of_subjects: bool) -> Condition:
        """Return the condition as it is compared and drawn.

        The spread is that of subjects' means, or of trials.
        """
        spread: RunningMeans[Curve] = RunningMeans(SAMPLES)
        for subject in self._subjects.values() if of_subjects else ():
            if subject.curves.columns:
                spread.add(tuple(subject.curves.columns), subject.curves.means())
        drawn = spread if of_subjects else self.each
        families = {
            family: _family(drawn, family, names) for family, names in families_of(drawn).items()
        }
        moving = {(family, name) for family, curves in families.items() for name in curves.names}
        return Condition(
            name=self.name,
            subjects=tuple(
                self._animal(name, subject, moving) for name, subject in self._subjects.items()
            ),
            trials=self.trials,
            cycle="stride" if self.cycle == OF_STRIDE else "trial",
            unit="subjects" if of_subjects else "trials",
            curves=families,
        )

    def _animal(self, name: str, subject: _Subject, moving: set[Curve]) -> Animal:
        """Return a subject with parameters of strides and the means of its curves that move.

        Without strides the parameters are those of the trial.
        """
        scalars = {
            quantity
            + ("" if (unit := self.units[quantity]) == "1" else f" [{unit}]"): subject.values.mean[
                :, column
            ]
            for quantity, column in subject.values.columns.items()
            if quantity.rpartition(", ")[0] in PER_STRIDE
        }
        if not scalars and "duration" in subject.values.columns:
            scalars = {"duration [s]": subject.values.mean[:, subject.values.columns["duration"]]}
        means = subject.curves.means()
        curves = {}
        for family, names in families_of(subject.curves).items():
            kept = [each for each in names if (family, each) in moving]
            curves[family] = Cycles(
                tuple(kept),
                means[None][:, :, [subject.curves.columns[family, each] for each in kept]],
            )
        return Animal(name=name, scalars=scalars, curves=curves, strides=int(subject.strides))


def joined_curves(curves: Mapping[str, Series]) -> tuple[tuple[Curve, ...], Array]:
    """Put the curves of all families side by side.

    Parameters
    ----------
    curves : (samples, columns) by family

    Returns
    -------
    family and name of each, and values (samples, names)
    """
    names = tuple((family, name) for family, series in curves.items() for name in series.names)
    parts = [series.values for series in curves.values()]
    return names, np.hstack(parts) if parts else np.zeros((SAMPLES, 0))


def _family(running: RunningMeans[Curve], family: str, names: Sequence[str]) -> MeanCurves:
    """Curves of a family that change along the cycle."""
    columns = [running.columns[family, name] for name in names]
    moving = [
        column
        for column in columns
        if np.nanmax(np.abs(running.mean[:, column] - running.mean[0, column]), initial=0.0) > 1e-9
    ]
    kept = [name for column, name in zip(columns, names, strict=True) if column in set(moving)]
    return mean_curves(
        kept, running.count[:, moving], running.mean[:, moving], running.squares[:, moving]
    )


def of_subjects(conditions: Sequence[GrowingCondition]) -> bool:
    """Return whether subjects are the unit, in all conditions alike.

    Where there is one only, its trials are.
    """
    return len({name for condition in conditions for name in condition.subjects}) > 1


def shown_quantities(quantities: Sequence[str]) -> set[str]:
    """Those that tables for people show: of a stride where there are strides, else of the trial."""
    every = set(quantities)
    return {quantity for quantity in quantities if f"{quantity} {IN_STRIDE}" not in every}


class OutlierSearch:
    """Values of all trials by condition and quantity, a few dozen numbers per trial."""

    def __init__(self) -> None:
        self._values: dict[_Key, list[tuple[str, str, float]]] = {}

    def add(self, whose: tuple[str, str, str], values: Sequence[Value]) -> None:
        """Values of one more trial: subject, condition and trial."""
        subject, condition, trial = whose
        shown = shown_quantities([value.quantity for value in values])
        for value in values:
            if value.quantity in shown and _is_telling(value):
                self._values.setdefault((condition, value.quantity, value.unit), []).append(
                    (subject, trial, value.value)
                )

    def add_curves(
        self,
        whose: tuple[str, str, str],
        condition: GrowingCondition,
        cycle: str,
        curves: Mapping[str, Series],
    ) -> None:
        """Add how far curves of a trial are from the mean of its condition.

        The distance is the root mean square over the cycle.
        """
        if cycle != condition.cycle or not condition.each.columns:
            # Of another cycle, or dropped because beside conditions with strides it is not shown.
            return
        names, values = joined_curves(curves)
        if not names:
            return
        away = values - condition.each.means()[:, condition.each.places(names)]
        known = np.isfinite(away)
        counts = known.sum(axis=0)
        squares = np.where(known, away, 0.0) ** 2
        distances = np.sqrt(squares.sum(axis=0) / np.maximum(counts, 1))
        for (family, name), distance, count in zip(
            names, distances.tolist(), counts.tolist(), strict=True
        ):
            if count:
                unit = family.partition(" [")[2].removesuffix("]")
                key = (whose[1], f"{name}, {DISTANCE}", unit)
                self._values.setdefault(key, []).append((whose[0], whose[2], distance))

    def found(self) -> list[Outlier]:
        """Return all values whose modified z-score is beyond the limit.

        Of distances only those are returned that are large.
        """
        outliers = []
        for (condition, quantity, unit), rows in self._values.items():
            values = np.array([value for *_, value in rows])
            scores = modified_z(values)
            middle = float(np.median(values))
            for (subject, trial, value), score in zip(rows, scores.tolist(), strict=True):
                if score > OUTLIER_SCORE or (
                    score < -OUTLIER_SCORE and not quantity.endswith(DISTANCE)
                ):
                    outliers.append(
                        Outlier(
                            subject=subject,
                            trial=trial,
                            condition=condition,
                            quantity=quantity,
                            value=value,
                            unit=unit,
                            middle=middle,
                            score=score,
                        )
                    )
        return outliers


def outlier_rows(outliers: Sequence[Outlier]) -> Iterator[tuple[str, ...]]:
    """One row an outlier; the heading first."""
    yield ("subject", "condition", "trial", "quantity", "value", "unit", "median", "score")
    for outlier in outliers:
        numbers = (
            f"{outlier.value:.9g}",
            outlier.unit,
            f"{outlier.middle:.9g}",
            f"{outlier.score:.4g}",
        )
        yield (outlier.subject, outlier.condition, outlier.trial, outlier.quantity, *numbers)


def _is_telling(value: Value) -> bool:
    """Return whether a value describes a trial as a whole.

    Such are values of strides, ranges of angles, peaks of torques, errors.
    """
    what = value.quantity.removesuffix(f" {IN_STRIDE}")
    if value.unit == "deg":
        return what.endswith(", range")
    if value.unit == "N m" and what.endswith((", maximum", ", minimum")):
        return True
    return (
        what in ("marker error, RMS", "residual force, RMS")
        or what.rpartition(", ")[0] in PER_STRIDE
    )


def described(growing: Sequence[GrowingCondition]) -> tuple[Described, ...]:
    """Describe every quantity in every condition.

    The units are subjects, each the mean of its trials; of one subject, they are its trials.
    """
    by_quantity: dict[str, list[tuple[float, float, int]]] = {}
    units: dict[str, str] = {}
    subjects = of_subjects(growing)
    for index, condition in enumerate(growing):
        for quantity, (mean, deviation, count) in condition.described(subjects).items():
            units.setdefault(quantity, condition.units[quantity])
            rows = by_quantity.setdefault(quantity, [(np.nan, np.nan, 0)] * len(growing))
            rows[index] = mean, deviation, count
    return tuple(
        Described(quantity, units[quantity], tuple(rows)) for quantity, rows in by_quantity.items()
    )


def described_rows(
    quantities: Sequence[Described], conditions: Sequence[Condition]
) -> Iterator[Row]:
    """One row a quantity and condition; the heading first."""
    yield ("condition", "quantity", "unit", "mean", "sd", "n", "of")
    for index, condition in enumerate(conditions):
        for each in quantities:
            mean, deviation, count = each.conditions[index]
            if count:
                values = (_number_text(mean), _number_text(deviation), str(count))
                yield (condition.name, each.quantity, each.unit, *values, condition.unit)


def curve_rows(conditions: Sequence[Condition]) -> Iterator[Row]:
    """One row a condition, curve and percent; the heading first."""
    yield ("condition", "kind", "curve", "cycle", "percent", "mean", "sd", "low", "high", "n", "of")
    for condition in conditions:
        for family, curves in condition.curves.items():
            for index, name in enumerate(curves.names):
                for i, percent in enumerate(np.linspace(0.0, 100.0, len(curves.mean))):
                    values = (
                        part[i, index]
                        for part in (curves.mean, curves.deviation, curves.low, curves.high)
                    )
                    yield (
                        *(condition.name, family, name, condition.cycle, f"{percent:g}"),
                        *(_number_text(value) for value in values),
                        *(f"{curves.count[i, index]:.0f}", condition.unit),
                    )


def pair_rows(comparisons: Sequence[Comparison]) -> Iterator[Row]:
    """One row a parameter, and one a curve where its effect is largest; the heading first."""
    yield (
        *(
            "first",
            "second",
            "paired",
            "kind",
            "name",
            "percent",
            "first_mean",
            "second_mean",
            "difference",
            "low",
        ),
        *(
            "high",
            "effect_size",
            "effect_low",
            "effect_high",
            "p",
            "p_corrected",
            "below",
            "differs_percent",
        ),
    )
    for comparison in comparisons:
        whose = (*comparison.names, "yes" if comparison.paired else "no")
        level = _number_text(comparison.options.alpha)
        for scalar in comparison.scalars:
            numbers = (scalar.first[0], scalar.second[0], *EFFECT(scalar), scalar.p, scalar.holm)
            yield (*whose, "parameter", scalar.name, "", *map(_number_text, numbers), level, "")
        for each in comparison.curves:
            if not np.isfinite(each.g).any():
                continue
            at = int(np.argmax(np.where(np.isfinite(each.g), np.abs(each.g), -1.0)))
            peaks = [float(part[at]) for part in (each.first.mean, each.second.mean, *EFFECT(each))]
            where = " ".join(f"{start:.0f}-{stop:.0f}" for start, stop in each.regions)
            percent = f"{100.0 * at / max(len(each.g) - 1, 1):g}"
            p = _number_text(each.least_p)
            yield (
                *whose,
                each.family,
                each.name,
                percent,
                *map(_number_text, peaks),
                "",
                p,
                level,
                where,
            )


def _number_text(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""
