"""The section on how sure results are: widths of the limits, and what contributes to them."""

from __future__ import annotations

import re

import numpy as np

from myomorph.model.model import Model
from myomorph.report.charts.axis import number
from myomorph.report.page.parts import Grid, Section
from myomorph.report.trial.prepared import Prepared
from myomorph.uncertainty.error_sizes import SourceSize
from myomorph.uncertainty.spread import Shares, Spread

TITLES = {
    "coordinates": "Joint angles and translations",
    "torques": "Joint torques",
    "activations": "Muscle activations",
    "forces": "Muscle tensions",
    "joint_reactions": "Joint loads",
    "contact_forces": "Contact forces of bodies",
    "contact_groups": "Contact forces",
    "torques_with_contacts": "Joint torques under estimated contact forces",
    "joint_contact_forces": "Forces at contact points of joints",
}
UNITS = {"coordinates": ("°", "m"), "torques": ("N·m", "N"), "torques_with_contacts": ("N·m", "N")}
"""Of tables by coordinate: of rotations, and of translations."""
PLACES, MOMENTS = re.compile(r"_p[xyz]$"), re.compile(r"_m[xyz]$|torque_?[xyz]$")
"""What columns of loads end in that are points and moments."""
ROWS = 12  # Columns of a table that are shown, those that are least sure first.
MAX_SOURCES, MIN_SHARE = 3, 0.01
"""Sources that are named for a column, and the share of the variance from which one is."""


def uncertainty_section(prepared: Prepared) -> Section | None:
    """For each table its least sure columns, and which sources of error matter most there."""
    uncertainty = prepared.results.uncertainty
    if not uncertainty.spreads:
        return None
    grids = []
    for name, spread in uncertainty.spreads.items():
        title = TITLES.get(name, name.replace("_", " ").capitalize())
        units = [unit_of(name, column, prepared.results.model) for column in spread.names]
        grids.append(_grid(title, units, spread, uncertainty.shares.get(name)))
    if uncertainty.sizes:
        grids.append(_sizes(uncertainty.sizes))
    lead = (
        f"{uncertainty.draws - uncertainty.failed} of {uncertainty.draws} inputs, drawn with errors of sizes that were "
        f"stated or that are usual, have a solution; {uncertainty.summary}. "
        "They are as right as these sizes are. Of each "
        "table the columns with the widest limits are shown; uncertainty.csv has all."
    )
    return Section("uncertainty", "Uncertainty", lead, (), (), tuple(grids))


def unit_of(table: str, column: str, model: Model | None) -> str:
    """The unit in which a column of a table is shown."""
    if table in UNITS:
        turns = model is None or column not in model.coordinate_names or model.coordinate(column).motion == "rotational"
        return UNITS[table][0 if turns else 1]
    if table == "activations":
        return ""
    if table == "forces":
        return "N"
    return "m" if PLACES.search(column) else "N·m" if MOMENTS.search(column) else "N"


def _grid(title: str, units: list[str], spread: Spread, shares: Shares | None) -> Grid:
    scales = np.where([unit == "°" for unit in units], 180.0 / np.pi, 1.0)
    widths = scales * np.nanmean(spread.high - spread.low, axis=0)
    deviations = scales * np.sqrt(np.nanmean(spread.deviation**2, axis=0))
    order = np.argsort(-np.nan_to_num(widths))[:ROWS]
    rows = []
    for column in order:
        row = (
            spread.names[column],
            *(f"{number(values[column])} {units[column]}".strip() for values in (widths, deviations)),
        )
        rows.append(row if shares is None else (*row, _leading(shares, int(column))))
    head = ("Column", "Mean width of the limits", "Standard deviation")
    return Grid(head if shares is None else (*head, "Main sources"), tuple(rows), title)


def _sizes(sizes: tuple[SourceSize, ...]) -> Grid:
    """How large sources of error were taken to be, those that are left out not."""
    rows = []
    for size in sizes:
        if not size.size:
            continue
        origin = f"{size.origin}, {size.items} sizes, {number(size.least)} to {number(size.greatest)}"
        rows.append((size.source, size.group, number(size.size), origin if size.items else size.origin))
    return Grid(("Source", "Group", "Standard deviation", "From"), tuple(rows), "Sizes of errors")


def _leading(shares: Shares, column: int) -> str:
    """The groups of sources that contribute most, with their shares of the variance."""
    total = np.nan_to_num(shares.total[:, column])
    leading = [g for g in np.argsort(-total)[:MAX_SOURCES] if total[g] > MIN_SHARE]
    return ", ".join(f"{shares.groups[g]} {100 * total[g]:.0f} %" for g in leading)
