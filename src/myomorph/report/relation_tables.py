"""Phases and relations of a motion: tables of what each phase is like and of what goes with what."""

from __future__ import annotations

import numpy as np

from myomorph.report.chart import number
from myomorph.report.motion_analysis import MotionAnalysis, Person
from myomorph.report.motion_phases import StageMeasures
from myomorph.report.section import Figure, Grid, Section
from myomorph.report.sided_table import Cell, sided_table

MOST_COLUMNS = 10


def phase_section(analysis: MotionAnalysis, how: str) -> Section | None:
    """What every phase is like, and how active each muscle is in it."""
    if not analysis.measures:
        return None
    figures = []
    if analysis.persons and analysis.activations is not None and analysis.persons[0].muscles:
        figures.append(Figure(_activity(analysis, analysis.persons[0]), "full"))
    who = analysis.persons[0].who.name if analysis.persons else ""
    lead = how
    if any(len(one.stage.phases) > 1 for one in analysis.measures):
        lead += " Those with the same contacts are taken together; range and variance are those within one."
    if who:
        lead += f" Center of gravity and muscles are those of {who}."
    return Section("phases", "Phases", lead, (), tuple(figures), (_phase_grid(analysis),))


def _phase_grid(analysis: MotionAnalysis) -> Grid:
    total = sum(one.stage.duration for one in analysis.measures)
    center = bool(analysis.persons)
    muscles = analysis.activations is not None and center and bool(analysis.persons[0].muscles)
    head = ["Phase", "From – to", "Lasts"]
    short = [axis.rpartition("(")[2].rstrip(")") for axis in analysis.axes]
    if center:
        head += ["Mean height", f"Range {', '.join(short)}", f"Variance {', '.join(short)}"]
    if muscles:
        head += ["Activation, mean", "peak", "most active"]
    if analysis.limbs and analysis.cutting.by != "contacts":
        head.append("Touching")
    rows = [_phase_row(one, analysis, total, center, muscles) for one in analysis.measures]
    return Grid(tuple(head), tuple(rows), "Phases in numbers")


def _phase_row(
    one: StageMeasures, analysis: MotionAnalysis, total: float, center: bool, muscles: bool
) -> tuple[str, ...]:
    stage = one.stage
    if len(stage.phases) == 1:
        when = f"{number(stage.phases[0].start, 0.01)} – {number(stage.phases[0].stop, 0.01)} s"
    else:
        when = f"{len(stage.phases)} times"
    cells = [stage.name, when, f"{number(stage.duration)} s ({100 * stage.duration / total:.0f} %)"]
    if center:
        cells.append(f"{number(float(one.mean[0]))} m")
        cells.append(", ".join(number(1000 * float(value)) for value in one.range) + " mm")
        cells.append(", ".join(number(1e6 * float(value)) for value in one.variance) + " mm²")
    if muscles:
        names = [
            f"{pair.label}, {side}" if side else pair.label
            for pair in analysis.persons[0].muscles
            for side in pair.members
        ]
        cells += [number(one.activity), number(one.peak), names[one.strongest] if one.strongest >= 0 else "–"]
    if analysis.limbs and analysis.cutting.by != "contacts":
        shares = [
            f"{limb.label} {100 * share:.0f} %"
            for limb, share in zip(analysis.limbs, one.contact, strict=True)
            if np.isfinite(share) and share >= 0.005
        ]
        cells.append(", ".join(shares) or "nothing")
    return tuple(cells)


def _activity(analysis: MotionAnalysis, person: Person) -> str:
    """Mean activation of every muscle in every phase."""
    series = analysis.activations
    assert series is not None
    stages = [one.stage for one in analysis.measures][:MOST_COLUMNS]
    inside = [stage.inside(series.time) for stage in stages]
    peak = 1e-9
    values: dict[tuple[int, int, str], float] = {}
    for i, pair in enumerate(person.muscles):
        for side in pair.members:
            name = ", ".join(one for one in (person.who.name, pair.label, side) if one)
            for j, rows in enumerate(inside):
                column = series[name][rows]
                mean = float(np.nanmean(column)) if np.isfinite(column).any() else float("nan")
                values[i, j, side] = mean
                peak = max(peak, 0.0 if np.isnan(mean) else mean)
    table = []
    for i, pair in enumerate(person.muscles):
        sides = ("right", "left") if set(pair.members) & {"right", "left"} else ("",)
        cells = []
        for j, stage in enumerate(stages):
            row = []
            for side in sides:
                mean = values.get((i, j, side), float("nan"))
                told = f"{pair.label} {side}, {stage.name}: {number(mean)}"
                row.append(None if side not in pair.members else Cell(mean / peak, number(mean, 0.01), told))
            cells.append(tuple(row))
        table.append((pair.label, tuple(cells)))
    title = "Mean activation by phase"
    return sided_table(title, "the deeper the more active", [one.name for one in stages], table)


def relation_section(analysis: MotionAnalysis) -> Section | None:
    """What contacts and muscles have to do with the center of gravity."""
    found = analysis.relations
    if found is None or not np.isfinite(found.values).any():
        return None
    rows: dict[str, dict[str, int]] = {}
    for i, name in enumerate(found.rows):
        label, side = _split(name)
        rows.setdefault(label, {})[side] = i
    table = []
    for label, sides in rows.items():
        order = ("right", "left") if set(sides) & {"right", "left"} else ("",)
        cells = tuple(
            tuple(_cell(analysis, sides[side], j) if side in sides else None for side in order)
            for j in range(len(found.columns))
        )
        table.append((label, cells))
    count, total = int(found.related.sum()), int(np.isfinite(found.values).sum())
    lead = (
        "Correlation of contacts and activations with the center of gravity (its straight line taken off) at the lag "
        "where it is strongest; a positive lag: contact or muscle follows the center of gravity. "
    )
    lead += (
        f"{count} of {total} pairs stand out from chance and are colored: neighbouring samples are not counted as "
        "independent, and of all pairs called related one in twenty may be so by chance."
        if count
        else f"None of {total} pairs stands out from chance: the recording is too short, or too slow, to tell."
    )
    drawing = sided_table("Correlation", "r · lag", list(found.columns), table, width=980)
    return Section("relations", "What goes together", lead, (), (Figure(drawing, "full"),))


def _split(name: str) -> tuple[str, str]:
    """Label and side of a row: of "Soleus, right" as of "right foot"."""
    label, comma, side = name.rpartition(", ")
    if comma and side in ("right", "left"):
        return label, side
    for side in ("right", "left"):
        if name.startswith(f"{side} "):
            return f"{name.removeprefix(side + ' ').capitalize()} touches", side
    return name, ""


def _cell(analysis: MotionAnalysis, i: int, j: int) -> Cell:
    found = analysis.relations
    assert found is not None
    value, lag = float(found.values[i, j]), float(found.lags[i, j])
    told = (
        f"{found.rows[i]} and {found.columns[j]}: r = {number(value)} at {number(lag, 0.01)} s, "
        f"{number(float(found.freedom[i, j]))} independent samples, chance {number(float(found.chance[i, j]))}"
    )
    if not found.related[i, j]:
        return Cell(float("nan"), number(value, 0.01), told)
    return Cell(value, f"{number(value, 0.01)} · {number(lag, 0.01)} s", told)
