"""`muscles` and `tension`."""

from __future__ import annotations

from myomorph.cli.options import (
    DrawCount,
    DrawProcesses,
    ModelFile,
    MotionFile,
    OutFolder,
    Threads,
    UncertaintyFile,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import folder_with, said, warn
from myomorph.report.trial.summary_lines import tension_line
from myomorph.study.inputs.motion import MotionFile as Coordinates
from myomorph.study.step.step import StepOutput, step_of
from myomorph.study.trial.steps import ik, muscles, tension
from myomorph.study.trial.steps.id import filter_summary
from myomorph.study.trial.steps.ik import put_fit_beside
from myomorph.study.trial.trial_files import TrialFiles
from myomorph.study.trial.trial_inputs import open_trial
from myomorph.study.trial.trial_step import StepResults, run_step
from myomorph.study.trial.uncertainty_file import STEP as UNCERTAINTY
from myomorph.study.trial.uncertainty_file import drawn_settings, limits_summary

MusclesOptions = options_class(*muscles.STEP.options)
TensionSettings = options_class(*tension.STEP.options)

MusclesInputs = inputs_class(*muscles.STEP.inputs)
TensionInputs = inputs_class(*tension.STEP.inputs)


def muscles_command(
    *,
    model: ModelFile,
    motion: MotionFile,
    out: OutFolder,
    inputs: MusclesInputs | None = None,  # type: ignore[valid-type]
    options: MusclesOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Muscle lengths, lengthening velocities and moment arms."""
    use_threads(threads)
    files = TrialFiles(model, inputs=inputs_of_flags(inputs).having(Coordinates(motion)))
    trial = open_trial(files, {"muscles": settings_dict(options)})
    poses = ik.recorded_poses(trial)
    with folder_with(out, "muscles") as (folder, writer):
        results = run_step(muscles.STEP, trial, StepResults(poses), StepOutput(writer, folder))
    warn((*results.notes, *trial.warnings))
    said(f"{results[muscles.MuscleLengths].summary}{filter_summary(trial, poses.recorded)}; wrote {out}")
    return 0


def tension_command(
    *,
    model: ModelFile,
    motion: MotionFile,
    out: OutFolder,
    inputs: TensionInputs | None = None,  # type: ignore[valid-type]
    draws: DrawCount = None,
    uncertainty: UncertaintyFile = None,
    workers: DrawProcesses = None,
    options: TensionSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Muscle tensions that make the joint torques with the least effort, and contact forces with them."""
    use_threads(threads)
    files = TrialFiles(model, inputs=inputs_of_flags(inputs).having(Coordinates(motion)))
    drawn = drawn_settings(draws, uncertainty, workers)
    trial = open_trial(files, {"tension": settings_dict(options), **drawn})
    poses = ik.recorded_poses(trial)
    with folder_with(out, "tension") as (folder, writer):
        output = StepOutput(writer, folder)
        results = run_step(tension.STEP, trial, StepResults(poses), output)
        if drawn:
            results = run_step(step_of(UNCERTAINTY), trial, results, output)
        put_fit_beside(writer, motion, trial.model, results[tension.Tensions].tension.time)
    warn((*results.notes, *trial.warnings), f"the report lists them ('myomorph report {out}')")
    summary = tension_line(trial.model, results[tension.Tensions].tension) + filter_summary(trial, poses.recorded)
    said(f"{summary}{limits_summary(results)}; wrote {out}")
    return 0
