"""A step of a trial as one value: what it reads and gives, its options, how it is stored, what the report shows of it.

Everything that depends on which steps there are follows from `step_table.STEPS`: hashes, reuse, resuming, the dry run,
settings of study files, `--help`, expected times, tables of values and the report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance
from myomorph.store.outcome import Outcome
from myomorph.store.results import ResultWriter, Stored, provenance_of
from myomorph.store.settings import ReportOptions, Setting, plain_settings, settings_of
from myomorph.study.inputs.by_type import ByType, OptionSet
from myomorph.study.inputs.reading import about
from myomorph.study.trial.step_table import REPORT, STEPS
from myomorph.study.trial.trial_inputs import TrialInputs

if TYPE_CHECKING:
    from myomorph.report.trial.report_input import ReportInput
    from myomorph.study.trial.trial_inputs import Signals, Value
    from myomorph.study.trial.trial_strides import TrialStrides

Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class StepHead:
    """What every step has, those on subjects and the report included.

    Attributes
    ----------
    name : in study files and on the command line
    title : as reports name it
    options : option dataclasses; their fields are the step's settings in study files and on the command line
    not_settings : fields that come from elsewhere
    grows_with : what its time grows with, "coordinates" or "muscles"
    """

    name: str
    title: str
    options: tuple[type, ...] = ()
    not_settings: tuple[str, ...] = ()
    grows_with: Literal["coordinates", "muscles"] = "coordinates"

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What a study file or the command line can say to the step."""
        return tuple(
            setting for kind in self.options for setting in settings_of(kind) if setting.name not in self.not_settings
        )


@dataclass(frozen=True)
class StepOutput:
    """Where a step writes: its values into a result file, its tables into a folder."""

    writer: ResultWriter
    folder: Path


@dataclass(frozen=True, kw_only=True)
class Step(StepHead, Generic[Result]):
    """One step of a trial.

    Attributes
    ----------
    gives : type of its result; a result may have `notes`, what was done about doubtful input, one line each
    needs : types of earlier results that it cannot do without
    uses : types of earlier results that it takes where they are there
    run : from the trial, the output and the results of `needs` and `uses` (None where absent) to its own; it writes
        tables and values
    read : its result as stored, None where the file has none
    roles : of the sources that its result depends on, None for all
    hashed : values of options that its result depends on; by default all of `options`
    show : adds what a result file has of this step to what the report shows
    signals : what it has over time, for tables of values and curves; from the file, the model and the mass [kg]
    numbers : what it comes to in numbers, for tables of values; from the file, the model and the strides, None where it
        is no walk
    numbers_last : they come after the statistics of the signals of all steps
    large : variables that are not read back, since nothing in a study or a page needs them
    tables : folder of its tables in that of the trial, "" for that of the trial itself
    outcome : adds what the result tells of a trial to its outcome
    outcome_variables : that must be read for this
    """

    gives: type[Result]
    run: Callable[..., Result]
    read: Callable[[Stored, OptionSet], Result | None]
    needs: tuple[type, ...] = ()
    uses: tuple[type, ...] = ()
    roles: tuple[str, ...] | None = None
    hashed: Callable[[TrialInputs], Sequence[object]] | None = None
    show: Callable[[ReportInput, Stored], ReportInput] = lambda given, stored: given
    signals: Callable[[Stored, Model, float], Sequence[Signals]] = lambda stored, model, mass: ()
    numbers: Callable[[Stored, Model, TrialStrides | None], Iterable[Value]] = lambda stored, model, strides: ()
    numbers_last: bool = False
    large: tuple[str, ...] = ()
    tables: str = ""
    outcome: Callable[[Outcome, Result], Outcome] | None = None
    outcome_variables: tuple[str, ...] = ()

    def hashed_options(self, trial: TrialInputs) -> dict[str, object]:
        """Options that the result depends on, by name."""
        values = [trial.options[kind] for kind in self.options] if self.hashed is None else self.hashed(trial)
        return {f"{self.name}.{name}": value for one in values for name, value in plain_settings(one).items()}


REPORT_STEP = StepHead(name=REPORT, title="report", options=(ReportOptions,), grows_with="muscles")


class StepResults(ByType):
    """What the steps have found so far."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done about doubtful input, one line each."""
        return tuple(dict.fromkeys(text for one in self for text in getattr(one, "notes", ())))


def step_of(name: str) -> Step[Any]:
    """A step of `STEPS`."""
    return import_module(STEPS[name]).STEP


def step_head(name: str) -> StepHead:
    """A step of `STEPS`, or the report."""
    if name == REPORT:
        return REPORT_STEP
    return step_of(name)


def steps_before(step: Step[Any]) -> tuple[Step[Any], ...]:
    """The steps whose results a step reads, and those before these, in their order."""
    names = list(STEPS)
    read, found = {*step.needs, *step.uses}, list[Step[Any]]()
    for name in reversed(names[: names.index(step.name)]):
        one = step_of(name)
        if one.gives in read:
            found.insert(0, one)
            read |= {*one.needs, *one.uses}
    return tuple(found)


def large_variables() -> tuple[str, ...]:
    """Variables of results that nothing reads back."""
    return tuple(name for step in STEPS for name in step_of(step).large)


def step_provenance(step: Step[Any], trial: TrialInputs) -> Provenance:
    """What a step's result is made from: its inputs, and the options of this step and those before it."""
    options: dict[str, object] = {"time": None if trial.time is None else list(trial.time)}
    for one in (*steps_before(step), step):
        options |= one.hashed_options(trial)
    sources = [source for source in trial.sources if step.roles is None or source.role in step.roles]
    return provenance_of(step.name, sources, options)


def run_step(step: Step[Any], trial: TrialInputs, results: StepResults, output: StepOutput) -> StepResults:
    """Run a step, write its tables into a folder and its values into a result file.

    Raises
    ------
    BadData
        where a result is missing that the step needs
    """
    for kind in step.needs:
        if results.get(kind) is None:
            giver = next(name for name in STEPS if step_of(name).gives is kind)
            raise BadData(f"{trial.name}: '{step.name}' has nothing to begin with: run '{giver}' first")
    with about(trial.name):
        found = step.run(trial, output, *(results.get(kind) for kind in (*step.needs, *step.uses)))
    results = results.having(found)
    # What the checks found comes first: it may change what is believed of the whole result.
    replace(trial, warnings=tuple(dict.fromkeys((*results.notes, *trial.warnings)))).put(output.writer)
    output.writer.remarks(step.name, getattr(found, "notes", ()))
    output.writer.provenance(step_provenance(step, trial))
    return results
