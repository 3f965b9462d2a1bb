"""The graph of contact states: who touches what, from when to when, as scores of drummers and dancers show it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.analysis.contact_states import Row, _is_stroke, limb_of
from myomorph.analysis.subjects import Subject
from myomorph.model.model import GROUND
from myomorph.report.charts.axis import number
from myomorph.report.charts.tracks import LEFT, Backdrop, opened

ROW = 15
BORDER = 0.011
MARKS = {("hand", "right"): "star", ("hand", "left"): "plus", ("foot", "right"): "ring", ("foot", "left"): "cross"}
"""Symbols of strokes, those of [D] figure 5.8; a left foot has none there."""


def contact_graph(rows: Sequence[Row], behind: Backdrop, who: Sequence[Subject] = ()) -> str:
    """The graph as an `<svg>` element: lines while a site touches, full dots where it begins, open where it ends."""
    if not rows:
        return ""
    height = ROW * len(rows) + 8
    frame = behind.frame(2.0, height - 2.0)
    told = "; ".join(f"{row.label} {len(row.touches)} times" for row in rows if row.touches)
    parts = [opened(f"Contact states: {told or 'nothing touches'}", height, frame, "contacts"), *behind.behind(frame)]
    for i, row in enumerate(rows):
        y = 4 + ROW * (i + 0.5)
        style = row.side or "middle"
        parts.append(f'<text class="tick end" x="2" y="{y + 3.5:.1f}">{escape(row.label)}</text>')
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{frame.right:g}"/>')
        for touch in row.touches:
            if touch.stop < behind.span[0] or touch.start > behind.span[1]:
                continue
            x0, x1 = (float(frame.x(np.clip(one, *behind.span))) for one in (touch.start, touch.stop))
            told = (
                f"{row.label}: {number(touch.start, 0.001)} to {number(touch.stop, 0.001)} s"
                + (f", {touch.source}" if touch.source else "")
                + (f", {100 * touch.confidence:.0f} % sure" if touch.confidence < 1.0 else "")
            )
            parts.append(f'<g class="touch {style}" opacity="{0.35 + 0.65 * touch.confidence:.2f}">')
            parts.append(f"<title>{escape(told)}</title>")
            if _is_stroke(touch) and touch.surface != GROUND:
                limb = limb_of(touch.site, who)
                parts.append(_mark(x0, y, MARKS.get((limb.part, limb.side), "ring"), limb.side or "middle"))
            else:
                parts.append(f'<path d="M{x0:.1f} {y:.1f}H{x1:.1f}"/>')
                if touch.start > behind.span[0] + BORDER:
                    parts.append(f'<circle cx="{x0:.1f}" cy="{y:.1f}" r="3"/>')
                if touch.stop < behind.span[1] - BORDER:
                    parts.append(f'<circle class="open" cx="{x1:.1f}" cy="{y:.1f}" r="2.6"/>')
            parts.append("</g>")
    return "".join([*parts, "</svg>"])


def _mark(x: float, y: float, kind: str, style: str) -> str:
    """A symbol of a stroke."""
    if kind == "ring":
        return f'<circle class="stroke {style}" cx="{x:.1f}" cy="{y:.1f}" r="3.6"/>'
    arms = {
        "plus": ((0, 1), (1, 0)),
        "cross": ((0.7, 0.7), (0.7, -0.7)),
        "star": ((0, 1), (0.87, 0.5), (0.87, -0.5)),
    }[kind]
    data = "".join(f"M{x - 4 * u:.1f} {y - 4 * v:.1f}l{8 * u:.1f} {8 * v:.1f}" for u, v in arms)
    return f'<path class="stroke {style}" d="{data}"/>'
