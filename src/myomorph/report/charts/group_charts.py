"""Drawings of two groups: mean curves with intervals over the cycle, and effect sizes in rows."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.analysis.groups import CurveDifference, ScalarDifference
from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number, ticks
from myomorph.report.charts.chart import Frame, heading, path_data

STYLES = ("left", "right")
"""Of the first group and of the second."""
ROW = 19.0
FURTHEST = 3.0
"""Effect sizes are drawn to at least, and intervals to at most, this many times the largest one."""


def cycle_chart(
    one: CurveDifference,
    unit: str,
    labels: tuple[str, str],
    styles: tuple[str, str] = STYLES,
    width: int = 330,
    height: int = 220,
) -> str:
    """Both groups' means with their intervals, every animal's own curve, and bars below where they differ."""
    percent = np.linspace(0.0, 100.0, len(one.difference))
    own = [curve for group in one.each for curve in group]
    low, high = range_of([one.first.low, one.first.high, one.second.low, one.second.high, *own])
    frame = Frame(46, 26.0, width - 8, height - 32, 0.0, 100.0, low, high)
    parts = [
        opened("time", one.name, width, height, frame.data),
        heading(one.name, unit),
        *across(frame),
        *percent_ticks(frame),
    ]
    for band, style, curves in ((one.first, styles[0], one.each[0]), (one.second, styles[1], one.each[1])):
        x = frame.x(percent)
        for curve in curves:
            parts.append(f'<path class="line thin {style}" d="{path_data(x, frame.y(curve))}"/>')
        parts.append(f'<path class="band {style}" d="{ribbon(frame, percent, band.low, band.high)}"/>')
    for band, style, label in ((one.first, styles[0], labels[0]), (one.second, styles[1], labels[1])):
        data = path_data(frame.x(percent), frame.y(band.mean))
        parts.append(f'<path class="line {style}" data-label="{escape(label, True)}" d="{data}"/>')
    parts += _bars(frame, one)
    return "".join([*parts, "</svg>"])


def effect_chart(one: CurveDifference, width: int = 330, height: int = 190) -> str:
    """Hedges' g along the cycle with its interval."""
    percent = np.linspace(0.0, 100.0, len(one.g))
    low, high = range_of([np.clip(one.g_low, -10, 10), np.clip(one.g_high, -10, 10), np.zeros(1)])
    frame = Frame(46, 26.0, width - 8, height - 32, 0.0, 100.0, low, high)
    parts = [
        opened("time", one.name, width, height, frame.data),
        heading(one.name, "Hedges’ g"),
        *across(frame),
        *percent_ticks(frame),
    ]
    inside = [np.clip(part, low, high) for part in (one.g_low, one.g_high, one.g)]
    parts.append(f'<path class="band middle" d="{ribbon(frame, percent, inside[0], inside[1])}"/>')
    parts.append(f'<path class="line middle" data-label="g" d="{path_data(frame.x(percent), frame.y(inside[2]))}"/>')
    parts += _bars(frame, one)
    return "".join([*parts, "</svg>"])


def effect_rows(scalars: Sequence[ScalarDifference], alpha: float, width: int = 680) -> str:
    """One row a parameter: Hedges' g with its interval, filled where the corrected p is small."""
    known = [one for one in scalars if np.isfinite(one.g)]
    largest = max([1.0, *(abs(one.g) for one in known)])
    reach = min(max([largest, *(max(abs(one.g_low), abs(one.g_high)) for one in known)]), FURTHEST * largest) * 1.05
    left = 10.0 + 5.9 * max((len(one.name) for one in scalars), default=1)
    bottom = 30.0 + ROW * len(scalars)
    frame = Frame(left, 30.0, width - 14, bottom, -reach, reach, 0.0, 1.0)
    height = int(bottom + 24)
    parts = [opened("rows", "effect sizes", width, height, ""), heading("Effect size", "Hedges’ g")]
    along = ticks(-reach, reach, 7)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        style = "zero" if abs(value) < 1e-9 else "grid"
        parts.append(f'<path class="{style}" d="M{x:.1f} {frame.top:g}V{bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{number(float(value), step)}</text>')
    for i, one in enumerate(scalars):
        parts += _effect_row(frame, frame.top + ROW * (i + 0.5), one, alpha)
    return "".join([*parts, "</svg>"])


def _effect_row(frame: Frame, y: float, one: ScalarDifference, alpha: float) -> list[str]:
    told = f"{one.name}: g {number(one.g)} ({number(one.g_low)} to {number(one.g_high)})"
    parts = [
        f"<g><title>{escape(told)}</title>",
        f'<text class="tick y" x="{frame.left - 6:g}" y="{y + 3.5:.1f}">{escape(one.name)}</text>',
    ]
    if np.isfinite(one.g_low):
        low, high = (float(frame.x(np.clip(end, frame.x0, frame.x1))) for end in (one.g_low, one.g_high))
        parts.append(f'<path class="whisker" d="M{low:.1f} {y:.1f}H{high:.1f}"/>')
    if np.isfinite(one.g):
        style = "first" if one.holm < alpha else "open"
        x = float(frame.x(np.clip(one.g, frame.x0, frame.x1)))
        parts.append(f'<circle class="mark {style}" cx="{x:.1f}" cy="{y:.1f}" r="4.5"/>')
    return [*parts, "</g>"]


def opened(kind: str, title: str, width: int, height: int, data: str) -> str:
    """The `<svg>` element's beginning."""
    label = escape(title, True)
    clock = ' data-clock="%"' if kind == "time" else ""
    return f'<svg class="chart {kind}" viewBox="0 0 {width} {height}" role="img" aria-label="{label}" {data}{clock}>'


def range_of(parts: Sequence[Array]) -> tuple[float, float]:
    """Lowest and highest value of several arrays, with a little air."""
    finite = [part[np.isfinite(part)] for part in parts]
    finite = [part for part in finite if part.size]
    if not finite:
        return 0.0, 1.0
    low, high = min(float(one.min()) for one in finite), max(float(one.max()) for one in finite)
    air = 0.06 * (high - low) or abs(high) * 0.1 or 1.0
    return low - air, high + air


def across(frame: Frame) -> list[str]:
    """Grid lines across a chart, with their values."""
    parts = []
    values = ticks(frame.y0, frame.y1, 4)
    step = float(values[1] - values[0]) if len(values) > 1 else 1.0
    for value in values:
        y = float(frame.y(value))
        style = "zero" if abs(value) < 1e-9 * step else "grid"
        parts.append(f'<path class="{style}" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 4:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    return parts


def percent_ticks(frame: Frame) -> list[str]:
    """Ticks of the cycle under a chart."""
    parts = []
    for value in (0, 25, 50, 75, 100):
        x = float(frame.x(value))
        text = f"{value} %" if value == 100 else f"{value}"
        parts.append(f'<path class="grid" d="M{x:.1f} {frame.bottom:g}v3"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{frame.bottom + 24:g}">{text}</text>')
    return parts


def ribbon(frame: Frame, percent: Array, low: Array, high: Array) -> str:
    """Closed outlines between two lines, one for every run of samples that are known."""
    known = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8))).reshape(-1, 2)
    parts = []
    for start, stop in edges:
        run = slice(int(start), int(stop))
        x = frame.x(percent[run])
        both = np.concatenate([frame.y(high[run]), frame.y(low[run])[::-1]])
        parts.append(path_data(np.concatenate([x, x[::-1]]), both) + "Z")
    return "".join(parts)


def _bars(frame: Frame, one: CurveDifference) -> list[str]:
    """Bars under the chart where the groups differ."""
    parts = []
    for start, stop in one.regions:
        a, b = float(frame.x(start)), float(frame.x(stop))
        title = f"differs from {start:.0f} to {stop:.0f} %, least p {number(one.least_p)}"
        place = f'x="{a - 1:.1f}" y="{frame.bottom + 5:g}" width="{max(b - a, 0.0) + 2:.1f}" height="5"'
        parts.append(f'<rect class="differs" {place}><title>{escape(title)}</title></rect>')
    return parts
