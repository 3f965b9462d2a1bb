"""The quantities that results hold, and where each is declared.

A module of the table has a tuple `QUANTITIES`. Quantities of a step that somebody adds need no line
here: they belong to the step (`Step.quantities`).
"""

from __future__ import annotations

from functools import cache

from myomorph.core.model.extension import load
from myomorph.core.model.quantity import Quantity, declared_once
from myomorph.core.model.registry import extensions

PLACES: tuple[str, ...] = (
    "myomorph.core.model.series_quantities",
    "myomorph.core.model.contact_quantities",
    "myomorph.core.model.message_quantities",
    "myomorph.core.motion.quantities",
    "myomorph.core.rigid.quantities",
    "myomorph.core.muscles.quantities",
    "myomorph.core.tension.quantities",
    "myomorph.core.tension.fiber_quantities",
    "myomorph.core.tension.load_quantities",
    "myomorph.core.tension.emg_quantities",
    "myomorph.lab.store.truth_quantities",
    "myomorph.lab.movements.quantities",
    "myomorph.lab.report.trial.answer.answer_quantities",
    "myomorph.lab.uncertainty.quantities",
    "myomorph.lab.analysis.stride_quantities",
)


@cache
def quantities_of(place: str) -> tuple[Quantity, ...]:
    """Return the quantities that a module declares."""
    return tuple(load(place, "QUANTITIES"))


def stated_quantities() -> tuple[Quantity, ...]:
    """Return all quantities of the table in its order, then those of extensions.

    Raises
    ------
    BadData : two have one name, and are not declared alike
    """
    added = [place for extension in extensions() for place in extension.quantities]
    return declared_once(
        tuple(quantity for place in (*PLACES, *added) for quantity in quantities_of(place))
    )
