"""The spread of results over draws in a result file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.quantity import SOURCE_GROUP, Quantity
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.quantities import Labels, get_quantity, put_quantity
from myomorph.lab.store.quantity_table import stated_quantities
from myomorph.lab.store.results import ResultWriter, Stored, stored_values
from myomorph.lab.uncertainty.quantities import GAIT_ERRORS, SIDES, VALUE_BOUNDS, VALUE_ERROR
from myomorph.lab.uncertainty.sources import SourceSize
from myomorph.lab.uncertainty.spread import Shares, Spread, Uncertainty, ValueErrors

FORMER_NAMES = {
    "coordinate_value": "coordinates",
    "generalized_force": "torques",
    "generalized_force_with_contacts": "torques_with_contacts",
    "activation": "activations",
    "muscle_force": "forces",
    "contact_load": "contact_forces",
    "contact_group_force": "contact_groups",
    "joint_reaction": "joint_reactions",
    "joint_contact_load": "joint_contact_forces",
}
"""Names that drawn quantities had in results of version 0.1."""
FORMER_COLUMNS = ("coordinate", "muscle")
"""Axes that these had already; each other had one of its own, NAME_column."""
VALUE = VALUE_ERROR.dims[1]
ERRORS = VALUE_ERROR.name
SEPARATOR = ": "  # Between a step and its quantity in a result file.


def put_uncertainty(writer: ResultWriter, uncertainty: Uncertainty) -> None:
    """Limits, standard deviations and shares of all quantities."""
    for name, spread in uncertainty.spreads.items():
        quantity = spread.quantity
        if quantity is None:
            raise BadData(f"draws of '{name}', which is not a declared quantity")
        columns = quantity.dims[1]
        labels: Labels = {"time": spread.time, columns: spread.names}
        for bound, values in spread.bounds().items():
            put_quantity(writer, quantity.bound(bound), values, labels)
        shares = uncertainty.shares.get(name)
        if shares is not None:
            labels = {SOURCE_GROUP: shares.groups, columns: spread.names}
            put_quantity(writer, quantity.share("alone"), shares.alone, labels)
            put_quantity(writer, quantity.share("total"), shares.total, labels)
    for side, gait_error in zip(SIDES, GAIT_ERRORS, strict=True):
        if side in uncertainty.gait:
            put_quantity(writer, gait_error, uncertainty.gait[side])
    writer.fact("draws", f"{uncertainty.draws} {uncertainty.failed}")
    writer.fact("limits_widened", json.dumps(dict(uncertainty.factors)))
    writer.fact("error_sizes", json.dumps(uncertainty.sizes))


def get_uncertainty(stored: Stored) -> Uncertainty | None:
    """Read what `put_uncertainty` wrote, or None."""
    if "draws" not in stored.facts:
        return None
    spreads = {}
    shares = {}
    for quantity in stated_quantities():
        spread = _get_spread(stored, quantity)
        if spread is not None:
            spreads[quantity.name] = spread
            contributions = _get_shares(stored, quantity)
            if contributions is not None:
                shares[quantity.name] = contributions
    draws, failed = map(int, stored.facts["draws"].split())
    factors = json.loads(stored.facts.get("limits_widened", "{}"))
    gait = zip(SIDES, (get_quantity(stored, each) for each in GAIT_ERRORS), strict=True)
    return Uncertainty(
        spreads=spreads,
        shares=shares,
        draws=draws,
        failed=failed,
        factors=FrozenMap({_name_now(name): factor for name, factor in factors.items()}),
        sizes=tuple(
            SourceSize._make(load) for load in json.loads(stored.facts.get("error_sizes", "[]"))
        ),
        gait={side: errors for side, errors in gait if errors is not None},
    )


def _get_spread(stored: Stored, quantity: Quantity) -> Spread | None:
    """Limits and standard deviation of a quantity, under its present or its former name."""
    for name in _names(quantity):
        deviation = stored.values.get(f"{name}_sd")
        if quantity.drawn and deviation is not None:
            return Spread(
                time=stored.time,
                names=stored.names[_columns(quantity, name)],
                low=stored.values[f"{name}_low"],
                high=stored.values[f"{name}_high"],
                deviation=deviation,
                quantity=quantity,
            )
    return None


def _get_shares(stored: Stored, quantity: Quantity) -> Shares | None:
    for name in _names(quantity):
        if f"{name}_alone" in stored.values:
            return Shares(
                groups=stored.names[SOURCE_GROUP],
                alone=stored.values[f"{name}_alone"],
                total=stored.values[f"{name}_total"],
            )
    return None


def _names(quantity: Quantity) -> tuple[str, ...]:
    former = FORMER_NAMES.get(quantity.name)
    return (quantity.name,) if former is None else (quantity.name, former)


def _name_now(name: str) -> str:
    """Present name of a quantity that may have its former one."""
    now = {former: name for name, former in FORMER_NAMES.items()}
    return now.get(name, name)


def _columns(quantity: Quantity, name: str) -> str:
    """Axis of the columns, in a file that calls the quantity so."""
    axis = quantity.dims[1]
    return axis if name == quantity.name or axis in FORMER_COLUMNS else f"{name}_column"


def put_value_errors(writer: ResultWriter, value_errors: ValueErrors) -> None:
    """Errors of the numbers of a trial under the draws, and their limits."""
    if not value_errors.names:
        return
    labels = {VALUE: [SEPARATOR.join(name) for name in value_errors.names]}
    put_quantity(writer, VALUE_ERROR, value_errors.errors, labels)
    for bound, values in zip(VALUE_BOUNDS, value_errors.limits(), strict=True):
        put_quantity(writer, bound, values, labels)


def get_value_limits(stored: Stored) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Read how far limits lie from the value, and the SD, by step and quantity.

    Nothing where nothing was drawn.
    """
    if "value_sd" not in stored.values or VALUE not in stored.names:
        return {}
    columns = (stored.values[bound.name].tolist() for bound in VALUE_BOUNDS)
    return dict(zip(_pairs(stored), zip(*columns, strict=True), strict=True))


def read_value_errors(path: Path) -> ValueErrors | None:
    """Read the errors of the numbers of a trial under its draws.

    None where nothing was drawn or there is no such file.
    """
    if not path.is_file():
        return None
    with open_netcdf(path) as file:
        stored = stored_values(path, file, only=(VALUE, ERRORS))
    errors = stored.values.get(ERRORS)
    return None if errors is None else ValueErrors(_pairs(stored), np.asarray(errors, np.float64))


def _pairs(stored: Stored) -> tuple[tuple[str, str], ...]:
    parts = (name.split(SEPARATOR, 1) for name in stored.names[VALUE])
    return tuple((step, quantity) for step, quantity in parts)
