"""The marks of every chart as SVG text, and the drawing around.

Marks are grid, line, band, dots, bars, intervals, levels and text. They are written here rather
than with a plotting library, so that a page follows the reader's light or dark setting, a script in
it can read values back from the drawn lines, and a hundred charts cost milliseconds. Colors are
classes of the page's style sheet.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.lab.report.charts.axis import Axis

MAX_POINTS = 420  # Bins of a drawn line; each keeps its smallest and largest value.
LETTER = 6.1  # Width of a printed character, in the drawing's own units.


@dataclass(frozen=True)
class Frame:
    """The area of a chart: an axis to the right and one upwards."""

    x: Axis
    y: Axis

    @property
    def data(self) -> str:
        """Attributes that let the page's script turn positions back into values."""
        places = " ".join(
            f"{place:g}" for place in (self.x.start, self.y.stop, self.x.stop, self.y.start)
        )
        values = " ".join(
            f"{limit:.9g}" for limit in (self.x.low, self.x.high, self.y.low, self.y.high)
        )
        return f'data-place="{places}" data-range="{values}"'


@dataclass(frozen=True)
class Level:
    """A value to compare with, drawn through the whole chart."""

    value: float
    label: str = ""
    # "limit" for one that should not be crossed, else a class of the style sheet
    style: str = "limit"
    spread: float = 0.0  # half width of a band around it


@dataclass(frozen=True, kw_only=True)
class Box:
    """A place in a drawing: its left and upper border, and how large it is [px]."""

    x: float
    y: float
    width: float
    height: float


def frame(
    left_top: tuple[float, float],
    right_bottom: tuple[float, float],
    x: tuple[float, float] = (0.0, 1.0),
    y: tuple[float, float] = (0.0, 1.0),
    unit: str = "",
) -> Frame:
    """Make the area between two corners for values within limits.

    `unit` stands behind the last tick to the right.
    """
    left, top = left_top
    right, bottom = right_bottom
    return Frame(
        x=Axis(low=x[0], high=x[1], start=left, stop=right, unit=unit),
        y=Axis(low=y[0], high=y[1], start=bottom, stop=top),
    )


def drawing(
    kind: str,
    title: str,
    size: tuple[float, float],
    *parts: str,
    unit: str | None = "",
    attributes: str = "",
) -> str:
    """Draw a chart as an `<svg>` element.

    Parameters
    ----------
    kind : class of the style sheet; "time" charts are read under the pointer by the page's script
    title : of the chart
    size : width and height [px]
    parts : marks, those in front last
    unit : of the values; None prints no title
    attributes : further ones of the element
    """
    heading = "" if unit is None else titled(title, unit, 2.0, 12.0)
    return (
        f'<svg class="chart {kind}" style="--wide: {size[0]:g}px" viewBox="0 0 {size[0]:g}'
        f' {size[1]:g}" role="img" aria-label="{escape(title, True)}"'
        f" {attributes}>{heading}{''.join(parts)}</svg>"
    )


def titled(title: str, unit: str, x: float, y: float) -> str:
    """Write a title with its unit."""
    return (
        f'<text class="title" x="{x:g}" y="{y:g}">{escape(title)} <tspan'
        f' class="unit">{escape(unit)}</tspan></text>'
    )


def mark(tag: str, kind: str, under: str = "", **attributes: str | float) -> str:
    """Write an SVG element of a class of the style sheet; `under` is shown under the pointer."""
    written = ""
    for name, value in attributes.items():
        shown = f"{value:.1f}" if isinstance(value, float) else value
        written += f' {name.replace("_", "-")}="{shown}"'
    opened = f'<{tag} class="{kind}"{written}'
    return f"{opened}><title>{escape(under)}</title></{tag}>" if under else f"{opened}/>"


def rect(kind: str, box: Box, under: str = "", **further: str) -> str:
    """Draw a filled box."""
    return mark(
        "rect", kind, under, x=box.x, y=box.y, width=box.width, height=box.height, **further
    )


def text(x: float, y: float, content: str, kind: str = "tick", under: str = "") -> str:
    """Write words at a position."""
    title = f"<title>{escape(under)}</title>" if under else ""
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{escape(content)}{title}</text>'


def upright_text(x: float, y: float, content: str, kind: str) -> str:
    """Write words upwards along an upright axis."""
    position = f'transform="translate({x:.1f} {y:.1f}) rotate(-90)"'
    return f'<text class="{kind}" {position}>{escape(content)}</text>'


def group(under: str, *parts: str, attributes: str = "") -> str:
    """Group marks that share what is shown under the pointer."""
    return f"<g{attributes}><title>{escape(under)}</title>{''.join(parts)}</g>"


def path_data(x: Array, y: Array) -> str:
    """Write the SVG path of points, broken where one is NaN.

    Parameters
    ----------
    x, y : (n,) positions [px]

    Returns
    -------
    The commands of the path
    """
    parts: list[str] = []
    pen = "M"
    for u, v, good in zip(
        x.tolist(), y.tolist(), (np.isfinite(x) & np.isfinite(y)).tolist(), strict=True
    ):
        if good:
            parts.append(f"{pen}{u:.1f} {v:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(parts)


def grid_up(area: Frame, count: int = 4) -> str:
    """Horizontal grid lines with the values of the upright axis."""
    parts = []
    for tick in area.y.ticks(count):
        parts.append(across(area, tick.position, "zero" if tick.zero else "grid"))
        parts.append(text(area.x.start - 4, tick.position + 3, tick.text, "tick y"))
    return "".join(parts)


def grid_along(area: Frame, count: int = 6, lines: bool = True, drop: float = 15.0) -> str:
    """Draw values of the axis to the right, `drop` below it.

    They come with upright grid lines or with ticks alone.
    """
    parts = []
    for tick in area.x.ticks(count):
        start, style = (
            (area.y.stop, "zero" if tick.zero else "grid") if lines else (area.y.start, "grid")
        )
        stop = area.y.start if lines else area.y.start + 3
        parts.append(mark("path", style, d=f"M{tick.position:.1f} {start:.1f}V{stop:.1f}"))
        parts.append(text(tick.position, area.y.start + drop, tick.text, "tick x"))
    return "".join(parts)


def across(area: Frame, y: float, kind: str) -> str:
    """Draw a horizontal line through the chart."""
    return mark("path", kind, d=f"M{area.x.start:.1f} {y:.1f}H{area.x.stop:.1f}")


def line(area: Frame, x: Array, y: Array, style: str, label: str = "") -> str:
    """Draw a line through points, broken where one is NaN.

    Parameters
    ----------
    area : of the chart, with its axes
    x, y : (n,) in the units of the axes
    style : class of the style sheet
    label : what the reading under the pointer says

    Returns
    -------
    The line as an SVG element
    """
    read = {"data_label": escape(label, True)} if label else {}
    return mark("path", f"line {style}", **read, d=path_data(area.x.at(x), area.y.cut(y)))


def titled_line(area: Frame, x: Array, y: Array, style: str, under: str) -> str:
    """Draw a line through points whose title is shown under the pointer.

    Parameters
    ----------
    area : of the chart, with its axes
    x, y : (n,) in the units of the axes
    style : class of the style sheet
    under : its title

    Returns
    -------
    The line as an SVG element
    """
    return mark("path", f"line {style}", under, d=path_data(area.x.at(x), area.y.cut(y)))


def filled(area: Frame, x: Array, y: Array, style: str) -> str:
    """Fill the area between a line and zero.

    Parameters
    ----------
    area : of the chart, with its axes
    x, y : (n,) in the units of the axes
    style : class of the style sheet

    Returns
    -------
    The area as an SVG element, "" without points
    """
    if not len(x):
        return ""
    base = float(area.y.cut(0.0))
    upper = area.y.cut(y)
    closed = np.concatenate([[base], np.where(np.isfinite(upper), upper, base), [base]])
    along = area.x.at(x)
    return mark(
        "path",
        f"area {style}",
        d=path_data(np.concatenate([along[:1], along, along[-1:]]), closed) + "Z",
    )


def band(area: Frame, x: Array, low: Array, high: Array, style: str) -> str:
    """Fill the area between two lines: an outline for every stretch where both are known.

    Parameters
    ----------
    area : of the chart, with its axes
    x : (n,) in the unit of the axis to the right
    low, high : (n,) in the unit of the upright axis, NaN where not known
    style : class of the style sheet

    Returns
    -------
    The band as an SVG element, "" where nothing is known
    """
    step = max(1, len(x) // 240)
    x = np.asarray(x)[::step]
    low = np.asarray(low)[::step]
    high = np.asarray(high)[::step]
    known = np.isfinite(low) & np.isfinite(high)
    outline = ""
    for start, stop in runs(known):
        along = area.x.at(x[start:stop])
        up = area.y.cut(np.concatenate([high[start:stop], low[start:stop][::-1]]))
        outline += path_data(np.concatenate([along, along[::-1]]), up) + "Z"
    return mark("path", f"band {style}", d=outline) if outline else ""


def intervals(
    area: Frame, x: Array, limits: tuple[Array, Array], style: str, aside: float = 0.0
) -> str:
    """Draw an upright line from low to high at every x where they differ.

    Parameters
    ----------
    area : of the chart, with its axes
    x : (n,) in the unit of the axis to the right
    limits : (n,) low and high, in the unit of the upright axis
    style : class of the style sheet
    aside : how far to the right of x they are drawn [px]

    Returns
    -------
    The lines as an SVG element
    """
    low, high = limits
    differ = np.asarray(high) - np.asarray(low) > 1e-3 * (area.y.high - area.y.low)
    along = area.x.at(np.asarray(x)[differ]) + aside
    ends = [area.y.cut(np.asarray(values)[differ]) for values in (low, high)]
    data = "".join(
        f"M{u:.1f} {first:.1f}V{last:.1f}" for u, first, last in zip(along, *ends, strict=True)
    )
    return mark("path", f"interval {style}", d=data)


def dot(x: float, y: float, style: str, radius: float = 3.3, under: str = "") -> str:
    """Draw a round mark at a position."""
    return mark("circle", f"mark {style}", under, cx=x, cy=y, r=f"{radius:g}")


def levels_across(area: Frame, levels: Sequence[Level]) -> str:
    """Horizontal lines with their labels at the right, and bands around those that spread."""
    parts = []
    for level in levels:
        if not area.y.low <= level.value <= area.y.high:
            continue
        kind = _level_class(level)
        y = float(area.y.at(level.value))
        if level.spread > 0.0:
            top = float(area.y.cut(level.value + 1 * level.spread))
            bottom = float(area.y.cut(level.value + (-1) * level.spread))
            wide = area.x.stop - area.x.start
            box = Box(x=area.x.start, y=top, width=wide, height=bottom - top)
            parts.append(rect(f"spread {level.style}", box))
        parts += [
            across(area, y, kind),
            text(area.x.stop - 3, y - 3, level.label, kind) if level.label else "",
        ]
    return "".join(parts)


def levels_up(area: Frame, levels: Sequence[Level]) -> str:
    """Upright lines with their labels above, those beside each other in two rows."""
    parts = []
    for row, level in enumerate(levels):
        if area.x.low <= level.value <= area.x.high:
            kind = _level_class(level)
            x = float(area.x.at(level.value))
            top = area.y.stop - 3
            parts.append(mark("path", kind, d=f"M{x:.1f} {top:.1f}V{area.y.start:.1f}"))
            # Labels lie towards the middle, so that none leaves the drawing.
            aside, anchor = (3, " start") if 2 * x < area.x.start + area.x.stop else (-3, "")
            parts.append(text(x + aside, top - 10 * (row % 2), level.label, kind + anchor))
    return "".join(parts)


def _level_class(level: Level) -> str:
    return "limit" if level.style == "limit" else f"level {level.style}"


def image(href: str, box: Box, under: str = "", stretch: bool = False) -> str:
    """Draw a picture; `stretch` lets it fill its place whatever its own proportions."""
    title = f"><title>{escape(under)}</title></image>" if under else "/>"
    fit = ' preserveAspectRatio="none"' if stretch else ""
    return (
        f'<image href="{href}" x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}"'
        f' height="{box.height:.1f}"{fit}{title}'
    )


def shortened(words: str, room: float) -> str:
    """Words cut to what fits, in the drawing's own units."""
    count = max(int(room), 1)
    return words if len(words) <= count else f"{words[: max(count - 1, 1)]}…"


def decimate(time: Array, values: Array, max_count: int = MAX_POINTS) -> tuple[Array, Array]:
    """Choose fewer points that draw the same line.

    They are the first of the smallest and of the largest of every bin. Peaks survive. A bin without
    any value becomes one NaN, which breaks the line.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples,)
    max_count : bins

    Returns
    -------
    Times and values, (points,) each
    """
    if len(time) <= 2 * max_count:
        return time, values
    edges = np.linspace(0, len(time), max_count + 1).astype(np.int64)
    low = np.where(np.isnan(values), np.inf, values)
    high = np.where(np.isnan(values), -np.inf, values)
    keep = np.empty((max_count, 2), dtype=np.int64)
    for i, (start, stop) in enumerate(itertools.pairwise(edges)):
        keep[i] = start + np.argmin(low[start:stop]), start + np.argmax(high[start:stop])
    chosen = np.unique(np.append(keep, [0, len(time) - 1]))
    return time[chosen], values[chosen]


def envelope(
    time: Array, values: Array, max_count: int = MAX_POINTS // 2
) -> tuple[Array, Array, Array, Array] | None:
    """Find mean, smallest and largest value of bins, where a line would only fill its chart.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples,) NaN where not known
    max_count : bins

    Returns
    -------
    Time, mean, smallest and largest value, (bins,) each; None for lines that are short, or that
        change little within a bin
    """
    if len(time) <= 4 * max_count:
        return None
    edges = np.linspace(0, len(time), max_count + 1).astype(np.int64)[:-1]
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
    middle = time[np.minimum(edges + len(time) // (2 * max_count), len(time) - 1)]
    return middle, mean, np.where(seen, low, np.nan), np.where(seen, high, np.nan)
