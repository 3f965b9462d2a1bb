"""Horizontal bars as SVG text."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number, ticks
from myomorph.report.charts.chart import Frame, Limit, heading


def bar_plot(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Array],
    styles: Sequence[str],
    labels: Sequence[str],
    limits: Sequence[Limit] = (),
    width: int = 680,
    peak: float = 0.0,
) -> str:
    """Horizontal bars, one row a name; several `values` lie over each other, the widest first.

    Parameters
    ----------
    peak : largest value that must fit, for charts of one scale
    """
    row, top, left = 15.0, 36.0 if limits else 26.0, 8.0 + 6.1 * max((len(name) for name in names), default=1)
    height = int(top + row * len(names) + 24)
    present = [float(np.nanmax(one)) for one in values if np.isfinite(one).any()]
    peak = max([peak, *present, *(one.value for one in limits)])
    frame = Frame(left, top, width - 14, top + row * len(names), 0.0, 1.06 * (peak or 1.0), 0.0, 1.0)
    parts = [
        f'<svg class="chart bars" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
    ]
    along = ticks(0.0, frame.x1, 6)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        parts.append(f'<path class="grid" d="M{x:.1f} {top:g}V{frame.bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{number(float(value), step)}</text>')
    for i, name in enumerate(names):
        y = top + row * i
        told = ", ".join(f"{label} {number(float(one[i]))}" for label, one in zip(labels, values, strict=True))
        parts.append(f"<g><title>{escape(name)}: {escape(told)} {escape(unit)}</title>")
        parts.append(f'<text class="tick y" x="{left - 5:g}" y="{y + 11:.1f}">{escape(name)}</text>')
        for j, (one, style) in enumerate(zip(values, styles, strict=True)):
            if np.isfinite(one[i]):
                thick = row - 4 if j == 0 else row - 9
                parts.append(
                    f'<rect class="bar {style}" x="{left:g}" y="{y + (row - thick) / 2:.1f}" '
                    f'width="{float(frame.x(one[i])) - left:.1f}" height="{thick:g}"/>'
                )
        parts.append("</g>")
    for limit in limits:
        x = float(frame.x(limit.value))
        parts.append(f'<path class="limit" d="M{x:.1f} {top - 4:g}V{frame.bottom:g}"/>')
        parts.append(f'<text class="limit" x="{x - 3:.1f}" y="{top - 5:g}">{escape(limit.label)}</text>')
    parts.append("</svg>")
    return "".join(parts)
