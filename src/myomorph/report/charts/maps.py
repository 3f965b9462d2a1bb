"""Charts that are not lines over time: the heat map of many muscles and paths seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.series import Event
from myomorph.report.charts.axis import number, ticks
from myomorph.report.charts.chart import Frame, heading, path_data
from myomorph.report.scene.image import HEAT, data_uri, png

MOST_COLUMNS = 700


def pooled(values: Array, most: int = MOST_COLUMNS) -> Array:
    """(frames, n) cut to at most `most` rows, each the largest of the frames it stands for."""
    if len(values) <= most:
        return values
    edges = np.linspace(0, len(values), most + 1).astype(np.int64)
    filled = np.where(np.isnan(values), -np.inf, values)
    largest: Array = np.maximum.reduceat(filled, edges[:-1], axis=0)
    return np.where(np.isfinite(largest), largest, np.nan)


def heat_map(
    title: str,
    unit: str,
    time: Array,
    values: Array,
    names: Sequence[str],
    blocks: Sequence[tuple[str, NDArray[np.int64]]],
    events: Sequence[Event] = (),
    width: int = 1040,
) -> str:
    """Many columns over time as rows of color, light for zero, in labelled blocks.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, columns), not negative
    names : of the columns
    blocks : a label and the columns in it, from top to bottom
    """
    rows = int(sum(len(columns) for _, columns in blocks))
    row = 10.0 if rows <= 90 else max(1.6, 900.0 / rows)
    gap, top, left = 14.0, 38.0, 96.0
    height = int(top + rows * row + gap * (len(blocks) - 1) + 24)
    right = width - 76.0
    finite = values[np.isfinite(values)]
    peak = float(finite.max()) if finite.size else 0.0
    peak = peak or 1.0
    shown = pooled(values)
    index = np.clip(np.round(np.nan_to_num(shown) / peak * 255.0), 0, 255).astype(np.uint8)
    last = max(float(time[-1]), float(time[0]) + 1e-9)
    parts = [
        f'<svg class="chart heat" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}" '
        f'data-peak="{peak:.9g}" data-unit="{escape(unit, True)}">',
        heading(title, unit),
    ]
    y = top
    every = max(1, int(np.ceil(9.8 / row)))
    for label, columns in blocks:
        tall = len(columns) * row
        frame = Frame(left, y, right, y + tall, float(time[0]), last, 0.0, float(len(columns)))
        parts += _heat_block(frame, label, [names[i] for i in columns], index[:, columns], every)
        parts += _events_over(frame, label, events)
        y += tall + gap
    y -= gap
    frame = Frame(left, top, right, y, float(time[0]), last, 0.0, 1.0)
    along = ticks(frame.x0, frame.x1, 9)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        text = number(float(value), step) + (" s" if value == along[-1] else "")
        parts.append(f'<path class="grid" d="M{x:.1f} {y:.1f}v3"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{y + 14:.1f}">{text}</text>')
    parts += _color_bar(right + 14, top, min(y - top, 220.0), peak, unit)
    parts.append("</svg>")
    return "".join(parts)


def _heat_block(frame: Frame, label: str, names: Sequence[str], index: NDArray[np.uint8], every: int) -> list[str]:
    """Rows of the colors `index` (frames, rows) with the block's label; names stand beside `every` so many rows."""
    y, tall = frame.top, frame.bottom - frame.top
    address = data_uri(png(np.ascontiguousarray(index.T), HEAT))
    listed = escape("|".join(name.replace("|", "/") for name in names), True)
    parts = [
        f'<image class="heat" href="{address}" x="{frame.left:g}" y="{y:.1f}" width="{frame.right - frame.left:g}" '
        f'height="{tall:.1f}" preserveAspectRatio="none" data-names="{listed}" {frame.data}/>'
    ]
    for k in range(0, len(names), every):
        at = y + (k + 0.5) * tall / len(names) + 3
        parts.append(f'<text class="tick y row" x="{frame.left - 4:g}" y="{at:.1f}">{escape(names[k])}</text>')
    if label:
        middle = y + tall / 2
        parts.append(f'<text class="block" transform="translate(10 {middle:.1f}) rotate(-90)">{escape(label)}</text>')
    return parts


def _events_over(frame: Frame, label: str, events: Sequence[Event]) -> list[str]:
    """Lines at events of the block's side, or of no side."""
    parts = []
    for event in events:
        beside = not event.side or not label or event.side.lower() == label.lower()
        if frame.x0 <= event.time <= frame.x1 and beside:
            x = float(frame.x(event.time))
            told = f"{event.side} {event.label}".strip()
            parts.append(
                f'<path class="event over" d="M{x:.1f} {frame.top:.1f}v{frame.bottom - frame.top:.1f}">'
                f"<title>{escape(told)}, {number(event.time, 0.001)} s</title></path>"
            )
    return parts


def _color_bar(x: float, top: float, tall: float, peak: float, unit: str) -> list[str]:
    address = data_uri(png(np.arange(255, -1, -1, dtype=np.uint8)[:, None], HEAT))
    parts = [
        f'<image href="{address}" x="{x:g}" y="{top:g}" width="10" height="{tall:.1f}" preserveAspectRatio="none"/>',
        f'<text class="tick x" x="{x + 5:g}" y="{top - 5:g}">{escape(unit)}</text>',
    ]
    along = ticks(0.0, peak, 5)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        y = top + tall * (1.0 - float(value) / peak)
        parts.append(f'<path class="grid" d="M{x + 10:g} {y:.1f}h3"/>')
        parts.append(f'<text class="tick end" x="{x + 16:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    return parts


def floor_plot(
    title: str,
    across: tuple[str, str],
    paths: Sequence[tuple[str, str, Array]],
    outlines: Sequence[tuple[str, Array]] = (),
    width: int = 330,
    height: int = 190,
    unit: str = "m",
    level: bool = True,
) -> str:
    """Paths on the ground seen from above, one scale along both axes.

    Parameters
    ----------
    across : names of the two axes: to the right, upwards in the drawing
    paths : label, style and points (frames, 2), NaN where there is none
    outlines : label and corners (n, 2) of force plates
    level : whether both axes have one scale; else each fills the chart
    """
    clouds = [points[np.isfinite(points).all(axis=1)] for _, _, points in paths]
    everything = [one for one in clouds if len(one)] + [corners for _, corners in outlines]
    if not everything:
        return ""
    stacked = np.concatenate(everything)
    low, high = stacked.min(axis=0), stacked.max(axis=0)
    size = max(float((high - low).max()) * 1.12, 1e-3)
    left, top, right, bottom = 46.0, 26.0, width - 8.0, height - 34.0
    scale = min(
        (right - left) / max((high - low)[0] * 1.12, 0.25 * size),
        (bottom - top) / max((high - low)[1] * 1.12, 0.25 * size),
    )
    middle = (low + high) / 2
    half = np.array([right - left, bottom - top]) / scale / 2
    if not level:
        half = np.maximum(0.56 * (high - low), 1e-9)
    frame = Frame(
        left, top, right, bottom, *(middle[0] + half[0] * np.array([-1, 1])), *(middle[1] + half[1] * np.array([-1, 1]))
    )
    parts = [
        f'<svg class="chart floor" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
    ]
    for value in ticks(frame.x0, frame.x1):
        step = float(np.diff(ticks(frame.x0, frame.x1))[:1].sum()) or 1.0
        x = float(frame.x(value))
        parts.append(f'<path class="grid" d="M{x:.1f} {top:g}V{bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{bottom + 13:g}">{number(float(value), step)}</text>')
    for value in ticks(frame.y0, frame.y1):
        step = float(np.diff(ticks(frame.y0, frame.y1))[:1].sum()) or 1.0
        y = float(frame.y(value))
        parts.append(f'<path class="grid" d="M{left:g} {y:.1f}H{right:g}"/>')
        parts.append(f'<text class="tick y" x="{left - 4:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    parts.append(f'<text class="tick x" x="{(left + right) / 2:g}" y="{bottom + 27:g}">{escape(across[0])} →</text>')
    parts.append(
        f'<text class="tick x" transform="translate(11 {(top + bottom) / 2:g}) rotate(-90)">'
        f"{escape(across[1])} →</text>"
    )
    for label, corners in outlines:
        data = path_data(frame.x(corners[:, 0]), frame.y(corners[:, 1]))
        parts.append(f'<path class="plate" d="{data}Z"><title>{escape(label)}</title></path>')
    for label, style, points in paths:
        step = max(1, len(points) // 800)
        data = path_data(frame.x(points[::step, 0]), frame.y(points[::step, 1]))
        parts.append(
            f'<path class="line {style}" data-label="{escape(label, True)}" d="{data}">'
            f"<title>{escape(label)}</title></path>"
        )
    parts.append("</svg>")
    return "".join(parts)
