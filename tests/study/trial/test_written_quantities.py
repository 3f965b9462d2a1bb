"""Laws of what a run writes: declared quantities and nothing else, under one name everywhere."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from docs_build.quantities import result_table

import myomorph as mm
from myomorph.core.io.sto import read_sto
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.quantities import get_quantity
from myomorph.lab.store.results import read_result
from myomorph.lab.study.step.step import declared_quantities
from myomorph.lab.study.step.step_table import STEPS

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = [{steps}]
[options.tension]
tendons = "{tendons}"
passive = true
reactions = "child"
"""
DRAWS = "[uncertainty]\ndraws = 4\ncontributions = 2\n"


def run(arm, steps, tendons="rigid", more=""):
    path = arm.folder / "study.toml"
    words = ", ".join(f'"{step}"' for step in steps)
    path.write_text(STUDY.format(steps=words, tendons=tendons) + more, encoding="utf-8")
    (outcome,) = mm.run_study(mm.read_plan(path), arm.out)
    assert outcome.error == ""
    return arm.out / "s01" / "reach"


@pytest.fixture
def home(arm):
    return run(arm, ("ik", "id", "muscles", "tension"), "elastic", DRAWS)


def test_nothing_is_written_that_no_declaration_names(home):
    declared = {quantity.name: quantity for quantity in declared_quantities()}
    declared |= {
        each.name: each for quantity in declared_quantities() for each in quantity.intervals
    }
    axes = {axis for quantity in declared.values() for axis in quantity.stored_dims}
    stored = read_result(home / "reach.nc")
    with open_netcdf(home / "reach.nc") as file:
        written = {one.name: (one.dimensions, one.told) for one in file.variables()}
    assert len(written) > 40
    assert set(written) <= set(declared) | axes
    for name, (dimensions, told) in written.items():
        quantity = declared.get(name)
        if quantity is None or quantity.kind == "text":
            continue
        assert dimensions == quantity.stored_dims, name
        assert told["units"] == quantity.unit, name
        assert np.array_equal(
            get_quantity(stored, quantity), quantity.restored(stored.values[name]), equal_nan=True
        )


def test_every_table_has_the_name_that_is_declared(home):
    files = {quantity.file for quantity in declared_quantities() if quantity.file}
    bounds = {
        f"{quantity.stem}_{bound}{quantity.suffix}"
        for quantity in declared_quantities()
        for bound in ("low", "high")
        if quantity.drawn
    }
    tables = {path.name for path in home.rglob("*.*") if path.suffix in (".sto", ".mot")}
    arms = {name for name in tables if name.startswith("moment_arms_")}
    assert arms
    assert tables - arms <= files | bounds
    assert {"forces.sto", "forces_low.sto", "joint_reactions_high.sto", "torques.sto"} <= tables


def test_values_and_files_have_the_same_names_axes_and_units(home):
    pytest.importorskip("xarray")
    (result,) = mm.load(home).values()
    whole = result.to_xarray()
    parts = (
        result.fit,
        result.motion,
        result.torques,
        result.wrenches,
        result.tension,
        result.markers,
    )
    for part in (part for part in parts if part is not None):
        dataset = part.to_xarray()
        # Viscous force that is 0 throughout is in no file.
        assert set(dataset) - {"muscle_viscous_force"} <= set(whole)
        for name in set(dataset) & set(whole):
            assert dataset[name].dims == whole[name].dims, name
            assert dataset[name].attrs["units"] == whole[name].attrs["units"], name
            values = whole[name].values
            np.testing.assert_array_equal(dataset[name].values.astype(values.dtype), values)
    frame = result.tension.to_pandas()
    assert {"activation", "muscle_force", "fiber_length"} <= set(frame.columns.get_level_values(0))


def test_a_quantity_of_one_file_is_in_store_tables_values_and_docs(arm, monkeypatch):
    """`power_step.py` declares `joint_power`; nothing else knows it."""
    assert "joint_power" not in result_table()
    monkeypatch.setitem(STEPS["trial"], "power", "tests.study.trial.power_step")
    home = run(arm, ("ik", "id", "power"))
    stored = read_result(home / "reach.nc")
    power = stored.values["joint_power"]
    table = read_sto(home / "joint_power.sto")
    np.testing.assert_allclose(table.values, power, rtol=1e-6, atol=1e-9)
    with (home / "values.csv").open(encoding="utf-8") as stream:
        rows = {row["quantity"]: row for row in csv.DictReader(stream)}
    peak = rows["elbow_flexion_power, maximum"]
    column = stored.names["coordinate"].index("elbow_flexion")
    assert peak["unit"] == "W"
    assert float(peak["value"]) == pytest.approx(power[:, column].max(), rel=1e-6)
    assert "joint power: elbow_flexion [W]" in (home / "curves.csv").read_text(encoding="utf-8")
    row = next(line for line in result_table().splitlines() if "`joint_power`" in line)
    assert "joint_power.sto" in row
    assert "power of the generalized force" in row
