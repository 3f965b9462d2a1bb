"""What the steps of a whole study begin with.

It has the plan, what became of its jobs, and the results in its folder.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import (
    DAMAGED,
    STORED,
    file_name,
    file_source,
    made_from,
    provenance_of,
    value_source,
)
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.trial.trial_step import KEY


@dataclass(frozen=True)
class StudyInputs:
    """The trials of a study, and subjects' own steps, when all have ended."""

    plan: Plan
    outcomes: tuple[Outcome, ...]
    out: Path

    def after(self, step: Step[Any], home: Path) -> StudyInputs:
        """Return the same: steps of a study do not read each other's results."""
        return self


def tables_provenance(study: StudyInputs, tables: tuple[str, ...]) -> Provenance:
    """Return what the tables of a study are derived from, each trial's own being `tables`."""
    plan = study.plan
    sources = []
    for outcome in study.outcomes:
        told = (outcome.condition, outcome.done, outcome.error, outcome.frames, outcome.changed)
        paths = [outcome.folder / name for name in tables]
        hashes = [file_source("", path).sha256 if path.is_file() else "" for path in paths]
        sources.append(
            value_source("trial", "/".join(name for name in outcome.key if name), *told, hashes)
        )
    options = {
        "name": plan.name,
        "trials": [(trial.subject, trial.name, trial.condition) for trial in plan.trials],
        "together": [together.name for together in plan.together],
        "groups": plan.groups is not None,
        "conditions": [list(plan.conditions.names), sorted(plan.conditions.trials.items())],
        "excluded": [astuple(excluded) for excluded in plan.excluded],
    }
    return provenance_of("tables", sources, options)


def groups_provenance(study: StudyInputs) -> Provenance:
    """Return what the comparison of two groups is derived from.

    It is what the results of their trials were derived from.
    """
    groups = study.plan.groups
    assert groups is not None
    options = {
        "name": study.plan.name,
        "groups": [groups.first, groups.second],
        "strides": repr(groups.strides),
    }
    sources = []
    for subject in (*groups.first[1], *groups.second[1]):
        for trial in groups.trials[subject]:
            path = study.out / file_name(subject) / file_name(trial) / f"{file_name(trial)}{STORED}"
            sources.append(value_source("trial", f"{subject}/{trial}", _result_key(path)))
    return provenance_of("groups", sources, options | {"trials": sorted(groups.trials.items())})


def _result_key(path: Path) -> tuple[object, ...]:
    try:
        with open_netcdf(path) as file:
            attributes = file.attributes
        return attributes.get(KEY, ""), sorted(
            (step, made.key) for step, made in made_from(attributes).items()
        )
    except DAMAGED:
        return ()
