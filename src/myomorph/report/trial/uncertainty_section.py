"""The section on how sure results are: widths of the limits, and what contributes to them."""

from __future__ import annotations

import numpy as np

from myomorph.report.charts.axis import number
from myomorph.report.page.parts import Grid, Section
from myomorph.report.trial.prepared import Prepared
from myomorph.uncertainty.found_sizes import SourceSize
from myomorph.uncertainty.spread import Shares, Spread

TITLES = {
    "coordinates": ("Joint angles and places", "rad or m"),
    "torques": ("Joint torques", "N·m or N"),
    "activations": ("Muscle activations", ""),
    "forces": ("Muscle tensions", "N"),
    "joint_reactions": ("Joint loads", "N or N·m"),
    "contact_forces": ("Contact forces of bodies", "N"),
    "contact_groups": ("Contact forces", "N"),
    "joint_contact_forces": ("Forces at contact points of joints", "N"),
}
ROWS = 12
"""Columns of a table that are shown, those that are least sure first."""
LEADING, LEAST = 3, 0.01
"""Sources that are named for a column, and the share of the variance from which one is."""


def uncertainty_section(prepared: Prepared) -> Section | None:
    """For each table its least sure columns, and which sources of error matter most there."""
    found = prepared.given.uncertainty
    if not found.spreads:
        return None
    grids = []
    for name, spread in found.spreads.items():
        title, unit = TITLES.get(name, (name.replace("_", " ").capitalize(), ""))
        grids.append(_grid(title, unit, spread, found.shares.get(name)))
    if found.sizes:
        grids.append(_sizes(found.sizes))
    lead = (
        f"{found.draws - found.failed} of {found.draws} inputs, drawn with errors of sizes that were stated or that "
        f"are usual, have a solution; {found.summary}. They are as right as these sizes are. Of each "
        "table the columns with the widest limits are shown; uncertainty.csv has all."
    )
    return Section("uncertainty", "Uncertainty", lead, (), (), tuple(grids))


def _grid(title: str, unit: str, spread: Spread, shares: Shares | None) -> Grid:
    widths = np.nanmean(spread.high - spread.low, axis=0)
    deviations = np.sqrt(np.nanmean(spread.deviation**2, axis=0))
    order = np.argsort(-np.nan_to_num(widths))[:ROWS]
    rows = []
    for k in order:
        row = (spread.names[k], f"{number(widths[k])} {unit}", f"{number(deviations[k])} {unit}")
        rows.append((*row, _leading(shares, int(k))))
    return Grid(("Column", "Mean width of the limits", "Standard deviation", "Most of it from"), tuple(rows), title)


def _sizes(sizes: tuple[SourceSize, ...]) -> Grid:
    """How large sources of error were taken to be, those that are left out not."""
    rows = []
    for one in sizes:
        if not one.size:
            continue
        found = f"{one.origin}, {one.items} sizes, {number(one.least)} to {number(one.greatest)}"
        rows.append((one.source, one.group, number(one.size), found if one.items else one.origin))
    return Grid(("Source", "Group", "Standard deviation", "From"), tuple(rows), "Sizes of errors")


def _leading(shares: Shares | None, column: int) -> str:
    """The groups of sources that contribute most, with their shares of the variance."""
    if shares is None:
        return "–"
    total = np.nan_to_num(shares.total[:, column])
    leading = [g for g in np.argsort(-total)[:LEADING] if total[g] > LEAST]
    return ", ".join(f"{shares.groups[g]} {100 * total[g]:.0f} %" for g in leading)
