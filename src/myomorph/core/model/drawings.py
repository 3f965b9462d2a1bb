"""Small drawings for notebooks: lines in space from the side, and curves over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array

SIZE = 180.0  # Of a drawing [pixels].
MARGIN = 8.0
MAX_CURVES = 6
COLORS = ("#1b6ca8", "#c8553d", "#3a7d44", "#8e5ea2", "#b58900", "#586e75")


def lines_drawing(lines: Sequence[tuple[Array, Array]], up: Array) -> str:
    """Draw lines in space from the side, as SVG.

    Parameters
    ----------
    lines : two ends (3,) of each [m]
    up : (3,)

    Returns
    -------
    the drawing; "" without lines
    """
    if not lines:
        return ""
    forward = np.cross(up, _across(up))
    flat = np.array([[end @ forward, -(end @ up)] for line in lines for end in line])
    ends = _scaled(flat).reshape(len(lines), 4)
    drawn = "".join(
        f"<line x1='{x1:.1f}' y1='{y1:.1f}' x2='{x2:.1f}' y2='{y2:.1f}'/>"
        for x1, y1, x2, y2 in ends
    )
    return _svg(f"<g stroke='{COLORS[0]}' stroke-width='2' stroke-linecap='round'>{drawn}</g>")


def _across(up: Array) -> Array:
    """Return a level axis (3,) that a model with this vertical (3,) has across its body."""
    return np.eye(3)[2] if abs(up[1]) > 0.5 else np.eye(3)[1]


def curves_drawing(time: Array, values: Array, names: Sequence[str]) -> str:
    """Draw the first columns over time, each in its own range, as SVG.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, columns)
    names : of the columns

    Returns
    -------
    the drawing; "" where there is nothing to draw
    """
    if len(time) < 2 or values.ndim != 2:
        return ""
    step = max(1, len(time) // 300)
    parts = []
    for column in range(min(len(names), MAX_CURVES)):
        points = np.stack([time, -values[:, column]], axis=1)[::step]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            continue
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in _scaled(points, keep_ratio=False))
        parts.append(f"<polyline points='{line}' fill='none' stroke='{COLORS[column]}'/>")
    return _svg("".join(parts)) if parts else ""


def _scaled(points: Array, keep_ratio: bool = True) -> Array:
    """Fit points (points, 2) into the drawing."""
    low = points.min(axis=0)
    extent = np.maximum(points.max(axis=0) - low, 1e-9)
    if keep_ratio:
        extent = np.full(2, extent.max())
    return np.asarray(MARGIN + (points - low) / extent * (SIZE - 2.0 * MARGIN))


def _svg(inner: str) -> str:
    size = f"{SIZE:.0f}"
    return f"<svg width='{size}' height='{size}' viewBox='0 0 {size} {size}'>{inner}</svg>"
