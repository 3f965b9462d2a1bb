"""Rows over one time axis: lines, bands and contacts under each other, read at one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from myomorph.analysis.phases import Phase
from myomorph.model.arrays import Array
from myomorph.model.series import Event
from myomorph.report.charts.chart import (
    Frame,
    Limit,
    Line,
    Panel,
    decimate,
    envelope,
    number,
    path_data,
    ticks,
    value_range,
)

WIDTH, LEFT, RIGHT = 1040, 190, 12
AXIS = 24
MOST_BAND = 240
BESIDE = 5.0


@dataclass(frozen=True, eq=False)
class Band:
    """What lies between two lines over time: `low` and `high` (samples,), NaN where unknown."""

    time: Array
    low: Array
    high: Array
    style: str


@dataclass(frozen=True, eq=False)
class Track:
    """One row.

    Attributes
    ----------
    title, unit : printed on the left
    bands, bars : what lies between two lines, known all the time or at some instants
    height : in the drawing's own units
    levels : values to compare with, drawn as dashed lines
    low, high : values that must be inside, or None
    small : one line of text, and ticks at the ends only
    """

    title: str
    unit: str
    lines: Sequence[Line]
    height: int = 84
    bands: Sequence[Band] = ()
    bars: Sequence[Band] = ()
    levels: Sequence[Limit] = ()
    low: float | None = None
    high: float | None = None
    small: bool = False


@dataclass(frozen=True, eq=False)
class Backdrop:
    """What all rows of a stack share: the time shown, phases as stripes and events as thin lines."""

    span: tuple[float, float]
    phases: Sequence[Phase] = ()
    events: Sequence[Event] = ()

    def frame(self, top: float, bottom: float, low: float = 0.0, high: float = 1.0) -> Frame:
        """The area of a row."""
        first, last = self.span
        return Frame(LEFT, top, WIDTH - RIGHT, bottom, first, max(last, first + 1e-9), low, high)

    def behind(self, frame: Frame) -> list[str]:
        """Stripes of every other phase, and events."""
        parts = []
        for i, phase in enumerate(self.phases):
            left, right = (float(frame.x(np.clip(one, *self.span))) for one in (phase.start, phase.stop))
            if i % 2 == 0 and right - left > 0.2:
                parts.append(
                    f'<rect class="phase" x="{left:.1f}" y="{frame.top:g}" width="{right - left:.1f}" '
                    f'height="{frame.bottom - frame.top:g}"/>'
                )
        for event in self.events:
            if frame.x0 <= event.time <= frame.x1:
                style, x = event.side.lower() or "middle", float(frame.x(event.time))
                parts.append(f'<path class="event {style}" d="M{x:.1f} {frame.top:g}V{frame.bottom:g}"/>')
        return parts


def opened(title: str, height: float, frame: Frame, kind: str = "") -> str:
    """Start of a row's drawing."""
    return (
        f'<svg class="chart time track {kind}" viewBox="0 0 {WIDTH} {height:g}" role="img" '
        f'aria-label="{escape(title, True)}" {frame.data}>'
    )


def draw_track(track: Track, behind: Backdrop) -> str:
    """One row as an `<svg>` element."""
    low, high = _range(track, behind.span)
    margin = 2.0 if track.small else 6.0
    frame = behind.frame(margin, track.height - margin, low, high)
    middle = (frame.top + frame.bottom) / 2
    parts = [opened(track.title, track.height, frame), *behind.behind(frame)]
    name = f'{escape(track.title)} <tspan class="unit">{escape(track.unit)}</tspan>'
    parts.append(f'<text class="title" x="2" y="{middle + 4:.1f}">{name}</text>')
    parts += _scale(frame, track.small)
    for band in track.bands:
        parts.append(_band(frame, band, behind.span))
    for i, bar in enumerate(track.bars):
        parts.append(_bars(frame, bar, behind.span, BESIDE * (i - (len(track.bars) - 1) / 2)))
    for line in track.lines:
        parts += _line(frame, line, behind.span)
    for level in track.levels:
        y = float(frame.y(level.value))
        parts.append(f'<path class="level" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="level" x="{frame.right - 3:g}" y="{y - 3:.1f}">{escape(level.label)}</text>')
    return "".join([*parts, "</svg>"])


def _range(track: Track, span: tuple[float, float]) -> tuple[float, float]:
    lines = list(track.lines) + [
        Line(band.time, values, "", "") for band in (*track.bands, *track.bars) for values in (band.low, band.high)
    ]
    low, high = value_range(Panel(track.title, track.unit, lines, span, low=track.low, high=track.high))
    for level in track.levels:
        reach = high - low
        low, high = min(low, level.value - 0.05 * reach), max(high, level.value + 0.05 * reach)
    return low, high


def _scale(frame: Frame, small: bool) -> list[str]:
    parts = []
    if small:
        for value in (frame.y0, frame.y1):
            parts.append(f'<path class="grid" d="M{frame.left:g} {float(frame.y(value)):.1f}H{frame.right:g}"/>')
        return parts
    across = ticks(frame.y0, frame.y1, max(3, int((frame.bottom - frame.top) / 24)))
    step = float(across[1] - across[0]) if len(across) > 1 else 1.0
    for value in across:
        y = float(frame.y(value))
        style = "zero" if abs(value) < 1e-9 * step else "grid"
        parts.append(f'<path class="{style}" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 5:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    return parts


def _line(frame: Frame, line: Line, span: tuple[float, float]) -> list[str]:
    shown = (line.time >= span[0] - 1e-9) & (line.time <= span[1] + 1e-9)
    time, values = np.asarray(line.time)[shown], np.clip(np.asarray(line.values)[shown], frame.y0, frame.y1)
    parts = []
    bins = envelope(time, values)
    if bins is not None and not line.filled:
        time, values, low, high = bins
        parts.append(_band(frame, Band(time, low, high, line.style), span))
    else:
        time, values = decimate(time, values)
    x, y = frame.x(time), frame.y(values)
    if line.filled and len(x):
        base = float(frame.y(max(0.0, frame.y0)))
        closed = np.concatenate([[base], np.where(np.isfinite(y), y, base), [base]])
        parts.append(f'<path class="area {line.style}" d="{path_data(np.concatenate([x[:1], x, x[-1:]]), closed)}Z"/>')
    label = escape(line.label, True)
    parts.append(f'<path class="line {line.style}" data-label="{label}" d="{path_data(x, y)}"/>')
    return parts


def _band(frame: Frame, band: Band, span: tuple[float, float]) -> str:
    """Closed outlines between two lines, one for every stretch where both are known."""
    shown = (band.time >= span[0] - 1e-9) & (band.time <= span[1] + 1e-9)
    step = max(1, int(shown.sum()) // MOST_BAND)
    time, low, high = (np.asarray(one)[shown][::step] for one in (band.time, band.low, band.high))
    known = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    outline = ""
    for start, stop in edges.reshape(-1, 2):
        x = frame.x(time[start:stop])
        y = frame.y(np.clip(np.concatenate([high[start:stop], low[start:stop][::-1]]), frame.y0, frame.y1))
        outline += path_data(np.concatenate([x, x[::-1]]), y) + "Z"
    return f'<path class="band {band.style}" d="{outline}"/>'


def _bars(frame: Frame, bar: Band, span: tuple[float, float], aside: float) -> str:
    """An upright line from low to high at every instant where they differ, `aside` to the right of its time."""
    apart = np.asarray(bar.high) - np.asarray(bar.low) > 1e-3 * (frame.y1 - frame.y0)
    shown = apart & (bar.time >= span[0] - 1e-9) & (bar.time <= span[1] + 1e-9)
    x = frame.x(np.asarray(bar.time)[shown]) + aside
    ends = [frame.y(np.clip(np.asarray(one)[shown], frame.y0, frame.y1)) for one in (bar.low, bar.high)]
    data = "".join(f"M{u:.1f} {low:.1f}V{high:.1f}" for u, low, high in zip(x, *ends, strict=True))
    return f'<path class="interval {bar.style}" d="{data}"/>'


def time_axis(behind: Backdrop) -> str:
    """The row of times that ends a stack."""
    frame = behind.frame(0.0, 4.0)
    along = ticks(*behind.span, 10)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {AXIS}" role="presentation">',
        f'<path class="zero" d="M{frame.left:g} 0.5H{frame.right:g}"/>',
    ]
    for value in along:
        x = float(frame.x(value))
        text = number(float(value), step) + (" s" if value == along[-1] else "")
        parts.append(f'<path class="zero" d="M{x:.1f} 0v4"/><text class="tick x" x="{x:.1f}" y="16">{text}</text>')
    return "".join([*parts, "</svg>"])


def named_lines(lines: Sequence[tuple[str, str]]) -> str:
    """A row that names styles of lines, for stacks with a legend of their own."""
    parts = [f'<svg class="chart" viewBox="0 0 {WIDTH} 18" role="presentation">']
    x = float(LEFT)
    for style, name in lines:
        parts.append(f'<path class="line {style}" d="M{x:g} 10h22"/>')
        parts.append(f'<text class="tick end" x="{x + 28:g}" y="13.5">{escape(name)}</text>')
        x += 46 + 6.0 * len(name)
    return "".join([*parts, "</svg>"])


def phase_names(behind: Backdrop) -> str:
    """The row of phases' names that begins a stack; "" without phases. Names that do not fit are cut."""
    if not behind.phases:
        return ""
    height = 20
    frame = behind.frame(0.0, height)
    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="Phases">',
        *Backdrop(behind.span, behind.phases).behind(frame),
    ]
    for phase in behind.phases:
        left, right = (float(frame.x(np.clip(one, *behind.span))) for one in (phase.start, phase.stop))
        room = int((right - left - 4) / 5.3)
        text = phase.name if len(phase.name) <= room else phase.name[: room - 1] + "…" if room > 4 else ""
        if text:
            told = f"{phase.name}, {number(phase.start, 0.01)} to {number(phase.stop, 0.01)} s"
            parts.append(
                f'<text class="phase" x="{(left + right) / 2:.1f}" y="14">{escape(text)}'
                f"<title>{escape(told)}</title></text>"
            )
    return "".join([*parts, "</svg>"])
