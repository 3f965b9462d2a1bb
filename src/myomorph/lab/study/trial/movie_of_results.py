"""From a folder of results to a movie of them."""

from __future__ import annotations

from pathlib import Path

from myomorph.core.model.errors import BadData
from myomorph.lab.store.progress import progress
from myomorph.lab.study.trial.result_folders import demo_model, folder_reader
from myomorph.lab.study.trial.viewing import Appearance, Recordings, recordings
from myomorph.lab.viewer.movie import AS_RECORDED, MovieClock, MovieOptions, draw_movie


def write_movie(
    results: str | Path,
    out: str | Path,
    options: MovieOptions = AS_RECORDED,
    geometry: str | Path | None = None,
) -> MovieClock:
    """Write a movie of results: the body with its muscles, beside curves.

    Muscles are spindles of their volume, in the color of their activation.

    Parameters
    ----------
    results : folder of results, of a study its first trial; or a file of results
    out : file to write: GIF, WebP or PNG, by its ending
    options : part, length, speed, size and curves
    geometry : folder of the meshes of bones, where they are not beside the model; bodies without a
        mesh are drawn as spindles too

    Returns
    -------
    the times of its pictures

    Raises
    ------
    BadFile : there are no results, or the movie cannot be written
    BadData : these results do not hold a curve or a time
    UnknownName : results have no curve of a name
    MissingPackage : Pillow is not installed

    Examples
    --------
    >>> import myomorph as mm
    >>> options = mm.viewer.MovieOptions(time=(0.0, 0.2), size=(240, 140))
    >>> clock = mm.viewer.write_movie("results", "arm.gif", options)
    >>> len(clock.times), clock.seconds
    (4, 0.2)
    """
    folder = None if geometry is None else Path(geometry)
    appearance = Appearance(demo_model=demo_model, geometry=folder)
    found = recordings_of(Path(results), appearance)
    return draw_movie(next(iter(found.values()))(), Path(out), options, progress)


def recordings_of(folder: Path, appearance: Appearance) -> Recordings:
    """Return the recordings of a folder of results of whichever kind, each opened when called.

    Raises
    ------
    BadData : there are none
    """
    reader = folder_reader(folder, lambda extension: extension.replays)
    own: Recordings = {} if reader is None else reader.read(folder)
    found = own or recordings(folder, appearance)
    if not found:
        raise BadData(f"{folder} holds no recording")
    return found
