"""What the trials of each condition have in common, gathered trial by trial in memory that does not grow with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from myomorph.model.series import Series
from myomorph.model.spatial import Array
from myomorph.report.conditions import Condition, MeanCurves, mean_curves
from myomorph.report.cycles import SAMPLES, Cycles
from myomorph.report.groups import Animal
from myomorph.study.group_strides import PARAMETERS
from myomorph.study.tidy import IN_STRIDE, OF_STRIDE, Value

Curve = tuple[str, str]
"""Family and name."""
PER_STRIDE = tuple(label.partition(" [")[0] for label, _ in PARAMETERS)


class RunningCurves:
    """Number, mean and sum of squared deviations of curves, one after the other (Welford 1962)."""

    def __init__(self) -> None:
        self.columns: dict[Curve, int] = {}
        self.count = np.zeros((SAMPLES, 0))
        self.mean = np.zeros((SAMPLES, 0))
        self.squares = np.zeros((SAMPLES, 0))
        self._places: dict[tuple[Curve, ...], Array] = {}

    def places(self, names: tuple[Curve, ...]) -> Array:
        """Columns of curves; new ones are made."""
        if names not in self._places:
            for name in names:
                self.columns.setdefault(name, len(self.columns))
            more = len(self.columns) - self.count.shape[1]
            for what in ("count", "mean", "squares"):
                setattr(self, what, np.hstack([getattr(self, what), np.zeros((SAMPLES, more))]))
            self._places[names] = np.array([self.columns[name] for name in names], dtype=np.int64)
        return self._places[names]

    def add(self, names: tuple[Curve, ...], values: Array) -> None:
        """One more of each curve (samples, names), NaN where it is not known."""
        own = self.places(names)
        known = np.isfinite(values)
        count = self.count[:, own] + known
        away = np.where(known, values - self.mean[:, own], 0.0)
        mean = self.mean[:, own] + away / np.maximum(count, 1.0)
        self.squares[:, own] += away * np.where(known, values - mean, 0.0)
        self.count[:, own], self.mean[:, own] = count, mean

    def families(self) -> dict[str, list[str]]:
        """Names of the curves by family, in their first order."""
        found: dict[str, list[str]] = {}
        for family, name in self.columns:
            found.setdefault(family, []).append(name)
        return found

    def means(self) -> Array:
        """(samples, columns), NaN where nothing is known."""
        return np.where(self.count > 0, self.mean, np.nan)


@dataclass
class RunningNumber:
    """Number, mean and sum of squared deviations of values, one after the other."""

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def add(self, value: float) -> None:
        """One more value."""
        self.count += 1
        away = value - self.mean
        self.mean += away / self.count
        self.squares += away * (value - self.mean)

    @property
    def described(self) -> tuple[float, float, int]:
        """Mean, standard deviation (ddof = 1), number."""
        spread = float(np.sqrt(self.squares / (self.count - 1))) if self.count > 1 else float("nan")
        return self.mean, spread, self.count


@dataclass
class _Subject:
    """What the trials of a subject add up to."""

    curves: RunningCurves = field(default_factory=RunningCurves)
    values: dict[str, RunningNumber] = field(default_factory=dict)
    strides: float = 0.0


class GrowingCondition:
    """One condition while its trials are read."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.trials = 0
        self.cycle = ""
        self.units: dict[str, str] = {}
        self.notes: list[str] = []
        self.each = RunningCurves()
        self._values: dict[str, RunningNumber] = {}
        self._subjects: dict[str, _Subject] = {}

    def add(self, subject: str, trial: str, values: Sequence[Value], cycle: str, curves: Mapping[str, Series]) -> None:
        """One more trial.

        Curves over strides replace those over whole trials: a condition does not mix the two.
        """
        self.trials += 1
        own = self._subjects.setdefault(subject, _Subject())
        for one in values:
            self.units.setdefault(one.quantity, one.unit)
            for sums in (own.values, self._values):
                sums.setdefault(one.quantity, RunningNumber()).add(one.value)
        own.strides += max((one.value for one in values if one.quantity.startswith("strides, ")), default=0.0)
        if self.cycle and cycle != self.cycle:
            if cycle != OF_STRIDE:
                self.notes.append(f"{subject}, {trial}: has no strides, and its curves are left out")
                return
            self.notes.append("trials without strides come before others that have some: their curves are left out")
            self.each = RunningCurves()
            for one in self._subjects.values():
                one.curves = RunningCurves()
        self.cycle = cycle
        names, joined = joined_curves(curves)
        if names:
            own.curves.add(names, joined)
            self.each.add(names, joined)

    def described(self) -> dict[str, tuple[float, float, int]]:
        """Mean, standard deviation (ddof = 1) and number by quantity: of subjects' means, of one subject's trials."""
        if len(self._subjects) == 1:
            return {quantity: one.described for quantity, one in self._values.items()}
        found: dict[str, RunningNumber] = {}
        for subject in self._subjects.values():
            for quantity, one in subject.values.items():
                found.setdefault(quantity, RunningNumber()).add(one.mean)
        return {quantity: one.described for quantity, one in found.items()}

    def finished(self) -> Condition:
        """The condition as it is compared and drawn."""
        several = len(self._subjects) > 1
        spread = RunningCurves()
        for one in self._subjects.values() if several else ():
            if one.curves.columns:
                spread.add(tuple(one.curves.columns), one.curves.means())
        drawn = spread if several else self.each
        families = {family: _family(drawn, family, names) for family, names in drawn.families().items()}
        moving = {(family, name) for family, curves in families.items() for name in curves.names}
        return Condition(
            self.name,
            tuple(self._animal(name, one, moving) for name, one in self._subjects.items()),
            self.trials,
            "stride" if self.cycle == OF_STRIDE else "trial",
            "subjects" if several else "trials",
            families,
        )

    def _animal(self, name: str, one: _Subject, moving: set[Curve]) -> Animal:
        """A subject: parameters of strides (else of the trial) and the means of its curves that move."""
        scalars = {
            _with_unit(quantity, self.units[quantity]): np.array([value.mean])
            for quantity, value in one.values.items()
            if quantity.rpartition(", ")[0] in PER_STRIDE
        }
        if not scalars and "duration" in one.values:
            scalars = {"duration [s]": np.array([one.values["duration"].mean])}
        means = one.curves.means()
        curves = {}
        for family, names in one.curves.families().items():
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


def _family(running: RunningCurves, family: str, names: Sequence[str]) -> MeanCurves:
    """Curves of a family that change along the cycle."""
    own = [running.columns[family, name] for name in names]
    moving = [k for k in own if np.nanmax(np.abs(running.mean[:, k] - running.mean[0, k]), initial=0.0) > 1e-9]
    kept = [name for k, name in zip(own, names, strict=True) if k in set(moving)]
    return mean_curves(kept, running.count[:, moving], running.mean[:, moving], running.squares[:, moving])


def shown_quantities(quantities: Sequence[str]) -> set[str]:
    """Those that tables for people show: of a stride where there are strides, else of the trial."""
    every = set(quantities)
    return {one for one in quantities if f"{one} {IN_STRIDE}" not in every}
