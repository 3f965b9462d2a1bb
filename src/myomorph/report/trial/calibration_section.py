"""The part of the page on lengths and markers before and after kinematic identification."""

from __future__ import annotations

import numpy as np

from myomorph.report.charts.chart import number
from myomorph.report.charts.dots import dot_plot
from myomorph.report.page.section import Figure, Grid, Section
from myomorph.report.trial.identified import CalibratedBody, IdentificationInput

MOST_MARKERS = 40
"""Markers in the chart, those that moved furthest."""

LONGEST_TABLE = 30


def calibration_section(given: IdentificationInput) -> Section | None:
    """Lengths, markers and marker errors before and after kinematic identification."""
    found = given.calibration
    if found is None:
        return None
    lead = "Lengths between joints and places of markers that fit the recordings"
    lead += f", from {number(found.frames, 1.0)} frames." if found.frames else "."
    lead += " Bars are one standard deviation to both sides." if any(one.sd for one in found.lengths) else ""
    return Section("calibration", "Lengths and markers", lead, (), _figures(found), _grids(found))


def _figures(found: CalibratedBody) -> tuple[Figure, ...]:
    figures = []
    if found.lengths:
        names = [one.name for one in found.lengths]
        change = 1000.0 * np.array([one.after - one.before for one in found.lengths])
        sd = 1000.0 * np.array([np.nan if one.sd is None else one.sd for one in found.lengths])
        figures.append(dot_plot("Change of lengths", "mm", names, [change], ("first",), ("change",), 520, sd))
    if found.markers:
        moved = dict(sorted(found.markers.items(), key=lambda one: -one[1])[:MOST_MARKERS])
        far = [1000.0 * np.array(list(moved.values()))]
        figures.append(dot_plot("How far markers moved", "mm", list(moved), far, ("third",), ("moved",), 520))
    return tuple(Figure(one, "medium") for one in figures)


def _grids(found: CalibratedBody) -> tuple[Grid, ...]:
    grids = []
    if found.errors:
        head = ("Trial", "Used for calibration", "RMS before", "RMS after")
        errors = tuple(
            (one.trial, "yes" if one.used else "no", _millimetres(one.before), _millimetres(one.after))
            for one in found.errors
        )
        grids.append(Grid(head, errors, "Marker errors before and after"))
    if found.lengths:
        head = ("Length", "Before", "After", "Standard deviation")
        rows = tuple(
            (one.name, *(_millimetres(value) for value in (one.before, one.after, one.sd))) for one in found.lengths
        )
        grids.append(Grid(head, rows, "Lengths", len(rows) > LONGEST_TABLE))
    if found.notes:
        grids.append(Grid(("Note",), tuple((text,) for text in found.notes), "What calibration had to say"))
    return tuple(grids)


def _millimetres(value: float | None) -> str:
    return "–" if value is None else f"{number(1000.0 * value)} mm"
