"""A step as one value.

It has what it is done for, what it reads and gives, its options, how it is stored and shown.

Everything that depends on which steps there are follows from `step_table.STEPS`: hashes, reuse,
resuming, the dry run, settings of study files, `--help`, tables of values and the report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from myomorph.core.model.errors import BadExtension, check_name
from myomorph.core.model.extension import load
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.quantity import Quantity, declared_once
from myomorph.core.model.registry import remark
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.quantities import get_value
from myomorph.lab.store.quantity_table import stated_quantities
from myomorph.lab.store.results import ResultWriter, Stored
from myomorph.lab.store.settings import ReportOptions, Setting, settings_of
from myomorph.lab.study.inputs.input import OptionSet
from myomorph.lab.study.step.own_table import OwnTable
from myomorph.lab.study.step.step_table import REPORT, STEPS, Scope

if TYPE_CHECKING:
    from myomorph.lab.report.trial.report_input import ReportInput

Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class StepHead:
    """A step or the report as files and commands name it.

    Settings are the fields of its options but `not_settings`. `refused`: why it cannot run, ""
    where it can.
    """

    name: str
    title: str
    options: tuple[type, ...] = ()
    not_settings: tuple[str, ...] = ()
    refused: str = ""

    @property
    def settings(self) -> tuple[Setting, ...]:
        """What a study file or the command line can say to the step."""
        return tuple(
            setting
            for kind in self.options
            for setting in settings_of(kind)
            if setting.name not in self.not_settings
        )


@dataclass(frozen=True)
class StepOutput:
    """Where a step of a trial writes: its values into a result file, its tables into a folder."""

    writer: ResultWriter
    folder: Path


@dataclass(frozen=True)
class StepCommand:
    """The command of a step of a trial.

    Attributes
    ----------
    line : what it prints, from the trial and the results; None for the step's title and its frames
    table : which of the step's tables is the file that it writes, "" for a folder of all
    draws : it is computed anew with errors where requested
    after : earlier steps that it uses are run first, else it does without them
    """

    line: Callable[[Any, Any], str] | None = None
    table: str = ""
    draws: bool = False
    after: bool = False


def read_nothing(stored: Stored, options: OptionSet) -> None:
    """Read no result: what a step gives is in files alone."""


@dataclass(frozen=True, kw_only=True)
class Step(StepHead, Generic[Result]):
    """One step; docs/adding.md says what its fields are for.

    What a step of a trial gives is a value with a type, kept among those of the trial's other steps
    in one result file; it may have `notes`, what was done about questionable input, one line each.
    What a step of another scope gives is a folder, with files that later steps and jobs read:
    `leaves`, as paths in the folder of the subject, specimen or study; a result is there when they
    are. `tables` is in that folder, too, "" for it itself.

    `quantities`: what a result file and the tables hold of it. Where `gives` is `Labelled`, they
    are its own, and it is stored, read back, tabled and tidied as they are declared: such a step
    needs neither `read` nor `signals`.

    `inputs`: names of the trial's inputs that it reads (`study.inputs.table`), whose flags its
    command has; `signals` take the mass [kg], `numbers` the strides, None where it is no walk; with
    `numbers_last` they come after the statistics of the signals of all steps; `large`: variables
    that are not read back, since nothing needs them; `outcome` adds what the result tells of a
    trial to its outcome, for which `outcome_variables` are read; `applies`: whether there is
    anything to do, from the inputs of its scope; `own_table`: of a subject in study files that a
    step of a subject brings.
    """

    run: Callable[..., Result]
    scope: Scope = "trial"
    tables: str = ""

    quantities: tuple[Quantity, ...] = ()
    gives: type[Result] = object  # type: ignore[assignment]
    needs: tuple[type, ...] = ()
    uses: tuple[type, ...] = ()
    read: Callable[[Stored, OptionSet], Result | None] = read_nothing
    inputs: tuple[str, ...] = ()
    roles: tuple[str, ...] | None = None
    hashed: Callable[[Any], Sequence[object]] | None = None
    show: Callable[[ReportInput, Stored], ReportInput] = lambda report_input, stored: report_input
    signals: Callable[[Stored, Model, float], Sequence[Any]] = lambda stored, model, mass: ()
    numbers: Callable[[Stored, Model, Any], Iterable[Any]] = lambda stored, model, strides: ()
    numbers_last: bool = False
    large: tuple[str, ...] = ()
    outcome: Callable[[Outcome, Result], Outcome] | None = None
    outcome_variables: tuple[str, ...] = ()
    command: StepCommand = StepCommand(after=True)

    applies: Callable[[Any], bool] = lambda inputs: True
    made_from: Callable[[Any], Provenance] | None = None
    leaves: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    own_table: OwnTable | None = None

    def __post_init__(self) -> None:
        if issubclass(self.gives, Labelled) and self.read is read_nothing:
            kind = self.gives
            object.__setattr__(self, "read", lambda stored, options: get_value(stored, kind))
        if issubclass(self.gives, Labelled) and not self.quantities:
            object.__setattr__(self, "quantities", self.gives.quantities)


# Scopes whose results lie in the folder of the study itself.
WHOLE_STUDY: tuple[Scope, ...] = ("cohort", "study")

REPORT_STEP = StepHead(name=REPORT, title="report", options=(ReportOptions,))


def step_of(name: str, scope: Scope = "trial") -> Step[Any]:
    """Return a step of `STEPS`.

    A step of an installed package that cannot be imported is replaced by one that does nothing, so
    that others run; `refused` has the reason.
    """
    try:
        step: Step[Any] = load(STEPS[scope][name], "STEP")
    except BadExtension as error:
        remark(str(error))
        return _refused_step(name, scope, error)
    return step


def _refused_step(name: str, scope: Scope, error: BadExtension) -> Step[Any]:
    def run(*inputs: object) -> None:
        raise error

    # Only steps that somebody names may fail.
    named = scope in ("trial", "subject")
    return Step(
        name=name,
        title=name,
        scope=scope,
        run=run,
        refused=str(error),
        applies=lambda inputs: named,
    )


def step_head(name: str) -> StepHead:
    """Return a step of a trial or a subject, or the report."""
    if name == REPORT:
        return REPORT_STEP
    return step_of(name, "subject" if name in STEPS["subject"] else "trial")


def trial_steps() -> tuple[Step[Any], ...]:
    """All steps of a trial, in their order."""
    return tuple(map(step_of, STEPS["trial"]))


def step_giving(name: str) -> str:
    """Return the step of a trial that gives a quantity; raise `UnknownName`."""
    givers = {quantity.name: step.name for step in trial_steps() for quantity in step.quantities}
    check_name("quantity", name, givers, "the steps of a trial")
    return givers[name]


def declared_quantities() -> tuple[Quantity, ...]:
    """All quantities of results: those of the table, and those of steps that were added."""
    added = tuple(quantity for step in trial_steps() for quantity in step.quantities)
    return declared_once((*stated_quantities(), *added))


def large_variables() -> tuple[str, ...]:
    """Variables of results that nothing reads back."""
    return tuple(name for step in trial_steps() for name in step.large)
