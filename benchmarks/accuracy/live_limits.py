"""Limits that `live` draws beside its frames, against those of the whole recording."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.accuracy.uncertainty import TITLES, command
from myomorph.store.results import Stored, read_result

Row = dict[str, object]

HOME = "rajagopal-walk-emg"
DRAWS = 40
STUDY_FILE = """
[study]
name = "walk"
flat = true
[uncertainty]
draws = {draws}
contributions = 0
[options.id]
cutoff = 6
[[subject]]
name = "person"
model = {model!r}
steps = ["ik", "id", "tension"]
trials = [{{ name = "walk", markers = {markers!r}, loads = {loads!r} }}]
"""
FILES = {"model": "subject_walk_scaled.osim", "markers": "markers_walk.trc", "loads": "grf_walk.xml"}
DIMENSIONS = {"coordinates": "coordinate", "torques": "coordinate", "forces": "muscle"}


def measure(folder: Path) -> Iterator[Row]:
    """Standard deviations of both, of a recorded walk."""
    home = folder / HOME
    files = {name: str(home / file) for name, file in FILES.items()}
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        words = [word for name, path in files.items() for word in (f"--{name}", path)]
        command("live", *words, "--speed", 0, "--draws", DRAWS, "--out", here / "live")
        (here / "study.toml").write_text(STUDY_FILE.format(draws=DRAWS, **files), encoding="utf-8")
        command("run", here / "study.toml", "--out", here / "out")
        live, whole = read_result(here / "live" / "live.nc"), read_result(next((here / "out").rglob("walk.nc")))
    for table, dimension in DIMENSIONS.items():
        yield {"limits of": TITLES[table], **_compared(table, dimension, live, whole)}


def _compared(table: str, dimension: str, live: Stored, whole: Stored) -> Row:
    """Ratios of columns above a hundredth of the table's largest standard deviation."""
    names = [one for one in whole.names[dimension] if one in live.names[dimension]]
    own = [live.names[dimension].index(one) for one in names]
    other = [whole.names[dimension].index(one) for one in names]
    known = np.isfinite(live.values[f"{table}_sd"]).all(axis=1)
    inside = (whole.time >= live.time[known][0]) & (whole.time <= live.time[known][-1])
    found = np.sqrt((live.values[f"{table}_sd"][known][:, own] ** 2).mean(axis=0))
    expected = np.sqrt((whole.values[f"{table}_sd"][inside][:, other] ** 2).mean(axis=0))
    counted = expected > 0.01 * expected.max()
    ratios = found[counted] / expected[counted]
    furthest = int(np.argmax(np.abs(np.log(ratios))))
    return {
        "columns": int(counted.sum()),
        "mean ratio": float(ratios.mean()),
        "within 10 % [%]": 100.0 * float((np.abs(ratios - 1.0) <= 0.1).mean()),
        "within 20 % [%]": 100.0 * float((np.abs(ratios - 1.0) <= 0.2).mean()),
        "furthest": np.array(names)[counted][furthest],
        "its ratio": float(ratios[furthest]),
    }
