"""The quantities that results hold, and where each is declared.

A module of the table has a tuple `QUANTITIES`. Quantities of a step that somebody adds need no line
here: they belong to the step (`Step.quantities`).
"""

from __future__ import annotations

from functools import cache
from importlib import import_module

from myomorph.core.model.quantity import Quantity, declared_once

PLACES: tuple[str, ...] = (
    "myomorph.core.model.series_quantities",
    "myomorph.core.model.contact_quantities",
    "myomorph.core.motion.quantities",
    "myomorph.core.rigid.quantities",
    "myomorph.core.muscles.quantities",
    "myomorph.core.tension.quantities",
    "myomorph.core.tension.fiber_quantities",
    "myomorph.core.tension.load_quantities",
    "myomorph.core.tension.emg_quantities",
    "myomorph.lab.store.truth_quantities",
    "myomorph.lab.uncertainty.quantities",
)


@cache
def quantities_of(place: str) -> tuple[Quantity, ...]:
    """The quantities that a module declares."""
    return tuple(import_module(place).QUANTITIES)


def stated_quantities() -> tuple[Quantity, ...]:
    """All quantities of the table, in its order; raises `BadData` where two have one name."""
    return declared_once(tuple(quantity for place in PLACES for quantity in quantities_of(place)))
