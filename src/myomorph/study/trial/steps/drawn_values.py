"""The numbers of a trial under drawn errors: extremes and means of its tables, over the trial and in a stride."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.series import Series
from myomorph.study.trial.joint_contact_step import ENDING as JOINT_CONTACT
from myomorph.study.trial.steps.drawn_quantities import Quantity
from myomorph.study.trial.trial_inputs import EXTREMES, IN_STRIDE, statistics_of
from myomorph.study.trial.trial_strides import TrialStrides, by_side

PEAKS = ("maximum", "mean")
LOADS = ("total_", "medial_", "lateral_")


@read_only
@dataclass(frozen=True)
class _Columns:
    """Columns of a table whose numbers are kept, as the step's own signals have them, with factors to the units of
    tables of values.
    """

    step: str
    columns: tuple[int, ...]
    names: tuple[str, ...]
    endings: tuple[str, ...]
    statistics: tuple[str, ...]
    factors: Array

    def quantities(self, in_stride: bool) -> list[tuple[str, str]]:
        """Step and quantity, in the order of `of`."""
        where = ("", f" {IN_STRIDE}") if in_stride else ("",)
        return [
            (self.step, f"{name}{ending}, {what}{words}")
            for words in where
            for what in self.statistics
            for name, ending in zip(self.names, self.endings, strict=True)
        ]

    def of(self, time: Array, values: Array, strides: TrialStrides | None) -> Array:
        """Numbers of a table (frames, columns)."""
        series = Series(time, self.names, values[:, self.columns] * self.factors)
        whole = statistics_of(series.values)
        statistics = [whole[what] for what in self.statistics]
        cycles = None if strides is None else by_side(series, strides)
        if cycles is not None:
            each = statistics_of(cycles.values, axis=1)
            statistics += [statistics_of(each[what])["mean"] for what in self.statistics]
        return np.concatenate(statistics)


@read_only
@dataclass(frozen=True, eq=False)
class DrawnValues:
    """What is kept of each draw beside its tables: columns of these at their times, and step, quantity and table of
    every number.
    """

    times: Mapping[str, Array]
    kept: Mapping[str, _Columns]
    strides: TrialStrides | None
    names: tuple[tuple[str, str], ...]
    tables: tuple[str, ...]

    def of(self, tables: Mapping[str, Array]) -> Array:
        """All numbers of a draw (names,)."""
        parts = [kept.of(self.times[name], tables[name], self.strides) for name, kept in self.kept.items()]
        return np.concatenate(parts) if parts else np.zeros(0)


def drawn_values(quantities: Sequence[Quantity], strides: TrialStrides | None) -> DrawnValues:
    """Which numbers of tables (at the frames that are drawn) are kept: those that the steps' tables of values have."""
    kept = {quantity.name: columns for quantity in quantities if (columns := _columns(quantity)) is not None}
    times = {quantity.name: quantity.time for quantity in quantities}
    names, tables = [], list[str]()
    for name, columns in kept.items():
        walks = strides is not None and by_side(_first(columns, times[name]), strides) is not None
        named_values = columns.quantities(walks)
        names += named_values
        tables += [name] * len(named_values)
    return DrawnValues(times, kept, strides, tuple(names), tuple(tables))


def _first(columns: _Columns, time: Array) -> Series:
    return Series(time, columns.names, np.zeros((len(time), len(columns.names))))


def _columns(quantity: Quantity) -> _Columns | None:
    count = len(quantity.names)
    every = tuple(range(count))
    if quantity.name == "coordinates":
        return _Columns("ik", every, quantity.names, ("",) * count, EXTREMES, quantity.factors)
    if quantity.name == "torques":
        endings = tuple("_moment" if unit == "N m" else "_force" for unit in quantity.units)
        return _Columns("id", every, quantity.names, endings, EXTREMES, np.ones(count))
    if quantity.name in ("activations", "forces"):
        ending = "_activation" if quantity.name == "activations" else "_force"
        return _Columns("tension", every, quantity.names, (ending,) * count, PEAKS, np.ones(count))
    if quantity.name == "joint_contact_forces":
        loads = tuple(index for index, name in enumerate(quantity.names) if name.startswith(LOADS))
        names = tuple(quantity.names[index] for index in loads)
        return _Columns("tension", loads, names, (JOINT_CONTACT,) * len(loads), PEAKS, np.ones(len(loads)))
    return None
