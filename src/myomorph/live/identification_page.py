"""What a subject sees while identification goes on: progress, the body, what to move next.

It is shown on terminal and page.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.segments import SEGMENTS, Segment
from myomorph.core.model.sides import split_side
from myomorph.core.model.surface import Surface
from myomorph.lab.analysis.presets import plain_words, segment_words
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.scene.image import level_color
from myomorph.lab.viewer.web_page import DEEPER, MARKER, BodyView, Page, escaped, half_blocks
from myomorph.live.online_identification import OnlineState

BAR = 18  # Characters of a bar.


@dataclass(frozen=True)
class Clock:
    """How far a live session is: time in the recording, its length where known [s].

    It knows too how late the session is shown [s].
    """

    now: float
    duration: float | None = None
    late: float = 0.0


def segment_levels(
    names: tuple[str, ...], segments: Mapping[str, Segment], levels: Array
) -> dict[str, dict[str, float]]:
    """Average the levels of the links of every segment by side.

    Parameters
    ----------
    names : of the bodies
    segments : by body
    levels : (bodies,) from 0 to 1, NaN where not known

    Returns
    -------
    By segment and side, {"thigh": {"right": 0.8, "left": 0.7}, ...}, from the head
    """
    by_segment: dict[str, dict[str, list[float]]] = {}
    for name, level in zip(names, levels, strict=True):
        if name in segments and np.isfinite(level):
            segment = segments[name]
            by_segment.setdefault(segment.name, {}).setdefault(segment.side, []).append(
                float(level)
            )
    order = {name: by_segment[name] for name in (*SEGMENTS, *by_segment) if name in by_segment}
    return {
        plain_words(name): {side: float(np.mean(each)) for side, each in by.items()}
        for name, by in order.items()
    }


def move_next(state: OnlineState, segments: Mapping[str, Segment]) -> str:
    """Name the movement that would show most: "left forearm (elbow flexion)".

    The text is "" where nothing would.
    """
    if not state.proposals:
        return ""
    best = state.proposals[0]
    joint = split_side(best.coordinate)[0].replace("_", " ")
    where = segment_words(segments[best.body]) if best.body in segments else best.body
    return f"{where} ({joint})"


def live_panel(
    state: OnlineState,
    names: tuple[str, ...],
    segments: Mapping[str, Segment],
    at: Clock,
    body: Text | None = None,
) -> RenderableType:
    """Everything for a terminal; `body`: the body drawn in characters."""
    facts = Table.grid(padding=(0, 2))
    facts.add_column(style="dim", no_wrap=True)
    facts.add_column()
    facts.add_row("Progress", _bar(state.fit.progress))
    facts.add_row("Frames", _frames(state))
    facts.add_row("Parameters", _identifiable(state))
    moment = state.fit.innovation_rms[:3]
    force = state.fit.innovation_rms[3:]
    facts.add_row("Wrench error", f"{_rms(force)} N, {_rms(moment)} N·m")
    facts.add_row("Move next", Text(move_next(state, segments) or "anything", style="bold"))
    grid = Table.grid(padding=(0, 2))
    for words, sides in segment_levels(names, segments, state.levels).items():
        bars = {
            side: Text.assemble((f"{side:>6}", "dim"), " ", _bar(level))
            for side, level in sides.items()
        }
        if "" in bars:
            grid.add_row(words.capitalize(), bars[""])
        if "right" in bars or "left" in bars:
            grid.add_row(
                words.capitalize(), *(bars.get(side, Text()) for side in ("right", "left"))
            )
    right: RenderableType = Group(facts, Text(), grid)
    both = Table.grid(padding=(0, 3))
    both.add_row(*([body, right] if body is not None else [right]))
    title = f"Identification, {at.now:.1f} s" + (f" of {at.duration:.1f} s" if at.duration else "")
    title += f", {at.late:.1f} s late" if at.late > 0.5 else ""
    return Panel(both, title=title, title_align="left", border_style="dim")


def _bar(level: float) -> Text:
    """Draw a bar in the color of its level, and the level in percent."""
    filled = round(BAR * min(max(level, 0.0), 1.0))
    r, g, b = map(int, 255 * level_color(np.array([level]))[0])
    text = Text("█" * filled, style=f"rgb({r},{g},{b})")
    text.append("░" * (BAR - filled), "dim")
    return text.append(f" {100 * level:3.0f} %", "default")


def _frames(state: OnlineState) -> str:
    used = f"{state.fit.frames} used of {state.frames}"
    reasons = ", ".join(
        f"{count} {reason.split(':')[0].split(',')[0]}" for reason, count in state.left_out.items()
    )
    return f"{used}; left out: {reasons}" if reasons else used


def _identifiable(state: OnlineState) -> str:
    fit = state.fit
    text = f"{fit.rank} of {len(fit.estimate)} identifiable"
    return (
        f"{text}, condition number {number(fit.condition)}" if np.isfinite(fit.condition) else text
    )


def _rms(errors: Array) -> str:
    return number(float(np.linalg.norm(errors)))


def live_markdown(
    state: OnlineState, names: tuple[str, ...], segments: Mapping[str, Segment], at: Clock
) -> str:
    """Write the same as text for a web page."""
    moment = state.fit.innovation_rms[:3]
    force = state.fit.innovation_rms[3:]
    facts = (
        f"**Move next: {escaped(move_next(state, segments) or 'anything')}**",
        f"{at.now:.1f} s" + (f" of {at.duration:.1f} s" if at.duration else ""),
        _frames(state),
        _identifiable(state).capitalize(),
        f"Error of the predicted wrench {_rms(force)} N, {_rms(moment)} N·m",
    )
    lines = ["\n\n".join(facts), "", "| Segment | identified |", "|---|---|"]
    for words, sides in segment_levels(names, segments, state.levels).items():
        for side, level in sides.items():
            segment = f"{side} {words}".strip()
            lines.append(f"| {escaped(segment)} | {100 * level:.0f} % |")
    return "\n".join(lines)


ROWS = 30
COLUMNS = 40  # Characters of the drawn body.
BESIDE = 60  # Characters that the numbers need beside it.
DRAWN = 30.0  # Poses a second that the page is sent [Hz].


class Display(Protocol):
    """Something that shows a session."""

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """Show a new frame.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]
        markers : (markers, 3) [m], None where the source has none
        """

    def show(self, state: OnlineState, at: Clock) -> None:
        """Show the estimate anew."""

    def close(self) -> None:
        """End the display with the session."""


class TerminalDisplay:
    """Draws on the terminal through `rich`."""

    def __init__(
        self, model: Model, segments: Mapping[str, Segment], surfaces: Mapping[str, Surface] | None
    ):
        self._model = model
        self._segments = segments
        self._view = BodyView(model, surfaces)
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=False)
        self._live.start()

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """Do nothing: the terminal is drawn with the next look.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]
        markers : (markers, 3) [m], None where the source has none
        """

    def show(self, state: OnlineState, at: Clock) -> None:
        """Draw the body and the numbers."""
        rows = min(ROWS, self._console.size.height - 4)
        body = None
        if rows >= 10 and self._console.size.width >= COLUMNS + BESIDE:
            body = half_blocks(self._view.pixels(state.pose, state.levels, COLUMNS, 2 * rows))
        panel = live_panel(state, self._model.body_names, self._segments, at, body)
        self._live.update(panel, refresh=True)

    def close(self) -> None:
        """Leave the last picture standing."""
        self._live.stop()


class WebDisplay(Page):
    """Display in a web page: links in colors, markers as points, numbers, a progress bar.

    `surfaces` are meshes by `Mesh.file`; without any, limbs are rounds.
    """

    def __init__(
        self,
        model: Model,
        segments: Mapping[str, Segment],
        surfaces: Mapping[str, Surface] | None,
        port: int,
    ):
        super().__init__(port, "Myomorph")
        self._model = model
        self._segments = segments
        self._drawn = 0.0
        view = BodyView(model, surfaces)
        self._show_body(view, view.scene.solids if view.meshed else view.limbs(), 0.6)
        self._progress = self._server.gui.add_progress_bar(0.0)
        self._text = self._server.gui.add_markdown("")
        sys.stderr.write(f"the body is at {self.address}\n")

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """Put the body in a pose and show markers, at most thirty times a second.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]
        markers : (markers, 3) [m], None where the source has none
        """
        if clock.monotonic() - self._drawn > 1.0 / DRAWN:
            with self._server.atomic():
                self._pose(coordinates)
                if markers is not None:
                    self._show_markers(markers, MARKER)
            self._drawn = clock.monotonic()

    def show(self, state: OnlineState, at: Clock) -> None:
        """Color the body by levels and write the numbers."""
        colors = (255.0 * level_color(state.levels) ** DEEPER).astype(int)
        with self._server.atomic():
            for body, mesh in self._links.handles.items():
                mesh.color = (
                    (190, 190, 190)
                    if body == 0
                    else tuple(int(color) for color in colors[body - 1])
                )
            self._progress.value = 100.0 * min(max(state.fit.progress, 0.0), 1.0)
            self._text.content = live_markdown(state, self._model.body_names, self._segments, at)
