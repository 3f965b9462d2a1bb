"""Quantities as the tables of a folder of results, with the columns that OpenSim's users know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Series, Table
from myomorph.core.model.units import MotionKind, conversion, unit_by_motion

COORDINATES = ("coordinate",)
"""Axes whose entries are coordinates of the model."""


def motions_of(
    quantity: Quantity, names: Sequence[str], model: Model | None
) -> tuple[MotionKind, ...]:
    """How the coordinate of each column moves; of other columns no ending and no unit depends on
    it.
    """
    if quantity.dims[-1] not in COORDINATES or model is None:
        return ("rotational",) * len(names)
    return tuple(model.coordinate(name).motion for name in names)


def quantity_table(
    quantity: Quantity,
    time: Array,
    names: Sequence[str],
    values: Array,
    model: Model | None = None,
) -> Table:
    """A quantity as its file has it.

    Parameters
    ----------
    time : (frames,) [s]
    names : of its last axis
    values : (frames, names) in the quantity's unit
    model : whose coordinates the columns are, where they are

    Returns
    -------
    (frames, columns) in the file's unit, named as in OpenSim
    """
    motions = motions_of(quantity, names, model)
    columns = tuple(
        f"{name}{quantity.ending_of(motion)}" for name, motion in zip(names, motions, strict=True)
    )
    facts = FrozenMap({"name": quantity.title or quantity.name.replace("_", " ")})
    if not quantity.file_unit:
        return Table(time, columns, values, facts=facts)
    factors = [
        conversion(quantity.unit_of(motion), unit_by_motion(quantity.file_unit, motion)) or 1.0
        for motion in motions
    ]
    degrees = "deg" in quantity.file_unit
    return Table(time, columns, values * np.array(factors), in_degrees=degrees, facts=facts)


def write_quantity(
    folder: Path,
    quantity: Quantity,
    time: Array,
    names: Sequence[str],
    values: Array,
    model: Model | None = None,
) -> None:
    """Write a quantity's table into a folder of results; see `quantity_table`."""
    write_sto(quantity_table(quantity, time, names, values, model), folder / quantity.file)


def write_series(folder: Path, series: Series, model: Model | None = None) -> None:
    """Write the table of a series that knows its quantity."""
    assert series.known is not None
    write_quantity(folder, series.known, series.time, series.names, series.values, model)
