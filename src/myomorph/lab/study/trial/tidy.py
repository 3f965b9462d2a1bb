"""What one trial comes to in numbers: a value a row, mean curves over the cycle, and how good it
is.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.lab.analysis.cycles import SAMPLES, Cycles, over_cycles
from myomorph.lab.report.page.parts import Verdict
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import Stored
from myomorph.lab.store.uncertainty_store import get_value_limits
from myomorph.lab.study.step.step import trial_steps
from myomorph.lab.study.step.step_table import REPORT
from myomorph.lab.study.trial.labelled_result import labelled_signals
from myomorph.lab.study.trial.reporting import TrialResults
from myomorph.lab.study.trial.trial_inputs import IN_STRIDE, LOADED, Signals, Value, statistics_of
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side

VALUES = "values.csv"
CURVES = "curves.csv"
QUALITY = "quality.csv"
OF_STRIDE = "percent_of_stride"
OF_TRIAL = "percent_of_trial"
VALUE_COLUMNS = ("step", "quantity", "value", "unit", "low", "high", "sd")
NUMBERS = ("value", "low", "high", "sd")
"""Columns of `VALUE_COLUMNS` that are numbers; those of draws are empty where nothing was drawn."""
QUALITY_COLUMNS = ("quantity", "value", "unit", "limit", "state", "worst", "time_s", "detail")


def write_trial_values(results: TrialResults, outcome: Outcome) -> None:
    """Write `values.csv`, `curves.csv` and `quality.csv` beside a trial's results, from these
    alone. Where every step was reused from an earlier run and the files are there, they stay.
    """
    names = (VALUES, CURVES, QUALITY)
    steps = [step for step in outcome.done if step != REPORT]
    if set(steps) <= set(outcome.reused) and all(
        (outcome.folder / name).is_file() for name in names
    ):
        return
    stored = results.stored
    model = results.model
    prepared = results.prepared
    strides = TrialStrides.whole(stored.facts.get("trial", ""), prepared.strides)
    mass = float(stored.facts.get("mass") or 0.0) or model.mass
    signals = [
        signal
        for step in trial_steps()
        for signal in (*step.signals(stored, model, mass), *labelled_signals(step, stored, model))
    ]
    cycles = [_cycles(signal, strides) for signal in signals]
    limits = get_value_limits(stored)
    _write_curves(outcome.folder / CURVES, strides, signals, cycles)
    write_csv(
        outcome.folder / QUALITY,
        QUALITY_COLUMNS,
        quality_rows(prepared.verdicts, prepared.results.head.warnings),
    )
    # Last, so that where there are values there is everything.
    write_csv(
        outcome.folder / VALUES,
        VALUE_COLUMNS,
        (
            value_row(_with_limits(trial_value, limits))
            for trial_value in trial_values(stored, model, strides, signals, cycles)
            if np.isfinite(trial_value.value)
        ),
    )


def value_row(value: Value) -> tuple[str, ...]:
    """A row of `VALUE_COLUMNS`."""
    drawn = (
        f"{number:.6g}" if np.isfinite(number) else ""
        for number in (value.low, value.high, value.sd)
    )
    return (value.step, value.quantity, f"{value.value:.9g}", value.unit, *drawn)


def _with_limits(
    value: Value, limits: Mapping[tuple[str, str], tuple[float, float, float]]
) -> Value:
    known = limits.get((value.step, value.quantity))
    if known is None:
        return value
    low, high, deviation = known
    return value._replace(low=value.value + low, high=value.value + high, sd=deviation)


def trial_values(
    stored: Stored,
    model: Model,
    strides: TrialStrides | None,
    signals: Sequence[Signals],
    cycles: Sequence[Cycles | None],
) -> Iterator[Value]:
    """All numbers of a trial, one after the other. Of every signal its extremes and mean over the
    trial; where there are strides also those of each stride, as the mean over the strides.
    """
    steps = trial_steps()
    for step in steps:
        if not step.numbers_last:
            yield from step.numbers(stored, model, strides)
    for signal, cycle in zip(signals, cycles, strict=True):
        tables = {"": statistics_of(signal.series.values)}
        if cycle is not None and strides is not None:
            each = statistics_of(cycle.values, axis=1)
            tables[f" {IN_STRIDE}"] = {
                name: statistics_of(values)["mean"] for name, values in each.items()
            }
        for index, name in enumerate(signal.series.names):
            for where, numbers in tables.items():
                for what in signal.statistics:
                    quantity = f"{name}{signal.endings[index]}, {what}{where}"
                    yield Value(
                        step=signal.step,
                        quantity=quantity,
                        value=float(numbers[what][index]),
                        unit=signal.units[index],
                    )
    for step in steps:
        if step.numbers_last:
            yield from step.numbers(stored, model, strides)


def quality_rows(verdicts: Sequence[Verdict], warnings: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of quality: what is held against a limit, then what files and steps had to
    say.
    """
    for verdict in verdicts:
        limit = "" if verdict.limit is None else f"{verdict.limit:.6g}"
        time = "" if verdict.time is None else f"{verdict.time:.6g}"
        value = f"{verdict.value:.6g}"
        yield (
            verdict.quantity,
            value,
            verdict.unit,
            limit,
            verdict.state,
            verdict.worst,
            time,
            verdict.detail,
        )
    for text in warnings:
        yield ("warning", "", "", "", "note", "", "", " ".join(text.split()))


def _cycles(signal: Signals, strides: TrialStrides | None) -> Cycles | None:
    """Signals over strides, else over the whole trial; None where nothing is long enough."""
    if strides is not None:
        result = by_side(signal.series, strides)
        if signal.curve.startswith("vertical force") and result is not None:
            # Cycles in which a foot never carries anything are not known: it stood beside the
            # plates.
            values = np.array(result.values)
            peaks = statistics_of(values, axis=1)["maximum"] * signal.factor
            values[np.broadcast_to(~(peaks > LOADED)[:, None], values.shape)] = np.nan
            return Cycles(result.names, values)
        return result
    if len(signal.series) < 2:
        return None
    return over_cycles(
        signal.series, [(float(signal.series.time[0]), float(signal.series.time[-1]))]
    )


def _write_curves(
    path: Path,
    strides: TrialStrides | None,
    signals: Sequence[Signals],
    cycles: Sequence[Cycles | None],
) -> None:
    """Mean over the strides of every drawn signal, one row a percent; nan where it is not known."""
    head = [OF_STRIDE if strides is not None else OF_TRIAL]
    columns = [np.linspace(0.0, 100.0, SAMPLES)[:, None]]
    for signal, cycle in zip(signals, cycles, strict=True):
        if cycle is None:
            continue
        drawn = list(signal.drawn)
        head += [curve_name(signal.curve, signal.series.names[column]) for column in drawn]
        columns.append(statistics_of(cycle.values[:, :, drawn])["mean"] * signal.factor[drawn])
    write_csv(path, head, np.hstack(columns).tolist())


def curve_name(family: str, name: str) -> str:
    """Heading of a curve: the family "joint angle [°]" and "knee_angle_r" are "joint angle:
    knee_angle_r [°]".
    """
    what, _, unit = family.partition(" [")
    return f"{what}: {name}" + (f" [{unit}" if unit else "")


def _family_and_name(heading: str) -> tuple[str, str]:
    what, _, rest = heading.partition(": ")
    name, bracket, unit = rest.rpartition(" [")
    return (f"{what} [{unit}", name) if bracket else (what, rest)


def read_curves(path: Path, only: tuple[str, ...] = ()) -> tuple[str, dict[str, Series]]:
    """Curves that `write_trial_values` wrote: over what (`OF_STRIDE` or `OF_TRIAL`), and by family
    (whose names begin with one of `only`, () for all) over percents.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        head = next(csv.reader(stream), [])
        if not head or head[0] not in (OF_STRIDE, OF_TRIAL):
            raise BadData(f"{path}: holds no curves over a cycle: run the trial again")
        columns = [
            0,
            *(index for index, name in enumerate(head) if index and name.startswith(only or "")),
        ]
        values = np.loadtxt(stream, delimiter=",", usecols=columns, ndmin=2)
    names = [_family_and_name(head[column]) for column in columns[1:]]
    families = grouped((family, place) for place, (family, _) in enumerate(names))
    return head[0], {
        family: Series(
            values[:, 0],
            tuple(names[column][1] for column in columns),
            values[:, [column + 1 for column in columns]],
        )
        for family, columns in families.items()
    }


def read_values(path: Path) -> list[Value]:
    """Values as `write_trial_values` wrote them."""
    with path.open(newline="", encoding="utf-8") as stream:
        rows = csv.reader(stream)
        next(rows, None)
        return [
            Value(
                step=step,
                quantity=quantity,
                value=float(value),
                unit=unit,
                low=float(low or "nan"),
                high=float(high or "nan"),
                sd=float(sd or "nan"),
            )
            for step, quantity, value, unit, low, high, sd in rows
        ]


def read_quality(path: Path) -> list[dict[str, str]]:
    """The table of quality as `write_trial_values` wrote it, empty where there is none."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))
