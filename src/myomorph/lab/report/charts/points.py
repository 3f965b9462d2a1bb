"""One quantity against another: clouds of points, values by rank, and paths seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import limits, number

RANK_HEIGHT = 230  # Of a chart of ranks [px]
MAX_DOTS = 700  # Points drawn; more of them would only darken the cloud.


@read_only
class Cloud:
    """Points (n,) to the right and up.

    `joined` draws them as a line, `dotted` as a line with its points.
    """

    x: Array
    y: Array
    style: str
    label: str
    joined: bool = False
    dotted: bool = False


@dataclass(frozen=True, kw_only=True)
class CloudLook:
    """How a chart of clouds looks.

    Attributes
    ----------
    width, height : of the chart [px]
    zero : whether both axes begin at or pass 0
    """

    width: int = 330
    height: int = 230
    zero: bool = True


def xy_plot(
    title: str,
    unit: str,
    x_label: str,
    clouds: Sequence[Cloud],
    look: CloudLook | None = None,
) -> str:
    """Draw point clouds and lines over common axes."""
    look = look or CloudLook()
    width = look.width
    height = look.height
    x = [cloud.x[np.isfinite(cloud.y)] for cloud in clouds]
    y = [cloud.y[np.isfinite(cloud.y)] for cloud in clouds]
    area = svg.frame(
        (48.0, 26.0),
        (width - 10.0, height - 36.0),
        limits(x, zero=look.zero),
        limits(y, zero=look.zero),
    )
    below = svg.text((area.x.start + area.x.stop) / 2, height - 6.0, x_label, "tick x")
    parts = [
        svg.grid_up(area),
        svg.grid_along(area, 5, drop=14.0),
        below,
        *(_cloud(area, cloud) for cloud in clouds),
    ]
    return svg.drawing("scatter", title, (width, height), *parts, unit=unit)


def _cloud(area: svg.Frame, cloud: Cloud) -> str:
    known = np.flatnonzero(np.isfinite(cloud.x) & np.isfinite(cloud.y))
    keep = known[
        np.unique(np.linspace(0, len(known) - 1, min(len(known), MAX_DOTS)).astype(np.int64))
    ]
    x = cloud.x[keep]
    y = cloud.y[keep]
    result = (
        svg.titled_line(area, x, y, cloud.style, cloud.label)
        if cloud.joined or cloud.dotted
        else ""
    )
    places = list(zip(area.x.at(x).tolist(), area.y.at(y).tolist(), strict=True))
    if cloud.dotted:
        return result + "".join(svg.dot(a, b, cloud.style, 3.0, cloud.label) for a, b in places)
    if cloud.joined:
        return result
    return svg.mark(
        "path",
        f"cloud {cloud.style}",
        cloud.label,
        d="".join(f"M{a:.1f} {b:.1f}h0" for a, b in places),
    )


@read_only
class Ranked:
    """Positive values that are drawn in ascending order.

    Attributes
    ----------
    names : of the values
    values : (n,) those that are not positive or not known are left out
    levels : values of horizontal lines, with their labels
    strong : (n,) values whose dots are colored; all by default
    """

    names: Sequence[str]
    values: Array
    levels: Sequence[tuple[float, str]] = ()
    strong: np.ndarray | None = None


def rank_plot(title: str, unit: str, x_label: str, ranked: Ranked, width: int = 680) -> str:
    """Draw positive values from the smallest to the largest on a logarithmic scale, one dot each.

    Parameters
    ----------
    title : of the chart
    unit : of the values
    x_label : words below the axis
    ranked : names, values and lines
    width : of the chart [px]

    Returns
    -------
    The chart as an `<svg>` element
    """
    values = ranked.values
    known = np.flatnonzero(np.isfinite(values) & (values > 0.0))
    order = known[np.argsort(values[known], kind="stable")]
    logs = np.log10(values[order])
    marks = [svg.Level(float(np.log10(value)), label) for value, label in ranked.levels]
    everything = np.concatenate([logs, [mark.value for mark in marks], [-1.0]])
    span = float(np.floor(everything.min())), float(np.ceil(everything.max() + 1e-9))
    area = svg.frame(
        (52.0, 28.0), (width - 12.0, RANK_HEIGHT - 34.0), (0.0, float(max(len(order) + 1, 2))), span
    )
    parts = []
    powers = np.arange(int(span[0]), int(span[1]) + 1)
    for power in powers[:: max(1, int(np.ceil(len(powers) / 8)))]:
        y = float(area.y.at(power))
        parts += [
            svg.across(area, y, "grid"),
            svg.text(area.x.start - 4, y + 3, number(10.0**power), "tick y"),
        ]
    for tick in area.x.ticks(min(8, len(order))):
        parts.append(svg.text(tick.position, area.y.start + 14, tick.text, "tick x"))
    parts.append(svg.text((area.x.start + area.x.stop) / 2, area.y.start + 28, x_label, "tick x"))
    parts.append(svg.levels_across(area, marks))
    for rank, (i, log) in enumerate(zip(order, logs, strict=True), 1):
        style = "first" if ranked.strong is None or ranked.strong[i] else "middle"
        under = f"{ranked.names[i]}: {number(float(values[i]))} {unit}"
        parts.append(svg.dot(float(area.x.at(rank)), float(area.y.at(log)), style, 2.2, under))
    return svg.drawing("dots", title, (width, RANK_HEIGHT), *parts, unit=unit)


@dataclass(frozen=True, kw_only=True)
class FloorLook:
    """How a chart of the ground looks.

    Attributes
    ----------
    width, height : of the chart [px]
    unit : of the points
    one_scale : whether both axes have one scale; else each fills the chart
    """

    width: int = 330
    height: int = 190
    unit: str = "m"
    one_scale: bool = True


def floor_plot(
    title: str,
    axes: tuple[str, str],
    paths: Sequence[tuple[str, str, Array]],
    outlines: Sequence[tuple[str, Array]] = (),
    look: FloorLook | None = None,
) -> str:
    """Draw paths on the ground and outlines of plates from above.

    Parameters
    ----------
    title : of the chart
    axes : names, to the right and upwards
    paths : label, style and points (frames, 2) of each
    outlines : name and corners (corners, 2) of each
    look : size, unit and scale

    Returns
    -------
    The chart as an `<svg>` element, "" where no point is known
    """
    look = look or FloorLook()
    clouds = [points[np.isfinite(points).all(axis=1)] for _, _, points in paths]
    everything = [cloud for cloud in clouds if len(cloud)] + [corners for _, corners in outlines]
    if not everything:
        return ""
    area = _floor_area(np.concatenate(everything), look)
    middle = (area.x.start + area.x.stop) / 2, (area.y.start + area.y.stop) / 2
    parts = [
        svg.grid_along(area, 4, drop=13.0),
        svg.grid_up(area),
        svg.text(middle[0], area.y.start + 27, f"{axes[0]} →", "tick x"),
        svg.upright_text(11.0, middle[1], f"{axes[1]} →", "tick x"),
    ]
    for label, corners in outlines:
        data = svg.path_data(area.x.at(corners[:, 0]), area.y.at(corners[:, 1]))
        parts.append(svg.mark("path", "plate", label, d=f"{data}Z"))
    for label, style, points in paths:
        shown = points[:: max(1, len(points) // 800)]
        data = svg.path_data(area.x.at(shown[:, 0]), area.y.cut(shown[:, 1]))
        named = escape(label, True)
        parts.append(svg.mark("path", f"line {style}", label, data_label=named, d=data))
    return svg.drawing("floor", title, (look.width, look.height), *parts, unit=look.unit)


def _floor_area(points: Array, look: FloorLook) -> svg.Frame:
    """Make the area that holds all points (n, 2), with one scale for both axes if wanted."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    left = 46.0
    top = 26.0
    right = look.width - 8.0
    bottom = look.height - 34.0
    least = 0.25 * max(float((high - low).max()) * 1.12, 1e-3)
    room = np.array([right - left, bottom - top])
    half = room / float((room / np.maximum(1.12 * (high - low), least)).min()) / 2
    if not look.one_scale:
        half = np.maximum(0.56 * (high - low), 1e-9)
    x0, y0 = (low + high) / 2 - half
    x1, y1 = (low + high) / 2 + half
    return svg.frame((left, top), (right, bottom), (x0, x1), (y0, y1))
