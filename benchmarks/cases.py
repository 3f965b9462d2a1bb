"""The recordings and models that comparisons with OpenSim run on, all from the data collection."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.recordings import RECORDINGS


@dataclass(frozen=True)
class MarkerCase:
    """A model and a marker recording, with OpenSim's task set where there is one."""

    name: str
    model: str
    markers: str
    tasks: str = ""
    most_frames: int = 200


@dataclass(frozen=True)
class ForceCase:
    """A model, a motion and external loads ("" for none), cut to [start, end] seconds."""

    name: str
    model: str
    motion: str
    loads: str = ""
    start: float = -1e9
    end: float = 1e9


def _markers(name: str, recording: str, most_frames: int = 200) -> MarkerCase:
    files = RECORDINGS[recording]
    return MarkerCase(name, files.model, files.markers, files.tasks, most_frames)


def _forces(name: str, recording: str, end: float = 1e9, start: float = -1e9, loads: bool = True) -> ForceCase:
    files = RECORDINGS[recording]
    return ForceCase(name, files.model, files.motion, files.loads if loads else "", start, end)


MARKER_CASES = (
    _markers("gait2354 walk, simulated markers", "gait2354-made"),
    _markers("gait2354 walk", "gait2354"),
    _markers("Rajagopal walk", "rajagopal"),
    _markers("OpenCap walking1", "opencap-walk"),
    _markers("OpenCap STS1", "opencap-rise"),
    _markers("OpenCap DJ1", "opencap-jump"),
    _markers("OpenCap static1", "opencap-static"),
    _markers("Hamner run200 (unscaled model)", "run-2"),
    _markers("Hamner run500 (unscaled model)", "run-5"),
    _markers("wholebody static", "wholebody", 50),
    _markers("520 muscles, static", "cyclist", 5),
)
FORCE_CASES = (
    _forces("gait2354 walk", "gait2354-dynamics"),
    _forces("Rajagopal walk", "rajagopal", 1.0, 0.5),
    _forces("OpenCap walking1", "opencap-walk"),
    _forces("OpenCap STS1", "opencap-rise", 3.0),
    _forces("OpenCap DJ1", "opencap-jump", 3.0),
    _forces("walk with EMG, 80 muscles (no loads)", "treadmill", 3.0, loads=False),
    _forces("gait2392 treadmill (no loads)", "gait2392", 3.0, loads=False),
    _forces("arm26", "arm26"),
    _forces("thoracoscapular shoulder, loop ignored (no loads)", "shoulder", 3.0),
)
