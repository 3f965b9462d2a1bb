"""One bar a name with its interval, beside what is known of it from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.provenance import Estimate
from myomorph.report.charts.chart import Frame, heading, number, ticks


@dataclass(frozen=True, eq=False)
class Beside:
    """Values (names,) drawn as marks on the bars, NaN where there is none."""

    label: str
    style: str
    values: Array


@dataclass(frozen=True, eq=False)
class Level:
    """A horizontal line over all bars, with a band to both sides of it."""

    label: str
    value: float
    spread: float = 0.0
    style: str = "middle"


def interval_bars(
    title: str,
    unit: str,
    names: Sequence[str],
    values: Sequence[Estimate | None],
    beside: Sequence[Beside] = (),
    levels: Sequence[Level] = (),
    width: int = 330,
    height: int = 210,
) -> str:
    """Upright bars, one a name, each with its interval; one that reaches far above the rest is cut and its value told.

    Parameters
    ----------
    values : one a name, None where it is lacking
    """
    top = _top(values, beside, levels)
    frame = Frame(48, 26.0, width - 8, height - 24, 0.0, float(max(len(names), 1)), 0.0, top)
    parts = [
        f'<svg class="chart upright" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
    ]
    across = ticks(0.0, top, 4)
    step = float(across[1] - across[0]) if len(across) > 1 else 1.0
    for value in across:
        y = float(frame.y(value))
        parts.append(f'<path class="grid" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 4:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    parts += [part for one in levels for part in _level(frame, one)]
    room = max(1, int((frame.right - frame.left) / max(len(names), 1) / 6.0))
    half = min(13.0, 0.3 * (frame.right - frame.left) / max(len(names), 1))
    for i, (name, one) in enumerate(zip(names, values, strict=True)):
        x = float(frame.x(i + 0.5))
        told = [f"{label.label} {number(float(label.values[i]))}" for label in beside if np.isfinite(label.values[i])]
        if one is not None:
            reach = f" ({number(one.low)} to {number(one.high)})" if np.isfinite(one.low) else ""
            told.insert(0, f"{number(one.value)}{reach}")
        parts.append(f"<g><title>{escape(name)}: {escape('; '.join(told) or 'not known')} {escape(unit)}</title>")
        short = name if len(name) <= room else f"{name[: max(room - 1, 1)]}…"
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{height - 8}">{escape(short)}</text>')
        parts += [] if one is None else _bar(frame, one, x, half)
        for mark in beside:
            if np.isfinite(mark.values[i]):
                y = float(frame.y(min(float(mark.values[i]), top)))
                parts.append(f'<path class="tack {mark.style}" d="M{x - half - 3:.1f} {y:.1f}h{2 * half + 6:.1f}"/>')
        parts.append("</g>")
    parts.append("</svg>")
    return "".join(parts)


def _top(values: Sequence[Estimate | None], beside: Sequence[Beside], levels: Sequence[Level]) -> float:
    """Highest value shown: all, except intervals that would press everything else to the floor."""
    known = [one.value for one in values if one is not None and np.isfinite(one.value)]
    known += [float(one) for mark in beside for one in mark.values if np.isfinite(one)]
    known += [one.value + one.spread for one in levels if np.isfinite(one.value + one.spread)]
    highs = [one.high for one in values if one is not None and np.isfinite(one.high)]
    peak = max([*known, 0.0])
    return 1.08 * max(peak, min(max([*highs, 0.0]), 2.0 * peak)) or 1.0


def _bar(frame: Frame, one: Estimate, x: float, half: float) -> list[str]:
    if not np.isfinite(one.value):
        return []
    y = float(frame.y(max(one.value, 0.0)))
    parts = [
        f'<rect class="bar first soft" x="{x - half:.1f}" y="{y:.1f}" width="{2 * half:.1f}" '
        f'height="{max(frame.bottom - y, 0.5):.1f}"/>'
    ]
    if np.isfinite(one.low) and np.isfinite(one.high) and one.high > one.low:
        low, high = (float(frame.y(min(max(end, 0.0), frame.y1))) for end in (one.low, one.high))
        cap = f"M{x - 4:.1f} {high:.1f}h8" if one.high <= frame.y1 else f"M{x - 4:.1f} {high + 5:.1f}l4 -5l4 5"
        parts.append(f'<path class="whisker" d="M{x:.1f} {low:.1f}V{high:.1f}M{x - 4:.1f} {low:.1f}h8{cap}"/>')
    return parts


def _level(frame: Frame, one: Level) -> list[str]:
    if not np.isfinite(one.value) or one.value > frame.y1:
        return []
    y = float(frame.y(one.value))
    parts = []
    if one.spread > 0.0:
        top, bottom = (
            float(frame.y(min(one.value + one.spread, frame.y1))),
            float(frame.y(max(one.value - one.spread, 0.0))),
        )
        parts.append(
            f'<rect class="spread {one.style}" x="{frame.left:g}" y="{top:.1f}" width="{frame.right - frame.left:g}" '
            f'height="{bottom - top:.1f}"/>'
        )
    parts.append(f'<path class="level {one.style}" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
    parts.append(f'<text class="level" x="{frame.right - 2:g}" y="{y - 3:.1f}">{escape(one.label)}</text>')
    return parts
