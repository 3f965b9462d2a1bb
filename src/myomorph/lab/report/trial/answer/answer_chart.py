"""A curve of the first screen as SVG: right solid, left dashed, names at the ends of the lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.trial.answer.answer_curve import FEW, AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SECONDS

WIDTH = 420.0
HEIGHT = 124.0
LEFT = 38.0
RIGHT = 58.0
TOP = 15.0
BOTTOM = 21.0
LABEL_GAP = 13.0
"""Heights of the names at the ends of lines differ by so much at least."""
CLOSE = 40.0
"""Marks closer than this along the axis have one value above and one below."""


@dataclass(frozen=True)
class Printed:
    """A printed value: where it stands, by which word it is anchored."""

    x: float
    y: float
    text: str
    side: str


def answer_chart(curve: AnswerCurve, result: MainResult, last: bool) -> str:
    """Return the chart of one curve; the last one names the axis; time is named by the note."""
    area = svg.frame((LEFT, TOP), (WIDTH - RIGHT, HEIGHT - BOTTOM), _span(curve), _limits(curve))
    parts = [svg.grid_up(area, 3)]
    parts += [_pose(area, number_of, pose) for number_of, pose in enumerate(result.poses, 1)]
    parts.append(_lift(area, result.lift, result.poses))
    for side in curve.sides:
        parts.append(_drawn(area, curve.at, side))
    parts.append(_names(area, curve))
    parts += [_value(printed) for printed in _values(area, curve)]
    if last and result.axis != SECONDS:
        parts.append(svg.text(WIDTH - RIGHT, HEIGHT - 6.0, result.axis, "tick y"))
    described = f"{curve.title} [{curve.unit}]: {'; '.join(_described(curve))}"
    return svg.drawing("answer", described, (WIDTH, HEIGHT), *parts, unit=None)


def _span(curve: AnswerCurve) -> tuple[float, float]:
    return float(curve.at[0]), float(curve.at[-1])


def _limits(curve: AnswerCurve) -> tuple[float, float]:
    """Lowest and highest value with room for printed ones; zero is inside."""
    values = np.concatenate([side.cycles.ravel() for side in curve.sides])
    low = min(float(np.nanmin(values)), 0.0)
    high = max(float(np.nanmax(values)), 0.0)
    air = 0.1 * (high - low) or 1.0
    return (low - air if low < 0.0 else low), (high + 1.6 * air if high > 0.0 else high)


def _pose(area: svg.Frame, count: int, pose: KeyPose) -> str:
    """Return an upright line at a key pose, with its number below."""
    if not area.x.low <= pose.at <= area.x.high:
        return ""
    x = float(area.x.at(pose.at))
    line = svg.mark("path", "pose-line", d=f"M{x:.1f} {area.y.stop:.1f}V{area.y.start:.1f}")
    dot = svg.dot(x, area.y.start + 11.0, "pose-dot", 7.5, pose.words)
    return line + dot + svg.text(x, area.y.start + 14.8, str(count), "pose-number")


def _lift(area: svg.Frame, lift: float | None, poses: Sequence[KeyPose]) -> str:
    """Where the foot leaves the ground, named where no pose's number is in the way."""
    if lift is None:
        return ""
    x = float(area.x.at(lift))
    line = svg.mark("path", "lift", d=f"M{x:.1f} {area.y.stop:.1f}V{area.y.start:.1f}")
    if any(abs(float(area.x.at(pose.at)) - x) < CLOSE for pose in poses):
        return line
    return line + svg.text(x, HEIGHT - 6.0, "foot off", "tick x")


def _drawn(area: svg.Frame, at: Array, side: SideCurve) -> str:
    """Single cycles where they are few, else their spread, and the mean in front."""
    style = side.side or "middle"
    parts = []
    spread = side.spread
    if spread is not None:
        parts.append(svg.band(area, at, side.mean - spread, side.mean + spread, style))
    elif 1 < len(side.cycles) < FEW:
        parts += [svg.line(area, at, cycle, f"thin {style}") for cycle in side.cycles]
    parts.append(svg.line(area, at, side.mean, style, side.label))
    return "".join(parts)


def _names(area: svg.Frame, curve: AnswerCurve) -> str:
    """Return the name of each side at the end of its line."""
    ends = [_end(area, side) for side in curve.sides]
    heights = _apart(ends)
    return "".join(
        svg.text(WIDTH - RIGHT + 6.0, height + 4.0, side.label, f"name {side.side or 'middle'}")
        for side, height in zip(curve.sides, heights, strict=True)
    )


def _end(area: svg.Frame, side: SideCurve) -> float:
    """Height of a line's last known value."""
    known = np.flatnonzero(np.isfinite(side.mean))
    return float(area.y.at(side.mean[known[-1]]))


def _apart(heights: Sequence[float]) -> list[float]:
    """Heights in the same order, moved apart where they are closer than `LABEL_GAP`."""
    if len(heights) < 2 or abs(heights[0] - heights[1]) >= LABEL_GAP:
        return list(heights)
    middle = 0.5 * (heights[0] + heights[1])
    shift = 0.5 * LABEL_GAP if heights[0] >= heights[1] else -0.5 * LABEL_GAP
    return [middle + shift, middle - shift]


def _values(area: svg.Frame, curve: AnswerCurve) -> list[Printed]:
    """Place marked values where they can be read: above, or below where two are close."""
    found = []
    for side in curve.sides:
        if side.mark is None:
            continue
        text = f"{side.printed(side.mark):.{curve.digits}f}".replace("-", "−")
        text += "°" if curve.unit == "°" else ""
        x = float(area.x.at(curve.at[side.mark]))
        y = float(area.y.at(side.value(side.mark)))
        found.append(Printed(x=x, y=y, text=text, side=side.side or "middle"))
    if len(found) == 2 and abs(found[0].x - found[1].x) < CLOSE:
        return _around(*found)
    return found


def _around(one: Printed, other: Printed) -> list[Printed]:
    """Two close values: the same one once, else one to the left and one to the right."""
    if one.text == other.text:
        return [one]
    return [one, other]


def _value(printed: Printed) -> str:
    """Return a mark with its value: round on the right side, square on the left."""
    x = printed.x
    if printed.side == "left":
        mark = svg.rect("mark left", svg.Box(x=x - 3.2, y=printed.y - 3.2, width=6.4, height=6.4))
        return mark + svg.text(x - 6.0, printed.y - 5.0, printed.text, "value left end")
    mark = svg.dot(x, printed.y, printed.side, 3.6)
    return mark + svg.text(x + 6.0, printed.y - 5.0, printed.text, f"value {printed.side} start")


def _described(curve: AnswerCurve) -> list[str]:
    """Say what a screen reader says of each side."""
    return [
        f"{side.label} {number(side.printed(side.mark))} at {number(float(curve.at[side.mark]))}"
        for side in curve.sides
        if side.mark is not None
    ]
