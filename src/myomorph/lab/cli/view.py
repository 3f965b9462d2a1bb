"""The command `view`: results as a page that plays, or as a movie."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import said, warn
from myomorph.lab.study.trial.result_folders import demo_model, folder_reader

if TYPE_CHECKING:
    from myomorph.lab.study.trial.viewing import Appearance, Recordings


@documented
@dataclass(frozen=True, kw_only=True)
class MovieFlags:
    """Options of a movie.

    Attributes
    ----------
    movie : write a movie to this file (.gif, .webp or .png), with the body next to its curves,
        instead of opening a page
        instead of opening a page
    size : width and height of the movie [pixels]
    time : START END [s]: part of the recording that the movie shows; all of it by default, up to 20
        s
    seconds : duration of the movie [s], which determines its speed
    speed : playback speed relative to real time, 1 by default; 0.5 is half as fast
    curves : up to three curves: coordinates, moments (knee_angle_r_moment), muscles, joints with
        contact forces, or external forces, with or without their side; by default the most
        informative ones
    """

    movie: Path | None = None
    size: tuple[int, int] = (760, 420)
    time: tuple[float, float] | None = None
    seconds: float | None = None
    speed: float | None = None
    curves: tuple[str, ...] = ()


MovieOptions = Annotated[MovieFlags, Parameter(name="*")]
NO_MOVIE = MovieFlags()


@documented
def view_command(
    folders: list[Path],
    /,
    *,
    port: int | None = None,
    browser: bool = True,
    geometry: Path | None = None,
    movie: MovieOptions = NO_MOVIE,
) -> int:
    """Show results in a web page: the body moves, with its muscles, forces, markers and curves.

    Parameters
    ----------
    folders : folders of results; several are shown in one scene with one clock
    port : port of the page; a free one by default
    browser : open the page in the browser
    geometry : folder of the bone meshes, if they are not next to the model
    movie : options of a movie, which replaces the page
    """
    from myomorph.lab.study.trial.viewing import Appearance

    appearance = Appearance(
        demo_model=demo_model, geometry=geometry, missing=lambda sentence: warn([sentence])
    )
    if movie.movie is not None:
        return _write_movie(folders, appearance, movie.movie, movie)
    if movie != NO_MOVIE:
        raise BadData("--size, --time, --seconds, --speed and --curves need --movie OUT.gif")
    return _play(folders, appearance, port, browser)


def _play(folders: list[Path], appearance: Appearance, port: int | None, browser: bool) -> int:
    """Serve the page until Ctrl-C; return the exit status."""
    from myomorph.lab.study.trial.viewing import open_replay

    def served(address: str) -> None:
        said(f"{address} (for this machine only; Ctrl-C ends)")
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    with _ended_by_ctrl_c() as ended:
        replay = open_replay(folders, port, served, appearance, _other_recordings)
        try:
            while not ended.wait(0.5):
                pass
        finally:
            replay.close()
    return 0


def _write_movie(folders: list[Path], appearance: Appearance, out: Path, flags: MovieFlags) -> int:
    """Write a movie of the first recording of a folder; return the exit status."""
    from myomorph.lab.store.progress import progress
    from myomorph.lab.study.trial.movie_of_results import recordings_of
    from myomorph.lab.viewer.movie import MovieOptions as Options
    from myomorph.lab.viewer.movie import draw_movie
    from myomorph.lab.viewer.movie_file import check_movie_file

    options = Options(
        size=flags.size,
        time=flags.time,
        seconds=flags.seconds,
        speed=flags.speed,
        curves=flags.curves,
    )
    check_movie_file(out)
    if len(folders) != 1:
        raise BadData(f"a movie shows one folder of results, not {len(folders)}")
    found = recordings_of(folders[0], appearance)
    name, opened = next(iter(found.items()))
    if len(found) > 1:
        said(f"{name}, the first of {len(found)} recordings: give the folder of another to see it")
    clock = draw_movie(opened(), out, options, progress)
    parts = [
        f"wrote {out}: {len(clock.times)} pictures",
        f"{clock.seconds:.3g} s at {clock.speed:.3g} of the recorded speed",
        f"{out.stat().st_size / 1e6:.2f} MB",
    ]
    said(", ".join(parts))
    if clock.cut:
        said(f"the recording goes on after {clock.times[-1]:.3g} s: see --time, --seconds, --speed")
    return 0


def _other_recordings(folder: Path) -> Recordings:
    """Return recordings of results of an extension; none of those of a trial or a study."""
    reader = folder_reader(folder, lambda extension: extension.replays)
    return {} if reader is None else reader.read(folder)


@contextmanager
def _ended_by_ctrl_c() -> Iterator[threading.Event]:
    """Yield the event that the first Ctrl-C sets; a second one interrupts.

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
