"""Two feet on one plate: forces of two plates are added up into one, and divided again by `myomorph tension`."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.cli import main
from myomorph.model.arrays import Array
from myomorph.model.series import Table

OPENCAP, RAJAGOPAL = "opencap-subject4-multitask", "rajagopal-walk-emg"
CASES = {
    "walk, Rajagopal": (
        f"{RAJAGOPAL}/subject_walk_scaled.osim", f"{RAJAGOPAL}/coordinates.sto",
        f"{RAJAGOPAL}/grf_walk.xml", (0.6, 1.4),
    ),
    "walk, OpenCap": (
        f"{OPENCAP}/models/manually_scaled.osim", f"{OPENCAP}/ik_manual_scaling/walking1_ik.mot",
        f"{OPENCAP}/grf/walking1_external_forces.xml", (0.3, 1.2),
    ),
    "sit to stand, OpenCap": (
        f"{OPENCAP}/models/manually_scaled.osim", f"{OPENCAP}/ik_manual_scaling/STS1_ik.mot",
        f"{OPENCAP}/grf/STS1_external_forces.xml", (1.0, 6.0),
    ),
}  # fmt: skip
"""Model, coordinates, forces of two plates, and the time [s]."""
WAYS = {"nearest foot": (), "shared": ("--contacts", "auto", "--measured", "shared")}
LOADED = 20.0
"""Force from which on there is a center of pressure [N]."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Rows: errors of each foot's force and of activations, against those of two plates."""
    for name, (model_file, motion_file, loads_file, span) in CASES.items():
        model = mm.read_model(folder / model_file)
        motion = mm.read_motion(folder / motion_file, model)
        plates = mm.read_loads(folder / loads_file, model, motion)
        common = ("--model", folder / model_file, "--motion", folder / motion_file, "--cutoff", 6, "--time", *span)
        with tempfile.TemporaryDirectory() as place:
            home = Path(place)
            one = home / "one.mot"
            mm.write_sto(_added(plates), one)
            truth = _tension(home / "truth", *common, "--loads", folder / loads_file)
            for way, more in WAYS.items():
                activations = _tension(home / "found", *common, "--loads", one, *more)
                found = mm.read_loads(home / "found" / "contact_forces.xml" if more else one, model, motion)
                row: dict[str, object] = {"recording": name, "one plate's force": way}
                for side in ("right", "left"):
                    error = _foot(found, side, truth.time) - _foot(plates, side, truth.time)
                    row[f"{side}, vertical, RMS [N]"] = float(np.sqrt(np.mean(error[:, 1] ** 2)))
                    row[f"{side}, fore-aft, RMS [N]"] = float(np.sqrt(np.mean(error[:, 0] ** 2)))
                row["activations, RMS"] = float(np.sqrt(np.mean((activations.values - truth.values) ** 2)))
                yield row


def _tension(out: Path, *typed: object) -> Table:
    """Activations of the command."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert main(["tension", "--out", str(out), *map(str, typed)]) == 0
    return mm.read_sto(out / "activations.sto")


def _added(plates: mm.Wrenches) -> Table:
    """The force of all plates as one plate at height 0 would have it."""
    forces, points, torques = (np.nan_to_num(part) for part in (plates.forces, plates.points, plates.torques))
    force, moment = forces.sum(axis=1), (torques + np.cross(points, forces)).sum(axis=1)
    loaded = force[:, 1] > LOADED
    vertical = np.where(loaded, force[:, 1], 1.0)
    center = np.stack([moment[:, 2] / vertical, np.zeros(len(force)), -moment[:, 0] / vertical], axis=1)
    values = np.hstack([force, center, moment - np.cross(center, force)]) * loaded[:, None]
    names = [f"ground_{part}{axis}" for part in ("force_v", "force_p", "torque_") for axis in "xyz"]
    return Table(plates.time, tuple(names), values)


def _foot(wrenches: mm.Wrenches, side: str, time: Array) -> Array:
    """(frames, 3) force on a foot [N]."""
    columns = [k for k, body in enumerate(wrenches.bodies) if body.endswith(f"_{side[0]}")]
    force = np.nan_to_num(wrenches.forces[:, columns]).sum(axis=1)
    return np.stack([np.interp(time, wrenches.time, part) for part in force.T], axis=1)
