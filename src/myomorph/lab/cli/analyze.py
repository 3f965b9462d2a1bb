"""`analyze`."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import said
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.trial.uncertainty_file import drawn_settings

INPUTS = (
    "imu",
    "tasks",
    "laboratory",
    "loads",
    "emg",
    "contacts",
    "contact points",
    "actuators",
    "time",
    "person",
)
STEPS = tuple(map(step_of, ("ik", "id", "muscles", "tension")))
AnalyzeInputs = flags.inputs_class(*INPUTS, leave_out=("height",))
AnalyzeOptions = flags.options_class(*(kind for step in STEPS for kind in step.options))


@flags.documented
@dataclass(frozen=True, kw_only=True)
class Subject:
    """Who was recorded, and how the recordings are to be read.

    Attributes
    ----------
    mass : body mass of the subject [kg]; by default the weight on the force plates, where they
        allow it
    height : height of the subject [m]; scales the generic model, and is compared with the markers
    static : recording of quiet standing; by default one found among or next to the recordings
    model : OpenSim or MuJoCo model with markers; by default the legs and trunk of myo-sim, scaled
        to the subject
    arms : add both arms with their muscles to the generic model, if markers show them
    protocol : table of your own marker protocols (.toml), used in addition to those of the package
    """

    mass: float | None = None
    height: float | None = None
    static: Path | None = None
    model: Path | None = None
    arms: bool = False
    protocol: Path | None = None


@flags.documented
@dataclass(frozen=True, kw_only=True)
class Computing:
    """Where results go, and how they are computed.

    Attributes
    ----------
    out : folder for the results
    workers : number of processes that run in parallel; by default as many as cores and memory allow
    prepare : write the study file and stop, so that it can be edited before it is run
    dry_run : write the study file, and print what would be computed and how long it would take
    """

    draws: flags.DrawCount = None
    out: Path = Path("analysis")
    threads: flags.Threads = None
    workers: int | None = None
    prepare: bool = False
    dry_run: bool = False


UNKNOWN = Subject()
AT_ONCE = Computing()


@flags.documented
def analyze_command(
    recordings: tuple[Path, ...],
    /,
    *,
    subject: Annotated[Subject, Parameter(name="*")] = UNKNOWN,
    inputs: AnalyzeInputs | None = None,  # type: ignore[valid-type]
    options: AnalyzeOptions | None = None,  # type: ignore[valid-type]
    computing: Annotated[Computing, Parameter(name="*")] = AT_ONCE,
) -> int:
    """Make a report of raw recordings.

    Protocol, axes, static trial, forces, EMG and model are found and reported.

    Parameters
    ----------
    recordings : recordings of markers (.c3d, .trc) or inertial sensors (.sto, .mvnx, .h5, .csv,
        .txt), or folders of them, including those of OpenCap and Pose2Sim
    subject : who was recorded
    inputs : further input files
    options : options of all steps
    computing : where results are written, and how they are computed
    """
    from myomorph.core.model.errors import BadData
    from myomorph.lab.analyze.analyze import prepare_request
    from myomorph.lab.analyze.recorded_trial import AnalyzeRequest, read_protocols
    from myomorph.lab.cli.running import Running
    from myomorph.lab.cli.study import run_plan
    from myomorph.lab.study.plan.plan import read_plan

    if not recordings:
        raise BadData(
            "no recording: give one or more recordings (.c3d, .trc, .mvnx, ...) or folders of them"
        )
    if subject.mass is not None and not subject.mass > 0.0:
        raise BadData(f"--mass {subject.mass:g}: expected the subject's mass [kg]")
    flags.use_threads(computing.threads)
    request = AnalyzeRequest(
        recordings=recordings,
        mass=subject.mass,
        height=subject.height,
        static=subject.static,
        model=subject.model,
        arms=subject.arms,
        table=None if subject.protocol is None else read_protocols(subject.protocol),
        inputs=flags.inputs_of_flags(inputs, near=True),
        options=flags.settings_by_step(options, STEPS) | drawn_settings(computing.draws, None),
        command=shlex.join(["myomorph", *sys.argv[1:]]),
    )
    prepared = prepare_request(request, computing.out)
    said("assumed:")
    for text in prepared.assumed:
        said(f"  {text}")
    said(f"study file, to be changed and run again: {prepared.study}")
    if computing.prepare and not computing.dry_run:
        return 0
    running = Running(
        dry_run=computing.dry_run, workers=computing.workers, threads=computing.threads
    )
    return run_plan(read_plan(prepared.study), computing.out, running)
