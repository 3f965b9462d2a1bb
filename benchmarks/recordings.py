"""Recordings of the data collection by short names: `recordings.toml` names their files, this opens them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import myomorph as mm
from myomorph.io.loads import read_external_loads
from myomorph.io.trc import read_trc


@dataclass(frozen=True)
class Recording:
    """Files of a recording, below the data collection; "" for those that there are not.

    `model`, `generic`: scaled to the subject, and not; `motion`: coordinates that somebody else found; `loads`:
    external loads or a table of forces; `tasks`: weights of markers; `mass`: of the subject [kg].
    """

    model: str
    markers: str = ""
    motion: str = ""
    loads: str = ""
    tasks: str = ""
    generic: str = ""
    mass: float | None = None


RECORDINGS = {
    name: Recording(**files)
    for name, files in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).items()
}


def read_markers(path: Path) -> mm.Markers:
    """The markers of a TRC file."""
    markers = read_trc(path).markers
    assert markers is not None
    return markers


def read_torques(path: Path | None, model: mm.Model, motion: mm.Motion) -> mm.Series:
    """Generalized forces of a motion under the loads of a file, None for no loads."""
    wrenches = None if path is None else mm.resample_wrenches(read_external_loads(path), motion.time)
    return mm.inverse_dynamics(model, motion, wrenches)
