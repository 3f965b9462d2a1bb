"""Two groups of subjects of a study: after the trials their comparison, as a page and as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from operator import attrgetter
from pathlib import Path

import numpy as np

from myomorph import __version__
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.lab import causes
from myomorph.lab.analysis.groups import Animal, Comparison, Group, compare_groups
from myomorph.lab.causes import GROUPS
from myomorph.lab.report.page.parts import Note, PageHead
from myomorph.lab.report.study.group_page import group_page
from myomorph.lab.report.study.study_input import ValueDifference
from myomorph.lab.store.results import STORED, file_name, read_result
from myomorph.lab.store.uncertainty_store import read_value_errors
from myomorph.lab.study.plan.groups import GroupPlan
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.summary.condition_values import EFFECT
from myomorph.lab.study.summary.study_inputs import StudyInputs, groups_provenance
from myomorph.lab.study.summary.value_differences import (
    MeasuredValues,
    difference_rows,
    differences,
)
from myomorph.lab.study.trial.reporting import model_of
from myomorph.lab.study.trial.tidy import VALUES as TRIAL_VALUES
from myomorph.lab.study.trial.tidy import read_values
from myomorph.lab.study.trial.trial_strides import (
    TrialStrides,
    animal_of,
    in_one_turn,
    trial_strides,
)

PAGE = "groups.html"
PARAMETERS = "group_parameters.csv"
CURVES = "group_curves.csv"
STRIDES = "group_strides.csv"
VALUES = "group_values.csv"
Row = tuple[object, ...]
STRIDE = attrgetter(
    "start", "lift", "stop", "length", "duration", "speed", "duty", "width", "seen", "source"
)


def compare_stored(plan: GroupPlan, out: Path, folder: Path, name: str = "") -> Comparison:
    """Compare the groups by results in `out/subject/trial`.

    It writes a page and four tables, which name trials that were left out.
    """
    notes: list[Message] = []
    rows: list[tuple[str, str, TrialStrides]] = []
    groups = [_group(members, plan, out, notes, rows) for members in (plan.first, plan.second)]
    for group in groups:
        if not group.animals:
            raise BadData(
                f"group '{group.name}' has no subject with strides:"
                f" {'; '.join(notes) or 'no trials'}"
            )
    animals = in_one_turn([*groups[0].animals, *groups[1].animals])
    count = len(groups[0].animals)
    first = replace(groups[0], animals=animals[:count])
    second = replace(groups[1], animals=animals[count:])
    result = compare_groups(first, second)
    page_head = PageHead(
        title=(
            f"{name}: {plan.first[0]} and {plan.second[0]}"
            if name
            else f"{plan.first[0]} and {plan.second[0]}"
        ),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        version=__version__,
        notes=tuple(Note("warning", note) for note in notes),
    )
    tables: dict[str, Iterator[Row]] = {
        PARAMETERS: _parameter_rows(result),
        CURVES: _curve_rows(result),
        STRIDES: _stride_rows(rows),
        VALUES: difference_rows(_value_differences(plan, out)),
    }
    for file, lines in tables.items():
        write_csv(folder / file, next(lines), lines, digits=9)
    (folder / PAGE).write_text(group_page(result, page_head), encoding="utf-8")
    return result


def _run(study: StudyInputs, output: FolderOutput) -> Comparison:
    assert study.plan.groups is not None
    with output.whole() as folder:
        return compare_stored(study.plan.groups, study.out, folder, study.plan.name)


def _value_differences(plan: GroupPlan, out: Path) -> list[ValueDifference]:
    """Every value of the trials in both groups, with the errors of draws where there are any."""
    values = MeasuredValues()
    for name, subjects in (plan.first, plan.second):
        for subject, trial in ((name, trial) for name in subjects for trial in plan.trials[name]):
            folder = out / file_name(subject) / file_name(trial)
            if (folder / TRIAL_VALUES).is_file():
                errors = read_value_errors(folder / f"{file_name(trial)}{STORED}")
                values.add((subject, name, trial), read_values(folder / TRIAL_VALUES), errors)
    return differences(values, (plan.first[0], plan.second[0]))


def _group(
    members: tuple[str, tuple[str, ...]],
    plan: GroupPlan,
    out: Path,
    notes: list[Message],
    rows: list[tuple[str, str, TrialStrides]],
) -> Group:
    animals: list[Animal] = []
    for subject in members[1]:
        results = []
        for trial in plan.trials[subject]:
            path = out / file_name(subject) / file_name(trial) / f"{file_name(trial)}{STORED}"
            try:
                result = read_result(path, leave_out=("moment_arm",))
                model = model_of(result)
                strides = trial_strides(result, model, plan.strides)
            except MyomorphError as error:
                notes.append(
                    GROUPS.message(f"{subject}, {trial}: left out: {' '.join(str(error).split())}")
                )
                continue
            notes += located(f"{subject}, {trial}", strides.notes)
            if not strides.count:
                notes.append(
                    causes.STRIDES.message(f"{subject}, {trial}: left out: no whole stride is seen")
                )
                continue
            results.append((result, model, strides))
            rows.append((members[0], subject, strides))
        if results:
            animals.append(animal_of(subject, results))
        else:
            notes.append(
                GROUPS.message(
                    f"{subject} is left out of group '{members[0]}': no trial of it has strides"
                )
            )
    return Group(members[0], tuple(animals))


def _parameter_rows(comparison: Comparison) -> Iterator[Row]:
    """One row a parameter; the heading first."""
    yield (
        "parameter",
        *(f"{name}_{what}" for name in comparison.names for what in ("mean", "sd", "animals")),
        *("difference", "low", "high", "hedges_g", "g_low", "g_high", "p", "p_holm", "q"),
    )
    for scalar in comparison.scalars:
        yield (
            scalar.name,
            *scalar.first,
            *scalar.second,
            *EFFECT(scalar),
            scalar.p,
            scalar.holm,
            scalar.q,
        )


def _curve_rows(comparison: Comparison) -> Iterator[Row]:
    """One row a curve and percent; the heading first."""
    yield (
        *("kind", "curve", "percent"),
        *(f"{name}_{what}" for name in comparison.names for what in ("mean", "low", "high")),
        *("difference", "low", "high", "hedges_g", "g_low", "g_high", "p_corrected"),
    )
    for each in comparison.curves:
        bands = (
            part for band in (each.first, each.second) for part in (band.mean, band.low, band.high)
        )
        percents = np.linspace(0.0, 100.0, len(each.difference))
        for numbers in zip(percents, *bands, *EFFECT(each), each.p, strict=True):
            yield (each.family, each.name, *map(float, numbers))


def _stride_rows(trials: Sequence[tuple[str, str, TrialStrides]]) -> Iterator[Row]:
    """One row a stride; the heading first."""
    yield (
        "group",
        "subject",
        "trial",
        "limb",
        "start_s",
        "lift_s",
        "stop_s",
        "length_m",
        "duration_s",
        "speed_m_per_s",
        "duty_factor",
        "width_m",
        "seen",
        "source",
    )
    for group, subject, strides in trials:
        for limb in strides.limbs:
            for stride in strides.of(limb):
                yield (group, subject, strides.trial, stride.limb, *STRIDE(stride))


STEP = Step(
    name="groups",
    title="comparison of two groups of subjects",
    scope="study",
    leaves=FrozenMap({"page": PAGE}),
    applies=lambda study: study.plan.groups is not None,
    run=_run,
    made_from=groups_provenance,
)
