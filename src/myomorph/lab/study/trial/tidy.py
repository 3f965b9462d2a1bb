"""Scalar results of one trial.

They are one value per row, mean curves over the cycle, and measures of quality.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.cells import csv_records, csv_rows
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.message_groups import grouped_messages
from myomorph.core.model.message_quantities import MESSAGE_TABLE
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.lab.analysis.cycles import Cycles, over_cycles
from myomorph.lab.analysis.stride_quantities import STRIDE_TABLE
from myomorph.lab.analysis.stride_spread import StrideSpread, stride_spreads
from myomorph.lab.report.page.parts import Verdict
from myomorph.lab.report.trial.answer.answer import judgement_of
from myomorph.lab.report.trial.movement.movement_section import shown_numbers
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import Stored
from myomorph.lab.store.uncertainty_store import get_value_limits
from myomorph.lab.study.step.step import trial_steps
from myomorph.lab.study.step.step_table import REPORT
from myomorph.lab.study.trial.labelled_result import labelled_signals
from myomorph.lab.study.trial.message_table import write_messages
from myomorph.lab.study.trial.movement_values import movement_values, write_movement
from myomorph.lab.study.trial.reporting import TrialResults
from myomorph.lab.study.trial.stride_table import write_stride_table
from myomorph.lab.study.trial.trial_inputs import IN_STRIDE, Signals, Value, statistics_of
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side, maxima_by_side

VALUES = "values.csv"
CURVES = "curves.csv"
QUALITY = "quality.csv"
MESSAGES = MESSAGE_TABLE
OF_STRIDE = "percent_of_stride"
OF_TRIAL = "percent_of_trial"
STRIDE_COLUMNS = ("stride_sd", "mean_low", "mean_high", "strides")
VALUE_COLUMNS = ("step", "quantity", "value", "unit", "low", "high", "sd", *STRIDE_COLUMNS)
OF_PLATES = ("vertical force", "joint torque")
"""Curves that follow from the force under a foot."""
NUMBERS = ("value", "low", "high", "sd", *STRIDE_COLUMNS)
"""Columns of `VALUE_COLUMNS` that are numbers; those of draws are empty where nothing was drawn,
those of strides where the value is no mean over strides.
"""
QUALITY_COLUMNS = ("quantity", "value", "unit", "limit", "state", "worst", "time_s", "detail")


def write_trial_values(results: TrialResults, outcome: Outcome) -> None:
    """Write `values.csv`, `curves.csv`, `strides.csv`, `quality.csv`, `messages.csv`.

    They are made from these alone. Where every step was reused from an earlier run and the files
    are there, they stay.
    """
    names = (VALUES, CURVES, QUALITY, MESSAGES)
    steps = [step for step in outcome.done if step != REPORT]
    if set(steps) <= set(outcome.reused) and all(
        (outcome.folder / name).is_file() for name in names
    ):
        return
    stored = results.stored
    model = results.model
    prepared = results.prepared
    strides = TrialStrides.whole(stored.facts.get("trial", ""), prepared.strides)
    if strides is not None:
        dynamics = prepared.results.dynamics
        strides = strides.on_plates(model, dynamics.wrenches, dynamics.measured)
    mass = float(stored.facts.get("mass") or 0.0) or model.mass
    signals = [
        signal
        for step in trial_steps()
        for signal in (*step.signals(stored, model, mass), *labelled_signals(step, stored, model))
    ]
    cycles = [_cycles(signal, strides) for signal in signals]
    limits = get_value_limits(stored)
    _write_curves(outcome.folder / CURVES, strides, signals, cycles)
    write_stride_table(outcome.folder / STRIDE_TABLE, prepared.stride_curves)
    write_csv(
        outcome.folder / QUALITY,
        QUALITY_COLUMNS,
        quality_rows(prepared.verdicts, prepared.results.head.warnings),
    )
    numbers = shown_numbers(prepared, judgement_of(prepared).use)
    write_movement(outcome.folder, numbers)
    write_messages(outcome.folder / MESSAGES, prepared.results.head.warnings)
    # Last, so that where there are values there is everything.
    write_csv(
        outcome.folder / VALUES,
        VALUE_COLUMNS,
        (
            value_row(_with_limits(trial_value, limits))
            for trial_value in (
                *trial_values(stored, model, strides, signals, cycles),
                *movement_values(numbers),
            )
            if np.isfinite(trial_value.value)
        ),
    )


def value_row(value: Value) -> tuple[str, ...]:
    """Return a row of `VALUE_COLUMNS`."""
    numbers = [value.low, value.high, value.sd]
    count = ""
    if value.strides is None:
        numbers += [math.nan] * 3
    else:
        numbers += [value.strides.sd, value.strides.low, value.strides.high]
        count = str(value.strides.count)
    texts = (f"{number:.6g}" if np.isfinite(number) else "" for number in numbers)
    return (value.step, value.quantity, f"{value.value:.9g}", value.unit, *texts, count)


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
    """Yield all numbers of a trial, one after the other.

    Of every signal they are its extremes and mean over the trial; where there are strides also
    those of each stride, as the mean over the strides.
    """
    steps = trial_steps()
    for step in steps:
        if not step.numbers_last:
            yield from step.numbers(stored, model, strides)
    for signal, cycle in zip(signals, cycles, strict=True):
        yield from _signal_values(signal, cycle, strides)
    for step in steps:
        if step.numbers_last:
            yield from step.numbers(stored, model, strides)


def _signal_values(
    signal: Signals, cycle: Cycles | None, strides: TrialStrides | None
) -> Iterator[Value]:
    """Yield extremes and means of the columns of a signal over the trial.

    Where there are strides the mean over these of each stride's own follows, with how strides
    differ.
    """
    whole = statistics_of(signal.series.values)
    each = {}
    if cycle is not None and strides is not None:
        each = statistics_of(cycle.values, axis=1)
        if signal.as_measured:
            known = np.isfinite(each["maximum"])
            each["maximum"] = np.where(known, maxima_by_side(signal.series, strides), np.nan)
    means = {what: statistics_of(each[what])["mean"] for what in signal.statistics if each}
    spreads = {what: stride_spreads(each[what]) for what in signal.statistics if each}
    for index, name in enumerate(signal.series.names):
        beginning = f"{name}{signal.endings[index]}"
        for what in signal.statistics:
            yield Value(
                step=signal.step,
                quantity=f"{beginning}, {what}",
                value=float(whole[what][index]),
                unit=signal.units[index],
            )
        for what, numbers in means.items():
            yield Value(
                step=signal.step,
                quantity=f"{beginning}, {what} {IN_STRIDE}",
                value=float(numbers[index]),
                unit=signal.units[index],
                strides=spreads[what][index],
            )


def quality_rows(verdicts: Sequence[Verdict], warnings: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Rows of the table of quality: what is held against a limit, then what files and steps said.

    What may change a number of the page is a warning, the rest a remark; `messages.csv` has causes.
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
    for group in grouped_messages(warnings):
        word = "warning" if group.is_warning else "remark"
        for message in group.messages:
            yield (word, "", "", "", "note", "", "", message.text)


def _cycles(signal: Signals, strides: TrialStrides | None) -> Cycles | None:
    """Signals over strides, else over the whole trial; None where nothing is long enough."""
    if strides is not None:
        return by_side(signal.series, strides, of_plates=signal.curve.startswith(OF_PLATES))
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
    """Return the heading of a curve.

    The family "joint angle [°]" and "knee_angle_r" are "joint angle: knee_angle_r [°]".
    """
    what, _, unit = family.partition(" [")
    return f"{what}: {name}" + (f" [{unit}" if unit else "")


def _family_and_name(heading: str) -> tuple[str, str]:
    what, _, rest = heading.partition(": ")
    name, bracket, unit = rest.rpartition(" [")
    return (f"{what} [{unit}", name) if bracket else (what, rest)


def read_curves(path: Path, only: tuple[str, ...] = ()) -> tuple[str, dict[str, Series]]:
    """Read curves that `write_trial_values` wrote.

    They are over `OF_STRIDE` or `OF_TRIAL`, which is returned first, and by family (whose names
    begin with one of `only`, () for all) over percents.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        head = next(csv_rows(stream), [])
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
    """Read values as `write_trial_values` wrote them.

    Tables of older versions have no columns of strides.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        return [_read_value(row) for row in csv_records(stream)]


def _read_value(row: Mapping[str, str]) -> Value:
    value = Value(
        step=row["step"],
        quantity=row["quantity"],
        value=float(row["value"]),
        unit=row["unit"],
        low=float(row["low"] or "nan"),
        high=float(row["high"] or "nan"),
        sd=float(row["sd"] or "nan"),
    )
    if not row.get("strides"):
        return value
    spread = StrideSpread(
        mean=value.value,
        sd=float(row["stride_sd"] or "nan"),
        low=float(row["mean_low"] or "nan"),
        high=float(row["mean_high"] or "nan"),
        count=int(row["strides"]),
    )
    return value._replace(strides=spread)


def read_quality(path: Path) -> list[dict[str, str]]:
    """Read the table of quality as `write_trial_values` wrote it, empty where there is none."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv_records(stream))
