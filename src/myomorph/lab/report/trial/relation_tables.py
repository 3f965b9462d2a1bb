"""Phases of a motion in tables, and what correlates with the center of gravity."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from myomorph.core.model.series import Series
from myomorph.lab.analysis.correlations import Correlations
from myomorph.lab.analysis.selection import Pair
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.cells import Cell, sided_table
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.trial.motion_analysis import MotionAnalysis, column_name

MAX_COLUMNS = 10
CUT_WORDS = {
    "given": "Phases as specified.",
    "events": "Phases are delimited by events.",
    "contacts": (
        "A phase ends when the contacts change; sites that are always in contact are not named."
    ),
    "cycles": "Phases are the periods of the center of gravity.",
    "parts": "No events, contacts or cycles delimit phases here: four equal parts.",
}


def cut_words(analysis: MotionAnalysis) -> str:
    """How a motion was cut, in words; "" where it was not."""
    return CUT_WORDS.get(analysis.cutting.by, "")


def phase_section(analysis: MotionAnalysis) -> Section | None:
    """Describe every phase, and how active each muscle is in it."""
    if not analysis.measures:
        return None
    figures = []
    who = ""
    if analysis.persons:
        first = analysis.persons[0]
        who = first.who.name
        if first.activations is not None:
            figures.append(Figure(_activity(analysis, first.muscles, first.activations), "full"))
    lead = cut_words(analysis)
    if any(len(measure.stage.phases) > 1 for measure in analysis.measures):
        lead += (
            " Phases with the same contacts are combined; range and variance are within a phase."
        )
    if who:
        lead += f" Center of gravity and muscles of {who}."
    grids = (_center_grid(analysis), _doing_grid(analysis))
    return Section(
        key="phases", title="Phases", lead=lead, legend=(), figures=tuple(figures), grids=grids
    )


def _center_grid(analysis: MotionAnalysis) -> Grid:
    """When every phase is, and its center of gravity."""
    total = sum(measure.stage.duration for measure in analysis.measures)
    head = ["Phase", "Time", "Duration"]
    short = ", ".join(axis.rpartition("(")[2].rstrip(")") for axis in analysis.axes)
    if analysis.persons:
        head += ["Mean height", f"Range {short}", f"Variance {short}"]
    rows = []
    for measure in analysis.measures:
        phases = measure.stage.phases
        when = f"{number(phases[0].start, 0.01)} – {number(phases[0].stop, 0.01)} s"
        lasting = (
            f"{number(measure.stage.duration)} s ({100 * measure.stage.duration / total:.0f} %)"
        )
        cells = [measure.stage.name, when if len(phases) == 1 else f"{len(phases)} times", lasting]
        if analysis.persons:
            cells.append(f"{number(float(measure.mean[0]), 0.001)} m")
            cells.append(", ".join(number(1000 * float(value)) for value in measure.range) + " mm")
            cells.append(
                ", ".join(number(1e6 * float(value)) for value in measure.variance) + " mm²"
            )
        rows.append(tuple(cells))
    return Grid(tuple(head), tuple(rows), "Center of gravity by phase")


def _doing_grid(analysis: MotionAnalysis) -> Grid:
    """Muscles and contacts of every phase; without rows where neither tells anything."""
    muscles = analysis.persons[0].activations if analysis.persons else None
    touching = bool(analysis.limbs) and analysis.cutting.by != "contacts"
    head = ["Phase"]
    head += [] if muscles is None else ["Mean activation", "Maximum", "Most active muscle"]
    head += ["Time in contact"] if touching else []
    rows = []
    for measure in analysis.measures if len(head) > 1 else ():
        cells = [measure.stage.name]
        if muscles is not None:
            strongest = muscles.names[measure.strongest] if measure.strongest >= 0 else "–"
            cells += [number(measure.activity), number(measure.peak), strongest]
        if touching:
            contacts = zip(analysis.limbs, measure.contact, strict=True)
            shares = [
                f"{limb.label} {100 * share:.0f} %" for limb, share in contacts if share >= 0.005
            ]
            cells.append(", ".join(shares) or "no contact")
        rows.append(tuple(cells))
    return Grid(
        tuple(head),
        tuple(rows),
        "Muscles and contacts by phase" if touching else "Muscles by phase",
    )


def _activity(analysis: MotionAnalysis, muscles: Sequence[Pair], series: Series) -> str:
    """Mean activation of every muscle in every phase."""
    stages = [measure.stage for measure in analysis.measures][:MAX_COLUMNS]
    means: list[dict[str, float]] = []
    for stage in stages:
        rows = series.values[stage.inside(series.time)]
        seen = np.isfinite(rows).any(axis=0)
        columns = zip(series.names, rows.T, seen, strict=True)
        means.append({name: float(np.nanmean(column)) for name, column, known in columns if known})
    peak = max([1e-9, *(mean for of_stage in means for mean in of_stage.values())])

    def cell(pair: Pair, side: str, stage: int) -> Cell | None:
        mean = means[stage].get(column_name(pair, side), float("nan"))
        printed = f"{pair.label} {side}, {stages[stage].name}: {number(mean)}"
        return Cell(mean / peak, number(mean, 0.01), printed) if side in pair.members else None

    table = []
    for pair in muscles:
        sides = ("right", "left") if set(pair.members) & {"right", "left"} else ("",)
        table.append(
            (
                pair.label,
                [[cell(pair, side, stage) for side in sides] for stage in range(len(stages))],
            )
        )
    return sided_table(
        "Mean activation by phase", "darker: more active", [stage.name for stage in stages], table
    )


def correlation_section(analysis: MotionAnalysis) -> Section | None:
    """Correlations of contacts and muscles with the center of gravity."""
    correlations = analysis.correlations
    if correlations is None or not np.isfinite(correlations.values).any():
        return None
    rows: dict[str, dict[str, int]] = {}
    for index, name in enumerate(correlations.rows):
        label, side = _split(name, {limb.label for limb in analysis.limbs})
        rows.setdefault(label, {})[side] = index
    table = []
    for label, sides in rows.items():
        order = ("right", "left") if set(sides) & {"right", "left"} else ("",)
        rows_of = [sides.get(side) for side in order]
        cells = [
            tuple(None if row is None else _cell(correlations, row, column) for row in rows_of)
            for column in range(len(correlations.columns))
        ]
        table.append((label, cells))
    count = int(correlations.significant.sum())
    total = int(np.isfinite(correlations.values).sum())
    lead = "Correlation of contacts and activations with the detrended center of gravity. " + (
        f"{count} of {total} pairs are significant and colored: autocorrelated samples are not"
        " counted as independent, and the false discovery rate is 5 %."
        if count
        else f"None of {total} pairs is significant: the recording is too short or too slow."
    )
    figure = Figure(sided_table("Correlation", "r", correlations.columns, table), "full")
    return Section("correlations", "Correlations", lead, figures=(figure,))


def _split(name: str, limbs: Set[str]) -> tuple[str, str]:
    """Label and side of a row: of "Soleus, right" as of "right foot" and "tori left foot"."""
    if name not in limbs:
        label, comma, side = name.rpartition(", ")
        return (label, side) if comma and side in ("right", "left") else (name, "")
    words = name.split()
    side = next((word for word in words if word in ("right", "left")), "")
    printed = " ".join(word for word in words if word != side)
    return f"{printed[:1].upper() + printed[1:]} contact", side


def _cell(correlations: Correlations, row: int, column: int) -> Cell:
    value = float(correlations.values[row, column])
    freedom = number(float(correlations.freedom[row, column]))
    chance = number(float(correlations.chance[row, column]))
    who = f"{correlations.rows[row]} and {correlations.columns[column]}"
    under = f"{who}: r = {number(value)}, {freedom} independent samples, p = {chance}"
    return Cell(
        value if correlations.significant[row, column] else float("nan"), number(value, 0.01), under
    )
