"""Quantities as the tables of a folder of results, with the columns that OpenSim's users know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import write_sto
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
    """Return how the coordinate of each column moves; of other columns nothing depends on it."""
    if quantity.dims[-1] not in COORDINATES or model is None:
        rotational: MotionKind = "rotational"
        return (rotational,) * len(names)
    return tuple(model.coordinate(name).motion for name in names)


def quantity_table(series: Series, model: Model | None = None) -> Table:
    """Return a series that knows its quantity as the quantity's file has it.

    Parameters
    ----------
    series : (frames, names) in the quantity's unit
    model : whose coordinates the columns are, where they are

    Returns
    -------
    (frames, columns) in the file's unit, named as in OpenSim
    """
    quantity = series.known
    assert quantity is not None
    motions = motions_of(quantity, series.names, model)
    columns = tuple(
        f"{name}{quantity.ending_of(motion)}"
        for name, motion in zip(series.names, motions, strict=True)
    )
    facts = FrozenMap({"name": quantity.title or quantity.name.replace("_", " ")})
    if not quantity.file_unit:
        return Table(series.time, columns, series.values, facts=facts)
    factors = [
        conversion(quantity.unit_of(motion), unit_by_motion(quantity.file_unit, motion)) or 1.0
        for motion in motions
    ]
    return Table(
        series.time,
        columns,
        series.values * np.array(factors),
        in_degrees="deg" in quantity.file_unit,
        facts=facts,
    )


def write_series(folder: Path, series: Series, model: Model | None = None) -> None:
    """Write the table of a series that knows its quantity into a folder of results."""
    assert series.known is not None
    write_sto(quantity_table(series, model), folder / series.known.file)
