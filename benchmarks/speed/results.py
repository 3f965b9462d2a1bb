"""Writing the NetCDF file of a trial: our writer beside h5netcdf, which xarray uses.

`python -m benchmarks results`: one file of 30 frames and one of a whole walk, read once and written by both in turn.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

import myomorph as mm
from benchmarks.speed.study import write_study
from benchmarks.speed.timing import alternate
from data_collection import data_folder
from myomorph.store.netcdf import new_netcdf, open_netcdf

WALK = """[study]
name = "walk"
[[subject]]
name = "s01"
model = '{folder}/ref_ik/subject01_simbody.osim'
trials = ["{folder}/experiment/subject01_walk1.trc"]
steps = ["ik", "id"]
"""
Variable = tuple[str, tuple[str, ...], Any, dict[str, Any]]


def run() -> list[dict[str, object]]:
    """A row a file."""
    with tempfile.TemporaryDirectory() as made:
        home = Path(made)
        short = mm.read_plan(write_study(home, 1, few=1))
        (home / "walk.toml").write_text(WALK.format(folder=(data_folder() / "opensim-gait-subject01").as_posix()))
        plans = {"30 frames": short, "a whole walk": mm.read_plan(home / "walk.toml")}
        return [compared(name, plan, home / name) for name, plan in plans.items()]


def compared(name: str, plan: Any, out: Path) -> dict[str, object]:
    """Milliseconds of both writers, and their ratio."""
    (outcome,) = mm.run_study(plan, out)
    if outcome.error:
        raise RuntimeError(outcome.error)
    (path,) = (path for path in out.rglob("*.nc") if ".steps" not in path.parts)
    with open_netcdf(path) as source:
        variables = [
            (one.name, source.dimensions_of(one), np.array(one.values[...]), one.told) for one in source.variables()
        ]
        attributes = dict(source.attributes)
    sizes = {d: n for _, dims, values, _ in variables for d, n in zip(dims, values.shape, strict=True)}
    writers = {"ours": with_ours, "h5netcdf": with_h5netcdf}
    seconds = alternate(
        {name: partial(write, out / f"{name}.nc", sizes, variables, attributes) for name, write in writers.items()}, 15
    )
    return {
        "file": name,
        "variables": len(variables),
        "size [kB]": path.stat().st_size / 1e3,
        **{f"{name} [ms]": 1e3 * taken for name, taken in seconds.items()},
        "times faster": seconds["h5netcdf"] / seconds["ours"],
    }


def with_ours(path: Path, sizes: dict[str, int], variables: list[Variable], attributes: dict[str, str]) -> None:
    """Write the file with the package's writer."""
    with new_netcdf(path) as file:
        file.dimensions |= sizes
        file.attributes |= attributes
        for name, dimensions, values, told in variables:
            file.tell(file.variable(name, dimensions, values.dtype, values), told)


def with_h5netcdf(path: Path, sizes: dict[str, int], variables: list[Variable], attributes: dict[str, str]) -> None:
    """Write the same file with h5netcdf."""
    with h5netcdf.File(path, "w") as file:
        file.dimensions = sizes
        file.attrs.update(attributes)
        for name, dimensions, values, told in variables:
            file.create_variable(name, dimensions, data=values).attrs.update(told)
