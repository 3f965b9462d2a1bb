"""Frames that live identification can take in a second, and what a look at the estimate costs.

`python -m benchmarks live`: a real walk and a drop jump from markers, pose by pose, and the 171-coordinate model from
made coordinates at 100 Hz with forces at 1000 Hz. Frames are played as fast as they go, nothing is shown.
"""

from __future__ import annotations

import time

import numpy as np
from threadpoolctl import threadpool_limits

import myomorph as mm
from data_collection import data_folder
from myomorph.identify.online import OnlineOptions
from myomorph.live.identification import LiveResult, identify_frames
from myomorph.live.sources import LiveRecording, Replay, open_recording
from myomorph.report.scene.body_view import BodyView

ROUNDS = 3
SECONDS = 20.0
"""Of the made motion [s]."""

Row = dict[str, object]


def run() -> list[Row]:
    """One row a recording."""
    data = data_folder()
    subject = data / "opencap-subject4-multitask"
    model = mm.read_model(subject / "models/manually_scaled.osim")
    rows = []
    for trial in ("walking1", "DJ1"):
        loads = subject / f"grf/{trial}_external_forces.xml"
        recording = open_recording(model, subject / f"markers/{trial}.trc", loads)
        rows.append(measured(f"{trial}, markers", model, recording))
    whole = mm.read_model(data / "fullbody-many-muscles/cyclistFullBodyMuscle.osim")
    return [*rows, measured("made motion, coordinates", whole, made(whole))]


def measured(name: str, model: mm.Model, recording: LiveRecording) -> Row:
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
    view, state = BodyView(model), plays[-1].state
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
    clock = np.arange(0.0, SECONDS, 0.01)
    rest = np.array([coordinate.default for coordinate in model.coordinates])
    size = np.where([coordinate.motion == "rotational" for coordinate in model.coordinates], 0.2, 0.01)
    values = rest + size * np.sin(2.0 * np.pi * clock[:, None] + random.uniform(0.0, 6.0, len(rest)))
    ticks = np.arange(0.0, SECONDS, 0.001)
    zero = np.zeros((len(ticks), 1, 3))
    weight = model.mass * float(np.linalg.norm(model.gravity))
    force = np.tile([0.0, weight, 0.0], (len(ticks), 1, 1))
    wrenches = mm.Wrenches(ticks, ("plate",), (model.body_names[0],), force, zero, zero)
    return LiveRecording(mm.Motion(clock, model.coordinate_names, values), wrenches)
