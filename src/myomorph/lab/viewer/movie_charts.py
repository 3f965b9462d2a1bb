"""Charts of a movie: curves over time that stand, and a cursor that moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import from_extra
from myomorph.lab.report.charts.axis import Axis, limits
from myomorph.lab.viewer.replay_charts import Chart, Curve

if TYPE_CHECKING:
    from PIL.Image import Image

SHRINK = 2
"""Pixels drawn for one shown, along each axis."""
INK = "#222222"
FAINT = "#6a7076"
GRID = "#e6e8ea"
CURSOR = "#9aa1a7"
BAND = 0.8
"""How far the color of a band fades to white."""
LINE = 2.2
DASH = 6.0
GAP = 4.0
DOT = 4.5
"""Width of a curve, length of dashes and of what is between them, radius of the cursor's dots
[pixels]."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Plot:
    """A chart in its place.

    Attributes
    ----------
    chart : its curves
    across, upward : axes of time [s] and of values, placed in pixels as drawn
    """

    chart: Chart
    across: Axis
    upward: Axis


@dataclass(frozen=True, kw_only=True)
class ChartPlace:
    """Room for charts.

    Attributes
    ----------
    span : first and last time that is shown [s]
    size : width and height of the picture [pixels]
    text : size of the letters [pixels]
    """

    span: tuple[float, float]
    size: tuple[int, int]
    text: int


class ChartPainter:
    """Pictures of some charts, one above the other.

    Parameters
    ----------
    charts : at least one
    time : (frames,) of their values [s]
    place : what is shown of them, and how large
    """

    def __init__(self, charts: Sequence[Chart], time: Array, place: ChartPlace):
        fonts = from_extra("view", "PIL.ImageFont", "pillow")
        start, end = place.span
        self._shown = (time >= start - 1e-9) & (time <= end + 1e-9)
        self._time = time[self._shown]
        self._text = place.text * SHRINK
        self._font = fonts.load_default(self._text)
        self._size = (place.size[0] * SHRINK, place.size[1] * SHRINK)
        self._plots = self._placed(charts, place.span)
        self._base = self._drawn()

    def picture(self, now: float) -> Image:
        """Draw the charts with their cursor at a time [s]."""
        page = self._base.copy()
        drawing = _drawing(page)
        for plot in self._plots:
            x = float(plot.across.at(now))
            drawing.line([(x, plot.upward.stop), (x, plot.upward.start)], CURSOR, SHRINK)
            for curve in plot.chart.curves:
                value = np.interp(now, self._time, curve.values[self._shown])
                if np.isfinite(value) and not curve.dashed:
                    _draw_dot(drawing, x, float(plot.upward.at(value)), curve.color)
        reduced: Image = page.reduce(SHRINK)
        return reduced

    def _placed(self, charts: Sequence[Chart], span: tuple[float, float]) -> tuple[Plot, ...]:
        """Place charts below each other, with room for titles, and for times below the last."""
        width, height = self._size
        below = 1.6 * self._text
        each = (height - below) / len(charts)
        gutter = max(self._gutter(chart) for chart in charts)
        across = Axis(
            low=span[0], high=span[1], start=gutter, stop=width - 0.6 * self._text, unit="s"
        )
        plots = []
        for number, chart in enumerate(charts):
            top = number * each + self._head(chart, width)
            bottom = (number + 1) * each - 0.35 * self._text
            low, high = self._limits(chart)
            upward = Axis(low=low, high=high, start=bottom, stop=top)
            plots.append(Plot(chart=chart, across=across, upward=upward))
        return tuple(plots)

    def _limits(self, chart: Chart) -> tuple[float, float]:
        values = [curve.values[self._shown] for curve in chart.curves]
        bands = [chart.curves[index] for index in chart.banded]
        ends = [
            end[self._shown]
            for curve in bands
            for end in (curve.low, curve.high)
            if end is not None
        ]
        known = np.concatenate([*values, *ends])
        return limits([known], zero=bool(np.nanmin(known, initial=0.0) >= 0.0))

    def _gutter(self, chart: Chart) -> float:
        """Room for the numbers of a chart's values."""
        low, high = self._limits(chart)
        ticks = Axis(low=low, high=high, start=0.0, stop=1.0).ticks(3)
        return max(float(self._font.getlength(tick.text)) for tick in ticks) + 0.7 * self._text

    def _head(self, chart: Chart, width: float) -> float:
        """Height of a chart's title, and of the names of its curves where they need a line."""
        return (1.5 if self._fits(chart, width) else 2.8) * self._text

    def _fits(self, chart: Chart, width: float) -> bool:
        names = sum(self._font.getlength(f"{curve.label}  ") for curve in chart.curves)
        return bool(names + self._font.getlength(f"{chart.title}   ") < width)

    def _drawn(self) -> Image:
        """Draw all that stands still."""
        page: Image = from_extra("view", "PIL.Image", "pillow").new("RGB", self._size, "white")
        drawing = _drawing(page)
        for plot in self._plots:
            self._draw_head(drawing, plot)
            self._draw_values(drawing, plot)
            for curve in plot.chart.curves:
                self._draw_curve(drawing, plot, curve)
        self._draw_times(drawing, self._plots[-1])
        return page

    def _draw_head(self, drawing: Any, plot: Plot) -> None:
        chart = plot.chart
        width = self._size[0]
        top = plot.upward.stop - self._head(chart, width) + 0.2 * self._text
        drawing.text((0.1 * self._text, top), chart.title, INK, self._font)
        names = [f"{curve.label}" for curve in chart.curves]
        gap = 0.7 * self._text
        lengths = [float(self._font.getlength(name)) + gap for name in names]
        if self._fits(chart, width):
            x = width - sum(lengths)
        else:
            x = plot.across.start
            top += 1.25 * self._text
        for name, length, curve in zip(names, lengths, chart.curves, strict=True):
            # Names that find no room are left out: the color is that of their side.
            if x + length <= width + gap:
                drawing.text((x, top), name, curve.color, self._font)
            x += length

    def _draw_values(self, drawing: Any, plot: Plot) -> None:
        right = plot.across.stop
        for tick in plot.upward.ticks(3):
            color = CURSOR if tick.zero else GRID
            drawing.line(
                [(plot.across.start, tick.position), (right, tick.position)], color, SHRINK
            )
            place = (plot.across.start - 0.35 * self._text, tick.position)
            drawing.text(place, tick.text, FAINT, self._font, anchor="rm")

    def _draw_times(self, drawing: Any, plot: Plot) -> None:
        for tick in plot.across.ticks(4):
            end = tick.position + 0.5 * float(self._font.getlength(tick.text))
            x = tick.position - max(end - self._size[0], 0.0)
            place = (x, plot.upward.start + 0.3 * self._text)
            drawing.text(place, tick.text, FAINT, self._font, anchor="ma")

    def _draw_curve(self, drawing: Any, plot: Plot, curve: Curve) -> None:
        x = plot.across.at(self._time)
        if plot.chart.curves.index(curve) in plot.chart.banded:
            assert curve.low is not None
            assert curve.high is not None
            low = plot.upward.at(curve.low[self._shown])
            high = plot.upward.at(curve.high[self._shown])
            for start, stop in runs(np.isfinite(low) & np.isfinite(high)):
                upper = np.stack([x, high], axis=1)[start:stop]
                lower = np.stack([x, low], axis=1)[start:stop][::-1]
                _draw_band(drawing, np.concatenate([upper, lower]), curve.color)
        y = plot.upward.at(curve.values[self._shown])
        for start, stop in runs(np.isfinite(y)):
            points = np.stack([x, y], axis=1)[start:stop]
            for part in _dashes(points) if curve.dashed else (points,):
                _draw_line(drawing, part, curve.color)


def _drawing(page: Image) -> Any:
    return from_extra("view", "PIL.ImageDraw", "pillow").Draw(page)


def _draw_dot(drawing: Any, x: float, y: float, color: str) -> None:
    radius = DOT * SHRINK
    drawing.ellipse((x - radius, y - radius, x + radius, y + radius), color, "white", SHRINK)


def _draw_line(drawing: Any, points: Array, color: str) -> None:
    """Draw a line through points (n, 2) [pixels]."""
    if len(points) > 1:
        drawing.line(
            [tuple(point) for point in points.tolist()], color, round(LINE * SHRINK), "curve"
        )


def _draw_band(drawing: Any, outline: Array, color: str) -> None:
    """Fill an outline (n, 2) [pixels] with a pale color."""
    channels = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    pale = np.round(channels + BAND * (255 - channels)).astype(int)
    if len(outline) > 2:
        drawing.polygon([tuple(point) for point in outline.tolist()], tuple(pale.tolist()))


def _dashes(points: Array) -> Iterator[Array]:
    """Yield the parts of a line through points (n, 2) that a dashed one has, (m, 2) [pixels]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    dash = SHRINK * DASH
    for start in np.arange(0.0, along[-1], dash + SHRINK * GAP):
        places = np.linspace(start, min(start + dash, along[-1]), 4)
        yield np.stack([np.interp(places, along, points[:, axis]) for axis in (0, 1)], axis=1)
