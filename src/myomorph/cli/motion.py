"""`ik` and `id`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import (
    LoadsFile,
    ModelFile,
    MotionFile,
    OutFile,
    Threads,
    Time,
    given,
    options_class,
    use_threads,
)
from myomorph.cli.output import said, table_beside, warn
from myomorph.motion.crossings import CrossingOptions
from myomorph.motion.ik import InverseKinematicsOptions
from myomorph.store.settings import Differentiation, TorqueTable

IkOptions = options_class(InverseKinematicsOptions, CrossingOptions, leave_out=("only_weighted",))
IdOptions = options_class(Differentiation, TorqueTable)


def ik_command(
    *,
    model: ModelFile,
    markers: Annotated[Path, Parameter(help="Recording: .trc, .c3d, .mat or .h5.")],
    out: OutFile,
    tasks: Annotated[Path | None, Parameter(help="OpenSim task set or setup file: weights of markers.")] = None,
    time: Time = None,
    options: IkOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Inverse kinematics: the coordinates whose markers lie nearest to those recorded."""
    from myomorph.study.trial.steps import run_step
    from myomorph.study.trial.take import Found
    from myomorph.study.trial.takes import FileTake, open_take

    use_threads(threads)
    files = FileTake(model=model, markers=markers, tasks=tasks, time=time)
    take = open_take(files, {"ik": given(options)})
    with table_beside(out, "ik", "coordinates.mot") as (folder, writer):
        found = run_step("ik", take, Found(), writer, folder)
    fit = found.fit
    assert fit is not None
    warn(take.warnings)
    said(f"{fit.summary}; wrote {out}")
    return 0


def id_command(
    *,
    model: ModelFile,
    motion: MotionFile,
    out: OutFile,
    loads: LoadsFile = None,
    time: Time = None,
    options: IdOptions | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Inverse dynamics: the generalized force of every coordinate."""
    from myomorph.study.trial.steps import run_step
    from myomorph.study.trial.take import Found
    from myomorph.study.trial.takes import FileTake, open_motion_take

    use_threads(threads)
    files = FileTake(model=model, motion=motion, loads=loads, time=time)
    take, recorded = open_motion_take(files, {"id": given(options)})
    with table_beside(out, "id", "torques.sto") as (folder, writer):
        found = run_step("id", take, dataclasses.replace(Found(), recorded=recorded), writer, folder)
    assert found.torques is not None
    warn((*take.warnings, *found.notes))
    forces = 0 if found.wrenches is None else len(found.wrenches.names)
    said(f"{len(found.torques)} frames, {len(found.torques.names)} coordinates, {forces} external forces; wrote {out}")
    return 0
