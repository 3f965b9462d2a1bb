"""What the trials of each condition have in common, gathered trial by trial in memory that does not grow with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from myomorph.model.series import Series
from myomorph.model.spatial import Array
from myomorph.report.conditions import Condition, MeanCurves, mean_curves
from myomorph.report.cycles import SAMPLES, Cycles
from myomorph.report.groups import Animal
from myomorph.study.group_strides import PARAMETERS
from myomorph.study.tidy import IN_STRIDE, OF_STRIDE

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
class _Subject:
    """Sums over the trials of a subject: curves, values as [sum, number], strides."""

    curves: RunningCurves = field(default_factory=RunningCurves)
    values: dict[str, list[float]] = field(default_factory=dict)
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
        self._subjects: dict[str, _Subject] = {}

    def add(
        self,
        subject: str,
        trial: str,
        values: Mapping[str, tuple[float, str]],
        cycle: str,
        curves: Mapping[str, Series],
    ) -> None:
        """One more trial that went well.

        Curves over strides replace those over whole trials: a condition does not mix the two.
        """
        self.trials += 1
        own = self._subjects.setdefault(subject, _Subject())
        for quantity, (value, unit) in values.items():
            self.units.setdefault(quantity, unit)
            sums = own.values.setdefault(quantity, [0.0, 0.0])
            sums[0] += value
            sums[1] += 1.0
        own.strides += max((one for name, (one, _) in values.items() if name.startswith("strides, ")), default=0.0)
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

    def subject_means(self) -> dict[str, dict[str, float]]:
        """Of every quantity, the mean over each subject's trials, by quantity and subject."""
        found: dict[str, dict[str, float]] = {}
        for name, one in self._subjects.items():
            for quantity, (total, count) in one.values.items():
                found.setdefault(quantity, {})[name] = total / count
        return found

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
            f"{quantity} [{self.units[quantity]}]": np.array([total / count])
            for quantity, (total, count) in one.values.items()
            if quantity.rpartition(", ")[0] in PER_STRIDE
        }
        if not scalars and "duration" in one.values:
            total, count = one.values["duration"]
            scalars = {"duration [s]": np.array([total / count])}
        means = one.curves.means()
        curves = {}
        for family, names in one.curves.families().items():
            kept = [each for each in names if (family, each) in moving]
            curves[family] = Cycles(tuple(kept), means[None][:, :, [one.curves.columns[family, each] for each in kept]])
        return Animal(name, scalars, curves, int(one.strides))


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


def shown_quantity(quantity: str, all_quantities: Iterable[str]) -> bool:
    """Whether tables for people show a quantity: of a stride where there are strides, else of the trial."""
    return quantity.endswith(IN_STRIDE) or f"{quantity} {IN_STRIDE}" not in set(all_quantities)
