"""Small, calm charts as SVG text: lines over time, and what all charts share.

Written here rather than with a plotting library, so that a page follows the reader's light or dark
setting, a script in it can read values back from the drawn lines, and a hundred panels cost
milliseconds. Colors are classes, given by the page's style sheet.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.series import Event
from myomorph.report.charts.axis import number, ticks

MOST_POINTS = 420
"""Bins of a drawn line; each keeps its smallest and largest value."""


@dataclass(frozen=True, eq=False)
class Line:
    """Values over time and how they are drawn.

    Attributes
    ----------
    time, values : (samples,)
    style : class of the style sheet: "right", "left", "middle", "truth", "emg", "first", "second", "third"
    label : what the reading under the pointer says
    filled : as an area down to zero
    """

    time: Array
    values: Array
    style: str
    label: str
    filled: bool = False


@dataclass(frozen=True)
class Limit:
    """A horizontal line that should not be crossed, at `value`."""

    value: float
    label: str


@dataclass(frozen=True, eq=False)
class Panel:
    """One chart over time.

    Attributes
    ----------
    title, unit : printed above it
    span : (first, last) time shown [s]
    events : drawn as vertical lines
    low, high : values that must be inside, or None
    width, height : in the drawing's own units
    name_events : print the events' labels above the chart
    second : factor and unit of a second scale on the right, e.g. moments per kilogram
    margin : free space on the right, so that charts above each other line up
    """

    title: str
    unit: str
    lines: Sequence[Line]
    span: tuple[float, float]
    events: Sequence[Event] = ()
    limits: Sequence[Limit] = ()
    low: float | None = None
    high: float | None = None
    width: int = 330
    height: int = 190
    name_events: bool = False
    second: tuple[float, str] | None = None
    margin: int = 8


def decimate(time: Array, values: Array, most: int = MOST_POINTS) -> tuple[Array, Array]:
    """Fewer points that draw the same line: the first of the smallest and of the largest of every bin.

    Peaks survive; a bin without any value becomes one NaN, which breaks the line.
    """
    if len(time) <= 2 * most:
        return time, values
    edges = np.linspace(0, len(time), most + 1).astype(np.int64)
    low = np.where(np.isnan(values), np.inf, values)
    high = np.where(np.isnan(values), -np.inf, values)
    keep = np.empty((most, 2), dtype=np.int64)
    for i, (start, stop) in enumerate(itertools.pairwise(edges)):
        keep[i] = start + np.argmin(low[start:stop]), start + np.argmax(high[start:stop])
    chosen = np.unique(np.append(keep, [0, len(time) - 1]))
    return time[chosen], values[chosen]


def envelope(time: Array, values: Array, most: int = MOST_POINTS // 2) -> tuple[Array, Array, Array, Array] | None:
    """Time, mean, smallest and largest value of bins, where a line would only fill its chart with ink.

    None for lines that are short, or that change little within a bin.
    """
    if len(time) <= 4 * most:
        return None
    edges = np.linspace(0, len(time), most + 1).astype(np.int64)[:-1]
    low = np.minimum.reduceat(np.where(np.isnan(values), np.inf, values), edges)
    high = np.maximum.reduceat(np.where(np.isnan(values), -np.inf, values), edges)
    seen = np.isfinite(low) & np.isfinite(high)
    if not seen.any():
        return None
    whole = float(high[seen].max() - low[seen].min())
    if float(np.mean(high[seen] - low[seen])) < 0.3 * whole or whole == 0.0:
        return None
    count = np.add.reduceat((~np.isnan(values)).astype(np.float64), edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(np.nan_to_num(values), edges) / count
    middle = time[np.minimum(edges + len(time) // (2 * most), len(time) - 1)]
    return middle, mean, np.where(seen, low, np.nan), np.where(seen, high, np.nan)


@dataclass(frozen=True)
class Frame:
    """The area of a chart in its drawing and the values at its borders."""

    left: float
    top: float
    right: float
    bottom: float
    x0: float
    x1: float
    y0: float
    y1: float

    def x(self, value: ArrayLike) -> Array:
        """Place of a value along the chart."""
        along: Array = self.left + (np.asarray(value) - self.x0) / (self.x1 - self.x0) * (self.right - self.left)
        return along

    def y(self, value: ArrayLike) -> Array:
        """Place of a value across the chart, downwards."""
        down: Array = self.bottom - (np.asarray(value) - self.y0) / (self.y1 - self.y0) * (self.bottom - self.top)
        return down

    @property
    def data(self) -> str:
        """Attributes that let the page's script turn places back into values."""
        places = " ".join(f"{one:g}" for one in (self.left, self.top, self.right, self.bottom))
        values = " ".join(f"{one:.9g}" for one in (self.x0, self.x1, self.y0, self.y1))
        return f'data-place="{places}" data-range="{values}"'


def path_data(x: Array, y: Array) -> str:
    """SVG path of the points (x, y), broken where one is NaN."""
    parts: list[str] = []
    pen = "M"
    for u, v, good in zip(x.tolist(), y.tolist(), (np.isfinite(x) & np.isfinite(y)).tolist(), strict=True):
        if good:
            parts.append(f"{pen}{u:.1f} {v:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)


def heading(title: str, unit: str) -> str:
    """A chart's title with its unit, at the upper left."""
    return f'<text class="title" x="2" y="12">{escape(title)} <tspan class="unit">{escape(unit)}</tspan></text>'


def value_range(panel: Panel) -> tuple[float, float]:
    """Lowest and highest value to draw, with a little air."""
    finite = []
    for line in panel.lines:
        shown = (line.time >= panel.span[0] - 1e-9) & (line.time <= panel.span[1] + 1e-9)
        finite.append(line.values[shown & np.isfinite(line.values)])
    lows = [float(one.min()) for one in finite if one.size]
    highs = [float(one.max()) for one in finite if one.size]
    lows += [] if panel.low is None else [panel.low]
    highs += [] if panel.high is None else [panel.high]
    if any(line.filled for line in panel.lines):
        lows.append(0.0)
    low, high = (min(lows), max(highs)) if lows and highs else (0.0, 1.0)
    if high - low < 1e-12 * max(1.0, abs(high)):
        air = abs(high) * 0.1 or 1.0
        return low - air, high + air
    air = 0.06 * (high - low)
    return (low if low == panel.low else low - air), (high if high == panel.high else high + air)


def time_plot(panel: Panel) -> str:
    """The chart as an `<svg>` element."""
    low, high = value_range(panel)
    top = 40.0 if panel.name_events and panel.events else 26.0
    first, last = panel.span
    frame = Frame(
        46,
        top,
        panel.width - (36 if panel.second else panel.margin),
        panel.height - 22,
        first,
        max(last, first + 1e-9),
        low,
        high,
    )
    parts = [
        f'<svg class="chart time" viewBox="0 0 {panel.width} {panel.height}" role="img" '
        f'aria-label="{escape(panel.title, True)}" {frame.data}>',
        heading(panel.title, panel.unit),
    ]
    parts += _grid(frame, panel.height)
    if panel.second:
        parts += _second_scale(frame, *panel.second)
    parts += _events(panel, frame)
    for line in panel.lines:
        shown = (line.time >= first - 1e-9) & (line.time <= last + 1e-9)
        t, v = np.asarray(line.time)[shown], np.asarray(line.values)[shown]
        band = envelope(t, v)
        if band is not None:
            t, v, smallest, largest = band
            parts.append(f'<path class="band {line.style}" d="{_ribbon(frame, t, smallest, largest)}"/>')
        else:
            t, v = decimate(t, v)
        x, y = frame.x(t), frame.y(v)
        if line.filled and len(x) and band is None:
            base = float(frame.y(max(0.0, low)))
            closed = np.concatenate([[base], np.where(np.isfinite(y), y, base), [base]])
            ends = np.concatenate([x[:1], x, x[-1:]])
            parts.append(f'<path class="area {line.style}" d="{path_data(ends, closed)}Z"/>')
        label = escape(line.label, True)
        parts.append(f'<path class="line {line.style}" data-label="{label}" d="{path_data(x, y)}"/>')
    for limit in panel.limits:
        if low <= limit.value <= high:
            level = float(frame.y(limit.value))
            parts.append(f'<path class="limit" d="M{frame.left:g} {level:.1f}H{frame.right:g}"/>')
            parts.append(
                f'<text class="limit" x="{frame.right - 3:g}" y="{level - 3:.1f}">{escape(limit.label)}</text>'
            )
    parts.append("</svg>")
    return "".join(parts)


def _ribbon(frame: Frame, time: Array, low: Array, high: Array) -> str:
    """Closed outline between two lines; bins without a value are left out."""
    seen = np.isfinite(low) & np.isfinite(high)
    x = frame.x(time[seen])
    both = np.concatenate([frame.y(high[seen]), frame.y(low[seen])[::-1]])
    return path_data(np.concatenate([x, x[::-1]]), both) + "Z" if len(x) else ""


def _grid(frame: Frame, height: int) -> list[str]:
    parts = []
    across = ticks(frame.y0, frame.y1, max(2, min(4, int((frame.bottom - frame.top) / 32))))
    step = float(across[1] - across[0]) if len(across) > 1 else 1.0
    for value in across:
        y = float(frame.y(value))
        style = "zero" if abs(value) < 1e-9 * step else "grid"
        parts.append(f'<path class="{style}" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 4:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    parts += _time_ticks(frame, height)
    return parts


def _second_scale(frame: Frame, factor: float, unit: str) -> list[str]:
    values = ticks(frame.y0 * factor, frame.y1 * factor)
    step = float(values[1] - values[0]) if len(values) > 1 else 1.0
    parts = [f'<text class="tick y second" x="{frame.right + 32:g}" y="{frame.top - 7:g}">{escape(unit)}</text>']
    for value in values:
        y = float(frame.y(value / factor))
        parts.append(f'<path class="grid" d="M{frame.right:g} {y:.1f}h3"/>')
        parts.append(
            f'<text class="tick end second" x="{frame.right + 5:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>'
        )
    return parts


def _time_ticks(frame: Frame, height: int) -> list[str]:
    parts = []
    along = ticks(frame.x0, frame.x1, max(3, int((frame.right - frame.left) / 46)))
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        text = number(float(value), step) + (" s" if value == along[-1] else "")
        parts.append(f'<path class="grid" d="M{x:.1f} {frame.bottom:g}v3"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{text}</text>')
    return parts


def _events(panel: Panel, frame: Frame) -> list[str]:
    parts = []
    taken = [-np.inf, -np.inf]
    for event in panel.events:
        if not frame.x0 <= event.time <= frame.x1:
            continue
        x = float(frame.x(event.time))
        name = f"{event.side} {event.label}".strip()
        style = event.side.lower() or "middle"
        parts.append(
            f'<path class="event {style}" d="M{x:.1f} {frame.top:g}V{frame.bottom:g}">'
            f"<title>{escape(name)}, {number(event.time, 0.001)} s</title></path>"
        )
        short = f"{event.side[:1]} {event.label.replace('Foot ', '')}".strip()
        half = 2.6 * len(short) + 3
        row = next((k for k in (0, 1) if x - half > taken[k]), None)
        if panel.name_events and row is not None:
            y = frame.top - 4 - 10 * row
            parts.append(f'<text class="event {style}" x="{x:.1f}" y="{y:g}">{escape(short)}</text>')
            taken[row] = x + half
    return parts
