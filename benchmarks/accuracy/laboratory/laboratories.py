"""`myomorph analyze` on recordings of many laboratories in public repositories, as published.

They lie in a folder that the environment variable MYOMORPH_LABORATORIES names, as OWNER+NAME/PATH
for the file PATH of the repository OWNER/NAME on GitHub; those that are absent are left out.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import myomorph as mm
from benchmarks.errors import rms_known
from myomorph.core.motion.protocols import recognize
from myomorph.lab.cli import main

Row = dict[str, object]
FOLDER = "MYOMORPH_LABORATORIES"
TABLE = Path(__file__).with_suffix(".csv")
GUESSED = 70.0
"""Mass where neither the set nor its plates say one [kg]."""
ANGLES = {"hip_flexion": (-50.0, 130.0), "knee_angle": (-25.0, 160.0), "ankle_angle": (-70.0, 55.0)}
"""Angles that people reach [deg]."""
MOMENT = 6.0
"""Net flexion moments in walking and running stay below this [N m/kg]."""
ERROR = 0.03
"""Root mean square of markers beyond which a fit says little [m]."""


class Recording(NamedTuple):
    """A recording of a repository.

    It has its files, the part that is used [s], and the mass of the set [kg], None for guessed.
    """

    laboratory: str
    repository: str
    file: str
    static: str = ""
    span: tuple[float, float] | None = None
    mass: float | None = None


def recordings() -> list[Recording]:
    """Those of `laboratories.csv`."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [
            Recording(
                laboratory=row["laboratory"],
                repository=row["repository"],
                file=row["file"],
                static=row["static"],
                span=(float(row["begin"]), float(row["end"])) if row["end"] else None,
                mass=float(row["mass"]) if row["mass"] else None,
            )
            for row in csv.DictReader(file)
        ]


def measure() -> Iterator[Row]:
    """Yield a row for each recording.

    It has the labels known, what `analyze` ends with, and whether the result can be a person's.
    """
    home = os.environ.get(FOLDER)
    for recording in recordings() if home is not None else ():
        folder = Path(home or "") / recording.repository.replace("/", "+")
        if (folder / recording.file).is_file():
            row = _row(recording, folder)
            print(
                f"{recording.laboratory}: {row['ends with']}, {row['time [s]']:.0f} s", flush=True
            )
            yield row


def _row(recording: Recording, folder: Path) -> Row:
    names = mm.read_recording(folder / recording.file).markers
    recognized = recognize(names.names if names is not None else ())
    row: Row = {
        "laboratory": recording.laboratory,
        "recording": f"{recording.repository}: {recording.file}",
        "static trial": Path(recording.static).name,
        "labels": len(recognized.sites) + len(recognized.unknown),
        "known": len(recognized.sites),
        "label set": recognized.protocol.title if recognized.protocol else "",
    }
    typed = _typed(recording, folder)
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "out"
        status, printed = _run([*typed, "--out", str(out)])
        guessed = status != 0 and "--mass" in printed.splitlines()[-1]
        if guessed:
            status, printed = _run([*typed, "--mass", f"{GUESSED:g}", "--out", str(out)])
        row |= {
            "time [s]": time.monotonic() - started,
            "ends with": {0: "report", 2: "one line"}.get(status, f"exit {status}"),
        }
        row |= _result(out) if status == 0 else {"implausible": ""}
        printed = printed.replace(str(folder), "").replace(name, "")
    if guessed:
        row["mass"] = "guessed"
    elif recording.mass:
        row["mass"] = "of the set"
    else:
        row["mass"] = "of the plates"
    findings = printed.partition("study file, ")[2].splitlines()
    row["warnings"] = sum(line.startswith("  ") for line in findings)
    row["message"] = _said(printed, status)
    return row


def _typed(recording: Recording, folder: Path) -> list[str]:
    """Return the command for a recording, without `--out`."""
    typed = ["analyze", str(folder / recording.file), "--workers", "1"]
    if recording.static:
        typed += ["--static", str(folder / recording.static)]
    if recording.span is not None:
        typed += ["--time", *(f"{second:g}" for second in recording.span)]
    if recording.mass is not None:
        typed += ["--mass", f"{recording.mass:g}"]
    return typed


def _said(printed: str, status: int) -> str:
    """Return the last line of a command that failed, else what it found of labels and mass."""
    lines = [line.strip() for line in printed.splitlines()]
    parts = [line for line in lines if "marker protocol" in line or "Nobody moves" in line]
    return " ".join(lines[-1:] if status else parts).removeprefix("error: ")[:300]


def _run(typed: list[str]) -> tuple[int, str]:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            status = main(typed)
        # What a user would see as a traceback is a row too.
        except Exception as error:
            return 1, f"{said.getvalue()}\n{type(error).__name__}: {error}"
    return status, said.getvalue()


def _result(out: Path) -> Row:
    """Return how well the markers fit, ranges of angles and largest moments.

    The row shows which of them no person has.
    """
    (trial,) = mm.load(out).values()
    assert trial.fit is not None
    assert trial.motion is not None
    assert trial.torques is not None
    mass = mm.read_model(out / "calibrated.osim").mass
    error = rms_known(trial.fit.marker_error)
    odd = ["markers"] if error > ERROR else []
    row: Row = {"markers, RMS [mm]": 1e3 * error}
    for joint, (low, high) in ANGLES.items():
        angles = np.degrees([trial.motion[f"{joint}_{side}"] for side in "rl"])
        moment = (
            max(float(np.nanmax(np.abs(trial.torques[f"{joint}_{side}"]))) for side in "rl") / mass
        )
        row[f"{joint} [deg]"] = f"{np.nanmin(angles):.0f} to {np.nanmax(angles):.0f}"
        row[f"{joint}, largest [N m/kg]"] = moment
        if np.nanmin(angles) < low or np.nanmax(angles) > high:
            odd.append(joint)
        if moment > MOMENT:
            odd.append(f"{joint} moment")
    return {**row, "implausible": ", ".join(odd)}
