"""Tables of a result as signals of BIDS, and what they were made from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.series import Series
from myomorph.exchange.bids.recording import force_signals
from myomorph.exchange.bids.signals import Channel, Signals, signals_of
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import Stored
from myomorph.lab.store.uncertainty_store import get_uncertainty
from myomorph.lab.uncertainty.spread import LEVEL

INTERVALS = "Intervals"  # Ends the name of a table of limits.
SPREADS = {"coordinates": "angles", "forces": "tensions"}
"""Names of tables of `Uncertainty` that are called otherwise here."""
TABLES = {
    "angles": ("ik", "coordinates of the model by inverse kinematics"),
    "torques": ("id", "generalized forces of inverse dynamics"),
    "loads": ("id", "external forces as inverse dynamics used them"),
    "envelopes": ("tension", "envelopes of EMG"),
    "tensions": ("tension", "forces of the muscles along their tendons"),
    "activations": ("tension", "activations of the muscles"),
    "reserves": ("tension", "forces and torques of reserve and other actuators"),
}
"""Step that a table is of, and what it holds; limits are of the step "uncertainty"."""
LIMITS = ("uncertainty", "limits between which the draws lie, and their standard deviation")
PLAIN = (
    ("tensions", "muscle_force", "muscle", "N"),
    ("activations", "activation", "muscle", "1"),
    ("reserves", "actuator_force", "actuator", "n/a"),
)
"""Tables whose columns have one unit: name, variable, its dimension, unit."""


def result_tables(stored: Stored) -> Iterator[tuple[str, Signals]]:
    """Tables of a result by name, and the limits of those that have some; facts are what is known
    of each.
    """
    names = stored.names.get("coordinate", ())
    values = stored.values
    angular = [unit == "rad" for unit in stored.names.get("coordinate_unit", ())]
    degrees = np.where(angular, 180.0 / np.pi, 1.0)
    kinds = {
        "angles": [
            Channel(name, *(("JNTANG", "deg") if turns else ("MISC", "m")))
            for name, turns in zip(names, angular, strict=False)
        ],
        "torques": [
            Channel(name, "MISC", "N*m" if turns else "N")
            for name, turns in zip(names, angular, strict=False)
        ],
    }
    tables = {}
    if "coordinate_value" in values:
        tables["angles"] = values["coordinate_value"] * degrees
    if "generalized_force" in values:
        tables["torques"] = values["generalized_force"]
    for table, variable, kind, unit in PLAIN:
        if variable in values:
            kinds[table] = [Channel(name, "MISC", unit) for name in stored.names[kind]]
            tables[table] = values[variable]
    for table, columns in tables.items():
        yield table, _signals(stored, stored.time, columns, kinds[table], table)
    if (wrenches := store.get_wrenches(stored)) is not None:
        yield "loads", replace(force_signals(wrenches, {}), facts=_facts(stored, "loads"))
    if (emg := store.get_emg(stored)) is not None:
        channels = [Channel(name, "MISC", "1") for name in emg.names]
        yield "envelopes", _signals(stored, emg.time, emg.values, channels, "envelopes")
    uncertainty = get_uncertainty(stored)
    for name, spread in ({} if uncertainty is None else uncertainty.spreads).items():
        table = SPREADS.get(name, name)
        channels = kinds.get(table) or [Channel(column, "MISC") for column in spread.names]
        parts = {"low": spread.low, "high": spread.high, "sd": spread.deviation}
        columns = np.hstack(
            [part * (degrees if table == "angles" else 1.0) for part in parts.values()]
        )
        channels = [
            replace(each, name=f"{each.name}_{part}") for part in parts for each in channels
        ]
        facts = {"Draws": uncertainty.draws, "Level": LEVEL} if uncertainty is not None else {}
        label = re.sub(r"[^0-9A-Za-z]", "", table) + INTERVALS
        yield label, _signals(stored, spread.time, columns, channels, table + INTERVALS, facts)


def _signals(
    stored: Stored,
    time: Array,
    values: Array,
    channels: list[Channel],
    table: str,
    facts: Mapping[str, Any] | None = None,
) -> Signals:
    series = Series(time, tuple(each.name for each in channels), values)
    return signals_of(series, channels, _facts(stored, table) | dict(facts or {}))


def _facts(stored: Stored, table: str) -> dict[str, Any]:
    step, description = TABLES.get(table, LIMITS)
    made = stored.provenance.get(step)
    return {"Description": description} | (
        {} if made is None else {"Provenance": plain_provenance(made)}
    )


def plain_provenance(made: Provenance) -> dict[str, Any]:
    """What a result was made from, without folders of the machine that made it."""
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
