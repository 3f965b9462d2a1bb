"""The spread of results over draws in a result file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.results import ResultWriter, Stored, stored_values
from myomorph.lab.uncertainty.sources import SourceSize
from myomorph.lab.uncertainty.spread import Shares, Spread, Uncertainty, ValueErrors

DIMENSIONS = {
    "coordinates": "coordinate",
    "torques": "coordinate",
    "activations": "muscle",
    "forces": "muscle",
}
"""Dimension of a table's columns in a result file; of the others one of their own."""
ENDINGS = {
    "low": "lower limit of 90 %",
    "high": "upper limit of 90 %",
    "sd": "standard deviation of the draws",
}
GAIT = "gait_error_"  # Begins the names of the errors of gait curves, before the side.
GROUP = "error_group"
VALUE = "drawn_value"
ERRORS = "value_error"
SEPARATOR = ": "  # Between a step and its quantity in a result file.


def put_uncertainty(writer: ResultWriter, uncertainty: Uncertainty, units: dict[str, str]) -> None:
    """Limits, standard deviations and shares of all tables, with the units of each table's columns."""
    for name, spread in uncertainty.spreads.items():
        dimension = _dimension(name)
        writer.time(spread.time)
        writer.names(dimension, spread.names)
        parts = {"low": spread.low, "high": spread.high, "sd": spread.deviation}
        for ending, meaning in ENDINGS.items():
            writer.put(f"{name}_{ending}", ("time", dimension), parts[ending], units[name], meaning)
        shares = uncertainty.shares.get(name)
        if shares is not None:
            writer.names(GROUP, shares.groups)
            meanings = {
                "alone": "share of the variance, by itself",
                "total": "share of the variance, with all others",
            }
            for kind, values in (("alone", shares.alone), ("total", shares.total)):
                writer.put(f"{name}_{kind}", (GROUP, dimension), values, "1", meanings[kind])
    for side, errors in uncertainty.gait.items():
        for dimension, size in zip(
            ("draw", "gait_sample", "gait_variable"), errors.shape, strict=True
        ):
            writer.sizes(dimension, size)
        meaning = "error of a mean curve of gait under a draw, widened"
        writer.put(
            f"{GAIT}{side}",
            ("draw", "gait_sample", "gait_variable"),
            errors.astype(np.float32),
            "",
            meaning,
        )
    writer.fact("draws", f"{uncertainty.draws} {uncertainty.failed}")
    writer.fact("limits_widened", json.dumps(dict(uncertainty.factors)))
    writer.fact("error_sizes", json.dumps(uncertainty.sizes))


def get_uncertainty(stored: Stored) -> Uncertainty | None:
    """What `put_uncertainty` wrote, or None."""
    if "draws" not in stored.facts:
        return None
    spreads = {}
    shares = {}
    for name in (
        key.removesuffix("_sd")
        for key in stored.values
        if key.endswith("_sd") and key != "value_sd"
    ):
        names = stored.names[_dimension(name)]
        spreads[name] = Spread(
            stored.time, names, *(stored.values[f"{name}_{ending}"] for ending in ENDINGS)
        )
        if f"{name}_alone" in stored.values:
            parts = (stored.values[f"{name}_{part}"] for part in ("alone", "total"))
            shares[name] = Shares(stored.names[GROUP], *parts)
    draws, failed = map(int, stored.facts["draws"].split())
    factors = FrozenMap(json.loads(stored.facts.get("limits_widened", "{}")))
    sizes = tuple(SourceSize(*load) for load in json.loads(stored.facts.get("error_sizes", "[]")))
    gait = {
        key.removeprefix(GAIT): np.asarray(values, np.float64)
        for key, values in stored.values.items()
        if key.startswith(GAIT)
    }
    return Uncertainty(
        spreads=spreads,
        shares=shares,
        draws=draws,
        failed=failed,
        factors=factors,
        sizes=sizes,
        gait=gait,
    )


def put_value_errors(writer: ResultWriter, value_errors: ValueErrors) -> None:
    """Errors of the numbers of a trial under the draws, and their limits."""
    if not value_errors.names:
        return
    writer.names(VALUE, [SEPARATOR.join(name) for name in value_errors.names])
    writer.sizes("draw", len(value_errors.errors))
    writer.put(
        ERRORS,
        ("draw", VALUE),
        value_errors.errors.astype(np.float32),
        "",
        "error of a value under a draw, widened",
    )
    for ending, values in zip(ENDINGS, value_errors.limits(), strict=True):
        writer.put(f"value_{ending}", (VALUE,), values, "", f"{ENDINGS[ending]}, less the value")


def get_value_limits(stored: Stored) -> dict[tuple[str, str], tuple[float, float, float]]:
    """By step and quantity how far limits lie from the value, and the SD; {} where nothing was
    drawn.
    """
    if "value_sd" not in stored.values or VALUE not in stored.names:
        return {}
    columns = (stored.values[f"value_{ending}"].tolist() for ending in ENDINGS)
    return dict(zip(_pairs(stored), zip(*columns, strict=True), strict=True))


def read_value_errors(path: Path) -> ValueErrors | None:
    """Errors of the numbers of a trial under its draws, None where nothing was drawn or there is no
    such file.
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


def _dimension(name: str) -> str:
    return DIMENSIONS.get(name, f"{name}_column")
