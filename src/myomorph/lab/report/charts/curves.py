"""Curves: over time, and over a cycle with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import Axis, limits, number


@read_only
class Line:
    """Values over time and how they are drawn."""

    # time, values: (samples,)
    time: Array
    values: Array
    # class of the style sheet: "right", "left", "middle", "truth", "emg", "first", "second",
    # "third"
    style: str
    label: str  # what the reading under the pointer says
    filled: bool = False  # as an area down to zero
    # low, high: (samples,) between which the values are believed to lie, drawn as a band; None for
    # none
    low: Array | None = None
    high: Array | None = None

    @property
    def ends(self) -> tuple[Line, ...]:
        """The limits as lines of their own; none where there is no band."""
        limits = (self.low, self.high)
        return tuple(
            Line(time=self.time, values=values, style=self.style, label=self.label)
            for values in limits
            if values is not None
        )


def within(span: tuple[float, float], time: Array, *values: Array) -> list[Array]:
    """Cut times and values to a span of time.

    Parameters
    ----------
    span : first and last time [s]
    time : (samples,) [s]
    values : (samples,) each

    Returns
    -------
    Times and values inside the span, (samples inside,) each
    """
    inside = (time >= span[0] - 1e-9) & (time <= span[1] + 1e-9)
    return [np.asarray(column)[inside] for column in (time, *values)]


def line_limits(
    lines: Sequence[Line], span: tuple[float, float], low: float | None, high: float | None
) -> tuple[float, float]:
    """Lowest and highest value of lines within a span, zero too where one is filled."""
    low = min(low or 0.0, 0.0) if any(line.filled for line in lines) else low
    return limits(
        [within(span, part.time, part.values)[1] for line in lines for part in (line, *line.ends)],
        low,
        high,
    )


def drawn_line(area: svg.Frame, curve: Line, span: tuple[float, float]) -> str:
    """Draw a line within a span, thinned to what the chart can show.

    Of noise the mean is drawn in the band of its extremes. A filled line is filled down to zero.
    """
    time, values = within(span, curve.time, curve.values)
    if curve.low is not None and curve.high is not None:
        _, low, high = within(span, curve.time, curve.low, curve.high)
        alone = drawn_line(area, replace(curve, low=None, high=None), span)
        return svg.band(area, time, low, high, curve.style) + alone
    bins = svg.envelope(time, values)
    if bins is not None:
        time, values, low, high = bins
        return svg.band(area, time, low, high, curve.style) + svg.line(
            area, time, values, curve.style, curve.label
        )
    time, values = svg.decimate(time, values)
    under = svg.filled(area, time, values, curve.style) if curve.filled else ""
    return under + svg.line(area, time, values, curve.style, curve.label)


@dataclass(frozen=True, kw_only=True)
class TimeLook:
    """How a chart over time looks.

    Attributes
    ----------
    events : upright lines
    levels : horizontal lines
    low, high : values that must be inside
    width, height : of the chart [px]
    name_events : whether events have their names
    second : factor and unit of a second scale on the right, e.g. moments per kilogram
    margin : free space on the right, so that charts above each other line up [px]
    """

    events: Sequence[Event] = ()
    levels: Sequence[svg.Level] = ()
    low: float | None = None
    high: float | None = None
    width: int = 330
    height: int = 190
    name_events: bool = False
    second: tuple[float, str] | None = None
    margin: int = 8


def time_plot(
    title: str,
    unit: str,
    lines: Sequence[Line],
    span: tuple[float, float],
    look: TimeLook | None = None,
) -> str:
    """Draw lines over time as an `<svg>` element.

    Parameters
    ----------
    title : of the chart
    unit : of the values
    lines : curves over time
    span : first and last time [s]
    look : size, events, levels and scales
    """
    look = look or TimeLook()
    first, last = span
    top = 40.0 if look.name_events and look.events else 26.0
    right = look.width - (36.0 if look.second else look.margin)
    shown = line_limits(lines, span, look.low, look.high)
    area = svg.frame(
        (46.0, top), (right, look.height - 22.0), (first, max(last, first + 1e-9)), shown, "s"
    )
    tall = area.y.start - area.y.stop
    wide = area.x.stop - area.x.start
    parts = [svg.grid_up(area, max(2, min(4, int(tall / 32))))]
    parts.append(svg.grid_along(area, max(3, int(wide / 46)), lines=False, drop=14.0))
    parts += [_second_scale(area, *look.second)] if look.second else []
    parts += [_events(area, look.events, look.name_events)]
    parts += [*(drawn_line(area, line, span) for line in lines)]
    parts.append(svg.levels_across(area, look.levels))
    size = look.width, look.height
    return svg.drawing("time", title, size, *parts, unit=unit, attributes=area.data)


def _second_scale(area: svg.Frame, factor: float, unit: str) -> str:
    """Draw the scale of the same values in another unit, at the right."""
    axis = Axis(
        low=area.y.low * factor, high=area.y.high * factor, start=area.y.start, stop=area.y.stop
    )
    parts = [svg.text(area.x.stop + 32, area.y.stop - 7, unit, "tick y second")]
    for tick in axis.ticks():
        parts.append(svg.mark("path", "grid", d=f"M{area.x.stop:.1f} {tick.position:.1f}h3"))
        parts.append(svg.text(area.x.stop + 5, tick.position + 3, tick.text, "tick end second"))
    return "".join(parts)


def event_line(area: svg.Frame, event: Event, style: str = "") -> str:
    """Draw an upright line at an event, in the color of its side where no style is given."""
    name = f"{event.side} {event.label}".strip()
    style = style or event.side.lower() or "middle"
    data = f"M{float(area.x.at(event.time)):.1f} {area.y.stop:.1f}V{area.y.start:.1f}"
    return svg.mark("path", f"event {style}", f"{name}, {number(event.time, 0.001)} s", d=data)


def _events(area: svg.Frame, events: Sequence[Event], named: bool) -> str:
    """Events as lines, named above the chart in two rows as far as there is room."""
    parts = []
    taken = [-np.inf, -np.inf]
    for event in events:
        if not area.x.low <= event.time <= area.x.high:
            continue
        parts.append(event_line(area, event))
        short = f"{event.side[:1]} {event.label.replace('Foot ', '')}".strip()
        x = float(area.x.at(event.time))
        half = 2.6 * len(short) + 3
        row = next((row for row in (0, 1) if x - half > taken[row]), None)
        if named and row is not None:
            parts.append(
                svg.text(
                    x, area.y.stop - 4 - 10 * row, short, f"event {event.side.lower() or 'middle'}"
                )
            )
            taken[row] = x + half
    return "".join(parts)


@read_only
class CycleCurve:
    """A mean over the cycle, from 0 to 100 % in even steps."""

    mean: Array  # (samples,), NaN where unknown
    style: str
    label: str
    interval: tuple[Array, Array] | None = None  # low and high (samples,) of the mean, or None
    # low and high (samples,) of a wider, fainter band, or None
    spread: tuple[Array, Array] | None = None
    each: Iterable[Array] = ()  # (samples,) curves that the mean is of, drawn thin


@dataclass(frozen=True, kw_only=True)
class CycleLook:
    """What a chart over the cycle shows besides its curves.

    Attributes
    ----------
    differs : start and stop of each bar below [%], and its words
    height : of the chart [px]
    upright : lines at a percent, with style
    """

    differs: Sequence[tuple[float, float, str]] = ()
    height: int = 220
    upright: Sequence[tuple[float, str]] = ()


def cycle_chart(
    title: str,
    unit: str,
    curves: Sequence[CycleCurve],
    shown: Sequence[Array],
    look: CycleLook | None = None,
) -> str:
    """Draw mean curves over the cycle with their intervals, and bars below where they differ.

    Parameters
    ----------
    title : of the chart
    unit : of the curves
    curves : means with intervals and spreads
    shown : arrays of values that must be inside; intervals beyond them are cut
    look : height, bars and upright lines

    Returns
    -------
    The chart as an `<svg>` element
    """
    look = look or CycleLook()
    width = 330.0
    height = look.height
    area = svg.frame((46.0, 26.0), (width - 8, height - 32.0), (0.0, 100.0), limits(shown), "%")
    behind = [svg.grid_up(area), svg.grid_along(area, 4, lines=False, drop=24.0)]
    front = []
    for cycle_curve in curves:
        percent = np.linspace(0.0, 100.0, len(cycle_curve.mean))
        known = (curve for curve in cycle_curve.each if np.isfinite(curve).any())
        behind += [svg.line(area, percent, curve, f"thin {cycle_curve.style}") for curve in known]
        for ends, faint in ((cycle_curve.spread, "faint "), (cycle_curve.interval, "")):
            behind.append(
                svg.band(area, percent, *ends, f"{faint}{cycle_curve.style}")
                if ends is not None
                else ""
            )
        front.append(
            svg.line(area, percent, cycle_curve.mean, cycle_curve.style, cycle_curve.label)
        )
    for start, stop, under in look.differs:
        a = float(area.x.at(start))
        b = float(area.x.at(stop))
        front.append(
            svg.rect(
                "differs",
                svg.Box(x=a - 1.0, y=area.y.start + 5.0, width=b - a + 2.0, height=5.0),
                under,
            )
        )
    for at, style in look.upright:
        path = f"M{float(area.x.at(at)):.1f} {area.y.stop:.1f}V{area.y.start:.1f}"
        behind.append(svg.mark("path", f"event {style}", d=path))
    attributes = f'{area.data} data-clock="%"'
    return svg.drawing(
        "time", title, (width, height), *behind, *front, unit=unit, attributes=attributes
    )
