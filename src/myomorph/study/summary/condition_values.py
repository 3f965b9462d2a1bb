"""What the trials of each condition have in common, gathered trial by trial in memory that does not grow with them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from myomorph.analysis.conditions import Condition, MeanCurves, mean_curves
from myomorph.analysis.cycles import SAMPLES, Cycles
from myomorph.analysis.groups import Animal
from myomorph.model.arrays import Array
from myomorph.model.series import Series
from myomorph.study.trial.tidy import IN_STRIDE, OF_STRIDE, Value
from myomorph.study.trial.trial_strides import PARAMETERS

Curve = tuple[str, str]
"""Family and name."""
Name = TypeVar("Name", bound=Hashable)
PER_STRIDE = tuple(label.partition(" [")[0] for label, _ in PARAMETERS)


class RunningMeans(Generic[Name]):
    """Number, mean and sum of squared deviations of columns, one after the other (Welford 1962).

    Attributes
    ----------
    columns : place of each name
    count, mean, squares : (samples, columns)
    """

    def __init__(self, samples: int) -> None:
        self.columns: dict[Name, int] = {}
        self.count, self.mean, self.squares = (np.zeros((samples, 0)) for _ in range(3))
        self._places: dict[tuple[Name, ...], Array] = {}

    def places(self, names: tuple[Name, ...]) -> Array:
        """Columns of names; new ones are made."""
        if names not in self._places:
            for name in names:
                self.columns.setdefault(name, len(self.columns))
            more = np.zeros((len(self.count), len(self.columns) - self.count.shape[1]))
            self.count, self.mean, self.squares = (
                np.hstack([part, more]) for part in (self.count, self.mean, self.squares)
            )
            self._places[names] = np.array([self.columns[name] for name in names], dtype=np.int64)
        return self._places[names]

    def add(self, names: tuple[Name, ...], values: Array) -> None:
        """One more of each column (samples, names), NaN where it is not known."""
        own = self.places(names)
        known = np.isfinite(values)
        count = self.count[:, own] + known
        away = np.where(known, values - self.mean[:, own], 0.0)
        mean = self.mean[:, own] + away / np.maximum(count, 1.0)
        self.squares[:, own] += away * np.where(known, values - mean, 0.0)
        self.count[:, own], self.mean[:, own] = count, mean

    def means(self) -> Array:
        """(samples, columns), NaN where nothing is known."""
        return np.where(self.count > 0, self.mean, np.nan)


def families_of(curves: RunningMeans[Curve]) -> dict[str, list[str]]:
    """Names of curves by family, in their first order."""
    found: dict[str, list[str]] = {}
    for family, name in curves.columns:
        found.setdefault(family, []).append(name)
    return found


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
        self.notes: list[str] = []
        self.each: RunningMeans[Curve] = RunningMeans(SAMPLES)
        self._values: RunningMeans[str] = RunningMeans(1)
        self._subjects: dict[str, _Subject] = {}

    def add(self, subject: str, trial: str, values: Sequence[Value], cycle: str, curves: Mapping[str, Series]) -> None:
        """One more trial.

        Curves over strides replace those over whole trials: a condition does not mix the two.
        """
        self.trials += 1
        own = self._subjects.setdefault(subject, _Subject())
        self.units |= {one.quantity: one.unit for one in values}
        quantities, numbers = tuple(one.quantity for one in values), np.array([[one.value for one in values]])
        for sums in (own.values, self._values):
            sums.add(quantities, numbers)
        own.strides += max((one.value for one in values if one.quantity.startswith("strides, ")), default=0.0)
        if self.cycle and cycle != self.cycle:
            if cycle != OF_STRIDE:
                self.notes.append(f"{subject}, {trial}: has fewer than two strides, and its curves are left out")
                return
            self.notes.append(
                "trials of fewer than two strides come before others that have more: their curves are left out"
            )
            self.each = RunningMeans(SAMPLES)
            for one in self._subjects.values():
                one.curves = RunningMeans(SAMPLES)
        self.cycle = cycle
        names, joined = joined_curves(curves)
        if names:
            own.curves.add(names, joined)
            self.each.add(names, joined)

    @property
    def subjects(self) -> tuple[str, ...]:
        """Who has trials in this condition."""
        return tuple(self._subjects)

    def described(self, of_subjects: bool) -> dict[str, tuple[float, float, int]]:
        """Mean, standard deviation (ddof = 1) and number by quantity: of subjects' means, or of trials."""
        whole = self._values
        if of_subjects:
            whole = RunningMeans(1)
            for one in self._subjects.values():
                whole.add(tuple(one.values.columns), one.values.means())
        count = whole.count[0]
        spread = np.where(count > 1, np.sqrt(whole.squares[0] / np.maximum(count - 1.0, 1.0)), np.nan)
        return {
            quantity: (float(whole.mean[0, k]), float(spread[k]), int(count[k]))
            for quantity, k in whole.columns.items()
        }

    def finished(self, of_subjects: bool) -> Condition:
        """The condition as it is compared and drawn: the spread is that of subjects' means, or of trials."""
        spread: RunningMeans[Curve] = RunningMeans(SAMPLES)
        for one in self._subjects.values() if of_subjects else ():
            if one.curves.columns:
                spread.add(tuple(one.curves.columns), one.curves.means())
        drawn = spread if of_subjects else self.each
        families = {family: _family(drawn, family, names) for family, names in families_of(drawn).items()}
        moving = {(family, name) for family, curves in families.items() for name in curves.names}
        return Condition(
            self.name,
            tuple(self._animal(name, one, moving) for name, one in self._subjects.items()),
            self.trials,
            "stride" if self.cycle == OF_STRIDE else "trial",
            "subjects" if of_subjects else "trials",
            families,
        )

    def _animal(self, name: str, one: _Subject, moving: set[Curve]) -> Animal:
        """A subject: parameters of strides (else of the trial) and the means of its curves that move."""
        scalars = {
            _with_unit(quantity, self.units[quantity]): one.values.mean[:, k]
            for quantity, k in one.values.columns.items()
            if quantity.rpartition(", ")[0] in PER_STRIDE
        }
        if not scalars and "duration" in one.values.columns:
            scalars = {"duration [s]": one.values.mean[:, one.values.columns["duration"]]}
        means = one.curves.means()
        curves = {}
        for family, names in families_of(one.curves).items():
            kept = [each for each in names if (family, each) in moving]
            curves[family] = Cycles(tuple(kept), means[None][:, :, [one.curves.columns[family, each] for each in kept]])
        return Animal(name, scalars, curves, int(one.strides))


def _with_unit(quantity: str, unit: str) -> str:
    return quantity if unit == "1" else f"{quantity} [{unit}]"


def joined_curves(curves: Mapping[str, Series]) -> tuple[tuple[Curve, ...], Array]:
    """Curves of all families side by side: their names, and (samples, names)."""
    names = tuple((family, name) for family, series in curves.items() for name in series.names)
    parts = [series.values for series in curves.values()]
    return names, np.hstack(parts) if parts else np.zeros((SAMPLES, 0))


def _family(running: RunningMeans[Curve], family: str, names: Sequence[str]) -> MeanCurves:
    """Curves of a family that change along the cycle."""
    own = [running.columns[family, name] for name in names]
    moving = [k for k in own if np.nanmax(np.abs(running.mean[:, k] - running.mean[0, k]), initial=0.0) > 1e-9]
    kept = [name for k, name in zip(own, names, strict=True) if k in set(moving)]
    return mean_curves(kept, running.count[:, moving], running.mean[:, moving], running.squares[:, moving])


def of_subjects(conditions: Sequence[GrowingCondition]) -> bool:
    """Whether subjects are the unit, in all conditions alike; where there is one only, its trials are."""
    return len({name for one in conditions for name in one.subjects}) > 1


def shown_quantities(quantities: Sequence[str]) -> set[str]:
    """Those that tables for people show: of a stride where there are strides, else of the trial."""
    every = set(quantities)
    return {one for one in quantities if f"{one} {IN_STRIDE}" not in every}
