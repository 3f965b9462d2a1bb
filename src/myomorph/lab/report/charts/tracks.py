"""Rows over one time axis: lines, bands, contacts and pictures, read at one time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Touch
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Event
from myomorph.lab.analysis.contact_states import Row, is_stroke, limb_of
from myomorph.lab.analysis.phases import Phase
from myomorph.lab.analysis.selection import Subject
from myomorph.lab.report.charts import marks as svg
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line, drawn_line, event_line, line_limits, within

WIDTH = 1040
LEFT = 190
RIGHT = 12
BESIDE = 5.0
CONTACT_ROW = 15
BORDER = 0.011
SYMBOLS = {
    ("hand", "right"): "star",
    ("hand", "left"): "plus",
    ("foot", "right"): "ring",
    ("foot", "left"): "cross",
}
"""Symbols of strokes, those of [D] figure 5.8; a left foot has none there."""
ARMS = {
    "plus": ((0.0, 1.0), (1.0, 0.0)),
    "cross": ((0.7, 0.7), (0.7, -0.7)),
    "star": ((0.0, 1.0), (0.87, 0.5), (0.87, -0.5)),
}
"""Half lines of the symbols."""


@read_only
class Band:
    """What lies between two lines over time: `low` and `high` (samples,), NaN where unknown."""

    time: Array
    low: Array
    high: Array
    style: str


@dataclass(frozen=True, eq=False)
class Backdrop:
    """What all rows of a stack share: the time shown, phases as stripes, events as thin lines."""

    span: tuple[float, float]
    phases: Sequence[Phase] = ()
    events: Sequence[Event] = ()

    def frame(self, top: float, bottom: float, low: float = 0.0, high: float = 1.0) -> svg.Frame:
        """Make the area of a row."""
        first, last = self.span
        return svg.frame(
            (LEFT, top), (WIDTH - RIGHT, bottom), (first, max(last, first + 1e-9)), (low, high), "s"
        )

    def behind(self, area: svg.Frame) -> str:
        """Stripes of every other phase, and events."""
        parts = []
        top = area.y.stop
        tall = area.y.start - area.y.stop
        for phase in self.phases[::2]:
            left = float(area.x.cut(phase.start))
            right = float(area.x.cut(phase.stop))
            if right - left > 0.2:
                parts.append(
                    svg.rect("phase", svg.Box(x=left, y=top, width=right - left, height=tall))
                )
        parts += [
            event_line(area, event)
            for event in self.events
            if area.x.low <= event.time <= area.x.high
        ]
        return "".join(parts)


@dataclass(frozen=True, kw_only=True)
class TrackLook:
    """How a row of a stack looks.

    Attributes
    ----------
    height : of the row [px]
    bands : areas between two lines, known all the time
    bars : the same, known at some instants
    levels : horizontal lines
    low, high : values that must be inside
    small : one line of text, and grid lines at the ends only
    """

    height: int = 84
    bands: Sequence[Band] = ()
    bars: Sequence[Band] = ()
    levels: Sequence[svg.Level] = ()
    low: float | None = None
    high: float | None = None
    small: bool = False


def draw_track(
    behind: Backdrop,
    title: str,
    unit: str,
    lines: Sequence[Line],
    look: TrackLook | None = None,
) -> str:
    """Draw one row as an `<svg>` element.

    Parameters
    ----------
    behind : what all rows of the stack share
    title : of the row
    unit : of the values
    lines : curves over time
    look : height, bands, levels and scale
    """
    look = look or TrackLook()
    ends = [
        Line(time=limits.time, values=end, style="", label="")
        for limits in (*look.bands, *look.bars)
        for end in (limits.low, limits.high)
    ]
    first, last = line_limits([*lines, *ends], behind.span, look.low, look.high)
    for level in look.levels:
        air = 0.05 * (last - first)
        first = min(first, level.value - air)
        last = max(last, level.value + air)
    margin = 2.0 if look.small else 6.0
    area = behind.frame(margin, look.height - margin, first, last)
    parts = [
        behind.behind(area),
        svg.titled(title, unit, 2.0, (area.y.start + area.y.stop) / 2 + 4),
    ]
    if look.small:
        parts += [svg.across(area, y, "grid") for y in (area.y.start, area.y.stop)]
    else:
        parts.append(svg.grid_up(area, max(3, int((area.y.start - area.y.stop) / 24))))
    for band in look.bands:
        time, least, most = within(behind.span, band.time, band.low, band.high)
        parts.append(svg.band(area, time, least, most, band.style))
    for i, bar in enumerate(look.bars):
        time, least, most = within(behind.span, bar.time, bar.low, bar.high)
        parts.append(
            svg.intervals(
                area, time, (least, most), bar.style, BESIDE * (i - (len(look.bars) - 1) / 2)
            )
        )
    parts += [drawn_line(area, line, behind.span) for line in lines]
    parts.append(svg.levels_across(area, look.levels))
    return svg.drawing(
        "time track", title, (WIDTH, look.height), *parts, unit=None, attributes=area.data
    )


def time_axis(behind: Backdrop) -> str:
    """Draw the row of times that ends a stack."""
    area = behind.frame(0.0, 0.5)
    parts = [svg.across(area, 0.5, "zero")]
    for tick in area.x.ticks(10):
        parts.append(svg.mark("path", "zero", d=f"M{tick.position:.1f} 0v4"))
        parts.append(svg.text(tick.position, 16.0, tick.text, "tick x"))
    return svg.drawing("", "Time", (WIDTH, 24), *parts, unit=None)


def named_lines(lines: Sequence[tuple[str, str]]) -> str:
    """Draw a row that names styles of lines, for stacks with a legend of their own."""
    parts = []
    x = float(LEFT)
    for style, name in lines:
        parts += [
            svg.mark("path", f"line {style}", d=f"M{x:g} 10h22"),
            svg.text(x + 28, 13.5, name, "tick end"),
        ]
        x += 46 + 6.0 * len(name)
    return svg.drawing("", "Lines", (WIDTH, 18), *parts, unit=None)


def row_title(words: str) -> str:
    """Draw a row that names those below it."""
    return svg.drawing("", words, (WIDTH, 20), svg.text(2.0, 15.0, words, "block start"), unit=None)


def phase_names(behind: Backdrop) -> str:
    """Draw the row of phases' names that begins a stack; "" without phases.

    Names that do not fit are cut.
    """
    if not behind.phases:
        return ""
    area = behind.frame(0.0, 20.0)
    parts = [Backdrop(behind.span, behind.phases).behind(area)]
    for phase in behind.phases:
        left = float(area.x.cut(phase.start))
        right = float(area.x.cut(phase.stop))
        room = int((right - left - 4) / 5.3)
        if len(phase.name) <= room:
            name = phase.name
        elif room > 4:
            name = phase.name[: room - 1] + "…"
        else:
            name = ""
        under = f"{phase.name}, {number(phase.start, 0.01)} to {number(phase.stop, 0.01)} s"
        parts.append(svg.text((left + right) / 2, 14.0, name, "phase", under) if name else "")
    return svg.drawing("", "Phases", (WIDTH, 20), *parts, unit=None)


def contact_graph(rows: Sequence[Row], behind: Backdrop, who: Sequence[Subject] = ()) -> str:
    """Draw contact intervals as scores of drummers and dancers show them, as an `<svg>` element.

    Lines are drawn while a site is in contact, full dots where contact begins, open ones where it
    ends ([D] figure 5.5).
    """
    if not rows:
        return ""
    height = CONTACT_ROW * len(rows) + 8
    area = behind.frame(2.0, height - 2.0)
    parts = [behind.behind(area)]
    for i, row in enumerate(rows):
        y = 4 + CONTACT_ROW * (i + 0.5)
        parts += [svg.text(2.0, y + 3.5, row.label, "tick end"), svg.across(area, y, "grid")]
        shown = [
            touch
            for touch in row.touches
            if touch.stop >= behind.span[0] and touch.start <= behind.span[1]
        ]
        parts += [_contact(area, y, row, touch, who) for touch in shown]
    counts = "; ".join(f"{row.label} {len(row.touches)} times" for row in rows if row.touches)
    title = f"Contact states: {counts or 'no contact'}"
    return svg.drawing(
        "time track contacts", title, (WIDTH, height), *parts, unit=None, attributes=area.data
    )


def _contact(area: svg.Frame, y: float, row: Row, touch: Touch, who: Sequence[Subject]) -> str:
    x0 = float(area.x.cut(touch.start))
    x1 = float(area.x.cut(touch.stop))
    if is_stroke(touch) and touch.surface != GROUND:
        limb = limb_of(touch.site, who)
        marks = _symbol(x0, y, SYMBOLS.get((limb.part, limb.side), "ring"), limb.side or "middle")
    else:
        begins = touch.start > area.x.low + BORDER
        ends = touch.stop < area.x.high - BORDER
        marks = f'<path d="M{x0:.1f} {y:.1f}H{x1:.1f}"/>'
        marks += f'<circle cx="{x0:.1f}" cy="{y:.1f}" r="3"/>' if begins else ""
        marks += svg.mark("circle", "open", cx=x1, cy=y, r="2.6") if ends else ""
    under = f"{row.label}: {number(touch.start, 0.001)} to {number(touch.stop, 0.001)} s"
    under += f", {touch.source}" if touch.source else ""
    under += f", {100 * touch.confidence:.0f} % confidence" if touch.confidence < 1.0 else ""
    attributes = (
        f' class="touch {row.side or "middle"}" opacity="{0.35 + 0.65 * touch.confidence:.2f}"'
    )
    return svg.group(under, marks, attributes=attributes)


def _symbol(x: float, y: float, kind: str, style: str) -> str:
    """Draw a symbol of an impact."""
    if kind == "ring":
        return svg.mark("circle", f"stroke {style}", cx=x, cy=y, r="3.6")
    data = "".join(
        f"M{x - 4 * u:.1f} {y - 4 * v:.1f}l{8 * u:.1f} {8 * v:.1f}" for u, v in ARMS[kind]
    )
    return svg.mark("path", f"stroke {style}", d=data)
