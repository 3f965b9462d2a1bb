"""One step of a trial: what its result is made from, and how it is run with the results before it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from myomorph.model.errors import BadData
from myomorph.model.provenance import Provenance
from myomorph.store.results import provenance_of
from myomorph.store.settings import plain_settings
from myomorph.study.inputs.by_type import ByType
from myomorph.study.inputs.reading import about
from myomorph.study.step.step import Step, StepOutput, trial_steps
from myomorph.study.trial.trial_inputs import TrialInputs


class StepResults(ByType):
    """What the steps have found so far."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done about doubtful input, one line each."""
        return tuple(dict.fromkeys(text for result in self for text in getattr(result, "notes", ())))


def steps_before(step: Step[Any]) -> tuple[Step[Any], ...]:
    """The steps whose results a step reads, and those before these, in their order."""
    read, before = {*step.needs, *step.uses}, list[Step[Any]]()
    names = [each.name for each in trial_steps()]
    for earlier in reversed(trial_steps()[: names.index(step.name)]):
        if earlier.gives in read:
            before.insert(0, earlier)
            read |= {*earlier.needs, *earlier.uses}
    return tuple(before)


def hashed_options(step: Step[Any], trial: TrialInputs) -> dict[str, object]:
    """Options that the result of a step depends on, by name."""
    values = [trial.options[kind] for kind in step.options] if step.hashed is None else step.hashed(trial)
    return {f"{step.name}.{name}": value for options in values for name, value in plain_settings(options).items()}


def step_provenance(step: Step[Any], trial: TrialInputs) -> Provenance:
    """What a step's result is made from: its inputs, and the options of this step and those before it."""
    options: dict[str, object] = {"time": None if trial.time is None else list(trial.time)}
    for each in (*steps_before(step), step):
        options |= hashed_options(each, trial)
    sources = [source for source in trial.sources if step.roles is None or source.role in step.roles]
    return provenance_of(step.name, sources, options)


def run_step(step: Step[Any], trial: TrialInputs, results: StepResults, output: StepOutput) -> StepResults:
    """Run a step, write its tables into a folder and its values into a result file."""
    for kind in step.needs:
        if results.get(kind) is None:
            giver = next(each.name for each in trial_steps() if each.gives is kind)
            raise BadData(f"{trial.name}: '{step.name}' needs the results of '{giver}': run '{giver}' first")
    with about(trial.name):
        result = step.run(trial, output, *(results.get(kind) for kind in (*step.needs, *step.uses)))
    results = results.having(result)
    # What the checks found comes first: it may change what is believed of the whole result.
    replace(trial, warnings=tuple(dict.fromkeys((*results.notes, *trial.warnings)))).put(output.writer)
    output.writer.remarks(step.name, getattr(result, "notes", ()))
    output.writer.provenance(step_provenance(step, trial))
    return results
