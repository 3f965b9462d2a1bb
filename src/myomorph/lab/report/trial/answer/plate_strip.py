"""Strip of plates: a line over time for each foot, each stance a bar that is filled where measured.

It is wider than a phone and scrolls there.
"""

from __future__ import annotations

from collections.abc import Sequence

from myomorph.core.model.messages import Span
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.trial.answer.foot_stances import FootStance

WIDTH = 720.0
LEFT = 44.0
ROW = 24.0
BAR = 12.0
TOP = 4.0
BOTTOM = 20.0


def plate_strip(stances: Sequence[FootStance], span: Span) -> str:
    """Draw when each foot stood, and where a plate measured it, as SVG.

    Parameters
    ----------
    stances : of both feet
    span : first and last time of the recording [s]

    Returns
    -------
    the drawing, "" where no foot was seen to step
    """
    sides = [side for side in SIDES if any(stance.side == side for stance in stances)]
    if not sides:
        return ""
    height = TOP + ROW * len(sides) + BOTTOM
    area = svg.frame((LEFT, TOP), (WIDTH - 8.0, height - BOTTOM), span, unit="s")
    parts = [svg.grid_along(area, 10, lines=False, drop=14.0)]
    for row, side in enumerate(sides):
        y = TOP + ROW * (row + 0.5)
        parts.append(svg.text(2.0, y + 4.0, side, f"name {side}"))
        parts.append(svg.across(area, y, "grid"))
        parts += [_bar(area, y, stance) for stance in stances if stance.side == side]
    return svg.drawing("plates", _described(stances), (WIDTH, height), *parts, unit=None)


def _bar(area: svg.Frame, y: float, stance: FootStance) -> str:
    """Return an outline from strike to lift, filled where a plate measured."""
    under = f"{stance.side} foot, {number(stance.start, 0.01)} to {number(stance.stop, 0.01)} s"
    boxes = [_box(area, y, stance.start, stance.stop, f"stance {stance.side}")]
    boxes += [
        _box(area, y, start, stop, f"stance measured {stance.side}")
        for start, stop in stance.measured
    ]
    return svg.group(f"{under}: {stance.words}", *boxes)


def _box(area: svg.Frame, y: float, start: float, stop: float, kind: str) -> str:
    """Return a bar over a stretch of time."""
    left = float(area.x.cut(start))
    width = max(float(area.x.cut(stop)) - left, 1.0)
    return svg.rect(kind, svg.Box(x=left, y=y - 0.5 * BAR, width=width, height=BAR))


def _described(stances: Sequence[FootStance]) -> str:
    """Say what somebody hears who does not see it."""
    whole = sum(stance.words == "measured" for stance in stances)
    return f"Stances of both feet: plates measured {whole} of {len(stances)} as a whole"
