"""A command for every step that has none of its own: a model and coordinates in, a folder of results out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Optional

from myomorph.cli.options import (
    ModelFile,
    MotionFile,
    OutFolder,
    Threads,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import folder_with, said, warn
from myomorph.study.inputs.motion import MotionFile as Coordinates
from myomorph.study.step.step import StepOutput, step_of
from myomorph.study.trial.steps.ik import Poses, recorded_poses
from myomorph.study.trial.trial_files import TrialFiles
from myomorph.study.trial.trial_inputs import open_trial
from myomorph.study.trial.trial_step import StepResults, run_step, steps_before


def __getattr__(name: str) -> Callable[..., int]:
    """The command `NAME_command` of the step NAME."""
    if not name.endswith("_command"):
        raise AttributeError(name)
    return step_command(name.removesuffix("_command"))


def step_command(name: str) -> Callable[..., int]:
    """A command whose options are those of a step; earlier steps whose results it needs are run first."""
    step = step_of(name)

    def command(
        *,
        model: ModelFile,
        motion: MotionFile,
        out: OutFolder,
        inputs: object = None,
        options: object = None,
        threads: Threads = None,
    ) -> int:
        use_threads(threads)
        files = TrialFiles(model, inputs=inputs_of_flags(inputs).having(Coordinates(motion)))
        trial = open_trial(files, {name: settings_dict(options)})
        poses = recorded_poses(trial)
        results = StepResults(poses)
        with folder_with(out, name) as (folder, writer):
            read = {*step.needs, *step.uses}
            needed = [past for past in steps_before(step) if past.gives in read and results.get(past.gives) is None]
            for part in (*needed, step):
                results = run_step(part, trial, results, StepOutput(writer, folder))
        warn((*results.notes, *trial.warnings))
        said(f"{step.title}: {len(poses.recorded)} frames; wrote {out}")
        return 0

    settings = options_class(*step.options, leave_out=step.not_settings)
    # Of earlier steps, inverse kinematics is not run: coordinates are there.
    earlier = [past for past in steps_before(step) if past.gives is not Poses]
    names = dict.fromkeys(name for part in (*earlier, step) for name in part.inputs)
    command.__annotations__["inputs"] = Optional[inputs_class(*names)]  # noqa: UP045
    command.__annotations__["options"] = Optional[settings]  # noqa: UP045
    command.__doc__ = f"{step.title[:1].upper()}{step.title[1:]}."
    return command
