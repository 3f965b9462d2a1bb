"""Tables of a result as signals of BIDS, and what they were made from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.fit.interval_rule import LEVEL
from myomorph.core.model.arrays import Array
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Series
from myomorph.core.model.series_quantities import COORDINATE_VALUE, EMG
from myomorph.core.model.units import MotionKind
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION, ACTUATOR_FORCE, MUSCLE_FORCE
from myomorph.exchange.bids.recording import force_signals
from myomorph.exchange.bids.signals import UNKNOWN, Channel, Signals, signals_of
from myomorph.lab.store import stored as store
from myomorph.lab.store.quantities import get_quantity
from myomorph.lab.store.results import Stored
from myomorph.lab.store.uncertainty_store import get_uncertainty
from myomorph.lab.study.step.step import step_giving
from myomorph.lab.uncertainty.spread import Spread

INTERVALS = "Intervals"  # Ends the label of a table of limits.
TABLES = (COORDINATE_VALUE, GENERALIZED_FORCE, MUSCLE_FORCE, ACTIVATION, ACTUATOR_FORCE)
"""Quantities with one column a name."""
LOADS = "external_force"
"""Name of the table of forces, points and free torques."""
DESCRIPTIONS = {
    LOADS: ("id", "external forces as inverse dynamics used them"),
    EMG.name: ("tension", "envelopes of EMG"),
}
"""Step and words of tables that are no quantity of one step."""
LIMITS = ("uncertainty", "limits between which the draws lie, and their standard deviation")
FORMER_NAMES = {
    "angles": COORDINATE_VALUE.name,
    "torques": GENERALIZED_FORCE.name,
    "loads": LOADS,
    "envelopes": EMG.name,
    "tensions": MUSCLE_FORCE.name,
    "activations": ACTIVATION.name,
    "reserves": ACTUATOR_FORCE.name,
}
"""Labels of datasets that version 0.1 wrote."""


def label_of(name: str) -> str:
    """Return the name of a quantity as a label of letters and digits only: "muscleForce"."""
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)


def name_of(label: str) -> str:
    """Return the name of the quantity whose label this is; those of version 0.1 too."""
    stem = label.removesuffix(INTERVALS)
    ending = "_intervals" if stem != label else ""
    words = re.sub(r"(?<!^)([A-Z])", r"_\1", stem).lower()
    return FORMER_NAMES.get(stem, words) + ending


class Columns(NamedTuple):
    """Columns of a table of BIDS.

    Attributes
    ----------
    channels : what each is
    factors : (columns,) from the quantity's unit to the channel's
    """

    channels: list[Channel]
    factors: Array


def result_tables(stored: Stored) -> Iterator[tuple[str, Signals]]:
    """Yield tables of a result by label, and the interval bounds of those that have some.

    Facts are what is known of each.
    """
    for quantity in TABLES:
        values = get_quantity(stored, quantity)
        if values is not None:
            columns = _columns(stored, quantity, stored.names[quantity.dims[1]])
            series = Series(stored.time, stored.names[quantity.dims[1]], values * columns.factors)
            facts = _facts(stored, step_giving(quantity.name), quantity.meaning)
            yield label_of(quantity.name), signals_of(series, columns.channels, facts)
    if (wrenches := store.get_wrenches(stored)) is not None:
        facts = _facts(stored, *DESCRIPTIONS[LOADS])
        yield label_of(LOADS), replace(force_signals(wrenches, {}), facts=facts)
    if (emg := store.get_emg(stored)) is not None:
        channels = [Channel(name, "MISC", EMG.unit) for name in emg.names]
        facts = _facts(stored, *DESCRIPTIONS[EMG.name])
        yield label_of(EMG.name), signals_of(emg, channels, facts)
    uncertainty = get_uncertainty(stored)
    for spread in () if uncertainty is None else uncertainty.spreads.values():
        assert uncertainty is not None
        assert spread.quantity is not None
        facts = {"Draws": uncertainty.draws, "Level": LEVEL} | _facts(stored, *LIMITS)
        yield label_of(spread.quantity.name) + INTERVALS, _limits(stored, spread, facts)


def _columns(stored: Stored, quantity: Quantity, names: Sequence[str]) -> Columns:
    """Return the channels of a quantity: angles in degrees, as BIDS has them."""
    rotates = [unit == "rad" for unit in stored.names.get("coordinate_unit", ())]
    by_coordinate = dict(zip(stored.names.get("coordinate", ()), rotates, strict=False))
    channels = []
    factors = []
    for name in names:
        motion: MotionKind = "rotational" if by_coordinate.get(name, True) else "translational"
        unit = quantity.tidy_unit(motion).replace(" ", "*")
        several = quantity is ACTUATOR_FORCE or quantity not in TABLES
        channels.append(
            Channel(
                name,
                "JNTANG" if unit == "deg" else "MISC",
                UNKNOWN if several else unit,
            )
        )
        factors.append(quantity.tidy_factor(motion))
    return Columns(channels=channels, factors=np.array(factors))


def _limits(stored: Stored, spread: Spread, facts: Mapping[str, Any]) -> Signals:
    """Return limits and standard deviation of a drawn quantity beside each other."""
    assert spread.quantity is not None
    columns = _columns(stored, spread.quantity, spread.names)
    bounds = spread.bounds()
    values = np.hstack([values * columns.factors for values in bounds.values()])
    channels = [
        replace(channel, name=f"{channel.name}_{bound}")
        for bound in bounds
        for channel in columns.channels
    ]
    series = Series(spread.time, tuple(channel.name for channel in channels), values)
    return signals_of(series, channels, facts)


def _facts(stored: Stored, step: str, description: str) -> dict[str, Any]:
    made = stored.provenance.get(step)
    return {"Description": description} | (
        {} if made is None else {"Provenance": plain_provenance(made)}
    )


def plain_provenance(made: Provenance) -> dict[str, Any]:
    """Return what a result was derived from, without folders of the machine that made it."""
    return {
        "Step": made.step,
        "Version": made.version,
        "Date": made.date,
        "Options": {name: _without_folders(value) for name, value in made.options.items()},
        "Sources": [
            {"Role": source.role, "Name": _without_folders(source.name), "SHA256": source.sha256}
            for source in made.sources
        ],
    }


def _without_folders(value: Any) -> Any:
    if isinstance(value, str):
        paths = (PurePosixPath(value), PureWindowsPath(value))
        # A name that was given relative to a folder is kept without the folder as well.
        return next((path.name for path in paths if len(path.parts) > 1), value)
    if isinstance(value, Mapping):
        return {_without_folders(name): _without_folders(inner) for name, inner in value.items()}
    return (
        [_without_folders(inner) for inner in value] if isinstance(value, list | tuple) else value
    )
