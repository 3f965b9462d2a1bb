"""`muscles` and `tension`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import (
    DrawCount,
    DrawProcesses,
    EmgMuscles,
    ForceBodies,
    LoadsFile,
    ModelFile,
    MotionFile,
    OutFolder,
    PlateBodies,
    Threads,
    Time,
    UncertaintyFile,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import folder_with, said, warn
from myomorph.model.errors import BadData
from myomorph.report.trial.summary_lines import tension_line
from myomorph.store.settings import Measured, Side
from myomorph.study.inputs.emg_files import channel_muscles
from myomorph.study.inputs.external_forces import bodies_of
from myomorph.study.step.step import StepOutput, step_of
from myomorph.study.trial.fit_beside import put_fit_beside
from myomorph.study.trial.open_trial import open_motion_trial
from myomorph.study.trial.steps import muscles, tension
from myomorph.study.trial.steps.id import filter_summary
from myomorph.study.trial.trial_files import TrialFiles
from myomorph.study.trial.trial_step import StepResults, run_step
from myomorph.study.trial.uncertainty_file import STEP as UNCERTAINTY
from myomorph.study.trial.uncertainty_file import drawn_settings, limits_summary

MusclesOptions = options_class(*muscles.STEP.options)
TensionSettings = options_class(*tension.STEP.options)

TorquesFile = Annotated[
    Path | None,
    Parameter(
        help="Joint torques from elsewhere (.sto, .mot), in the place of --loads and inverse dynamics: columns "
        "named as coordinates, or with _moment and _force as OpenSim's inverse dynamics names them [N m, N]."
    ),
]
ContactPoints = Annotated[
    str,
    Parameter(
        help="Share a joint's force among contact points (joint_contact_forces.sto): auto (medial and lateral "
        "point of every knee, from the femur's mesh beside the model), a folder with the bones' meshes, or a file "
        "of points (.toml)."
    ),
]


def muscles_command(
    *,
    model: ModelFile,
    motion: MotionFile,
    out: OutFolder,
    time: Time = None,
    options: MusclesOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Muscle lengths, lengthening velocities and moment arms."""
    use_threads(threads)
    files = TrialFiles(model=model, motion=motion, time=time)
    trial, poses = open_motion_trial(files, {"muscles": settings_dict(options)})
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
    loads: LoadsFile = None,
    bodies: ForceBodies = (),
    plates: PlateBodies = "",
    torques: TorquesFile = None,
    emg: Annotated[
        Path | None,
        Parameter(help="EMG (.sto, .mot, .csv, .c3d), raw or envelopes. A channel named as a muscle is its target."),
    ] = None,
    emg_side: Annotated[Side, Parameter(help="right or left: side of EMG channels whose names contain none.")] = "",
    emg_muscles: EmgMuscles = (),
    emg_mvc: Annotated[
        list[Path] | None,
        Parameter(
            help="Recordings of maximum voluntary contractions (as --emg): EMG is scaled to their largest "
            "envelopes, and no gain is larger than that."
        ),
    ] = None,
    emg_gains_file: Annotated[
        Path | None,
        Parameter(
            help="Gains of the subject's EMG channels found over all trials: gains.json of the step 'emg' of a study. "
            "By default they are found on this recording alone."
        ),
    ] = None,
    contacts: Annotated[
        str,
        Parameter(
            help="Estimate contact forces that no plate measured: auto (sites under the model's feet), a table of "
            "touches (.csv: site, start, stop), or a contact file (.toml)."
        ),
    ] = "",
    measured: Annotated[
        Measured | None,
        Parameter(
            help="What the forces of --loads are used for where contacts are estimated: exact (default; contacts only "
            "where nothing was measured), shared (each is known for all sites on it together) or hidden."
        ),
    ] = None,
    contact_points: ContactPoints = "",
    actuators: Annotated[
        Path | None, Parameter(help="OpenSim force set (.xml) of reserve and residual actuators.")
    ] = None,
    time: Time = None,
    draws: DrawCount = None,
    uncertainty: UncertaintyFile = None,
    workers: DrawProcesses = None,
    options: TensionSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Muscle tensions that make the joint torques with the least effort, and contact forces with them."""
    if measured is not None and not contacts:
        raise BadData(f"--measured {measured} without --contacts: give --contacts auto, or a contact file")
    if measured == "shared" and loads is None:
        raise BadData("--measured shared without --loads: give the forces that the contacts share")
    if emg_mvc and emg is None:
        raise BadData("--emg-mvc without --emg: give the EMG that is scaled to maximum contractions")
    if emg_gains_file is not None and emg is None:
        raise BadData("--emg-gains-file without --emg: give the EMG whose gains they are")
    if emg_muscles and emg is None:
        raise BadData("--emg-muscles without --emg: give the EMG whose channels they are")
    use_threads(threads)
    named = bodies_of(bodies, plates)
    files = TrialFiles(
        model=model,
        motion=motion,
        loads=loads,
        bodies=named.bodies,
        plates=named.plates,
        torques=torques,
        emg=emg,
        emg_side=emg_side,
        emg_muscles=channel_muscles(emg_muscles),
        emg_mvc=tuple(emg_mvc or ()),
        emg_gains=emg_gains_file,
        actuators=actuators,
        contacts=contacts,
        measured=measured,
        contact_points=contact_points,
        time=time,
    )
    drawn = drawn_settings(draws, uncertainty, workers)
    trial, poses = open_motion_trial(files, {"tension": settings_dict(options), **drawn})
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
