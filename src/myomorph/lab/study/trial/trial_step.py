"""One step of a trial: the sources of its result, and its run on the results before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from myomorph import __version__
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.results import (
    DAMAGED,
    STORED,
    ResultWriter,
    file_name,
    provenance_of,
    value_source,
)
from myomorph.lab.store.settings import ReportOptions, plain_settings
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.reading import about
from myomorph.lab.study.step.step import Step, StepOutput, step_of, trial_steps
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.trial.labelled_result import write_labelled
from myomorph.lab.study.trial.trial_inputs import TrialInputs


class StepResults(ByType):
    """What the steps have found so far."""

    @property
    def notes(self) -> tuple[Message, ...]:
        """What was done about questionable input, one line each."""
        return tuple(
            dict.fromkeys(text for result in self for text in getattr(result, "notes", ()))
        )


def steps_before(step: Step[Any]) -> tuple[Step[Any], ...]:
    """List the steps whose results a step reads, and those before these, in their order."""
    read = {*step.needs, *step.uses}
    before = list[Step[Any]]()
    names = list(STEPS["trial"])
    for earlier in map(step_of, reversed(names[: names.index(step.name)])):
        if earlier.gives in read:
            before.insert(0, earlier)
            read |= {*earlier.needs, *earlier.uses}
    return tuple(before)


def step_provenance(step: Step[Any], trial: TrialInputs) -> Provenance:
    """Return what a step's result is derived from.

    It is the step's inputs, and the options of this step and those before it.
    """
    options: dict[str, object] = {"time": None if trial.time is None else list(trial.time)}
    for each in (*steps_before(step), step):
        hashed = (
            [trial.options[kind] for kind in each.options]
            if each.hashed is None
            else each.hashed(trial)
        )
        options |= {
            f"{each.name}.{name}": one
            for part in hashed
            for name, one in plain_settings(part).items()
        }
    sources = [
        source for source in trial.sources if step.roles is None or source.role in step.roles
    ]
    return provenance_of(step.name, sources, options)


def run_step(
    step: Step[Any], trial: TrialInputs, results: StepResults, output: StepOutput
) -> StepResults:
    """Run a step, write its tables into a folder and its values into a result file."""
    for kind in step.needs:
        if results.get(kind) is None:
            giver = next(each.name for each in trial_steps() if each.gives is kind)
            raise BadData(
                f"{trial.name}: '{step.name}' needs the results of '{giver}': run '{giver}' first"
            )
    with about(trial.name):
        result = step.run(trial, output, *(results.get(kind) for kind in (*step.needs, *step.uses)))
    write_labelled(result, output, trial.model)
    results = results.having(result)
    # What the checks found comes first: it may change what is believed of the whole result.
    replace(trial, warnings=tuple(dict.fromkeys((*results.notes, *trial.warnings)))).put(
        output.writer
    )
    output.writer.remarks(step.name, getattr(result, "notes", ()))
    output.writer.provenance(step_provenance(step, trial))
    return results


KEY = "report_key"
PAGE = "report.html"


def report_key(trial: TrialInputs, done: Sequence[str]) -> str:
    """Hash of all that a report is made of: results by their keys, and its settings."""
    results = sorted(step_provenance(step_of(step), trial).key for step in done)
    settings = sorted(plain_settings(trial.options[ReportOptions]).items())
    return value_source(
        "report", trial.name, __version__, results, settings, sorted(trial.facts.items())
    ).sha256


def keep_facts(writer: ResultWriter, trial: TrialInputs, done: Sequence[str]) -> None:
    """Write the facts of the recording as they are now, before earlier ones are reused.

    Steps add warnings.
    """
    for name, text in trial.facts.items():
        if name != "warnings":
            writer.fact(name, text)
    writer.fact(KEY, report_key(trial, done))


def report_is_made(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether the report of a folder is that of its results and of the present facts."""
    return (folder / PAGE).is_file() and same_report(folder, trial, done)


def same_report(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether results hold the present facts of the recording, such as the subject's mass."""
    stored = folder / f"{file_name(trial.name)}{STORED}"
    if not stored.is_file():
        return False
    try:
        with open_netcdf(stored) as file:
            return file.attributes.get(KEY, "") == report_key(trial, done)
    except DAMAGED:
        return False
