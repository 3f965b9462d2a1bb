"""A study of two recorded walks as a dataset of BIDS.

The tables have what its validator reports, and how exactly it is read back.
"""

from __future__ import annotations

import functools
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from data_collection import data_folder
from myomorph.exchange.bids.dataset import export_bids, read_bids
from myomorph.lab.study.inputs.emg_files import channels_of

Row = dict[str, object]

IMPLANT = "knee-implant-walk"
ADULT = "rajagopal-walk-emg"
DRAWS = 4
STUDY = f"""[study]
name = "two walks"
[[subject]]
name = "implant"
model = "{{data}}/{IMPLANT}/scaled.osim"
emg_side = "left"
steps = ["ik", "id", "tension"]
[[subject.trials]]
markers = "{{data}}/{IMPLANT}/walk1.c3d"
loads = "{{data}}/{IMPLANT}/walk1.c3d"
emg = "{{data}}/{IMPLANT}/walk1.c3d"
time = [5.5, 5.7]
[[subject]]
name = "adult"
model = "{{data}}/{ADULT}/subject_walk_scaled.osim"
steps = ["ik", "id", "tension", "uncertainty"]
[[subject.trials]]
markers = "{{data}}/{ADULT}/markers_walk.trc"
loads = "{{data}}/{ADULT}/grf_walk.xml"
emg = "{{data}}/{ADULT}/electromyography.sto"
time = [0.6, 0.8]
[options.uncertainty]
draws = {DRAWS}
"""
"""Short parts of two recordings: what is compared is files, not results."""
VALIDATOR = ("-c", "import bids_validator_deno; bids_validator_deno.cli()")
TABLES = {
    "angles": ("coordinate_value", "rad, m"),
    "torques": ("generalized_force", "N m, N"),
    "tensions": ("muscle_force", "N"),
    "activations": ("activation", "1"),
}
LIMITS = {"torques": ("generalized_force", "N m, N"), "forces": ("muscle_force", "N")}
"""Words of the table, and the quantity that each is of."""


@functools.cache
def _rows() -> tuple[list[Row], list[Row]]:
    """Rows of what is read back, and of the validator."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "study.toml").write_text(STUDY.format(data=data_folder()), encoding="utf-8")
        outcomes = mm.run_study(mm.read_plan(folder / "study.toml"), folder / "results")
        assert not any(outcome.error for outcome in outcomes), [
            outcome.error for outcome in outcomes
        ]
        notes = export_bids(folder / "results", folder / "dataset")
        assert not notes, notes
        return list(_read_back(folder)), list(_validated(folder / "dataset"))


def measure() -> list[Row]:
    """Compare what was computed or recorded with what is read back.

    The rows have the largest difference of each kind of table.
    """
    return _rows()[0]


def measure_validator() -> list[Row]:
    """Errors and warnings of the validator."""
    return _rows()[1]


def _read_back(folder: Path) -> Iterator[Row]:
    results = mm.load(folder / "results")
    trials = read_bids(folder / "dataset")
    for name, result in results.items():
        trial = trials[name]
        stored = result.stored
        for table, (variable, unit) in TABLES.items():
            yield _row(name, table, stored.values[variable], trial.derived[variable].values, unit)
        for table, (drawn, unit) in LIMITS.items():
            if f"{drawn}_intervals" in trial.derived:
                limits = np.hstack(
                    [stored.values[f"{drawn}_{part}"] for part in ("low", "high", "sd")]
                )
                found = trial.derived[f"{drawn}_intervals"].values
                yield _row(name, f"limits of {table}", limits, found, unit)
        sources = {
            source.role: source.name
            for source in stored.provenance["tension"].sources
            if "." in source.name
        }
        recorded = mm.read_recording(sources["markers"]).markers
        markers = trial.recording.markers
        # Those of a C3D file are turned, y upwards: distances between markers stay.
        yield _row(name, "markers, from their mean", _distances(recorded), _distances(markers), "m")
        emg = channels_of(sources["emg"])
        columns = [emg.names.index(channel) for channel in trial.emg.names]
        values = emg.values[:, columns]
        share = np.abs(values).max(axis=0)
        yield _row(
            name,
            "EMG, over the largest of its channel",
            values / share,
            trial.emg.values / share,
            "1",
        )


def _distances(markers: mm.Markers) -> np.ndarray:
    return np.linalg.norm(
        markers.values - np.nanmean(markers.values, axis=1, keepdims=True), axis=2
    )


def _row(trial: str, table: str, values: np.ndarray, back: np.ndarray, unit: str) -> Row:
    assert np.array_equal(np.isnan(values), np.isnan(back)), (trial, table)
    return {
        "trial": trial,
        "table": table,
        "values": values.size,
        "unit": unit,
        "largest value": float(np.nanmax(np.abs(values))),
        "largest difference": float(np.nanmax(np.abs(values - back))),
    }


def _validated(dataset: Path) -> Iterator[Row]:
    program = [
        sys.executable,
        *VALIDATOR,
        str(dataset),
        "--format",
        "json",
        "--recursive",
        "--max-rows",
        "-1",
    ]
    said = json.loads(subprocess.run(program, capture_output=True, text=True, check=False).stdout)
    for part, found in {
        "recordings": said,
        "derivatives": said["derivativesSummary"]["/derivatives/myomorph/"],
    }.items():
        issues = found["issues"]["issues"]
        kinds = sorted({issue["code"] for issue in issues if issue["severity"] == "warning"})
        yield {
            "part": part,
            "files": found["summary"]["totalFiles"],
            "errors": sum(issue["severity"] == "error" for issue in issues),
            "warnings": sum(issue["severity"] == "warning" for issue in issues),
            "of": ", ".join(kinds),
        }
