"""`info` and `report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.output import said


def info_command(file: Annotated[Path, Parameter(help="Model, recording or table.")], /) -> int:
    """What is in a model, C3D, TRC, MOT or STO file, and what is wrong with it."""
    from myomorph.study.info.inspect import inspect

    for line in inspect(file).lines():
        said(line)
    return 0


def report_command(
    folder: Annotated[Path, Parameter(help="Folder of results.")],
    /,
    *,
    preset: Annotated[
        str,
        Parameter(help="How to look at the motion: taichi, tap, drum, judo, gait, lift or motion; else as it fits."),
    ] = "",
    times: Annotated[
        tuple[float, ...],
        Parameter(help="Instants to picture [s]; those of events by default.", consume_multiple=True),
    ] = (),
) -> int:
    """Make report.html of a folder of results."""
    from myomorph.demo.jump import demo_model
    from myomorph.study.trial.reporting import report_folder
    from myomorph.viscosity.study.results import STORE, remake_report

    if (folder / STORE).is_file():
        paths = [remake_report(folder)]
    else:
        paths = report_folder(folder, preset=preset, times=times, demo_model=demo_model)
    for path in paths:
        said(f"wrote {path}")
    return 0
