"""The command of a step of a trial.

It reads a model and what was recorded, and writes a table or a folder of results.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, Optional

from cyclopts import Parameter as CliParameter

from myomorph.core.model.errors import BadData
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import folder_with, said, table_beside, warn
from myomorph.lab.study.inputs.motion import MotionFile as Coordinates
from myomorph.lab.study.step.step import Step, StepOutput, step_of
from myomorph.lab.study.trial.steps.ik import Poses, recorded_poses
from myomorph.lab.study.trial.trial_inputs import TrialFiles, TrialInputs, open_trial
from myomorph.lab.study.trial.trial_step import StepResults, run_step, steps_before
from myomorph.lab.study.trial.uncertainty_file import STEP as UNCERTAINTY
from myomorph.lab.study.trial.uncertainty_file import drawn_settings
from myomorph.lab.uncertainty.spread import Uncertainty


def __getattr__(name: str) -> Callable[..., int]:
    """Return the command `NAME_command` of the step NAME."""
    if not name.endswith("_command"):
        raise AttributeError(name)
    return step_command(name.removesuffix("_command"))


@dataclass(frozen=True)
class Drawing:
    """How a result is computed anew with errors in all inputs."""

    draws: flags.DrawCount = None
    uncertainty: flags.UncertaintyFile = None
    workers: flags.DrawProcesses = None


NOT_DRAWN = Drawing()


def step_command(name: str) -> Callable[..., int]:
    """Make a command whose options are those of a step and of its inputs."""
    step = step_of(name)
    own = step.command
    # The coordinates are those of a file, but for the step that finds them.
    begins = step.gives is Poses
    read = {*step.needs, *step.uses} if own.after else set()
    before = [past for past in steps_before(step) if past.gives in read and past.gives is not Poses]

    def command(
        *,
        model: flags.ModelFile,
        motion: Path | None = None,
        out: Path,
        inputs: Any = None,
        drawing: Drawing = NOT_DRAWN,
        options: Any = None,
        threads: flags.Threads = None,
    ) -> int:
        flags.use_threads(threads)
        settings = flags.inputs_of_flags(inputs)
        files = TrialFiles(
            model, inputs=settings if motion is None else settings.having(Coordinates(motion))
        )
        if files.recording is None:
            raise BadData(
                "no recording: give markers (--markers FILE), inertial sensors (--imu FILE ...), or"
                " both"
            )
        drawn = {}
        if own.draws:
            drawn = drawn_settings(drawing.draws, drawing.uncertainty, drawing.workers)
        trial = open_trial(files, {name: flags.settings_dict(options), **drawn})
        results = StepResults() if begins else StepResults(recorded_poses(trial))
        written = table_beside(out, name, own.table) if own.table else folder_with(out, name)
        with written as (folder, writer):
            for part in (*before, step, *((step_of(UNCERTAINTY),) if drawn else ())):
                results = run_step(part, trial, results, StepOutput(writer, folder))
        where = () if own.table else (f"the report lists them ('myomorph report {out}')",)
        warn((*results.notes, *trial.warnings), *where)
        limits = f"; {results[Uncertainty].summary}" if drawn else ""
        said(f"{_line(step, trial, results)}{limits}; wrote {out}")
        return 0

    _sign(command, step, [*before, step], begins)
    return command


def _line(step: Step[Any], trial: TrialInputs, results: StepResults) -> str:
    """Write what a step found, in its own words if it has any."""
    if step.command.line is None:
        return f"{step.title}: {len(results[Poses].recorded)} frames"
    return step.command.line(trial, results)


def _sign(command: Any, step: Step[Any], parts: list[Step[Any]], begins: bool) -> None:
    """Give a command the options of its step, and no others."""
    names = dict.fromkeys(
        (*(("markers",) if begins else ()), *(name for part in parts for name in part.inputs))
    )
    lacking = {"motion"} if begins else set()
    lacking |= set() if step.command.draws else {"drawing"}
    own = {
        "motion": flags.MotionFile,
        "out": flags.OutFile if step.command.table else flags.OutFolder,
        "drawing": Annotated[Drawing, CliParameter(name="*")],
        "inputs": Optional[flags.inputs_class(*names)],  # noqa: UP045
        "options": Optional[flags.options_class(*step.options, leave_out=step.not_settings)],  # noqa: UP045
    }
    signed = signature(command, eval_str=True)
    parameters = [part for part in signed.parameters.values() if part.name not in lacking]
    parameters = [
        part.replace(annotation=own.get(part.name, part.annotation)) for part in parameters
    ]
    parameters = [
        part.replace(default=Parameter.empty) if part.name == "motion" else part
        for part in parameters
    ]
    command.__signature__ = signed.replace(parameters=parameters)
    command.__annotations__ = {part.name: part.annotation for part in parameters} | {"return": int}
    command.__doc__ = f"{step.title[:1].upper()}{step.title[1:]}."
