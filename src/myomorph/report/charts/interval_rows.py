"""One row a name: a value with its interval as a dot on a line, for names too long to stand under bars."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.model.provenance import Estimate
from myomorph.report.charts.chart import Frame, heading, number, ticks
from myomorph.report.charts.interval_bars import Beside, Level

ROW = 17.0


def interval_rows(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Estimate],
    beside: Sequence[Beside] = (),
    levels: Sequence[Level] = (),
    width: int = 680,
) -> str:
    """Dots with intervals, further values as upright ticks, common values as upright lines.

    Intervals that reach far beyond all values are cut at the border of the chart.
    """
    top, left = 38.0, 10.0 + 5.9 * max((len(name) for name in names), default=1)
    bottom = top + ROW * len(names)
    height = int(bottom + 24)
    frame = Frame(left, top, width - 14, bottom, 0.0, _reach(values, beside, levels), 0.0, 1.0)
    parts = [
        f'<svg class="chart rows" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
    ]
    along = ticks(0.0, frame.x1, 6)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        parts.append(f'<path class="grid" d="M{x:.1f} {top:g}V{bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{number(float(value), step)}</text>')
    for row, one in enumerate(levels):
        if np.isfinite(one.value) and one.value <= frame.x1:
            x = float(frame.x(one.value))
            parts.append(f'<path class="level {one.style}" d="M{x:.1f} {top - 3:g}V{bottom:g}"/>')
            parts.append(
                f'<text class="level start" x="{x + 3:.1f}" y="{top - 3 - 10 * (row % 2):g}">{escape(one.label)}</text>'
            )
    for i, (name, value) in enumerate(zip(names, values, strict=True)):
        parts += _row(frame, top + ROW * (i + 0.5), name, value, [(one, float(one.values[i])) for one in beside], unit)
    parts.append("</svg>")
    return "".join(parts)


def _reach(values: Sequence[Estimate], beside: Sequence[Beside], levels: Sequence[Level]) -> float:
    known = [one.value for one in values] + [float(one) for mark in beside for one in mark.values]
    known += [one.value for one in levels]
    peak = max([one for one in known if np.isfinite(one)] or [0.0])
    highs = [one.high for one in values if np.isfinite(one.high)]
    return 1.06 * max(peak, min(max(highs, default=0.0), 1.5 * peak)) or 1.0


def _row(
    frame: Frame, y: float, name: str, value: Estimate, beside: Sequence[tuple[Beside, float]], unit: str
) -> list[str]:
    told = [f"{number(value.value)} ({number(value.low)} to {number(value.high)})"]
    told += [f"{mark.label} {number(one)}" for mark, one in beside]
    parts = [
        f"<g><title>{escape(name)}: {escape('; '.join(told))} {escape(unit)}</title>",
        f'<text class="tick y" x="{frame.left - 6:g}" y="{y + 3.5:.1f}">{escape(name)}</text>',
    ]
    if np.isfinite(value.low) and np.isfinite(value.high):
        low, high = (float(frame.x(min(max(end, 0.0), frame.x1))) for end in (value.low, value.high))
        parts.append(f'<path class="whisker" d="M{low:.1f} {y:.1f}H{high:.1f}M{low:.1f} {y - 3:.1f}v6"/>')
        if value.high <= frame.x1:
            parts.append(f'<path class="whisker" d="M{high:.1f} {y - 3:.1f}v6"/>')
    for mark, one in beside:
        if np.isfinite(one):
            parts.append(f'<path class="tack {mark.style}" d="M{float(frame.x(one)):.1f} {y - 5:.1f}v10"/>')
    if np.isfinite(value.value):
        parts.append(f'<circle class="mark first" cx="{float(frame.x(value.value)):.1f}" cy="{y:.1f}" r="4"/>')
    return [*parts, "</g>"]
