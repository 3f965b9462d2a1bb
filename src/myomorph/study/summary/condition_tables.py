"""Conditions of a study as tables: values, mean curves, and the differences of every pair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.analysis.conditions import Condition
from myomorph.analysis.groups import Comparison
from myomorph.report.study.study_given import Described
from myomorph.study.summary.condition_values import GrowingCondition, of_subjects

Row = tuple[str, ...]


def described(growing: Sequence[GrowingCondition]) -> tuple[Described, ...]:
    """Every quantity in every condition: of subjects, each the mean of its trials; of one subject, of its trials."""
    found: dict[str, list[tuple[float, float, int]]] = {}
    units: dict[str, str] = {}
    subjects = of_subjects(growing)
    for k, one in enumerate(growing):
        for quantity, (mean, deviation, count) in one.described(subjects).items():
            units.setdefault(quantity, one.units[quantity])
            rows = found.setdefault(quantity, [(np.nan, np.nan, 0)] * len(growing))
            rows[k] = mean, deviation, count
    return tuple(Described(quantity, units[quantity], tuple(rows)) for quantity, rows in found.items())


def described_rows(quantities: Sequence[Described], conditions: Sequence[Condition]) -> Iterator[Row]:
    """One row a quantity and condition; the heading first."""
    yield ("condition", "quantity", "unit", "mean", "sd", "n", "of")
    for k, one in enumerate(conditions):
        for each in quantities:
            mean, deviation, count = each.conditions[k]
            if count:
                yield (one.name, each.quantity, each.unit, _told(mean), _told(deviation), str(count), one.unit)


def curve_rows(conditions: Sequence[Condition]) -> Iterator[Row]:
    """One row a condition, curve and percent; the heading first."""
    yield ("condition", "kind", "curve", "cycle", "percent", "mean", "sd", "low", "high", "n", "of")
    for one in conditions:
        for family, curves in one.curves.items():
            for k, name in enumerate(curves.names):
                for i, percent in enumerate(np.linspace(0.0, 100.0, len(curves.mean))):
                    values = (part[i, k] for part in (curves.mean, curves.deviation, curves.low, curves.high))
                    yield (
                        *(one.name, family, name, one.cycle, f"{percent:g}"),
                        *(_told(value) for value in values),
                        *(f"{curves.count[i, k]:.0f}", one.unit),
                    )


def pair_rows(comparisons: Sequence[Comparison]) -> Iterator[Row]:
    """One row a parameter, and one a curve where its effect is largest; the heading first."""
    yield (
        *("first", "second", "paired", "kind", "name", "percent", "first_mean", "second_mean", "difference", "low"),
        *("high", "effect_size", "effect_low", "effect_high", "p", "p_corrected", "below", "differs_percent"),
    )
    for found in comparisons:
        whose = (*found.names, "yes" if found.paired else "no")
        level = _told(found.options.alpha)
        for one in found.scalars:
            numbers = (one.first[0], one.second[0], one.difference, one.low, one.high, one.g, one.g_low, one.g_high)
            yield (*whose, "parameter", one.name, "", *map(_told, numbers), _told(one.p), _told(one.holm), level, "")
        for each in found.curves:
            if not np.isfinite(each.g).any():
                continue
            at = int(np.argmax(np.where(np.isfinite(each.g), np.abs(each.g), -1.0)))
            parts = (each.first.mean, each.second.mean, each.difference, each.low, each.high, each.g, each.g_low)
            peaks = [float(part[at]) for part in (*parts, each.g_high)]
            where = " ".join(f"{start:.0f}-{stop:.0f}" for start, stop in each.regions)
            percent = f"{100.0 * at / max(len(each.g) - 1, 1):g}"
            p = _told(each.least_p)
            yield (*whose, each.family, each.name, percent, *map(_told, peaks), "", p, level, where)


def _told(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""
