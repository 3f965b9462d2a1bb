"""Dots: several values a name in one row, and many values by rank on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number, ticks
from myomorph.report.charts.chart import Frame, heading

ROW, RADIUS = 14.0, 3.3


def dot_plot(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Array],
    styles: Sequence[str],
    labels: Sequence[str],
    width: int = 680,
    spread: Array | None = None,
) -> str:
    """One row a name, one dot a value, joined by a line, so that many names compare at a glance.

    Parameters
    ----------
    values : (names,) of each kind, NaN where there is none
    styles, labels : of each kind
    spread : (names,) drawn as a bar to both sides of the first kind's dot, NaN where there is none
    """
    top, left = 26.0, 10.0 + 6.1 * max((len(name) for name in names), default=1)
    height = int(top + ROW * len(names) + 24)
    reach = np.zeros(len(names)) if spread is None else np.nan_to_num(spread)
    reached = [values[0] - reach, values[0] + reach, *values[1:]]
    finite = [one[np.isfinite(one)] for one in reached]
    low = min(0.0, *(float(one.min(initial=0.0)) for one in finite))
    high = max((float(one.max(initial=0.0)) for one in finite), default=1.0) or 1.0
    air = 0.05 * (high - low)
    frame = Frame(left, top, width - 14, top + ROW * len(names), low - air * (low < 0.0), high + air, 0.0, 1.0)
    parts = [
        f'<svg class="chart dots" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
        *_upright_grid(frame, height, 6),
    ]
    for i, name in enumerate(names):
        y = top + ROW * (i + 0.5)
        row = [float(one[i]) for one in values]
        told = ", ".join(f"{label} {number(one)}" for label, one in zip(labels, row, strict=True))
        parts.append(f"<g><title>{escape(name)}: {escape(told)} {escape(unit)}</title>")
        parts.append(f'<text class="tick y" x="{left - 6:g}" y="{y + 3.5:.1f}">{escape(name)}</text>')
        known = [one for one in row if np.isfinite(one)]
        if len(known) > 1:
            ends = frame.x([min(known), max(known)])
            parts.append(f'<path class="grid" d="M{ends[0]:.1f} {y:.1f}H{ends[1]:.1f}"/>')
        if reach[i] > 0.0:
            ends = frame.x([row[0] - reach[i], row[0] + reach[i]])
            parts.append(f'<path class="line {styles[0]}" d="M{ends[0]:.1f} {y:.1f}H{ends[1]:.1f}"/>')
        for one, style in reversed(list(zip(row, styles, strict=True))):
            if np.isfinite(one):
                parts.append(
                    f'<circle class="mark {style}" cx="{float(frame.x(one)):.1f}" cy="{y:.1f}" r="{RADIUS:g}"/>'
                )
        parts.append("</g>")
    parts.append("</svg>")
    return "".join(parts)


def rank_plot(
    title: str,
    unit: str,
    across: str,
    names: Sequence[str],
    values: Array,
    limits: Sequence[tuple[float, str]] = (),
    strong: np.ndarray | None = None,
    width: int = 680,
    height: int = 230,
) -> str:
    """Positive values from the smallest to the largest on a logarithmic scale, one dot each.

    Parameters
    ----------
    across : what the horizontal axis counts
    limits : values to draw a line at, and what to write there
    strong : (names,) which dots are in color, the others are grey; all where not given
    """
    known = np.flatnonzero(np.isfinite(values) & (values > 0.0))
    order = known[np.argsort(values[known], kind="stable")]
    logs = np.log10(values[order])
    marks = np.log10([value for value, _ in limits])
    least, most = (float(f(np.concatenate([logs, marks, [-1.0]]))) for f in (np.min, np.max))
    top, bottom = 28.0, height - 34.0
    frame = Frame(52, top, width - 12, bottom, 0.0, max(len(order) + 1, 2), np.floor(least), np.ceil(most + 1e-9))
    parts = [
        f'<svg class="chart dots" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
    ]
    powers = np.arange(int(frame.y0), int(frame.y1) + 1)
    for power in powers[:: max(1, int(np.ceil(len(powers) / 8)))]:
        y = float(frame.y(power))
        parts.append(f'<path class="grid" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 4:g}" y="{y + 3:.1f}">{number(10.0**power)}</text>')
    for value in ticks(0.0, frame.x1, min(8, len(order))):
        x = float(frame.x(value))
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{bottom + 14:g}">{number(float(value), 1.0)}</text>')
    parts.append(
        f'<text class="tick x" x="{(frame.left + frame.right) / 2:g}" y="{bottom + 28:g}">{escape(across)}</text>'
    )
    for mark, (_, label) in zip(marks, limits, strict=True):
        y = float(frame.y(mark))
        parts.append(f'<path class="limit" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="limit" x="{frame.right - 3:g}" y="{y - 3:.1f}">{escape(label)}</text>')
    for rank, (i, log) in enumerate(zip(order, logs, strict=True)):
        x, y = float(frame.x(rank + 1)), float(frame.y(log))
        style = "first" if strong is None or strong[i] else "middle"
        parts.append(
            f'<circle class="mark {style}" cx="{x:.1f}" cy="{y:.1f}" r="2.2"><title>{escape(names[i])}: '
            f"{number(float(values[i]))} {escape(unit)}</title></circle>"
        )
    parts.append("</svg>")
    return "".join(parts)


def _upright_grid(frame: Frame, height: int, count: int) -> list[str]:
    along = ticks(frame.x0, frame.x1, count)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    parts = []
    for value in along:
        x = float(frame.x(value))
        parts.append(f'<path class="grid" d="M{x:.1f} {frame.top:g}V{frame.bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{number(float(value), step)}</text>')
    return parts
