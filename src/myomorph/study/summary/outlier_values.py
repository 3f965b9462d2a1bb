"""Which values of which trials lie far from those of the others of their condition."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from myomorph.analysis.conditions import FAR, modified_z
from myomorph.model.series import Series
from myomorph.report.study.study_given import Outlier
from myomorph.study.summary.condition_values import PER_STRIDE, GrowingCondition, joined_curves, shown_quantities
from myomorph.study.trial.tidy import IN_STRIDE, Value

COMPARED = ("joint angle", "joint torque")
"""Curves whose distance to the mean of the condition is looked at."""
DISTANCE = "distance of its curve from the mean, RMS"
_Key = tuple[str, str, str]
"""Condition, quantity and unit."""


class OutlierSearch:
    """Values of all trials, by condition and quantity; of each trial a few dozen numbers are kept."""

    def __init__(self) -> None:
        self._values: dict[_Key, list[tuple[str, str, float]]] = {}

    def add(self, whose: tuple[str, str, str], values: Sequence[Value]) -> None:
        """Values of one more trial: subject, condition and trial."""
        subject, condition, trial = whose
        shown = shown_quantities([one.quantity for one in values])
        for one in values:
            if one.quantity in shown and _is_telling(one):
                self._values.setdefault((condition, one.quantity, one.unit), []).append((subject, trial, one.value))

    def add_curves(
        self, whose: tuple[str, str, str], condition: GrowingCondition, cycle: str, curves: Mapping[str, Series]
    ) -> None:
        """How far curves of a trial are from the mean of its condition, root mean square over the cycle."""
        if cycle != condition.cycle:
            return
        names, values = joined_curves(curves)
        if not names:
            return
        away = values - condition.each.means()[:, condition.each.places(names)]
        known = np.isfinite(away)
        counts = known.sum(axis=0)
        squares = np.where(known, away, 0.0) ** 2
        distances = np.sqrt(squares.sum(axis=0) / np.maximum(counts, 1))
        for (family, name), distance, count in zip(names, distances.tolist(), counts.tolist(), strict=True):
            if count:
                unit = family.partition(" [")[2].removesuffix("]")
                key = (whose[1], f"{name}, {DISTANCE}", unit)
                self._values.setdefault(key, []).append((whose[0], whose[2], distance))

    def found(self) -> list[Outlier]:
        """All values whose modified z-score is beyond the limit; of distances only those that are large."""
        outliers = []
        for (condition, quantity, unit), rows in self._values.items():
            values = np.array([value for *_, value in rows])
            scores = modified_z(values)
            middle = float(np.median(values))
            for (subject, trial, value), score in zip(rows, scores.tolist(), strict=True):
                if score > FAR or (score < -FAR and not quantity.endswith(DISTANCE)):
                    outliers.append(Outlier(subject, trial, condition, quantity, value, unit, middle, score))
        return outliers


def outlier_rows(outliers: Sequence[Outlier]) -> Iterator[tuple[str, ...]]:
    """One row an outlier; the heading first."""
    yield ("subject", "condition", "trial", "quantity", "value", "unit", "median", "score")
    for one in outliers:
        numbers = f"{one.value:.9g}", one.unit, f"{one.middle:.9g}", f"{one.score:.4g}"
        yield (one.subject, one.condition, one.trial, one.quantity, *numbers)


def _is_telling(one: Value) -> bool:
    """Whether a value says something of a trial as a whole: of strides, ranges of angles, peaks of torques, errors."""
    what = one.quantity.removesuffix(f" {IN_STRIDE}")
    if one.unit == "deg":
        return what.endswith(", range")
    if one.unit == "N m" and what.endswith((", maximum", ", minimum")):
        return True
    return what in ("marker error, RMS", "residual force, RMS") or what.rpartition(", ")[0] in PER_STRIDE
