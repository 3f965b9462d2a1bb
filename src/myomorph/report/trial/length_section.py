"""The section on muscle lengths over the stride: every stride of the major muscles, their means, and a table."""

from __future__ import annotations

from html import escape

import numpy as np

from myomorph.analysis.cycles import band
from myomorph.analysis.length_analysis import RANGE_HEAD, LengthAnalysis, length_analysis, range_row
from myomorph.analysis.selection import Pair, major_muscles
from myomorph.analysis.strides import walking_strides
from myomorph.model.arrays import Array
from myomorph.model.sides import split_side
from myomorph.report.charts.chart import Frame, heading, path_data
from myomorph.report.charts.group_charts import across, opened, percent_ticks, range_of, ribbon
from myomorph.report.page.section import SIDES_LEGEND, Figure, Grid, Section
from myomorph.report.trial.prepared import Prepared

WIDTH, HEIGHT = 330, 220
GAITS = ("", "gait")
"""Presets in which strides are looked for."""


def analysed_lengths(prepared: Prepared) -> LengthAnalysis | None:
    """Lengths over the strides of a walk; None where lengths, feet or strides are not there."""
    given = prepared.given
    if (
        given.muscles.lengths is None
        or given.model is None
        or given.kinematics.motion is None
        or given.analysis.preset not in GAITS
    ):
        return None
    strides = walking_strides(given.model, given.kinematics.motion, given.kinematics.fit)
    if strides is None:
        return None
    return length_analysis(given.model, given.muscles.lengths, strides, given.muscles.velocities)


def length_cycle_section(prepared: Prepared) -> Section | None:
    """Muscle-tendon lengths over the stride, right and left together."""
    analysis = analysed_lengths(prepared)
    if analysis is None:
        return None
    ranges = analysis.ranges
    if not ranges:
        return None
    shown = {one.muscle for one in ranges}
    moving = {one.muscle: one.excursion for one in ranges}
    most = np.array([moving.get(name, 0.0) for name in analysis.muscles])
    chosen = [pair for pair in major_muscles(analysis.muscles, most) if shown & set(pair.names)]
    figures = tuple(Figure(stride_chart(analysis, pair)) for pair in chosen)
    counts = ", ".join(f"{len(own)} of {limb}" for limb, own in analysis.strides.items())
    lead = (
        f"From strike to strike of each muscle's own foot ({counts}). A stride starts where the foot is farthest ahead "
        "of the trunk. Thin lines are strides; the band is the 95 % interval of their mean. Velocities in the table "
        "are means of each stride's fastest, in optimal fiber lengths a second; 'standing' is the model's default pose."
    )
    rows = tuple(range_row(one) for one in ranges)
    grid = Grid(RANGE_HEAD, rows, f"All {len(rows)} muscles over a stride", True)
    return Section("length_cycles", "Muscle lengths over the stride", lead, SIDES_LEGEND, figures, (grid,))


def stride_chart(analysis: LengthAnalysis, pair: Pair, width: int = WIDTH, height: int = HEIGHT) -> str:
    """Every stride of a muscle on both sides, its mean and interval [mm]."""
    drawn: list[tuple[str, str, Array]] = []
    for side, names in pair.members.items():
        drawn.append((side or "right", names[0], 1e3 * analysis.curves(names[0])))
    low, high = range_of([curves.ravel() for _, _, curves in drawn])
    frame = Frame(46, 26.0, width - 8, height - 32, 0.0, 100.0, low, high)
    percent = next(iter(analysis.lengths.values())).percent
    x = frame.x(percent)
    first = drawn[0][1]
    several = any(len(names) > 1 for names in pair.members.values())
    title = f"{pair.label} ({split_side(first)[0]})" if several else pair.label
    parts = [opened("time", title, width, height, frame.data), heading(title, "mm")]
    parts += [*across(frame), *percent_ticks(frame)]
    for side, name, curves in drawn:
        for curve in curves:
            if np.isfinite(curve).any():
                parts.append(f'<path class="line thin {side}" d="{path_data(x, frame.y(curve))}"/>')
        mean = band(curves)
        outline = ribbon(frame, percent, mean.low, mean.high)
        if outline:
            parts.append(f'<path class="band {side}" d="{outline}"/>')
        label = escape(name, True)
        parts.append(f'<path class="line {side}" data-label="{label}" d="{path_data(x, frame.y(mean.mean))}"/>')
    return "".join([*parts, "</svg>"])
