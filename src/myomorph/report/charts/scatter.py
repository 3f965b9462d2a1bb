"""Points of one quantity against another, with the lines fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number, ticks
from myomorph.report.charts.chart import Frame, heading

MOST = 700
"""Points drawn; more of them would only darken the cloud."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (n,) across and up; `joined` draws them as a line, `dotted` as a line with its points."""

    across: Array
    up: Array
    style: str
    label: str
    joined: bool = False
    dotted: bool = False


def xy_plot(
    title: str,
    unit: str,
    across: str,
    clouds: Sequence[Cloud],
    width: int = 330,
    height: int = 230,
    zero: bool = True,
) -> str:
    """Clouds of points and lines over common axes.

    Parameters
    ----------
    unit : of the upright axis, behind the title
    across : the level axis in words, with its unit
    zero : whether both axes begin at or pass zero
    """
    x = np.concatenate([one.across[np.isfinite(one.up)] for one in clouds] or [np.zeros(1)])
    y = np.concatenate([one.up[np.isfinite(one.up)] for one in clouds] or [np.zeros(1)])
    frame = Frame(48, 26.0, width - 10, height - 36, *_range(x, zero), *_range(y, zero))
    parts = [
        f'<svg class="chart scatter" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title, True)}">',
        heading(title, unit),
        *_axes(frame, across, height),
    ]
    for one in clouds:
        known = np.flatnonzero(np.isfinite(one.across) & np.isfinite(one.up))
        keep = known[np.unique(np.linspace(0, len(known) - 1, min(len(known), MOST)).astype(np.int64))]
        u, v = frame.x(one.across[keep]), frame.y(one.up[keep])
        told = f"<title>{escape(one.label)}</title>"
        if (one.joined or one.dotted) and len(u):
            line = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(u, v, strict=True))
            parts.append(f'<path class="line {one.style}" d="{line}">{told}</path>')
        if one.dotted:
            parts += [
                f'<circle class="mark {one.style}" cx="{a:.1f}" cy="{b:.1f}" r="3">{told}</circle>'
                for a, b in zip(u, v, strict=True)
            ]
        elif not one.joined:
            dots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(u, v, strict=True))
            parts.append(f'<path class="cloud {one.style}" d="{dots}">{told}</path>')
    parts.append("</svg>")
    return "".join(parts)


def _range(values: Array, zero: bool) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    air = 0.06 * (high - low) or abs(high) * 0.1 or 1.0
    return (low if zero and low == 0.0 else low - air), (high if zero and high == 0.0 else high + air)


def _axes(frame: Frame, across: str, height: int) -> list[str]:
    parts = []
    levels = ticks(frame.y0, frame.y1, 4)
    step = float(levels[1] - levels[0]) if len(levels) > 1 else 1.0
    for value in levels:
        y = float(frame.y(value))
        style = "zero" if abs(value) < 1e-9 * step else "grid"
        parts.append(f'<path class="{style}" d="M{frame.left:g} {y:.1f}H{frame.right:g}"/>')
        parts.append(f'<text class="tick y" x="{frame.left - 4:g}" y="{y + 3:.1f}">{number(float(value), step)}</text>')
    along = ticks(frame.x0, frame.x1, 5)
    step = float(along[1] - along[0]) if len(along) > 1 else 1.0
    for value in along:
        x = float(frame.x(value))
        style = "zero" if abs(value) < 1e-9 * step else "grid"
        parts.append(f'<path class="{style}" d="M{x:.1f} {frame.top:g}V{frame.bottom:g}"/>')
        parts.append(f'<text class="tick x" x="{x:.1f}" y="{frame.bottom + 14:g}">{number(float(value), step)}</text>')
    middle = (frame.left + frame.right) / 2
    parts.append(f'<text class="tick x" x="{middle:g}" y="{height - 6}">{escape(across)}</text>')
    return parts
