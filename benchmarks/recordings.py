"""Recordings of the data collection by short names.

`recordings.toml` names their files, this opens them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import myomorph as mm
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.trc import read_trc


@dataclass(frozen=True)
class Recording:
    """Files of a recording, below the data collection; "" for those that there are not.

    `model`, `generic`: scaled to the subject, and not; `motion`: coordinates that somebody else
    found; `loads`: external loads or a table of forces; `tasks`: weights of markers; `mass`: of the
    subject [kg].
    """

    model: str
    markers: str = ""
    motion: str = ""
    loads: str = ""
    tasks: str = ""
    generic: str = ""
    mass: float | None = None


RECORDINGS = {
    name: replace(Recording(model=files["model"]), **files)
    for name, files in tomllib.loads(
        Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    ).items()
}


def read_markers(path: Path) -> mm.Markers:
    """Read the markers of a TRC file."""
    markers = read_trc(path).markers
    assert markers is not None
    return markers


def read_torques(path: Path | None, model: mm.Model, motion: mm.Motion) -> mm.Series:
    """Generalized forces of a motion under the loads of a file, None for no loads."""
    wrenches = (
        None if path is None else mm.resample_wrenches(read_external_loads(path), motion.time)
    )
    return mm.inverse_dynamics(model, motion, wrenches)


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
    return MarkerCase(
        name=name,
        model=files.model,
        markers=files.markers,
        tasks=files.tasks,
        most_frames=most_frames,
    )


def _forces(
    name: str, recording: str, end: float = 1e9, start: float = -1e9, loads: bool = True
) -> ForceCase:
    files = RECORDINGS[recording]
    return ForceCase(
        name=name,
        model=files.model,
        motion=files.motion,
        loads=files.loads if loads else "",
        start=start,
        end=end,
    )


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
