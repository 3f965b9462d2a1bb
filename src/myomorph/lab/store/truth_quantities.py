"""Quantities of simulated recordings whose true values are known, each on its own clock."""

from __future__ import annotations

from typing import NamedTuple

from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION

KNOWN = (COORDINATE_VALUE, GENERALIZED_FORCE, ACTIVATION)
"""Quantities whose truth a simulation may give."""

FORMER_NAMES = {
    "coordinate_value": "motion",
    "generalized_force": "torques",
    "activation": "activations",
}
"""Names that results of version 0.1 have."""


class TrueQuantity(NamedTuple):
    """The true values of a quantity, and their clock."""

    clock: Quantity
    values: Quantity


def true_quantity(quantity: Quantity, name: str = "") -> TrueQuantity:
    """How a result file holds the true values of a quantity, by default under its own name."""
    name = f"true_{name or quantity.name}"
    clock = f"{name}_time"
    words = name.replace("_", " ")
    return TrueQuantity(
        clock=Quantity(
            name=clock, dims=(clock,), unit="s", meaning=f"clock of the {words}", attribute="time"
        ),
        values=Quantity(
            name=name,
            dims=(clock, f"{name}_name"),
            unit=quantity.unit,
            meaning=f"{words} of the simulated recording",
            attribute="values",
        ),
    )


QUANTITIES = tuple(part for quantity in KNOWN for part in true_quantity(quantity))
