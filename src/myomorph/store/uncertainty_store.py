"""The spread of results over draws in a result file."""

from __future__ import annotations

import json

from myomorph.model.frozen_map import FrozenMap
from myomorph.store.results import ResultWriter, Stored
from myomorph.uncertainty.found_sizes import SourceSize
from myomorph.uncertainty.spread import Shares, Spread, Uncertainty

DIMENSIONS = {"coordinates": "coordinate", "torques": "coordinate", "activations": "muscle", "forces": "muscle"}
"""Dimension of a table's columns in a result file; of the others one of their own."""
ENDINGS = {
    "low": "lower limit of 90 %",
    "high": "upper limit of 90 %",
    "sd": "standard deviation of the draws",
}
GROUP = "error_group"


def put_uncertainty(writer: ResultWriter, found: Uncertainty, units: dict[str, str]) -> None:
    """Limits, standard deviations and shares of all tables.

    Parameters
    ----------
    units : of each table's columns
    """
    for name, spread in found.spreads.items():
        dimension = _dimension(name)
        writer.time(spread.time)
        writer.names(dimension, spread.names)
        parts = {"low": spread.low, "high": spread.high, "sd": spread.deviation}
        for ending, meaning in ENDINGS.items():
            writer.put(f"{name}_{ending}", ("time", dimension), parts[ending], units[name], meaning)
        shares = found.shares.get(name)
        if shares is not None:
            writer.names(GROUP, shares.groups)
            meanings = {"alone": "share of the variance, by itself", "total": "share of the variance, with all others"}
            for kind, values in (("alone", shares.alone), ("total", shares.total)):
                writer.put(f"{name}_{kind}", (GROUP, dimension), values, "1", meanings[kind])
    writer.fact("draws", f"{found.draws} {found.failed}")
    writer.fact("limits_widened", json.dumps(dict(found.factors)))
    writer.fact("error_sizes", json.dumps(found.sizes))


def get_uncertainty(stored: Stored) -> Uncertainty | None:
    """What `put_uncertainty` wrote, or None."""
    if "draws" not in stored.facts:
        return None
    spreads, shares = {}, {}
    for name in (key.removesuffix("_sd") for key in stored.values if key.endswith("_sd")):
        names = stored.names[_dimension(name)]
        spreads[name] = Spread(stored.time, names, *(stored.values[f"{name}_{one}"] for one in ENDINGS))
        if f"{name}_alone" in stored.values:
            parts = (stored.values[f"{name}_{one}"] for one in ("alone", "total"))
            shares[name] = Shares(stored.names[GROUP], *parts)
    draws, failed = map(int, stored.facts["draws"].split())
    factors = FrozenMap(json.loads(stored.facts.get("limits_widened", "{}")))
    sizes = tuple(SourceSize(*one) for one in json.loads(stored.facts.get("error_sizes", "[]")))
    return Uncertainty(spreads, shares, draws, failed, factors=factors, sizes=sizes)


def _dimension(name: str) -> str:
    return DIMENSIONS.get(name, f"{name}_column")
