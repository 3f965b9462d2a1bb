"""Commands on files and folders of results: `info`, `convert`, `report` and `view`."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Literal

from myomorph.core.model.errors import check_name
from myomorph.core.model.extension import Extension, FolderReader, load
from myomorph.core.model.registry import extensions
from myomorph.lab.cli.options import documented, inputs_class, inputs_of_flags
from myomorph.lab.cli.output import said, warn

if TYPE_CHECKING:
    from myomorph.core.model.model import Model
    from myomorph.lab.study.trial.viewing import Recordings


ConvertInputs = inputs_class("loads", "time", leave_out=("loads", "bodies"))


@documented
def info_command(file: Path, /, *, reasons: bool = False) -> int:
    """What is in a model, C3D, TRC, MOT or STO file, and what is wrong with it; of a folder of
    recordings who was recorded, when, and in which movements.

    Parameters
    ----------
    file : model, recording or table, or a folder of recordings
    reasons : of a folder, print how each statement is known
    """
    from myomorph.lab.info.inspect import inspect

    for line in inspect(file, reasons).lines():
        said(line)
    return 0


@documented
def convert_command(
    files: list[Path],
    /,
    *,
    out: Path,
    up: Literal["", "y", "z", "keep"] = "",
    forward: Literal["", "x", "-x", "y", "-y", "z", "-z"] = "",
    axes: str = "",
    units: Literal["mm", "cm", "m"] = "mm",
    labels: Path | None = None,
    inputs: ConvertInputs | None = None,  # type: ignore[valid-type]
) -> int:
    """A recording as other files: C3D to TRC, MOT with external loads and STO, and back.

    Parameters
    ----------
    files : recording (.c3d, .trc, .mat), tables of forces and EMG (.mot, .sto, .csv), or several of
        them
    out : file to write, by its ending: .trc markers, .mot forces with external loads (.xml) beside
        it, .sto or .csv EMG or a table, .c3d all of it; or a folder for all that there is
    up : axis that points up: y by default, as OpenSim has it; kept where a C3D file is written
    forward : axis that the walk goes along, by right angles; kept by default
    axes : instead of both, the new axes in the old frame: x,z,-y turns z up to y up
    units : of lengths in a TRC file
    labels : table of names (.csv: label, new name; an empty new name drops the marker or channel)
    """
    from myomorph.core.io.labels import read_labels
    from myomorph.lab.convert.convert import ConvertOptions, convert
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.time_span import TimeSpan

    names = {} if labels is None else read_labels(labels)
    named = inputs_of_flags(inputs)
    plates = named.or_default(LoadsFile).plates
    time = named.or_default(TimeSpan).time
    options = ConvertOptions(
        up=up, forward=forward, axes=axes, units=units, labels=names, plates=plates, time=time
    )
    made = convert(files, out, options)
    warn(made.notes, "'myomorph info FILE' lists those of the file")
    for path, held in made.files:
        said(f"wrote {path}: {held}")
    return 0


@documented
def report_command(
    folder: Path, /, *, preset: str = "", times: tuple[float, ...] = (), norms: tuple[str, ...] = ()
) -> int:
    """Make report.html of a folder of results, and of a walk gait.html, one page for the clinic.

    Parameters
    ----------
    folder : of results
    preset : how to look at the motion: taichi, tap, drum, judo, gait, lift or motion; else as it
        fits
    times : instants to picture [s]; those of events by default
    norms : what gait.html holds a walk against: folders of results of a control group, adults or
        none; by default adults, for a body of their size
    """
    reader = _reader(folder, lambda extension: extension.reports)
    if reader is not None:
        paths = [reader.read(folder)]
    else:
        from myomorph.lab.study.trial.reporting import report_folder

        paths = report_folder(
            folder, preset=preset, times=times, demo_model=_demo_model, norms=norms
        )
    for path in paths:
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
    from myomorph.lab.study.trial.viewing import open_replay

    def served(opened: int) -> None:
        address = f"http://127.0.0.1:{opened}"
        said(f"{address} (for this machine only; Ctrl-C ends)")
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    with _ended_by_ctrl_c() as ended:
        replay = open_replay(folders, port, served, _demo_model, _other_recordings)
        try:
            while not ended.wait(0.5):
                pass
        finally:
            replay.close()
    return 0


def _reader(
    folder: Path, kinds: Callable[[Extension], Sequence[FolderReader]]
) -> FolderReader | None:
    """What shows a folder of results of an extension, None for those of a trial or a study."""
    readers = (reader for extension in extensions() for reader in kinds(extension))
    return next((reader for reader in readers if reader.knows(folder)), None)


def _other_recordings(folder: Path) -> Recordings:
    reader = _reader(folder, lambda extension: extension.replays)
    return {} if reader is None else reader.read(folder)


def _demo_model(name: str) -> Model:
    """The model of a demo's results."""
    demos = {name: demo for each in extensions() for name, demo in each.demos.items() if demo.model}
    check_name("demo", name, demos, "the installation")
    return load(demos[name].model)(name)


@contextmanager
def _ended_by_ctrl_c() -> Iterator[threading.Event]:
    """The event that the first Ctrl-C sets; a second one interrupts.

    An exception can be raised anywhere, in callbacks too whose exceptions Python prints and
    forgets: the program would then go on.
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
