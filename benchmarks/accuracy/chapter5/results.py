"""Runs of `myomorph run`, and their results beside the truth."""

from __future__ import annotations

import contextlib
import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from myomorph.cli.program import main
from myomorph.model.arrays import Array


def ran(study: Path) -> Path:
    """Results of `myomorph run STUDY` by default options; raises `RuntimeError` with what it printed where it fails."""
    out = study.parent / "results"
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as told:
        status = main(["run", str(study), "--out", str(out)])
    if status:
        raise RuntimeError(f"{study}: {said.getvalue()}{told.getvalue()}")
    return out


def over_limits(home: Path) -> str:
    """Quantities that the report lists first, as they are over their limits."""
    with (home / "quality.csv").open(encoding="utf-8", newline="") as file:
        return "; ".join(row["quantity"] for row in csv.DictReader(file) if row["state"] == "over") or "none"


OF_ARMS = re.compile(r"(^|_)(arm|elbow)_")  # In names of coordinates.


def compared(home: Path, torques: mm.Series, names: Sequence[str], activations: mm.Series) -> dict[str, object]:
    """RMS errors of the arms' torques and of the others beside standard deviations over time of the truth, those of
    activations, and what the report warns of. `names`: of coordinates.
    """
    row: dict[str, object] = {}
    found = mm.read_sto(home / "torques_with_contacts.sto")
    for what in ("arms", "legs and trunk"):
        some = [name for name in names if bool(OF_ARMS.search(name)) == (what == "arms")]
        errors = [at_times(found, f"{name}_moment", torques.time) - torques[name] for name in some]
        row[f"torques of {what}, RMS error [N m]"] = float(np.sqrt(np.nanmean(np.square(errors))))
        row[f"SD of {what} [N m]"] = rms([torques[name] - torques[name].mean() for name in some])
    row |= likeness(mm.read_sto(home / "activations.sto"), activations, activations.names)
    return row | {"over their limits": over_limits(home)}


def at_times(table: mm.Series, name: str, time: Array) -> Array:
    """A column at other times (frames,), NaN outside."""
    return np.interp(time, table.time, table[name], left=np.nan, right=np.nan)


def likeness(table: mm.Series, truth: mm.Series, names: Sequence[str]) -> dict[str, object]:
    """RMS error of activations, and the median over muscles that change of their correlation with the truth."""
    errors, alike = [], []
    for name in names:
        found = at_times(table, name, truth.time)
        known = np.isfinite(found)
        true = truth[name][known]
        errors.append(found[known] - true)
        if np.ptp(true) > 0.05:
            alike.append(np.corrcoef(found[known], true)[0, 1] if np.ptp(found[known]) > 0.0 else 0.0)
    return {
        "activations, RMS": rms(np.concatenate(errors)),
        "activations, median r": float(np.median(alike)),
    }
