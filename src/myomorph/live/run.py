"""`live`: from files or streams to a page, a stream, and a folder of results.

The folder holds tables, one result file and delays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.io.inertial.read import read_inertial
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.provenance import Source as Input
from myomorph.core.model.series import Z_UP_TO_Y_UP, Motion
from myomorph.core.motion.sensors.mounting import SensorMounting, with_orientations
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.store.results import (
    file_source,
    provenance_of,
    value_source,
    whole_folder,
)
from myomorph.lab.store.settings import plain_settings
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.imu import NONE, ImuFiles
from myomorph.lab.study.trial.reporting import surfaces_of
from myomorph.lab.uncertainty.sources import Sources
from myomorph.live.chain import ChainOptions, LiveChain
from myomorph.live.interruption import ended_by_signals
from myomorph.live.limits import LimitOptions
from myomorph.live.loop import Delays, LiveSession, Output, follow
from myomorph.live.page import LivePage
from myomorph.live.session_log import LOG, SessionLog, head_of, read_log
from myomorph.live.session_results import STEP, SessionResults
from myomorph.live.sources import Replay, Source, open_recording, read_forces_of
from myomorph.live.streams import LabOutlet, LabStreams


@dataclass(frozen=True)
class LiveFiles:
    """A recording that is played."""

    markers: Path  # file of markers, or of coordinates (.mot, .sto)
    # external loads file, or a table of plates; None for the plates of a C3D file, or for no forces
    loads: Path | None = None
    speed: float = 1.0  # times real time; 0 as fast as it goes
    # what the model calls markers that the recording calls otherwise, "" for those to leave out
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))


@dataclass(frozen=True)
class LiveStreams:
    """Streams of the Lab Streaming Layer, see `LabStreams`."""

    # markers, forces: their names; "" for no forces
    markers: str
    forces: str = ""
    up: str = "y"  # the laboratory's vertical axis; z is turned to the model's y


@dataclass(frozen=True)
class LiveSensors:
    """Inertial sensors of files that are played, or of a stream (`stream`, its name).

    Their mounting and headings are found on a recording that begins with the calibration pose
    (`settings.imu_pose`), walking behind it where headings are not named.
    """

    settings: ImuFiles
    stream: str = ""
    loads: Path | None = None
    speed: float = 1.0


@dataclass(frozen=True)
class LiveOutputs:
    """Where results go, beside the end's summary."""

    web: int | None = None  # port of a page on this machine
    stream: str = ""  # name of a stream of the Lab Streaming Layer
    folder: Path | None = None  # of tables


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """Options of all that is computed of a frame.

    Attributes
    ----------
    chain : of poses, filter and recruitment
    tension : of muscle tensions
    limits : how interval bounds of results are drawn; None for no bounds
    sources : sizes of the errors that they are drawn with
    """

    chain: ChainOptions = field(default_factory=ChainOptions)
    tension: TensionOptions = field(default_factory=TensionOptions)
    limits: LimitOptions | None = None
    sources: Sources | None = None


def run_live_chain(
    model: Path,
    live_files: LiveFiles | LiveStreams | LiveSensors,
    outputs: LiveOutputs | None = None,
    settings: LiveSettings | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> LiveSession:
    """Follow a recording or streams until they end.

    Parameters
    ----------
    model : OpenSim (.osim) or MuJoCo (.xml) file
    live_files : what the frames come from
    outputs : page, stream and folder
    settings : options of all that is computed
    said : called with a line for every place where results can be seen
    """
    outputs = outputs or LiveOutputs()
    settings = settings or LiveSettings()
    opened = reading.open_model(model)
    reading.has_mass(opened, "live")
    mounting = (
        sensor_mounting(opened, live_files.settings)
        if isinstance(live_files, LiveSensors)
        else None
    )
    source, read = open_source(opened, live_files)
    chain = LiveChain(
        model=opened,
        source=source,
        options=settings.chain,
        tension=settings.tension,
        limits=settings.limits,
        sources=settings.sources,
        mounting=mounting,
    )
    delays = Delays()
    direct: list[Output] = []
    late: list[Output] = []
    with ExitStack() as stack:
        if outputs.stream:
            outlet = LabOutlet(outputs.stream, chain, source)
            direct.append(outlet)
            stack.callback(outlet.close)
            said(f"results are sent as stream '{outputs.stream}'")
        if outputs.web is not None:
            page = LivePage(
                model=opened,
                chain=chain,
                surfaces=surfaces_of(opened),
                port=outputs.web,
                delays=delays,
            )
            stack.callback(page.close)
            late.append(page)
            said(f"the body is at {page.address}")
        log = None
        # After whatever may refuse what was asked for, so that no folder is left behind.
        if outputs.folder is not None:
            made = provenance_of(
                STEP,
                (file_source("model", model), *read),
                plain_settings(chain.options) | plain_settings(settings.tension),
            )
            outputs.folder.mkdir(parents=True, exist_ok=True)
            log = SessionLog(outputs.folder / LOG, head_of(chain, model, made), delays)
            stack.enter_context(log)
            late.insert(0, log)
        stack.enter_context(ended_by_signals())
        try:
            session = follow(chain, source, direct, late, delays)
        except BaseException:
            if log is not None:
                _keep(log, len(delays), said)
            raise
    if log is not None:
        _write_results(log.path, opened, session)
    return session


def _keep(log: SessionLog, frames: int, said: Callable[[str], None]) -> None:
    """Keep the log of a session that an error ended, if it holds a frame."""
    with suppress(OSError):
        # On a full disk this is what ended the session.
        log.close()
    if frames == 0:
        log.path.unlink()
        with suppress(OSError):
            # Only where nothing else is in it.
            log.path.parent.rmdir()
    else:
        said(f"{frames} frames are kept: myomorph live --recover {log.path.parent}")


def _write_results(log: Path, model: Model, session: LiveSession) -> None:
    """Write the results of a log, all together, and remove the log."""
    stored = read_log(log)
    table = stored.rows[:, stored.head.parts["delays"]]
    session = replace(session, delays=Delays.of_table(table, dropped=session.delays.dropped))
    with whole_folder(log.parent) as folder:
        SessionResults(head=stored.head, rows=stored.rows, model=model, folder=folder).write(
            session
        )
    log.unlink()


def recover_session(folder: Path) -> LiveSession:
    """Write the results of a session that was killed, or ended by an error, of its log.

    Parameters
    ----------
    folder : that the session wrote to

    Raises
    ------
    BadFile : it holds no log, or the model was changed since
    """
    path = folder / LOG
    if not path.is_file():
        hint = "give the --out of a session of live that did not end"
        raise BadFile(folder, f"holds no {LOG}: there is nothing to recover", hint)
    stored = read_log(path)
    head = stored.head
    rows = stored.rows
    made = Provenance.from_json(head.provenance)
    source = next(source for source in made.sources if source.role == "model")
    if file_source("model", head.model).sha256 != source.sha256:
        hint = "restore the model of the session"
        raise BadFile(head.model, f"was changed since the session in '{folder}'", hint)
    model = reading.open_model(Path(head.model))
    parts = head.parts
    lost = int(rows[-1, parts["dropped"].start])
    delays = Delays.of_table(rows[:, parts["delays"]], dropped=lost)
    times = rows[:, parts["delays"].start]
    times = times[np.isfinite(times)]
    notes = [*head.notes, f"the session did not end by itself: recovered from its {LOG}"]
    if stored.damaged:
        notes.append(f"rows of the {LOG} that are damaged or cut off, left out: {stored.damaged}")
    session = LiveSession(
        delays=delays,
        filter_delay=head.filter_delay,
        seconds=float(np.ptp(times)) if len(times) else 0.0,
        notes=tuple(notes),
        interrupted=True,
    )
    _write_results(path, model, session)
    return session


def sensor_mounting(model: Model, settings: ImuFiles) -> SensorMounting:
    """How sensors are mounted, by the recording of their calibration."""
    if not settings.imu_pose:
        needed = (
            "a recording that begins with the model's default pose, then walking or --imu-heading"
        )
        raise BadData(f"live sensors need their calibration, --imu-pose FILE: {needed}")
    bodies = FrozenMap(
        {name: "" if body.lower() in NONE else body for name, body in settings.imu_bodies.items()}
    )
    pose = read_inertial(settings.imu_pose)
    heading = settings.imu_heading
    return sensor_kinematics(
        model,
        SensorRecording(
            sensors=pose,
            bodies=bodies,
            pose=None,
            pose_time=settings.imu_pose_time,
            headings=heading,
        ),
    ).mounting


def _played_sensors(model: Model, live: LiveSensors) -> tuple[Source, tuple[Input, ...]]:
    """Files of sensors as a source; raw signals through a filter that knows no future."""
    files = live.settings.imu
    recorded = read_inertial(files)
    if recorded.orientations is None and recorded.magnetic_fields is None:
        missing = (
            "neither orientations nor magnetic fields: headings would not be those of the"
            " calibration"
        )
        raise BadData(f"{recorded.source}: holds {missing}")
    still = Motion(recorded.time[:1], (), np.zeros((1, 0)))
    wrenches = None if live.loads is None else read_forces_of(model, live.loads, still)
    named = [file_source("imu", path) for path in (*files, *live.settings.imu_pose)]
    named += [file_source("loads", live.loads)] if live.loads else []
    return Replay(with_orientations(recorded, causal=True), wrenches, live.speed), tuple(named)


def open_source(
    model: Model, live_files: LiveFiles | LiveStreams | LiveSensors
) -> tuple[Source, tuple[Input, ...]]:
    """Frames to come, and what provenance says of them."""
    if isinstance(live_files, LiveSensors):
        if not live_files.stream:
            return _played_sensors(model, live_files)
        stream = LabStreams(live_files.stream, "", orientations=True)
        pose = (file_source("imu", path) for path in live_files.settings.imu_pose)
        return stream, (value_source("stream", live_files.stream, live_files.stream), *pose)
    if isinstance(live_files, LiveStreams):
        if live_files.up not in ("y", "z"):
            raise BadData(f"--up {live_files.up}: expected y or z")
        turn = Z_UP_TO_Y_UP if live_files.up == "z" else None
        streams = LabStreams(live_files.markers, live_files.forces, turn=turn)
        names = [name for name in (live_files.markers, live_files.forces) if name]
        return streams, tuple(value_source("stream", name, name) for name in names)
    series, wrenches = open_recording(
        model, live_files.markers, live_files.loads, labels=live_files.labels
    )
    inputs = [file_source("markers", live_files.markers)]
    if live_files.loads:
        inputs.append(file_source("loads", live_files.loads))
    if live_files.labels:
        inputs.append(
            value_source("markers", "labels of markers", sorted(live_files.labels.items()))
        )
    return Replay(series, wrenches, live_files.speed), tuple(inputs)
