"""Latency of `live`, on recordings played at their own speed.

Frames a second that live identification takes are measured too.

`python -m benchmarks live-delay`: a walk and two runs at 100 and 200 Hz (frames between by lines),
then the walk over streams from another process, and with the page open. The filter's delay comes on
top. `live` plays as fast as it goes.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import time
from collections.abc import Iterator, Sequence

import numpy as np
from tests.truths.simulated_sensors import NO_ERRORS, simulated_sensors
from threadpoolctl import threadpool_limits

import myomorph as mm
from data_collection import data_folder
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.motion.sensors.mounting import SensorMounting
from myomorph.lab.viewer.web_page import BodyView
from myomorph.live.chain import SOLVED, ChainOptions, LiveChain
from myomorph.live.identification import LiveResult, identify_frames
from myomorph.live.limits import LimitOptions
from myomorph.live.loop import Delays, Output, Spread, follow
from myomorph.live.online_identification import OnlineOptions, total_wrench
from myomorph.live.page import LivePage
from myomorph.live.sources import LiveRecording, Replay, Source, open_recording
from myomorph.live.streams import LabOutlet, LabStreams

SECONDS = 12.0
"""Time that each recording is played for, at least [s]."""

CASES = (
    (
        "walk",
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "rajagopal-walk-emg/markers_walk.trc",
        "grf_walk.xml",
    ),
    (
        "run, 2 m/s",
        "hamner-run-subject04/unscaled_generic.osim",
        "hamner-run-subject04/run200/markers.trc",
        "grf.mot",
    ),
    (
        "run, 5 m/s",
        "hamner-run-subject04/unscaled_generic.osim",
        "hamner-run-subject04/run500/markers.trc",
        "grf.mot",
    ),
)
PORT = 8189
DRAWS = 40
"""Of limits."""

Row = dict[str, object]


def run() -> list[Row]:
    """One row a recording, rate and way."""
    return list(_rows())


def _rows() -> Iterator[Row]:
    data = data_folder()
    walk: tuple[mm.Model, mm.Markers, mm.Wrenches] | None = None
    for name, model_path, path, loads in CASES:
        model = mm.read_model(data / model_path)
        markers, wrenches = open_recording(model, data / path, (data / path).with_name(loads))
        assert isinstance(markers, mm.Markers)
        assert wrenches is not None
        for recording in (markers, doubled(markers)):
            plays = max(1, round(SECONDS / (recording.time[-1] - recording.time[0])))
            yield _measured(name, model, [Replay(recording, wrenches) for _ in range(plays)])
        if name == "walk":
            walk = model, doubled(markers), wrenches
    assert walk is not None
    yield with_limits(*walk)
    yield with_page(*walk)
    yield over_streams(*walk)


def doubled(markers: mm.Markers) -> mm.Markers:
    """Twice as many frames, those between halfway between their neighbours."""
    values = np.empty((2 * len(markers) - 1, *markers.values.shape[1:]))
    values[::2] = markers.values
    values[1::2] = 0.5 * (markers.values[1:] + markers.values[:-1])
    clock = np.empty(len(values))
    clock[::2] = markers.time
    clock[1::2] = 0.5 * (markers.time[1:] + markers.time[:-1])
    return mm.Markers(clock, markers.names, values)


def _measured(
    name: str,
    model: mm.Model,
    sources: Sequence[Source],
    outputs: Sequence[Output] = (),
    late: Sequence[Output] = (),
    draws: int = 0,
    mounting: SensorMounting | None = None,
) -> Row:
    """Play all sources, each with a new chain, and put their delays together."""
    sessions = []
    for source in sources:
        chain = LiveChain(
            model, source, ChainOptions(), limits=LimitOptions(draws), mounting=mounting
        )
        sessions.append(follow(chain, source, outputs, late))
    return row_of(
        name, model, sources[0].rate, [one.delays for one in sessions], sessions[0].filter_delay
    )


def row_of(
    name: str, model: mm.Model, rate: float, delays: Sequence[Delays], filter_delay: float
) -> Row:
    """Summarize some plays in a row."""
    table = np.concatenate([one.table for one in delays])
    ages = Spread.of(table[:, 2])
    busy = Spread.of(table[:, 3])
    return {
        "recording": name,
        "frames a second": rate,
        "muscles": len(model.muscles),
        "coordinates": len(model.coordinates),
        "frames": len(table),
        "dropped": sum(one.dropped for one in delays),
        "solved [%]": 100.0 * float(np.mean(table[:, 4] == SOLVED)),
        "median [ms]": 1e3 * ages.median,
        "99 % [ms]": 1e3 * ages.late,
        "worst [ms]": 1e3 * ages.worst,
        "computation [ms]": 1e3 * busy.median,
        "filter [ms]": 1e3 * filter_delay,
    }


def with_limits(model: mm.Model, markers: mm.Markers, wrenches: mm.Wrenches) -> Row:
    """Measure the same with intervals of all results."""
    plays = max(1, round(SECONDS / (markers.time[-1] - markers.time[0])))
    sources = [Replay(markers, wrenches) for _ in range(plays)]
    return _measured(f"walk, {DRAWS} draws", model, sources, draws=DRAWS)


BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
"""Of sensors, as sets for walking have them."""


def run_sensors() -> list[Row]:
    """Measure the walk by simulated sensors in the place of markers, at 100 and 200 Hz."""
    _, model_path, path, loads = CASES[0]
    data = data_folder()
    model = mm.read_model(data / model_path)
    markers, wrenches = open_recording(model, data / path, (data / path).with_name(loads))
    assert isinstance(markers, mm.Markers)
    rows = []
    for recording in (markers, doubled(markers)):
        made = simulated_sensors(
            model, mm.inverse_kinematics(model, recording).motion, BODIES, NO_ERRORS
        )
        mounting = sensor_kinematics(model, SensorRecording(made.sensors, pose=made.pose)).mounting
        plays = max(1, round(SECONDS / (recording.time[-1] - recording.time[0])))
        sources = [Replay(made.sensors, wrenches) for _ in range(plays)]
        rows.append(_measured(f"walk, {len(BODIES)} sensors", model, sources, mounting=mounting))
    return rows


def with_page(model: mm.Model, markers: mm.Markers, wrenches: mm.Wrenches) -> Row:
    """Measure the same while a page draws it in another process."""
    plays = max(1, round(SECONDS / (markers.time[-1] - markers.time[0])))
    sources = [Replay(markers, wrenches) for _ in range(plays)]
    page = LivePage(
        model=model, chain=LiveChain(model, sources[0]), surfaces=None, port=PORT, delays=Delays()
    )
    try:
        return _measured("walk, page open", model, sources, late=[page])
    finally:
        page.close()


def over_streams(model: mm.Model, markers: mm.Markers, wrenches: mm.Wrenches) -> Row:
    """Measure the walk sent from another process, its results sent on.

    The latency is from the sender's time stamp to the result's being sent.
    """
    name = f"myomorph-benchmark-{time.time_ns()}"
    context = multiprocessing.get_context("spawn")
    plays = max(1, round(SECONDS / (markers.time[-1] - markers.time[0])))
    sender = context.Process(target=_send, args=(name, markers, wrenches, plays), daemon=True)
    sender.start()
    try:
        source = LabStreams(f"{name}-markers", f"{name}-plates", wait=60.0)
        chain = LiveChain(model, source, ChainOptions())
        outlet = LabOutlet(f"{name}-results", chain, source)
        with contextlib.closing(outlet):
            session = follow(chain, source, [outlet])
    finally:
        sender.terminate()
    return row_of("walk, over streams", model, source.rate, [session.delays], session.filter_delay)


def _send(name: str, markers: mm.Markers, wrenches: mm.Wrenches, plays: int) -> None:
    """Send a recording several times over, on time."""
    import pylsl

    outlets = []
    layouts = (
        ("markers", markers.rate, [f"{one}_{axis}" for one in markers.names for axis in "xyz"]),
        (
            "plates",
            2000.0,
            [f"{plate}_{a}{b}" for plate in ("one", "two") for a in "FM" for b in "xyz"],
        ),
    )
    for what, rate, labels in layouts:
        info = pylsl.StreamInfo(
            f"{name}-{what}", "Mocap", len(labels), rate, "double64", f"{name}-{what}"
        )
        channels = info.desc().append_child("channels")
        for label in labels:
            channels.append_child("channel").append_child_value("label", label)
        outlets.append(pylsl.StreamOutlet(info))
    while not all(one.have_consumers() for one in outlets):
        time.sleep(0.01)
    first = float(markers.time[0])
    length = float(markers.time[-1] - markers.time[0]) + 1.0 / markers.rate
    each = total_wrench(
        *(one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
    )
    played = (wrenches.time >= first) & (wrenches.time < first + length)
    force_time = wrenches.time[played]
    rows = each[played][:, :, [3, 4, 5, 0, 1, 2]].reshape(-1, 12)
    began = pylsl.local_clock() + 1.0
    for _ in range(plays):
        sample = 0
        for moment, row in zip(markers.time, markers.values, strict=True):
            due = began + float(moment) - first
            time.sleep(max(due - pylsl.local_clock(), 0.0))
            while sample < len(rows) and force_time[sample] <= moment:
                outlets[1].push_sample(rows[sample], began + force_time[sample] - first)
                sample += 1
            outlets[0].push_sample(row.ravel(), due)
        began += length
    time.sleep(30.0)


if __name__ == "__main__":
    from benchmarks.__main__ import print_rows

    print_rows(run())


ROUNDS = 3
ALL_SECONDS = 20.0
"""Of the made motion [s]."""


def run_identification() -> list[Row]:
    """One row a recording."""
    data = data_folder()
    subject = data / "opencap-subject4-multitask"
    model = mm.read_model(subject / "models/manually_scaled.osim")
    rows = []
    for trial in ("walking1", "DJ1"):
        loads = subject / f"grf/{trial}_external_forces.xml"
        recording = open_recording(model, subject / f"markers/{trial}.trc", loads)
        rows.append(measured_identification(f"{trial}, markers", model, recording))
    whole = mm.read_model(data / "fullbody-many-muscles/cyclistFullBodyMuscle.osim")
    return [*rows, measured_identification("made motion, coordinates", whole, made(whole))]


def measured_identification(name: str, model: mm.Model, recording: LiveRecording) -> Row:
    """Median over a few plays."""
    plays: list[LiveResult] = []
    looks = []
    for _ in range(ROUNDS):
        source = Replay(recording.motion, recording.wrenches, 0.0)
        plays.append(identify_frames(model, source, online=OnlineOptions(missing=1e9)))
        with threadpool_limits(limits=1, user_api="blas"):
            began = time.perf_counter()
            plays[-1].identification.state()
            looks.append(time.perf_counter() - began)
    view = BodyView(model)
    state = plays[-1].state
    began = time.perf_counter()
    view.pixels(state.pose, state.levels, 40, 60)
    return {
        "recording": name,
        "coordinates": len(model.coordinates),
        "base parameters": len(state.fit.estimate),
        "frames": plays[-1].frames,
        "frames a second": float(np.median([one.frames_per_second for one in plays])),
        "delay of the filter [s]": plays[-1].identification.delay,
        "a look [ms]": 1e3 * float(np.median(looks)),
        "a picture [ms]": 1e3 * (time.perf_counter() - began),
    }


def made(model: mm.Model) -> LiveRecording:
    """Every coordinate in a sine of its own phase, and a constant force on the base."""
    random = np.random.default_rng(0)
    clock = np.arange(0.0, ALL_SECONDS, 0.01)
    rest = np.array([coordinate.default for coordinate in model.coordinates])
    size = np.where(
        [coordinate.motion == "rotational" for coordinate in model.coordinates], 0.2, 0.01
    )
    values = rest + size * np.sin(
        2.0 * np.pi * clock[:, None] + random.uniform(0.0, 6.0, len(rest))
    )
    ticks = np.arange(0.0, ALL_SECONDS, 0.001)
    zero = np.zeros((len(ticks), 1, 3))
    weight = model.mass * float(np.linalg.norm(model.gravity))
    force = np.tile([0.0, weight, 0.0], (len(ticks), 1, 1))
    wrenches = mm.Wrenches(ticks, ("plate",), (model.body_names[0],), force, zero, zero)
    return LiveRecording(mm.Motion(clock, model.coordinate_names, values), wrenches)
