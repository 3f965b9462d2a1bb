"""A study of many short trials: recordings of the data collection, cut, repeated and perturbed, and marked as such."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.recordings import RECORDINGS, Recording, read_markers
from data_collection import data_folder

FRAMES = 24
OFFSET, NOISE = 2e-3, 5e-4
"""Standard deviation of what is added to each marker for a whole trial, and to each frame [m]."""


@dataclass(frozen=True)
class Source:
    """A recording of the collection that trials are made of.

    `start`, `end`: between which its forces are known [s]; `share`: of the trials of a study; `report`: whether its
    trials get a page each, which takes as long as all other steps.
    """

    name: str
    files: Recording
    table: str
    start: float
    end: float
    share: float
    report: bool = False


SOURCES = (
    Source("gait", RECORDINGS["gait2354"], "subject01_walk1_grf.mot", 0.5, 1.9, 0.5),
    Source("rajagopal", RECORDINGS["rajagopal"], "grf_walk.mot", 0.6, 1.8, 0.3),
    Source("opencap", RECORDINGS["opencap-walk"], "walking1_grf.mot", 0.2, 1.1, 0.2, True),
)


def make_study(folder: Path, trials: int) -> Path:
    """Write models, forces, perturbed recordings and the study file; returns this.

    Which frames a trial has and what is added to its markers follows from its number alone.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parts = ['[study]\nname = "recordings repeated and perturbed, not measured"\n']
    for number, source in enumerate(SOURCES):
        loads = data_folder() / source.files.loads
        for path in (data_folder() / source.files.model, loads, loads.with_name(source.table)):
            shutil.copyfile(path, folder / path.name)
        markers = read_markers(data_folder() / source.files.markers)
        rows = []
        for trial in range(max(1, round(trials * source.share))):
            name = f"made_{source.name}_{trial + 1:03d}"
            _write_trial(markers, source, np.random.default_rng((number, trial)), folder / f"{name}.trc")
            rows.append(f'    {{markers = "{name}.trc", loads = "{loads.name}"}},')
        steps = '"ik", "id", "muscles", "tension"' + (', "report"' if source.report else "")
        table = [
            f'[[subject]]\nname = "{source.name}"\nmodel = "{Path(source.files.model).name}"',
            f"steps = [{steps}]",
        ]
        parts.append("\n".join((*table, "trials = [", *rows, "]\n")))
    path = folder / "study.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def _write_trial(markers: mm.Markers, source: Source, random: np.random.Generator, path: Path) -> None:
    inside = np.flatnonzero((markers.time >= source.start) & (markers.time <= source.end))
    first = inside[0] + random.integers(len(inside) - FRAMES)
    rows = slice(first, first + FRAMES)
    moved = markers.values[rows] + random.normal(0.0, OFFSET, markers.values.shape[1:])
    values = moved + random.normal(0.0, NOISE, moved.shape)
    mm.write_trc(replace(markers, time=markers.time[rows], values=values), path)
