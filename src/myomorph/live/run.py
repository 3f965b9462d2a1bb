"""`live` from files or streams to a page, a stream and a folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.live.chain import ChainOptions, LiveChain
from myomorph.live.delays import Delays
from myomorph.live.session import LiveSession, Output, follow_chain
from myomorph.live.sources import LabStreams, Replay, Source
from myomorph.model.errors import BadData, BadFile
from myomorph.model.model import Model
from myomorph.model.provenance import Source as Input
from myomorph.model.series import Markers, Motion, Wrenches
from myomorph.store.results import file_source, value_source, whole_folder
from myomorph.study.trial import inputs
from myomorph.tension.tension import TensionOptions


@dataclass(frozen=True)
class LiveFiles:
    """A recording that is played.

    Attributes
    ----------
    markers : file of markers, or of coordinates (.mot, .sto)
    loads : external loads file, or a table of plates; None for the plates of a C3D file, or for no forces
    speed : times real time; 0 as fast as it goes
    """

    markers: Path
    loads: Path | None = None
    speed: float = 1.0


@dataclass(frozen=True)
class LiveStreams:
    """Streams of the Lab Streaming Layer, see `LabStreams`.

    Attributes
    ----------
    markers, forces : their names; "" for no forces
    up : the laboratory's vertical axis; z is turned to the model's y
    """

    markers: str
    forces: str = ""
    up: str = "y"


@dataclass(frozen=True)
class LiveOutputs:
    """Where results go, beside the end's summary.

    Attributes
    ----------
    web : port of a page on this machine
    stream : name of a stream of the Lab Streaming Layer
    folder : of tables
    """

    web: int | None = None
    stream: str = ""
    folder: Path | None = None


def run_live_chain(
    model: Path,
    given: LiveFiles | LiveStreams,
    outputs: LiveOutputs | None = None,
    options: ChainOptions | None = None,
    tension: TensionOptions | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> LiveSession:
    """Follow a recording or streams until they end.

    Parameters
    ----------
    said : told where results can be seen, and when frames may come

    Raises
    ------
    MyomorphError : what is given does not fit, or an optional package is missing
    """
    outputs = outputs or LiveOutputs()
    opened = inputs.open_model(model)
    inputs.has_mass(opened, "live")
    source, read = open_source(opened, given)
    chain = LiveChain(opened, source, options, tension)
    delays = Delays()
    direct: list[Output] = []
    late: list[Output] = []
    with ExitStack() as stack:
        record = None
        if outputs.folder is not None:
            from myomorph.live.record import LiveRecord

            folder = stack.enter_context(whole_folder(outputs.folder))
            record = stack.enter_context(LiveRecord(chain, folder))
            late.append(record)
        if outputs.stream:
            from myomorph.live.outlet import LabOutlet

            direct.append(LabOutlet(outputs.stream, chain, source))
            stack.callback(direct[-1].close)
            said(f"results are sent as stream '{outputs.stream}'")
        if outputs.web is not None:
            from myomorph.live.page import LivePage
            from myomorph.study.trial.reporting import surfaces_of

            page = LivePage(opened, chain, surfaces_of(opened), outputs.web, delays)
            stack.callback(page.close)
            late.append(page)
            said(f"the body is at http://localhost:{page.port}")
        session = follow_chain(chain, source, direct, late, delays)
        if record is not None:
            record.write(session, (file_source("model", model), *read), tension)
    return session


def open_source(model: Model, given: LiveFiles | LiveStreams) -> tuple[Source, tuple[Input, ...]]:
    """Frames to come, and what provenance tells of them.

    Raises
    ------
    MyomorphError : a file cannot be read or does not fit the model, or a stream is not there
    """
    if isinstance(given, LiveStreams):
        from myomorph.model.series import Z_UP_TO_Y_UP

        if given.up not in ("y", "z"):
            raise BadData(f"--up {given.up}: expected y or z")
        turn = Z_UP_TO_Y_UP if given.up == "z" else None
        streams = LabStreams(given.markers, given.forces, turn=turn)
        names = [one for one in (given.markers, given.forces) if one]
        return streams, tuple(value_source("stream", name, name) for name in names)
    files = [("markers", given.markers)] + ([("loads", given.loads)] if given.loads else [])
    series, wrenches = open_played(model, given.markers, given.loads)
    return Replay(series, wrenches, given.speed), tuple(file_source(role, path) for role, path in files)


def open_played(model: Model, markers: Path, loads: Path | None) -> tuple[Markers | Motion, Wrenches | None]:
    """A recording to be played: markers or coordinates, and its forces.

    Raises
    ------
    MyomorphError : a file cannot be read, or does not fit the model
    """
    from myomorph.contact.plates import wrenches_from_plates

    if markers.suffix.lower() in inputs.TABLE_FILES:
        motion = inputs.open_motion(markers, model)
        return motion, None if loads is None else _open_loads(loads, model, motion)
    trial = inputs.fitted_to(model, inputs.open_trial(markers))
    assert trial.markers is not None
    if loads is not None:
        nowhere = Motion(trial.markers.time[:1], (), np.zeros((1, 0)))
        return trial.markers, _open_loads(loads, model, nowhere)
    if trial.plates:
        return trial.markers, wrenches_from_plates(trial.plates, trial.plate_time)
    return trial.markers, None


def _open_loads(loads: Path, model: Model, motion: Motion) -> Wrenches:
    if loads.suffix.lower() in inputs.TABLE_FILES:
        return inputs.force_table(loads, plates_of_table(loads))
    return inputs.open_loads(loads, model, motion)


def plates_of_table(path: Path) -> Mapping[str, str]:
    """What the columns of each plate of a table begin with; the bodies on them are not known ("").

    Raises
    ------
    BadFile : no column is that of a force with a point of application
    """
    from myomorph.io.sto import read_sto

    names = set(read_sto(path).names)
    found = {
        match[1]: ""
        for match in (re.match(r"(.+)vx$", name) for name in sorted(names))
        if match and f"{match[1]}px" in names
    }
    if not found:
        raise BadFile(
            path, "holds no plate: no columns NAMEvx ... and NAMEpx ...", "give an external loads file (.xml) with it"
        )
    return found
