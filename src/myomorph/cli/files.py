"""Commands that take a file or folder and nothing else: `info`, `report`, `run-tool` and `view`."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from myomorph.cli.options import Threads, documented, use_threads
from myomorph.cli.output import said, warn

if TYPE_CHECKING:
    from myomorph.model.model import Model
    from myomorph.study.trial.viewing import Recordings


@documented
def info_command(file: Path, /) -> int:
    """What is in a model, C3D, TRC, MOT or STO file, and what is wrong with it.

    Parameters
    ----------
    file : model, recording or table
    """
    from myomorph.study.info.inspect import inspect

    for line in inspect(file).lines():
        said(line)
    return 0


@documented
def report_command(
    folder: Path, /, *, preset: str = "", times: tuple[float, ...] = (), norms: tuple[str, ...] = ()
) -> int:
    """Make report.html of a folder of results, and of a walk gait.html, one page for the clinic.

    Parameters
    ----------
    folder : of results
    preset : how to look at the motion: taichi, tap, drum, judo, gait, lift or motion; else as it fits
    times : instants to picture [s]; those of events by default
    norms : what gait.html holds a walk against: folders of results of a control group, adults or none; by default
        adults, for a body of their size
    """
    from myomorph.study.trial.reporting import report_folder
    from myomorph.viscosity.study.results import STORE, remake_report

    if (folder / STORE).is_file():
        paths = [remake_report(folder)]
    else:
        paths = report_folder(folder, preset=preset, times=times, demo_model=_demo_model, norms=norms)
    for path in paths:
        said(f"wrote {path}")
    return 0


@documented
def run_tool_command(setup: Path, /, *, threads: Threads = None) -> int:
    """Run an OpenSim setup file: ScaleTool, InverseKinematicsTool, InverseDynamicsTool or AnalyzeTool.

    Parameters
    ----------
    setup : OpenSim setup file (.xml) of one of the four tools
    """
    from myomorph.opensim_tools.run import run_tool

    use_threads(threads)
    result = run_tool(setup)
    warn(result.warnings)
    for line in result.lines:
        said(f"{result.tool}: {line}")
    for path in result.written:
        said(f"wrote {path}")
    return 0


@documented
def view_command(folders: list[Path], /, *, port: int | None = None, browser: bool = True) -> int:
    """Show results in a web page: the body moves, with its muscles, forces, markers and curves.

    Parameters
    ----------
    folders : of results; several are shown in one scene, with one clock
    port : of the page; any free one by default
    browser : open the page in the browser
    """
    from myomorph.study.trial.viewing import open_replay

    def served(opened: int) -> None:
        address = f"http://127.0.0.1:{opened}"
        said(f"{address} (for this machine only; Ctrl-C ends)")
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    with _ended_by_ctrl_c() as ended:
        replay = open_replay(folders, port, served, _demo_model, _swings)
        try:
            while not ended.wait(0.5):
                pass
        finally:
            replay.close()
    return 0


def _swings(folder: Path) -> Recordings:
    if not [*folder.glob("swings.json"), *folder.glob("*/swings.json")]:
        return {}
    from myomorph.viscosity.study.viewing import swings_of

    return swings_of(folder)


def _demo_model(name: str) -> Model:
    from myomorph.demo.demos import demo_model

    return demo_model(name)


@contextmanager
def _ended_by_ctrl_c() -> Iterator[threading.Event]:
    """The event that the first Ctrl-C sets; a second one interrupts.

    An exception can be raised anywhere, in callbacks too whose exceptions Python prints and forgets: the program would
    then go on.
    """
    ended = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        ended.set()

    before = signal.signal(signal.SIGINT, end)
    try:
        yield ended
    finally:
        signal.signal(signal.SIGINT, before)
