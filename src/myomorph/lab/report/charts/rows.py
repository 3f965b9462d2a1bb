"""One row, or one column, for each name: bars, dots and intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.interval import Interval
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import number


@read_only
class Beside:
    """Values (names,) drawn as marks beside others, NaN where there is none."""

    label: str
    style: str
    values: Array


def row_frame(
    names: Sequence[str], x: tuple[float, float], row: float, width: float, top: float = 26.0
) -> svg.Frame:
    """Make the area of rows of one height under each other, with room for names at the left."""
    left = 10.0 + svg.LETTER * max((len(name) for name in names), default=1)
    return svg.frame((left, top), (width - 14.0, top + row * len(names)), x)


def _named_rows(
    kind: str,
    title: str,
    unit: str,
    area: svg.Frame,
    rows: Sequence[tuple[str, str, str]],
    width: float,
    levels: Sequence[svg.Level] = (),
    count: int = 6,
) -> str:
    """Draw rows, each its name, what is shown under the pointer, and its marks."""
    tall = (area.y.start - area.y.stop) / max(len(rows), 1)
    parts = []
    for i, (name, under, marks) in enumerate(rows):
        label = svg.text(area.x.start - 6, area.y.stop + tall * (i + 0.5) + 3.5, name, "tick y")
        parts.append(svg.group(f"{name}: {under}", label, marks))
    size = width, int(area.y.start + 24)
    return svg.drawing(
        kind,
        title,
        size,
        svg.grid_along(area, count),
        svg.levels_up(area, levels),
        *parts,
        unit=unit,
    )


def _across(area: svg.Frame, low: float, high: float, y: float, kind: str) -> str:
    """Draw a line along a row."""
    return svg.mark(
        "path", kind, d=f"M{float(area.x.cut(low)):.1f} {y:.1f}H{float(area.x.cut(high)):.1f}"
    )


@read_only
class Rows:
    """Values by name, of one kind or several.

    Attributes
    ----------
    names : of the rows
    values : (names,) of each kind
    styles : one per kind
    labels : one per kind
    """

    names: Sequence[str]
    values: Sequence[Array]
    styles: Sequence[str]
    labels: Sequence[str]

    def under(self, row: int, unit: str) -> str:
        """Write what is shown under the pointer on a row."""
        listed = ", ".join(
            f"{label} {number(float(kind[row]))}"
            for label, kind in zip(self.labels, self.values, strict=True)
        )
        return f"{listed} {unit}".strip()


@dataclass(frozen=True, kw_only=True)
class BarLook:
    """How bars are drawn.

    Attributes
    ----------
    levels : upright lines
    width : of the chart [px]
    peak : value that the scale reaches at least, so that charts share one
    """

    levels: Sequence[svg.Level] = ()
    width: int = 680
    peak: float = 0.0


def bar_plot(title: str, unit: str, rows: Rows, look: BarLook | None = None) -> str:
    """Draw bars of names; several values of a name lie over each other.

    Parameters
    ----------
    title : of the chart
    unit : of the values
    rows : names and values, the kind with the widest bars first
    look : lines, width and scale

    Returns
    -------
    The chart as an `<svg>` element
    """
    look = look or BarLook()
    row = 15.0
    highest = (float(np.nanmax(value)) for value in rows.values if np.isfinite(value).any())
    peak = max([look.peak, *highest, *(level.value for level in look.levels)])
    top = 36.0 if look.levels else 26.0
    area = row_frame(rows.names, (0.0, 1.06 * (peak or 1.0)), row, look.width, top)
    drawn = []
    for i, name in enumerate(rows.names):
        bars = ""
        for j, (column, style) in enumerate(zip(rows.values, rows.styles, strict=True)):
            thick = row - 4.0 if j == 0 else row - 9.0
            top = area.y.stop + row * (i + 0.5) - thick / 2
            wide = float(area.x.at(column[i])) - area.x.start
            bars += (
                svg.rect(f"bar {style}", svg.Box(x=area.x.start, y=top, width=wide, height=thick))
                if np.isfinite(wide)
                else ""
            )
        drawn.append((name, rows.under(i, unit), bars))
    return _named_rows("bars", title, unit, area, drawn, look.width, look.levels)


def dot_plot(
    title: str, unit: str, rows: Rows, width: int = 680, spread: Array | None = None
) -> str:
    """Draw one row per name with a dot for each of its values, joined by a line.

    So many names compare at a glance.

    Parameters
    ----------
    title : of the chart
    unit : of the values
    rows : names and values
    width : of the chart [px]
    spread : (names,) drawn as a bar to both sides of the first kind's dot

    Returns
    -------
    The chart as an `<svg>` element
    """
    values = rows.values
    half = np.zeros(len(rows.names)) if spread is None else np.nan_to_num(spread)
    finite = [
        value[np.isfinite(value)] for value in (values[0] - half, values[0] + half, *values[1:])
    ]
    low = min(0.0, *(float(column.min(initial=0.0)) for column in finite))
    high = max((float(column.max(initial=0.0)) for column in finite), default=1.0) or 1.0
    air = 0.05 * (high - low)
    row = 14.0
    area = row_frame(rows.names, (low - air * (low < 0.0), high + air), row, width)
    drawn = []
    for i, name in enumerate(rows.names):
        row_values = [float(value[i]) for value in values]
        y = area.y.stop + row * (i + 0.5)
        known = [value for value in row_values if np.isfinite(value)]
        marks = _across(area, min(known), max(known), y, "grid") if len(known) > 1 else ""
        if half[i] > 0.0:
            marks += _across(
                area, row_values[0] - half[i], row_values[0] + half[i], y, f"line {rows.styles[0]}"
            )
        for at, style in reversed(list(zip(row_values, rows.styles, strict=True))):
            marks += svg.dot(float(area.x.at(at)), y, style) if np.isfinite(at) else ""
        drawn.append((name, rows.under(i, unit), marks))
    return _named_rows("dots", title, unit, area, drawn, width)


@dataclass(frozen=True, kw_only=True)
class IntervalLook:
    """What a chart of intervals shows besides them.

    Attributes
    ----------
    beside : further values of the names
    levels : lines across
    solid : names whose dots are filled, all by default
    signed : zero is in the middle, for values of both signs, and the chart at least 1 wide to
        both sides
    """

    beside: Sequence[Beside] = ()
    levels: Sequence[svg.Level] = ()
    solid: Sequence[bool] | None = None
    signed: bool = False


def interval_rows(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Interval],
    look: IntervalLook | None = None,
) -> str:
    """Draw dots with intervals in rows, and further values as upright ticks.

    Intervals far beyond all values are cut.
    """
    look = look or IntervalLook()
    reach = _reach(values, look)
    row = 17.0
    low = -reach if look.signed else 0.0
    area = row_frame(names, (low, reach), row, 680, 38.0 if look.levels else 28.0)
    rows = []
    for i, (name, value) in enumerate(zip(names, values, strict=True)):
        y = area.y.stop + row * (i + 0.5)
        style = "first" if look.solid is None or look.solid[i] else "open"
        marks = _whisker(area, value, y)
        for other in look.beside:
            if np.isfinite(other.values[i]):
                x = float(area.x.at(other.values[i]))
                marks += svg.mark("path", f"tack {other.style}", d=f"M{x:.1f} {y - 5:.1f}v10")
        if np.isfinite(value.value):
            marks += svg.dot(float(area.x.cut(value.value)), y, style, 4.2)
        words = "; ".join([with_interval(value), *_printed(look.beside, i)])
        rows.append((name, f"{words} {unit}", marks))
    count = 7 if look.signed else 6
    return _named_rows("rows", title, unit, area, rows, 680, look.levels, count)


def _reach(values: Sequence[Interval], look: IntervalLook) -> float:
    """Find how far the axis reaches: to all values, and to intervals that do not go far beyond."""
    known = [dot.value for dot in values] + [level.value for level in look.levels]
    known += [value for marks in look.beside for value in marks.values]
    peak = max([abs(value) for value in known if np.isfinite(value)] or [0.0])
    peak, furthest = (max(peak, 1.0), 3.0) if look.signed else (peak, 1.5)
    ends = [
        abs(end) for interval in values for end in (interval.low, interval.high) if np.isfinite(end)
    ]
    return 1.06 * max(peak, min(max(ends, default=0.0), furthest * peak)) or 1.0


def _whisker(area: svg.Frame, value: Interval, y: float) -> str:
    """Draw an interval with caps at the ends that are inside the chart."""
    if not (np.isfinite(value.low) and np.isfinite(value.high)):
        return ""
    inside = [
        float(area.x.at(end)) for end in (value.low, value.high) if area.x.low <= end <= area.x.high
    ]
    caps = (svg.mark("path", "whisker", d=f"M{x:.1f} {y - 3:.1f}v6") for x in inside)
    return _across(area, value.low, value.high, y, "whisker") + "".join(caps)


def with_interval(estimate: Interval) -> str:
    """Write a value for print, with its interval where that is known."""
    interval = (
        f" ({number(estimate.low)} to {number(estimate.high)})" if np.isfinite(estimate.low) else ""
    )
    if not np.isfinite(estimate.value) and interval:
        return interval.strip(" ()")
    return number(estimate.value) + interval


def _printed(beside: Sequence[Beside], i: int) -> list[str]:
    return [
        f"{marks.label} {number(float(marks.values[i]))}"
        for marks in beside
        if np.isfinite(marks.values[i])
    ]


def interval_bars(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Interval | None],
    look: IntervalLook | None = None,
) -> str:
    """Draw upright bars, one per name, each with its interval.

    An interval that reaches far above the rest is cut.
    """
    look = look or IntervalLook()
    beside = look.beside
    top = _top(values, beside, look.levels)
    width = 330
    height = 210
    area = svg.frame(
        (48.0, 26.0), (width - 8.0, height - 24.0), (0.0, float(max(len(names), 1))), (0.0, top)
    )
    column = (area.x.stop - area.x.start) / max(len(names), 1)
    half = min(13.0, 0.3 * column)
    parts = [svg.grid_up(area), svg.levels_across(area, look.levels)]
    for i, (name, value) in enumerate(zip(names, values, strict=True)):
        x = float(area.x.at(i + 0.5))
        known = [] if value is None else [with_interval(value)]
        marks = svg.text(x, height - 8.0, svg.shortened(name, column / 6.0), "tick x")
        marks += "" if value is None else _bar(area, value, x, half)
        for other in beside:
            if np.isfinite(other.values[i]):
                y = float(area.y.cut(other.values[i]))
                marks += svg.mark(
                    "path",
                    f"tack {other.style}",
                    d=f"M{x - half - 3:.1f} {y:.1f}h{2 * half + 6:.1f}",
                )
        parts.append(
            svg.group(
                f"{name}: {'; '.join([*known, *_printed(beside, i)]) or 'not known'} {unit}", marks
            )
        )
    return svg.drawing("upright", title, (width, height), *parts, unit=unit)


def _top(
    values: Sequence[Interval | None], beside: Sequence[Beside], levels: Sequence[svg.Level]
) -> float:
    """Highest value shown: all, except intervals that would press everything else to the floor."""
    known = [
        value.value if np.isfinite(value.value) else value.high
        for value in values
        if value is not None and (np.isfinite(value.value) or np.isfinite(value.high))
    ]
    known += [float(value) for other in beside for value in other.values if np.isfinite(value)]
    known += [
        level.value + level.spread for level in levels if np.isfinite(level.value + level.spread)
    ]
    highs = [value.high for value in values if value is not None and np.isfinite(value.high)]
    peak = max([*known, 0.0])
    return 1.08 * max(peak, min(max([*highs, 0.0]), 2.0 * peak)) or 1.0


def _bar(area: svg.Frame, estimate: Interval, x: float, half: float) -> str:
    """Draw an upright bar with its whisker, and an arrow where the interval is cut.

    Of a range without a value the range is drawn.
    """
    if not np.isfinite(estimate.value):
        if not (np.isfinite(estimate.low) and np.isfinite(estimate.high)):
            return ""
        top = float(area.y.cut(estimate.high))
        tall = max(float(area.y.cut(estimate.low)) - top, 0.5)
        return svg.rect("bar first soft", svg.Box(x=x - half, y=top, width=2.0 * half, height=tall))
    y = float(area.y.cut(estimate.value))
    bottom = area.y.start
    bar = svg.rect(
        "bar first soft", svg.Box(x=x - half, y=y, width=2.0 * half, height=max(bottom - y, 0.5))
    )
    if not (
        np.isfinite(estimate.low) and np.isfinite(estimate.high) and estimate.high > estimate.low
    ):
        return bar
    low = float(area.y.cut(estimate.low))
    high = float(area.y.cut(estimate.high))
    cap = (
        f"M{x - 4:.1f} {high:.1f}h8"
        if estimate.high <= area.y.high
        else f"M{x - 4:.1f} {high + 5:.1f}l4 -5l4 5"
    )
    return bar + svg.mark(
        "path", "whisker", d=f"M{x:.1f} {low:.1f}V{high:.1f}M{x - 4:.1f} {low:.1f}h8{cap}"
    )
