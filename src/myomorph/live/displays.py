"""Where a live session is shown: the terminal, and a web page."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Mapping
from typing import Protocol

from myomorph.identify.online import OnlineState
from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.segments import Segment
from myomorph.model.surface import Surface
from myomorph.report.scene.body_view import BodyView, half_blocks
from myomorph.viewer.live_view import Clock, live_markdown, live_panel

ROWS, COLUMNS = 30, 40
"""Characters of the drawn body."""

BESIDE = 60
"""Characters that the numbers need beside it."""

DRAWN = 30.0
"""Poses a second that the page is sent [Hz]."""


class Display(Protocol):
    """Something that shows a session."""

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """A new frame."""

    def show(self, state: OnlineState, at: Clock) -> None:
        """A new look at the estimate."""

    def close(self) -> None:
        """The session is over."""


class TerminalDisplay:
    """Draws on the terminal through `rich`."""

    def __init__(self, model: Model, segments: Mapping[str, Segment], surfaces: Mapping[str, Surface] | None):
        from rich.console import Console
        from rich.live import Live

        self._model, self._segments = model, segments
        self._view = BodyView(model, surfaces)
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=False)
        self._live.start()

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """Nothing: the terminal is drawn with the next look."""

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


class WebDisplay:
    """Draws in a web page."""

    def __init__(
        self, model: Model, segments: Mapping[str, Segment], surfaces: Mapping[str, Surface] | None, port: int
    ):
        from myomorph.viewer.identification_page import WebViewer

        self._model, self._segments = model, segments
        self._viewer = WebViewer(model, surfaces, port)
        self._drawn = 0.0
        sys.stderr.write(f"the body is at http://localhost:{self._viewer.port}\n")

    def pose(self, coordinates: Array, markers: Array | None) -> None:
        """Move the body, at most thirty times a second."""
        if clock.monotonic() - self._drawn > 1.0 / DRAWN:
            self._viewer.pose(coordinates, markers)
            self._drawn = clock.monotonic()

    def show(self, state: OnlineState, at: Clock) -> None:
        """Color the body and tell the numbers."""
        text = live_markdown(state, self._model.body_names, self._segments, at)
        self._viewer.levels(state.levels, state.fit.progress, text)

    def close(self) -> None:
        """Take the page down."""
        self._viewer.close()
