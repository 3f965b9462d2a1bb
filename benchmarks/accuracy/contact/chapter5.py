"""Chapter 5 of [D], with simulated files whose truth is known.

`myomorph demo` writes the files and `myomorph run` runs them. The results are compared with the
truth.
"""

from __future__ import annotations

import contextlib
import csv
import io
import re
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from myomorph.core.io.contact_events import read_events
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.arrays import Array
from myomorph.lab.cli.program import main
from myomorph.show.demo.performances import Written, contact_rows, write_performance
from myomorph.show.simulate.performances import STICK_OF

Row = dict[str, object]
OF_ARMS = re.compile(r"(^|_)(arm|elbow)_")  # In names of coordinates.


@cache
def ran(name: str) -> tuple[Written, Path]:
    """Run a demonstration, and return it with the folder of its results by default options.

    Raises
    ------
    RuntimeError
        where a command fails, with what it printed
    """
    written = write_performance(name, Path(tempfile.mkdtemp(prefix="chapter5_")))
    out = written.study.parent / "results"
    with (
        contextlib.redirect_stdout(io.StringIO()) as said,
        contextlib.redirect_stderr(io.StringIO()) as told,
    ):
        status = main(["run", str(written.study), "--out", str(out)])
    if status:
        raise RuntimeError(f"{name}: {said.getvalue()}{told.getvalue()}")
    return written, out


def measured(name: str) -> Iterator[Row]:
    """Truth and error of each contact's force; torques and activations once."""
    written, out = ran(name)
    rest = compared(out / written.results, written)
    for index, row in enumerate(contact_rows(written, out)):
        yield row | (rest if index == 0 else {})


def measure_judo() -> Iterator[Row]:
    """Measure the force of each foot and grip, and torques and activations of both fighters."""
    yield from measured("judo")


def measure_taichi() -> Iterator[Row]:
    """Each foot's force where one plate measured both together."""
    yield from measured("taichi")


def measure_tap() -> Iterator[Row]:
    """Measure the force of each end of each foot."""
    yield from measured("tap")


def measure_drum() -> Iterator[Row]:
    """Strokes, their times and impulses as they reach the forearm; torques; feet without plates."""
    written, out = ran("drum")
    home = out / written.results
    touches = [
        touch
        for touch in read_events(home / "contacts.csv").intervals
        if touch.site.startswith("stick")
    ]
    loads = read_external_loads(home / "contact_forces.xml")
    for name, side in STICK_OF.items():
        on = loads.bodies.index(f"forearm_{side}")
        mine = [stroke for stroke in written.strokes if stroke[0] == name]
        late = []
        share = []
        for _, at, impulse, known in mine:
            starts = [touch.start - at for touch in touches if touch.site == f"stick_{side}"]
            near = [start for start in starts if abs(start) < 0.05]
            if near:
                late.append(min(near, key=abs))
                span = np.abs(loads.time - at) < 0.2
                estimate = np.trapezoid(loads.forces[span, on, 1], loads.time[span])
                if not known:
                    share.append(estimate / impulse - 1.0)
        yield {
            "contact": f"stick on the {name}",
            "strokes": len(mine),
            "found": len(late),
            "late, RMS [ms]": 1e3 * rms(late),
            "impulse not known before, median error [%]": 100.0 * float(np.median(np.abs(share))),
            "largest [%]": 100.0 * float(np.max(np.abs(share))),
        }
    yield from measured("drum")


def compared(home: Path, written: Written) -> Row:
    """Compare torques and activations with the truth, and count what the report warns of.

    RMS errors of the arms' torques and of the others stand next to standard deviations over time of
    the truth.
    """
    row: Row = {}
    torques = written.torques
    table = mm.read_sto(home / "torques_with_contacts.sto")
    for what in ("arms", "legs and trunk"):
        some = [name for name in torques.names if bool(OF_ARMS.search(name)) == (what == "arms")]
        errors = [_found(table, name, torques.time) - torques[name] for name in some]
        row[f"torques of {what}, RMS error [N m]"] = float(np.sqrt(np.nanmean(np.square(errors))))
        row[f"SD of {what} [N m]"] = rms([torques[name] - torques[name].mean() for name in some])
    row |= likeness(mm.read_sto(home / "activations.sto"), written.activations)
    with (home / "quality.csv").open(encoding="utf-8", newline="") as file:
        over = (
            "; ".join(row["quantity"] for row in csv.DictReader(file) if row["state"] == "over")
            or "none"
        )
    return row | {"over their limits": over}


def _found(table: mm.Series, name: str, time: Array) -> Array:
    """Return a coordinate's force or torque, by OpenSim's column, at other times (frames,)."""
    column = f"{name}_moment" if f"{name}_moment" in table.names else f"{name}_force"
    return at_times(table, column, time)


def at_times(table: mm.Series, name: str, time: Array) -> Array:
    """Interpolate a column at other times, NaN outside.

    Parameters
    ----------
    table : that has the column
    name : of the column
    time : (frames,) other times [s]

    Returns
    -------
    (frames,) in the unit of the column
    """
    return np.interp(time, table.time, table[name], left=np.nan, right=np.nan)


def likeness(table: mm.Series, truth: mm.Series) -> Row:
    """Compare activations with the truth.

    The row has their RMS error, and the median of their correlation with the truth over muscles
    that change.
    """
    errors = []
    alike = []
    for name in truth.names:
        estimate = at_times(table, name, truth.time)
        known = np.isfinite(estimate)
        true = truth[name][known]
        errors.append(estimate[known] - true)
        if np.ptp(true) > 0.05:
            alike.append(
                np.corrcoef(estimate[known], true)[0, 1] if np.ptp(estimate[known]) > 0.0 else 0.0
            )
    return {
        "activations, RMS": rms(np.concatenate(errors)),
        "activations, median r": float(np.median(alike)),
    }
