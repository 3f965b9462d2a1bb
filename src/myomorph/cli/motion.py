"""`ik` and `id`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import (
    DrawCount,
    DrawProcesses,
    ModelFile,
    MotionFile,
    OutFile,
    Threads,
    UncertaintyFile,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import said, table_beside, warn
from myomorph.model.errors import BadData
from myomorph.report.trial.summary_lines import dynamics_line, kinematics_line
from myomorph.study.inputs.imu import ImuFiles
from myomorph.study.inputs.markers import MarkersFile
from myomorph.study.inputs.motion import MotionFile as Coordinates
from myomorph.study.step.step import StepOutput, step_of
from myomorph.study.trial.steps import id as dynamics
from myomorph.study.trial.steps import ik
from myomorph.study.trial.trial_files import TrialFiles
from myomorph.study.trial.trial_inputs import open_trial
from myomorph.study.trial.trial_step import StepResults, run_step
from myomorph.study.trial.uncertainty_file import STEP as UNCERTAINTY
from myomorph.study.trial.uncertainty_file import drawn_settings, limits_summary

IkOptions = options_class(*ik.STEP.options, leave_out=ik.STEP.not_settings)
IdOptions = options_class(*dynamics.STEP.options)
IkInputs = inputs_class(*ik.STEP.inputs)
IdInputs = inputs_class(*dynamics.STEP.inputs)


def ik_command(
    *,
    model: ModelFile,
    out: OutFile,
    markers: Annotated[Path | None, Parameter(help="Recording: .trc, .c3d, .mat or .h5.")] = None,
    inputs: IkInputs | None = None,  # type: ignore[valid-type]
    draws: DrawCount = None,
    uncertainty: UncertaintyFile = None,
    workers: DrawProcesses = None,
    options: IkOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Inverse kinematics: the coordinates that explain recorded markers, inertial sensors, or both best."""
    use_threads(threads)
    settings = inputs_of_flags(inputs)
    if markers is None and not settings.or_default(ImuFiles).imu:
        raise BadData("no recording: give markers (--markers FILE), inertial sensors (--imu FILE ...), or both")
    files = TrialFiles(model, inputs=settings if markers is None else settings.having(MarkersFile(markers)))
    drawn = drawn_settings(draws, uncertainty, workers)
    trial = open_trial(files, {"ik": settings_dict(options), **drawn})
    with table_beside(out, "ik", "coordinates.mot") as (folder, writer):
        output = StepOutput(writer, folder)
        results = run_step(ik.STEP, trial, StepResults(), output)
        if drawn:
            results = run_step(step_of(UNCERTAINTY), trial, results, output)
    poses = results[ik.Poses]
    warn((*results.notes, *trial.warnings))
    assert poses.fit is not None
    said(f"{kinematics_line(poses.fit, trial.model, trial.recording.markers)}{limits_summary(results)}; wrote {out}")
    return 0


def id_command(
    *,
    model: ModelFile,
    motion: MotionFile,
    out: OutFile,
    inputs: IdInputs | None = None,  # type: ignore[valid-type]
    draws: DrawCount = None,
    uncertainty: UncertaintyFile = None,
    workers: DrawProcesses = None,
    options: IdOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Inverse dynamics: the generalized force of every coordinate."""
    use_threads(threads)
    files = TrialFiles(model, inputs=inputs_of_flags(inputs).having(Coordinates(motion)))
    drawn = drawn_settings(draws, uncertainty, workers)
    trial = open_trial(files, {"id": settings_dict(options), **drawn})
    poses = ik.recorded_poses(trial)
    with table_beside(out, "id", "torques.sto") as (folder, writer):
        output = StepOutput(writer, folder)
        results = run_step(dynamics.STEP, trial, StepResults(poses), output)
        if drawn:
            results = run_step(step_of(UNCERTAINTY), trial, results, output)
    warn((*results.notes, *trial.warnings))
    inverse = results[dynamics.Torques]
    forces = 0 if inverse.wrenches is None else len(inverse.wrenches.names)
    counts = f"{len(inverse.torques)} frames, {len(inverse.torques.names)} coordinates, {forces} external forces"
    residual = dynamics_line(trial.model, inverse.motion, inverse.torques, inverse.wrenches)
    filtered = dynamics.filter_summary(trial, poses.recorded, inverse)
    said(f"{counts}{f'; {residual}' if residual else ''}{filtered}{limits_summary(results)}; wrote {out}")
    return 0
