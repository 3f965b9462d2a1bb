"""Laws of declared quantities: each comes back from a file as it was, under one name."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.quantity import Quantity, Tidy, declared_once
from myomorph.core.model.units import conversion, unit_by_motion
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.quantities import get_quantity, put_quantity
from myomorph.lab.store.results import new_result, read_result
from myomorph.lab.study.step.step import declared_quantities

SIZE = 3
DECLARED = [quantity for quantity in declared_quantities() if quantity.stored]
DERIVED = [interval for quantity in declared_quantities() for interval in quantity.intervals]
FORCE = Quantity(name="pull", dims=("time", "rope"), unit="N", meaning="force of a rope")


def example(quantity: Quantity):
    """Values of a quantity on axes of `SIZE` entries each."""
    draw = np.random.default_rng(len(quantity.name))
    shape = (SIZE,) * len(quantity.stored_dims)
    return {
        "text": [f"entry {number}" for number in range(SIZE)],
        "flag": draw.random(shape) > 0.5,
        "count": draw.integers(0, 1000, shape),
        "code": draw.integers(0, 5, shape).astype(np.int8),
        "number": draw.standard_normal(shape),
        "single": draw.standard_normal(shape).astype(np.float32),
    }[quantity.kind]


@pytest.mark.parametrize("quantity", [*DECLARED, *DERIVED], ids=lambda quantity: quantity.name)
def test_every_quantity_is_read_back_equal_with_its_unit_and_axes(quantity, tmp_path):
    values = example(quantity)
    labels = {"time": np.arange(SIZE) / 10.0}
    with new_result(tmp_path / "x.nc") as writer:
        put_quantity(writer, quantity, values, labels)
    back = get_quantity(read_result(tmp_path / "x.nc"), quantity)
    if quantity.kind == "text":
        assert list(back) == values
        return
    np.testing.assert_array_equal(back, values)
    assert back.dtype.kind == np.asarray(values).dtype.kind
    with open_netcdf(tmp_path / "x.nc") as file:
        written = {variable.name: variable for variable in file.variables()}[quantity.name]
    assert written.dimensions == quantity.stored_dims
    assert written.told["units"] == quantity.unit
    assert written.told["long_name"] == quantity.meaning


def test_a_name_is_that_of_one_quantity():
    names = [quantity.name for quantity in (*declared_quantities(), *DERIVED)]
    assert len(names) == len(set(names))
    with pytest.raises(BadData, match="'pull' is declared twice"):
        declared_once((FORCE, FORCE.replaced(unit="kN")))


def test_a_file_holds_quantities_of_the_same_axes_or_of_one_group():
    """One column of a table belongs to one quantity."""
    by_file: dict[str, list[Quantity]] = {}
    for quantity in declared_quantities():
        if quantity.file.endswith((".sto", ".mot")):
            by_file.setdefault(quantity.file, []).append(quantity)
    shared = {file for file, quantities in by_file.items() if len(quantities) > 1}
    assert shared == {"joint_contact_forces.sto", "contact_intervals.sto"}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"name": "Pull"}, "is not a valid name"),
        ({"dims": ("time", "time")}, "an axis twice"),
        ({"unit": ""}, "expected one"),
        ({"kind": "text"}, "but none of texts"),
        ({"kind": "complex"}, "unknown kind 'complex'"),
        ({"meaning": ""}, "meaning in one line"),
        ({"file": "pull.txt"}, "is not a valid name of a"),
        ({"dims": ("rope",), "tidy": Tidy(statistics=("mean",))}, "one column a name"),
    ],
)
def test_a_declaration_checks_itself(change, what):
    with pytest.raises(BadData, match=what):
        FORCE.replaced(**change)


def test_units_follow_how_coordinates_move():
    assert unit_by_motion("N m or N", "rotational") == "N m"
    assert unit_by_motion("N m or N", "translational") == "N"
    assert unit_by_motion("rad or m", "coupled") == "1"
    assert conversion("rad", "°") == pytest.approx(57.29577951308232)
    assert conversion("N m", "N·m") == 1.0
    assert conversion("N", "N·m") is None
