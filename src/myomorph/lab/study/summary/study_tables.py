"""The tables of a study.

They hold values of all trials, their quality, conditions, and angles that models count differently.
"""

from __future__ import annotations

import csv
import importlib.util
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from myomorph import __version__
from myomorph.core.io.parsing.cells import csv_rows, spreadsheet_cell
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import few
from myomorph.core.model.frozen_map import FrozenMap, grouped
from myomorph.core.model.messages import Message
from myomorph.lab.analysis.conditions import Condition, compare_conditions
from myomorph.lab.analysis.groups import Comparison, GroupOptions
from myomorph.lab.causes import GROUPS
from myomorph.lab.report.study.study_input import (
    Described,
    Judged,
    Outlier,
    StudyInput,
    TrialLine,
    ValueDifference,
)
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
        "of every trial: values compared with limits, warnings, failures and exclusions",
    ),
    (
        TRIAL_MESSAGES,
        "possible errors of every trial: cause, gravity, place, size, effect, remedy",
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
                f"below it in {few(below, MAX_NAMED)}: if their models have opposite signs, means"
                " over these subjects are meaningless"
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

    def values(self) -> list[Value]:
        """Read its numbers, of the steps that ended well."""
        values = tidy.read_values(self.outcome.folder / tidy.VALUES)
        return [value for value in values if value.step in self.outcome.done]


@dataclass
class _Gathered:
    """What the values of all trials come to, while they are read trial by trial.

    Attributes
    ----------
    conditions : by name
    search : for trials that lie far from the others
    measured : values with their errors, for differences
    signs : of angles, which models may count differently
    """

    conditions: dict[str, GrowingCondition]
    search: OutlierSearch = field(default_factory=OutlierSearch)
    measured: MeasuredValues = field(default_factory=MeasuredValues)
    signs: SignSearch = field(default_factory=SignSearch)

    @property
    def seen(self) -> list[GrowingCondition]:
        """Conditions that have trials."""
        return [condition for condition in self.conditions.values() if condition.trials]

    def add(self, trial: _Trial, values: Sequence[Value]) -> None:
        """Add a trial with its numbers."""
        outcome = trial.outcome
        condition = self.conditions.setdefault(trial.condition, GrowingCondition(trial.condition))
        curves = tidy.read_curves(outcome.folder / tidy.CURVES)
        condition.add(outcome.subject, outcome.trial, values, *curves)
        self.search.add(trial.whose, values)
        self.measured.add(trial.whose, values, trial.drawn)
        self.signs.add(outcome.subject, values)

    def compare_curves(self, trials: Sequence[_Trial]) -> None:
        """Compare the curves of every trial with the mean of its condition, once all are added."""
        if len(self.seen) > 1:
            for condition in self.conditions.values():
                condition.without_whole_trials()
        for trial in trials:
            curves = tidy.read_curves(trial.outcome.folder / tidy.CURVES, COMPARED)
            self.search.add_curves(trial.whose, self.conditions[trial.condition], *curves)

    def summary(self) -> _Summary:
        """Describe and compare the conditions."""
        seen = self.seen
        outliers = self.search.found()
        subjects = of_subjects(seen)
        conditions = tuple(condition.finished(subjects) for condition in seen)
        options = GroupOptions(permutations=PERMUTATIONS)
        return _Summary(
            conditions=conditions,
            comparisons=tuple(compare_conditions(conditions, options)),
            outliers=outliers,
            quantities=described(seen),
            differences=differences(self.measured, [condition.name for condition in seen]),
        )

    def notes(self) -> tuple[str, ...]:
        """Lines on angles that models count differently, and on conditions."""
        named = [
            (f"{condition.name}: " if condition.name else "", condition.notes)
            for condition in self.seen
        ]
        of_conditions = [f"{prefix}{text}" for prefix, texts in named for text in texts]
        return (*self.signs.notes(), *of_conditions)


@dataclass(frozen=True, eq=False)
class _Summary:
    """Conditions described and compared.

    Attributes
    ----------
    conditions : that have trials
    comparisons : of curves, of every pair of conditions
    outliers : values of trials that lie far from the others
    quantities : in every condition
    differences : of values, of every pair of conditions
    """

    conditions: tuple[Condition, ...]
    comparisons: tuple[Comparison, ...]
    outliers: list[Outlier]
    quantities: tuple[Described, ...]
    differences: list[ValueDifference]

    def write(self, folder: Path) -> None:
        """Write each as a table."""
        for name, rows in (
            (OUTLIERS, outlier_rows(self.outliers)),
            (CONDITION_VALUES, described_rows(self.quantities, self.conditions)),
            (CONDITION_CURVES, curve_rows(self.conditions)),
            (DIFFERENCES, pair_rows(self.comparisons)),
            (VALUE_DIFFERENCES, difference_rows(self.differences)),
        ):
            write_csv(folder / name, next(rows), rows)


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
    with_values = [trial for trial in trials if trial.has_values]
    gathered = _Gathered({name: GrowingCondition(name) for name in plan.conditions.names})
    _write_values(with_values, gathered, folder)
    _write_parquet(folder)
    gathered.compare_curves(with_values)
    summary = gathered.summary()
    summary.write(folder)
    shown = shown_quantities([quantity.quantity for quantity in summary.quantities])
    study_input = StudyInput(
        name=plan.name,
        date=made_at(),
        version=__version__,
        trials=tuple(lines),
        conditions=summary.conditions,
        comparisons=summary.comparisons,
        outliers=tuple(summary.outliers),
        described=tuple(each for each in summary.quantities if each.quantity in shown),
        differences=tuple(
            each
            for each in summary.differences
            if each.quantity in shown and np.isfinite(each.measured_sd)
        ),
        changes=_changes(trials),
        messages=_write_messages(trials, folder),
        notes=gathered.notes(),
        files=_files(plan),
    )
    (folder / PAGE).write_text(study_page(study_input), encoding="utf-8")


def _files(plan: Plan) -> tuple[tuple[str, str], ...]:
    """Names of a study's files, and what each is."""
    groups = ((GROUPS_PAGE, "comparison of the two groups of subjects"),)
    tables = tuple((name, text) for name, text in FILES if name != PARQUET or has_parquet())
    return tables if plan.groups is None else (*groups, *tables)


def _write_values(trials: Sequence[_Trial], gathered: _Gathered, folder: Path) -> None:
    """Write the values of all trials into one table while they are gathered."""
    with (folder / TIDY).open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow((*WHOSE, *tidy.VALUE_COLUMNS))
        for trial in trials:
            values = trial.values()
            table.writerows(
                map(spreadsheet_cell, (*trial.whose, *tidy.value_row(each))) for each in values
            )
            gathered.add(trial, values)


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
