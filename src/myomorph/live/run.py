"""`live`: from files or streams to a page, a stream, and a folder of tables, one result file and
delays.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np

from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.io.inertial.read import read_inertial
from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source as Input
from myomorph.core.model.series import Z_UP_TO_Y_UP, Motion, Series, Wrenches
from myomorph.core.motion.sensors.mounting import SensorMounting, with_orientations
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantity_files import quantity_table, write_series
from myomorph.lab.store.results import (
    STORED,
    file_source,
    new_result,
    provenance_of,
    value_source,
    whole_folder,
)
from myomorph.lab.store.settings import plain_settings
from myomorph.lab.store.uncertainty_store import put_uncertainty
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.imu import NONE, ImuFiles
from myomorph.lab.study.trial.reporting import surfaces_of
from myomorph.lab.uncertainty.sources import Sources
from myomorph.lab.uncertainty.spread import Spread, Uncertainty
from myomorph.live.chain import ChainFrame, ChainOptions, LiveChain
from myomorph.live.limits import TABLES, LimitOptions
from myomorph.live.loop import STATES, Delays, LiveSession, Output, follow
from myomorph.live.page import LivePage
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
    """Inertial sensors of files that are played, or of a stream (`stream`, its name). Their
    mounting and headings are found on a recording that begins with the calibration pose
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


def run_live_chain(
    model: Path,
    live_files: LiveFiles | LiveStreams | LiveSensors,
    outputs: LiveOutputs | None = None,
    options: ChainOptions | None = None,
    tension: TensionOptions | None = None,
    said: Callable[[str], None] = lambda line: None,
    limits: LimitOptions | None = None,
    sources: Sources | None = None,
) -> LiveSession:
    """Follow a recording or streams until they end. `limits`: how limits of results are drawn, with
    errors of the sizes in `sources`; None for no limits; `said`: called with a line for every place
    where results can be seen.
    """
    outputs = outputs or LiveOutputs()
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
        options=options,
        tension=tension,
        limits=limits,
        sources=sources,
        mounting=mounting,
    )
    delays = Delays()
    direct: list[Output] = []
    late: list[Output] = []
    with ExitStack() as stack:
        record = None
        if outputs.folder is not None:
            folder = stack.enter_context(whole_folder(outputs.folder))
            record = stack.enter_context(LiveRecord(chain, folder))
            late.append(record)
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
        session = follow(chain, source, direct, late, delays)
        if record is not None:
            record.write(session, (file_source("model", model), *read), tension)
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


STEP = "live"
BLOCK = 256  # Frames that are written at once.


class LiveRecord:
    """Keeps every frame in a folder while the session runs, and writes the results at its end."""

    def __init__(self, chain: LiveChain, folder: Path):
        self._chain = chain
        self._folder = folder
        model = chain.model
        n = len(model.coordinates)
        muscles = len(model.muscles)
        widths = {
            "time": 1,
            "coordinates": n,
            "velocities": n,
            "torques": n,
            "activations": muscles,
            "forces": muscles,
            "reserves": len(chain.actuators),
            "balanced": len(chain.tension.coordinates),
            "wrenches": 6 * len(chain.bodies),
            "residual": 1,
            "status": 1,
            "error": 1,
            "seen": 1,
            "remaining": 1,
        }
        if chain.limits is not None:
            widths |= {f"{name}_limits": 3 * widths[name] for name in TABLES}
        ends = np.cumsum([0, *widths.values()])
        self._part = {name: slice(a, b) for name, a, b in zip(widths, ends, ends[1:], strict=False)}
        self._rows = np.empty((BLOCK, int(ends[-1])))
        self._filled = 0
        self._path = folder / "frames.tmp"
        self._file: IO[bytes] = self._path.open("wb")

    def __enter__(self) -> LiveRecord:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()
        self._path.unlink(missing_ok=True)

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """Keep one frame."""
        row = self._rows[self._filled]
        shared = frame.tension
        values = (
            frame.time,
            frame.coordinates,
            frame.velocities,
            frame.torques,
            shared.activations,
            shared.forces,
            shared.reserves,
            shared.balanced,
            frame.wrenches.ravel(),
            shared.equilibrium_residual,
            shared.status,
            frame.error,
            frame.seen,
            frame.owed,
        )
        for part, value in zip(self._part.values(), values, strict=False):
            row[part] = value
        if self._chain.limits is not None:
            for name in TABLES:
                limits = np.nan if frame.limits is None else getattr(frame.limits, name).ravel()
                row[self._part[f"{name}_limits"]] = limits
        self._filled += 1
        if self._filled == BLOCK:
            self._flush()

    def _flush(self) -> None:
        self._file.write(self._rows[: self._filled].tobytes())
        self._filled = 0

    def close(self) -> None:
        """Nothing more comes."""
        if not self._file.closed:
            self._flush()
            self._file.close()

    def write(
        self, session: LiveSession, sources: Iterable[Input], tension: TensionOptions | None
    ) -> None:
        """Write tables, `live.nc`, `delays.csv` and `session.json`."""
        self.close()
        rows = np.fromfile(self._path, dtype=np.float64).reshape(-1, self._rows.shape[1])
        self._write_delays(session, rows)
        # What has a value is of an instant before the newest frame by the filter's delay.
        known = np.isfinite(rows[:, self._part["coordinates"]]).all(axis=1)
        if known.any():
            self._write_results(session, rows[known], sources, tension or TensionOptions())

    def _write_delays(self, session: LiveSession, rows: Array) -> None:
        delays = session.delays
        markers = rows[:, [self._part[part].start for part in ("seen", "error", "remaining")]]
        head = (
            "time_s,waiting_ms,latency_ms,computation_ms,state,markers_seen,marker_error_mm,"
            "remaining_jump"
        )
        lines = (
            f"{time:.6f},{1e3 * waiting:.4f},{1e3 * age:.4f},{1e3 * busy:.4f},"
            f"{STATES[int(state)]},{seen:.0f},{1e3 * error:.3f},{remaining:.3g}"
            for (time, waiting, age, busy, state), (seen, error, remaining) in zip(
                delays.table, markers, strict=True
            )
        )
        (self._folder / "delays.csv").write_text(
            "\n".join([head, *lines, ""]), encoding="utf-8", newline="\n"
        )
        spread = {}
        for name, delay in (
            ("from_frame_to_result", delays.end_to_end),
            ("computation", delays.busy),
        ):
            times = {"median": delay.median, "percentile_99": delay.late, "worst": delay.worst}
            rounded = {
                key: round(1e3 * time, 4) if np.isfinite(time) else None
                for key, time in times.items()
            }
            spread[f"{name}_ms"] = rounded
        facts = {
            "frames": len(delays),
            "dropped": delays.dropped,
            "seconds": round(session.seconds, 3),
            "states": {STATES[state]: count for state, count in delays.states().items()},
            "filter_delay_s": round(session.filter_delay, 6),
            **spread,
            "notes": list(session.notes),
        }
        (self._folder / "session.json").write_text(
            json.dumps(facts, indent=1) + "\n", encoding="utf-8"
        )

    def _write_results(
        self, session: LiveSession, rows: Array, sources: Iterable[Input], options: TensionOptions
    ) -> None:
        chain = self._chain
        folder = self._folder
        part = self._part
        model = chain.model
        time = rows[:, 0] - session.filter_delay
        motion = Motion(
            time=time,
            names=model.coordinate_names,
            values=rows[:, part["coordinates"]],
            velocities=rows[:, part["velocities"]],
        )
        torques = Series(
            time, model.coordinate_names, rows[:, part["torques"]], quantity=GENERALIZED_FORCE
        )
        tension = self._tension(time, rows, options)
        write_series(folder, motion, model)
        write_series(folder, torques, model)
        for quantity in (ACTIVATION, MUSCLE_FORCE):
            values = quantity.of(tension)
            write_series(folder, Series(time, tension.muscles, values, quantity=quantity))
        with new_result(folder / f"{STEP}{STORED}", STEP) as writer:
            chosen = plain_settings(chain.options) | plain_settings(options)
            writer.provenance(provenance_of(STEP, sources, chosen))
            store.put_derivatives(writer, motion, model)
            store.put_torques(writer, torques, self._wrenches(time, rows))
            acts = {actuator.name: actuator.coordinate for actuator in model.actuators}
            store.put_tension(
                writer, tension, tuple(acts.get(name, "") for name in tension.reserve_names)
            )
            writer.fact("trial", STEP)
            if chain.limits is not None:
                put_uncertainty(writer, self._limits(time, rows))

    def _limits(self, time: Array, rows: Array) -> Uncertainty:
        """Limits of all tables, written beside them."""
        drawn = self._chain.limits
        spreads = dict[str, Spread]()
        assert drawn is not None
        model = self._chain.model
        for part, quantity in TABLES.items():
            by_muscle = quantity.dims[1] == "muscle"
            names = self._chain.tension.muscles if by_muscle else model.coordinate_names
            parts = rows[:, self._part[f"{part}_limits"]].reshape(len(rows), 3, len(names))
            low, high, deviation = np.array(parts).swapaxes(0, 1)
            spreads[quantity.name] = Spread(
                time=time, names=names, low=low, high=high, deviation=deviation, quantity=quantity
            )
            for bound, values in (("low", low), ("high", high)):
                file = f"{quantity.stem}_{bound}{quantity.suffix}"
                table = quantity_table(Series(time, names, values, quantity=quantity), model)
                write_sto(table, self._folder / file)
        return Uncertainty(FrozenMap(spreads), draws=drawn.draws, factors=FrozenMap(drawn.factors))

    def _tension(self, time: Array, rows: Array, options: TensionOptions) -> Tension:
        solver = self._chain.tension
        kept = {name: np.array(rows[:, part]) for name, part in self._part.items()}
        return Tension(
            time=np.array(time),
            muscles=solver.muscles,
            activation=kept["activations"],
            muscle_force=kept["forces"],
            reserve_names=solver.actuators,
            actuator_force=kept["reserves"],
            coordinates=solver.coordinates,
            balanced_torque=kept["balanced"],
            equilibrium_residual=kept["residual"][:, 0],
            status=kept["status"][:, 0].astype(np.int8),
            iterations=np.zeros(len(rows), np.int64),
            activation_lower=np.array(solver.lower),
            activation_upper=np.array(solver.upper),
            overstretched=(),
            options=options,
        )

    def _wrenches(self, time: Array, rows: Array) -> Wrenches | None:
        """External forces where they meet the floor."""
        bodies = self._chain.bodies
        if not bodies:
            return None
        each = rows[:, self._part["wrenches"]].reshape(len(rows), len(bodies), 6)
        moments = each[..., :3]
        forces = each[..., 3:]
        up = self._chain.feet.up
        lift = forces @ up
        acts = np.abs(lift) > 1.0
        points = np.where(
            acts[..., None], np.cross(up, moments) / np.where(acts, lift, 1.0)[..., None], 0.0
        )
        return Wrenches(
            time=time,
            names=bodies,
            bodies=bodies,
            forces=forces,
            points=points,
            torques=moments - np.cross(points, forces),
        )
