"""The force in an instrumented knee, with markers on patellae and without them.

They inform how far the patellae lie from the knees' axes; nothing is fitted to the measured force.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import (
    BODY_WEIGHT,
    PARTS,
    STRIDES,
    STUDY,
    command,
    measured,
)
from benchmarks.errors import rms
from benchmarks.results import Row
from myomorph.core.model.arrays import Array
from myomorph.lab.study.subject.calibrating import PATELLAE

CONTACT_FORCES = "joint_contact_forces.sto"
CHANGES = {
    "left out": ("mass = 75.0\n", 'labels = { LPatella = "", RPatella = "" }\n'),
    "tracked only": ("[options.tension]\n", "[options.calibrate]\npatellae = false\n\n"),
    "used (default)": ("", ""),
}
"""Of the study file that `analyze --prepare` writes: what a line is put before, and the line."""


def measure(folder: Path) -> Iterator[Row]:
    """Error of the left knee's force by `analyze` of both walks' C3D files.

    Rows are of the markers on patellae left out, tracked only, and used.
    """
    recordings = [folder / STUDY / f"{stride}.c3d" for stride in STRIDES]
    for name, (before, line) in CHANGES.items():
        with tempfile.TemporaryDirectory() as work:
            study = Path(work) / "study.toml"
            command("analyze", *recordings, "--mass", 75, "--prepare", "--out", work)
            text = study.read_text(encoding="utf-8").replace(before, line + before, 1)
            study.write_text(text, encoding="utf-8")
            results = Path(work) / "results"
            command("run", study, "--out", results)
            tables = results / "calibration"
            row = patella_line(tables) if (tables / PATELLAE).is_file() else {}
            for stride in STRIDES:
                errors = _errors(folder, results / stride, stride, row)
                yield {"markers on patellae": name, "stride": stride} | errors


def _errors(folder: Path, results: Path, stride: str, patellae: Mapping[str, str]) -> Row:
    """Errors of total, medial and lateral force in body weights, and the patellae's distance."""
    truth, clock = measured(folder, stride)
    forces = mm.read_sto(results / CONTACT_FORCES)
    start = _start(folder / STUDY / f"{stride}.trc")
    row: Row = {}
    for number, part in enumerate(PARTS):
        values = np.interp(clock + start, forces.time, _of_left_knee(forces, part))
        row[f"{part} [BW]"] = rms(values - truth[:, number]) / BODY_WEIGHT
        if part == "total":
            row["peak [BW]"] = float(values.max()) / BODY_WEIGHT
            row["measured peak [BW]"] = float(truth[:, number].max()) / BODY_WEIGHT
    for name in ("farther_mm", "lowest_mm", "highest_mm"):
        title = name.replace("_mm", " [mm]")
        row[title] = float(patellae[name]) if patellae else ""
    return row


def _of_left_knee(forces: mm.Series, part: str) -> Array:
    """(frames,) force of a part of the left knee [N]."""
    name = next(
        name
        for name in forces.names
        if name.startswith(part) and "knee" in name and name.endswith("_l")
    )
    return np.asarray(forces[name])


def _start(path: Path) -> float:
    """When the study's table begins on the clock of the C3D file [s]."""
    with path.open(encoding="utf-8") as lines:
        head = [next(lines).split() for _ in range(3)]
    stated = dict(zip(head[1], head[2], strict=True))
    return (float(stated["OrigDataStartFrame"]) - 1.0) / float(stated["OrigDataRate"])


def patella_line(tables: Path) -> Mapping[str, str]:
    """Read the line on patellae of a calibration."""
    with (tables / PATELLAE).open(encoding="utf-8", newline="") as stream:
        return next(csv.DictReader(stream))
