"""The tables of a study.

They hold values of all trials, their quality, conditions, and angles that models count differently.
"""

from __future__ import annotations

import csv
import importlib.util
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from myomorph import __version__
from myomorph.core.io.parsing.cells import csv_rows, spreadsheet_cell
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import few
from myomorph.core.model.frozen_map import FrozenMap, grouped
from myomorph.core.model.messages import Message
from myomorph.lab.analysis.conditions import compare_conditions
from myomorph.lab.analysis.groups import GroupOptions
from myomorph.lab.causes import GROUPS
from myomorph.lab.report.study.study_input import Judged, StudyInput, TrialLine
from myomorph.lab.report.study.study_page import study_page
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import STORED, file_name, made_at
from myomorph.lab.store.uncertainty_store import read_value_errors
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.summary.condition_values import (
    COMPARED,
    GrowingCondition,
    OutlierSearch,
    curve_rows,
    described,
    described_rows,
    of_subjects,
    outlier_rows,
    pair_rows,
    shown_quantities,
)
from myomorph.lab.study.summary.grouping import PAGE as GROUPS_PAGE
from myomorph.lab.study.summary.study_inputs import StudyInputs, tables_provenance
from myomorph.lab.study.summary.value_differences import (
    MeasuredValues,
    difference_rows,
    differences,
)
from myomorph.lab.study.trial import tidy
from myomorph.lab.study.trial.message_table import HEAD, read_messages
from myomorph.lab.study.trial.reporting import REPORT
from myomorph.lab.study.trial.trial_inputs import Value
from myomorph.lab.uncertainty.spread import ValueErrors

SMALL = 10.0
LARGE = 25.0
"""An angle that stays within the first on one side of zero and passes the second on the other bends
one way [deg].
"""

MAX_NAMED = 4
PAGE = "study.html"
TIDY = "results_tidy.csv"
PARQUET = "results.parquet"
TRIAL_QUALITY = "quality.csv"
TRIAL_MESSAGES = tidy.MESSAGES
OUTLIERS = "outliers.csv"
DIFFERENCES = "differences.csv"
CONDITION_VALUES = "condition_values.csv"
CONDITION_CURVES = "condition_curves.csv"
VALUE_DIFFERENCES = "value_differences.csv"
# Tables of each trial from which these are made.
OF_TRIALS = (tidy.VALUES, tidy.CURVES, tidy.QUALITY)
WHOSE = ("subject", "condition", "trial")
# Of the Parquet file [bytes]: the memory that gathering takes grows with it, not with the trials.
BLOCK = 1 << 23
# Relabellings of a pair of conditions above which random ones are drawn: there may be many pairs.
PERMUTATIONS = 4000
FILES = (
    (TIDY, "every value of every trial"),
    (PARQUET, "the same as Parquet"),
    (
        TRIAL_QUALITY,
        "of every trial what is held against a limit, warnings, what failed and what was left out",
    ),
    (
        TRIAL_MESSAGES,
        "of every trial what may be wrong: cause, gravity, place, size, effect, remedy",
    ),
    (
        CONDITION_VALUES,
        "every value in every condition: mean, standard deviation, number of subjects",
    ),
    (CONDITION_CURVES, "mean curves of every condition with standard deviation and interval"),
    (DIFFERENCES, "every pair of conditions: differences, effect sizes, corrected p"),
    (
        VALUE_DIFFERENCES,
        (
            "every value in every pair of conditions: difference, and its interval with the draws'"
            " errors"
        ),
    ),
    (OUTLIERS, "values far from those of the other trials"),
)


class SignSearch:
    """Which angles bend to which side, by subject; of each trial nothing else is kept."""

    def __init__(self) -> None:
        self._above: dict[str, dict[str, None]] = {}
        self._below: dict[str, dict[str, None]] = {}

    def add(self, subject: str, values: Sequence[Value]) -> None:
        """Values of one more trial."""
        angles = {value.quantity: value.value for value in values if value.unit == "deg"}
        for quantity, most in angles.items():
            name, ending, _ = quantity.partition(", maximum")
            least = angles.get(f"{name}, minimum")
            if not ending or quantity != f"{name}, maximum" or least is None:
                continue
            if least > -SMALL and most > LARGE:
                self._above.setdefault(name, {})[subject] = None
            elif most < SMALL and least < -LARGE:
                self._below.setdefault(name, {})[subject] = None

    def notes(self) -> list[Message]:
        """One line for all angles that bend one way in some subjects, the other in others."""
        both = self._above.keys() & self._below.keys()
        sides = grouped(
            ((tuple(above), tuple(self._below[name])), name)
            for name, above in self._above.items()
            if name in both
        )
        return [
            GROUPS.message(
                f"{few(names, MAX_NAMED)}: above zero in {few(above, MAX_NAMED)}, "
                f"below it in {few(below, MAX_NAMED)}: where their models count it "
                "the other way round, means over these subjects mean nothing"
            )
            for (above, below), names in sides.items()
        ]


@dataclass(frozen=True)
class _Trial:
    """One trial with what became of it, or a subject's own steps."""

    outcome: Outcome
    condition: str

    @property
    def whose(self) -> tuple[str, str, str]:
        """Subject, condition and trial."""
        return self.outcome.subject, self.condition, self.outcome.trial

    @property
    def drawn(self) -> ValueErrors | None:
        """Errors of its numbers under draws, None where nothing was drawn."""
        if "uncertainty" not in self.outcome.done:
            return None
        return read_value_errors(self.outcome.folder / f"{file_name(self.outcome.trial)}{STORED}")

    @property
    def has_values(self) -> bool:
        """Whether the trial was done, and has a table of values."""
        return (
            bool(self.outcome.trial and self.outcome.done)
            and (self.outcome.folder / tidy.VALUES).is_file()
        )


def gather_study(plan: Plan, outcomes: Sequence[Outcome], out: Path, folder: Path) -> None:
    """Write the tables of a study and its page, `study.html`, into a folder.

    They are made from what trials wrote beside their results. Trials stand in the order of the
    study file, whenever they ended. One that failed has the values of the steps that ended well.
    """
    if not has_parquet():
        # What an earlier run has left would hold other values than the tables beside it.
        (out / PARQUET).unlink(missing_ok=True)
    trials = _in_order(plan, outcomes)
    lines = _write_quality(plan, trials, out, folder)
    growing = {name: GrowingCondition(name) for name in plan.conditions.names}
    search = OutlierSearch()
    signs = SignSearch()
    measured = MeasuredValues()
    with (folder / TIDY).open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow((*WHOSE, *tidy.VALUE_COLUMNS))
        for trial in (trial for trial in trials if trial.has_values):
            outcome = trial.outcome
            values = [
                each
                for each in tidy.read_values(outcome.folder / tidy.VALUES)
                if each.step in outcome.done
            ]
            table.writerows(
                map(spreadsheet_cell, (*trial.whose, *tidy.value_row(each))) for each in values
            )
            condition = growing.setdefault(trial.condition, GrowingCondition(trial.condition))
            condition.add(
                outcome.subject,
                outcome.trial,
                values,
                *tidy.read_curves(outcome.folder / tidy.CURVES),
            )
            search.add(trial.whose, values)
            measured.add(trial.whose, values, trial.drawn)
            signs.add(outcome.subject, values)
    _write_parquet(folder)
    if len([condition for condition in growing.values() if condition.trials]) > 1:
        for condition in growing.values():
            condition.without_whole_trials()
    for trial in trials:
        if trial.has_values:
            curves = tidy.read_curves(trial.outcome.folder / tidy.CURVES, COMPARED)
            search.add_curves(trial.whose, growing[trial.condition], *curves)
    seen = [condition for condition in growing.values() if condition.trials]
    outliers = search.found()
    subjects = of_subjects(seen)
    conditions = tuple(condition.finished(subjects) for condition in seen)
    comparisons = tuple(compare_conditions(conditions, GroupOptions(permutations=PERMUTATIONS)))
    quantities = described(seen)
    compared = differences(measured, [condition.name for condition in seen])
    for name, rows in (
        (OUTLIERS, outlier_rows(outliers)),
        (CONDITION_VALUES, described_rows(quantities, conditions)),
        (CONDITION_CURVES, curve_rows(conditions)),
        (DIFFERENCES, pair_rows(comparisons)),
        (VALUE_DIFFERENCES, difference_rows(compared)),
    ):
        write_csv(folder / name, next(rows), rows)
    shown = shown_quantities([quantity.quantity for quantity in quantities])
    groups = (
        ()
        if plan.groups is None
        else ((GROUPS_PAGE, "the two groups of subjects beside each other"),)
    )
    named = [
        (f"{condition.name}: " if condition.name else "", condition.notes) for condition in seen
    ]
    texts = [f"{prefix}{text}" for prefix, condition_notes in named for text in condition_notes]
    study_input = StudyInput(
        name=plan.name,
        date=made_at(),
        version=__version__,
        trials=tuple(lines),
        conditions=conditions,
        comparisons=comparisons,
        outliers=tuple(outliers),
        described=tuple(quantity for quantity in quantities if quantity.quantity in shown),
        differences=tuple(
            each for each in compared if each.quantity in shown and np.isfinite(each.measured_sd)
        ),
        changes=_changes(trials),
        messages=_write_messages(trials, folder),
        notes=(*signs.notes(), *texts),
        files=(
            *groups,
            *((name, text) for name, text in FILES if name != PARQUET or has_parquet()),
        ),
    )
    (folder / PAGE).write_text(study_page(study_input), encoding="utf-8")


def _run(study: StudyInputs, output: FolderOutput) -> None:
    with output.whole() as folder:
        gather_study(study.plan, study.outcomes, study.out, folder)


def _in_order(plan: Plan, outcomes: Sequence[Outcome]) -> list[_Trial]:
    """Return outcomes with their conditions in the order of the study file.

    A subject's own steps stand before its trials.
    """
    by_key = {outcome.key: outcome for outcome in outcomes}
    keys = [
        key for trial in plan.trials for key in ((trial.subject, ""), (trial.subject, trial.name))
    ]
    keys += [(together.name, together.name) for together in plan.together]
    conditions = {(trial.subject, trial.name): trial.condition for trial in plan.trials} | dict(
        plan.conditions.trials
    )
    outcomes = [by_key[key] for key in dict.fromkeys(keys) if key in by_key]
    return [
        _Trial(outcome, outcome.condition or conditions.get(outcome.key, ""))
        for outcome in outcomes
    ]


def _write_quality(
    plan: Plan, trials: Sequence[_Trial], out: Path, folder: Path
) -> list[TrialLine]:
    """Write the table of quality of all trials; return each trial as a line of the page."""
    lines = list[TrialLine]()
    cells = list[tuple[str, ...]]()
    for trial in trials:
        rows = tidy.read_quality(trial.outcome.folder / tidy.QUALITY) if trial.has_values else []
        cells += [(*trial.whose, *(row[name] for name in tidy.QUALITY_COLUMNS)) for row in rows]
        if trial.outcome.error:
            cells.append(
                (*trial.whose, "failed", "", "", "", "failed", "", "", trial.outcome.error)
            )
        lines.append(_line(trial, rows, out))
    for left in plan.excluded:
        condition = plan.conditions.trials.get((left.subject, left.trial), "")
        cells.append(
            (
                left.subject,
                condition,
                left.trial,
                "left out",
                "",
                "",
                "",
                "left out",
                "",
                "",
                left.reason,
            )
        )
        lines.append(
            TrialLine(
                subject=left.subject,
                trial=left.trial,
                condition=condition,
                state="left out",
                reason=left.reason,
            )
        )
    write_csv(folder / TRIAL_QUALITY, (*WHOSE, *tidy.QUALITY_COLUMNS), cells)
    return lines


def _write_messages(
    trials: Sequence[_Trial], folder: Path
) -> tuple[tuple[str, tuple[Message, ...]], ...]:
    """Write the messages of all trials as one table; return them by trial."""
    found = []
    cells: list[tuple[str, ...]] = []
    for trial in trials:
        path = trial.outcome.folder / tidy.MESSAGES
        messages = read_messages(path) if trial.has_values else ()
        if not messages:
            continue
        found.append(("/".join(filter(None, trial.outcome.key)), messages))
        with path.open(newline="", encoding="utf-8") as stream:
            cells += [(*trial.whose, *row) for row in islice(csv_rows(stream), 1, None)]
    write_csv(folder / TRIAL_MESSAGES, (*WHOSE, *HEAD), cells)
    return tuple(found)


def _line(trial: _Trial, rows: Sequence[Mapping[str, str]], out: Path) -> TrialLine:
    outcome = trial.outcome
    page = outcome.folder / REPORT
    judged = {
        row["quantity"]: Judged(
            value=float(row["value"]),
            unit=row["unit"],
            limit=float(row["limit"]) if row["limit"] else None,
            state=row["state"],
        )
        for row in rows
        if row["value"]
    }
    return TrialLine(
        subject=outcome.subject,
        trial=outcome.trial,
        condition=trial.condition,
        state="failed" if outcome.error else "done",
        report=(
            Path(os.path.relpath(page, out)).as_posix()
            if "report" in outcome.done or not outcome.trial
            else ""
        ),
        steps=outcome.done,
        frames=outcome.frames,
        reason=outcome.error,
        judged=judged,
        warnings=sum(1 for row in rows if row["quantity"] == "warning"),
    )


def _changes(trials: Sequence[_Trial]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return what made steps be computed again, each with the trials it concerns."""
    trials_by_text = grouped(
        (text, ", ".join(filter(None, trial.outcome.key)))
        for trial in trials
        for text in trial.outcome.changed
    )
    return tuple((text, tuple(names)) for text, names in trials_by_text.items())


def has_parquet() -> bool:
    """Whether tables can be written as Parquet, too."""
    return importlib.util.find_spec("pyarrow") is not None


def _write_parquet(folder: Path) -> None:
    """Write the values of all trials as Parquet, too, in blocks.

    Nothing is written without the extra `parquet`.
    """
    if not has_parquet():
        return
    # Takes half a second to import, and only here.
    import pyarrow as pa
    from pyarrow import csv as arrow_csv
    from pyarrow import parquet

    columns = (*WHOSE, *tidy.VALUE_COLUMNS)
    kinds = {name: pa.float64() if name in tidy.NUMBERS else pa.string() for name in columns}
    options = (
        arrow_csv.ReadOptions(block_size=BLOCK),
        None,
        arrow_csv.ConvertOptions(column_types=kinds),
    )
    with (
        arrow_csv.open_csv(folder / TIDY, *options) as rows,
        parquet.ParquetWriter(folder / PARQUET, rows.schema) as table,
    ):
        for batch in rows:
            table.write_batch(batch)


STEP = Step(
    name="tables",
    title="tables and page of the study",
    scope="study",
    leaves=FrozenMap({"page": PAGE}),
    run=_run,
    made_from=lambda study: tables_provenance(study, OF_TRIALS),
)
