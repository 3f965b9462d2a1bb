"""`analyze`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import DrawCount, Threads, inputs_class, inputs_of_flags, use_threads
from myomorph.cli.output import said

AnalyzeInputs = inputs_class("loads", "emg", "time", leave_out=("bodies", "plates", "emg", "emg_gains_file"))


def analyze_command(
    recordings: Annotated[
        tuple[Path, ...],
        Parameter(help="Recordings (.c3d, .trc) or folders of them, those of OpenCap and Pose2Sim too.", negative=()),
    ],
    /,
    *,
    mass: Annotated[float, Parameter(help="Of the subject [kg].")],
    height: Annotated[
        float | None, Parameter(help="Of the subject [m]: scales the generic model, and is held against the markers.")
    ] = None,
    static: Annotated[
        Path | None,
        Parameter(help="Recording of standing still; by default found among or beside the recordings."),
    ] = None,
    model: Annotated[
        Path | None,
        Parameter(help="OpenSim or MuJoCo model with markers; by default myo-sim's legs and trunk."),
    ] = None,
    protocol: Annotated[
        Path | None, Parameter(help="Table of marker protocols of your own (.toml), beside those of the package.")
    ] = None,
    force_columns: Annotated[
        str, Parameter(help="Names of the columns of a table of forces: time,Fx1,Fy1,Fz1,COPx1,...; - leaves one out.")
    ] = "",
    force_rate: Annotated[float, Parameter(help="Rows a second of a table of forces without times [Hz].")] = 0.0,
    force_origins: Annotated[
        str, Parameter(help="Points that moments without a center of pressure are about [m]: 'x,y,z; x,y,z'.")
    ] = "",
    force_shift: Annotated[float, Parameter(help="Added to the times of external forces [s].")] = 0.0,
    inputs: AnalyzeInputs | None = None,  # type: ignore[valid-type]
    draws: DrawCount = None,
    out: Annotated[Path, Parameter(help="Folder to write.")] = Path("analysis"),
    threads: Threads = None,
    workers: Annotated[int | None, Parameter(help="Processes that work side by side.")] = None,
    prepare: Annotated[
        bool, Parameter(negative=(), help="Only write the study file, so that it can be changed before it is run.")
    ] = False,
    dry_run: Annotated[
        bool,
        Parameter(
            negative=(), help="Only write the study file, and print what would be computed and how long it takes."
        ),
    ] = False,
) -> int:
    """From raw recordings to a report: protocol, axes, static trial, forces, EMG and model are found, and said."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.cli.study import dry_run_plan, run_plan
    from myomorph.model.errors import BadData
    from myomorph.store.settings import ForceOptions
    from myomorph.study.analyze.analyze import AnalyzeRequest, prepare_study
    from myomorph.study.analyze.own_protocols import read_protocols
    from myomorph.study.inputs.emg import EmgFiles
    from myomorph.study.inputs.loads import LoadsFile
    from myomorph.study.inputs.time_span import TimeSpan
    from myomorph.study.plan.plan import read_plan

    if not recordings:
        raise BadData("no recording: give one or more recordings (.c3d, .trc) or folders of them")
    if not mass > 0.0:
        raise BadData(f"--mass {mass:g}: expected the subject's mass [kg]")
    use_threads(threads)
    named = inputs_of_flags(inputs)
    emg = named.or_default(EmgFiles)
    request = AnalyzeRequest(
        recordings,
        mass,
        height,
        static,
        model,
        None if protocol is None else read_protocols(protocol),
        emg.emg_muscles,
        emg.emg_side,
        emg.emg_mvc,
        shlex.join(["myomorph", *sys.argv[1:]]),
        draws,
        named.or_default(TimeSpan).time,
        named.or_default(LoadsFile).loads,
        ForceOptions(
            force_shift=force_shift,
            force_columns=force_columns,
            force_rate=force_rate,
            force_origins=force_origins,
        ),
    )
    prepared = prepare_study(request, out)
    said("assumed:")
    for text in prepared.assumed:
        said(f"  {text}")
    said(f"study file, to be changed and run again: {prepared.study}")
    if dry_run:
        return dry_run_plan(read_plan(prepared.study), out, workers=workers, threads=threads)
    return 0 if prepare else run_plan(read_plan(prepared.study), out, workers=workers, threads=threads)
