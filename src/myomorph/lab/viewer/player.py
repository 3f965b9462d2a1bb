"""What plays on a page of results: bodies, the clock that they share, and findings."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_scene import ShownBody
from myomorph.lab.viewer.web_page import Page, view_from

TOO_NEAR = 0.1
SIDE_BY_SIDE = 0.45
"""Distance of two bodies below which they begin side by side, and how far apart they then are, in
sizes of the body.
"""

GOES_AWAY = 0.4  # Way over the floor from which on the view follows, in sizes of the body.
NEAR = 0.82  # Distance of the camera in sizes of the body.
# From where the camera looks at first: ahead, to the right and above.
FIRST_VIEW = (0.75, 0.7, 0.16)
MAX_LABELS = 6  # Muscles that are named in the scene.


class Player(Page):
    """A page with bodies and a clock: which time it is, and how the page shows it.

    Attributes
    ----------
    lock : held while the page changes, for the clock and every control run in threads of their own
    follows : whether the view goes with the first body
    now : on the page's clock [s]
    drawn : frames that were drawn
    """

    # bodies, shown: what is played, and how the page shows it
    bodies: list[PlayedBody]
    shown: list[ShownBody]
    found: list[tuple[int, ...]]  # of each body, indices of the muscles that stand out
    span: tuple[float, float]  # first and last time of that clock [s]
    spacing: float  # distance between bodies beside each other, beyond where they were [m]

    def __init__(self, port: int | None):
        super().__init__(port, "Myomorph")
        self.lock = threading.RLock()
        self.playing = False
        self.speed = 1.0
        self.loop = True
        self.follows = False
        self.now = 0.0
        self.drawn = 0

    def seek(self, now: float) -> None:
        """Go to a time of the page's clock [s]."""
        with self.lock:
            self.now = float(np.clip(now, *self.span))
            self._draw(slow=True)

    def play(self, playing: bool) -> None:
        """Play on, or pause; at the end it begins again."""
        with self.lock:
            if playing and self.now >= self.span[1] - 1e-9:
                self.now = self.span[0]
            self.playing = playing
            self._draw(slow=True)

    def redraw(self) -> None:
        """Draw everything as it is now, though no frame has passed."""
        with self.lock:
            self._frames = [-1] * len(self.bodies)
            self._draw(slow=True)

    def own_time(self, number: int) -> float:
        """Return the present by a body's own clock [s]."""
        return self.now + self._offsets[number]

    def toggle(self, layer: str, visible: bool) -> None:
        """Show a layer of all bodies, or hide it."""
        with self.lock:
            if layer == "floor":
                self.floor.visible = visible
            for shown in self.shown:
                shown.toggle(layer, visible)
        self.redraw()

    def follow(self, follows: bool) -> None:
        """Let the view go with the first body, or stay."""
        self.follows = follows
        self.redraw()

    def stand_out(self, number: int, muscles: tuple[int, ...]) -> None:
        """Let muscles of a body stand out, by their indices, and none of the others."""
        self.found = [muscles if i == number else () for i in range(len(self.bodies))]
        self.redraw()

    def look_from(self, ahead: float, right: float, up: float) -> None:
        """Turn every browser's camera to the bodies, in the axes of the first one."""
        for client in self._server.get_clients().values():
            self._aim(client, (ahead, right, up))

    def part(self, distance: float) -> None:
        """Place every body to the right of the one before it, by a distance from its path [m]."""
        with self.lock:
            self.spacing = distance
            for i, shown in enumerate(self.shown):
                shown.node.position = i * distance * self.bodies[0].scene.right

    def _load(self, bodies: list[PlayedBody]) -> None:
        """Put bodies on the page, at the begin of their clock."""
        scene = bodies[0].scene
        self.bodies = bodies
        self.found = [()] * len(bodies)
        # Recordings that share no time all begin at 0.
        apart = max(body.time[0] for body in bodies) >= min(body.time[-1] for body in bodies)
        self._offsets = [
            float(body.time[0]) if apart and len(bodies) > 1 else 0.0 for body in bodies
        ]
        ends = [
            (body.time[0] - late, body.time[-1] - late)
            for body, late in zip(bodies, self._offsets, strict=True)
        ]
        self.span = float(min(end for end, _ in ends)), float(max(end for _, end in ends))
        self.now = self.span[0]
        first = [body.at(self._frame(i)) for i, body in enumerate(bodies)]
        self._lay_floor(scene, first[0].origins[1])
        self.shown = [
            ShownBody(page=self._page, root=f"/around/body{i}", body=body, number=i)
            for i, body in enumerate(bodies)
        ]
        self._frames = [-1] * len(bodies)
        spread = float(np.linalg.norm(np.ptp([body.middle for body in first], axis=0)))
        near = len(bodies) > 1 and spread < TOO_NEAR * scene.size
        self.part(round(SIDE_BY_SIDE * scene.size, 1) if near else 0.0)
        self.follows = bodies[0].travelled > GOES_AWAY * scene.size

    def _aim(self, client: Any, direction: tuple[float, float, float] = FIRST_VIEW) -> None:
        """Turn a browser's camera to the bodies.

        A browser that is early waits until there are some.
        """
        with self.lock:
            client.camera.up_direction = self.bodies[0].scene.up
            client.camera.position, client.camera.look_at = self._camera(*direction)

    def _camera(self, ahead: float, right: float, up: float) -> tuple[np.ndarray, np.ndarray]:
        """Find where a camera sees all bodies from a direction, and the middle that it looks at.

        Both are where the page has them.
        """
        scene = self.bodies[0].scene
        roots = [
            body.at(self._frame(i)).middle + self.around.position + shown.node.position
            for i, (body, shown) in enumerate(zip(self.bodies, self.shown, strict=True))
        ]
        mean = np.mean(roots, axis=0)
        middle: np.ndarray = mean + (0.5 * (scene.floor + scene.high) - mean @ scene.up) * scene.up
        spread = float(np.linalg.norm(np.ptp(roots, axis=0))) / scene.size
        direction = ahead * scene.forward + right * scene.right + up * scene.up
        return view_from(scene, middle, direction, NEAR * (1.0 + 0.7 * spread)), middle

    def _frame(self, number: int) -> int:
        return self.bodies[number].frame_at(self.own_time(number))

    def _advance(self, seconds: float, slow: bool) -> None:
        start, stop = self.span
        self.now += seconds
        if self.now > stop:
            self.now = start + (self.now - stop) % max(stop - start, 1e-9) if self.loop else stop
            self.playing = self.loop
        self._draw(slow=slow or not self.playing)

    def _draw(self, slow: bool) -> None:
        """Send what has changed; numbers and curves only where `slow`."""
        with self._server.atomic():
            for i, shown in enumerate(self.shown):
                frame = self._frame(i)
                if frame == self._frames[i]:
                    continue
                self._frames[i] = frame
                instant = self.bodies[i].at(frame, self.found[i])
                shown.draw(instant)
                if i == 0:
                    self._carry_back(instant.origins[1] if self.follows else self._start)
                self.drawn += 1
                shown.label(self._labels(i, frame), frame)
            if slow:
                self._show_numbers(self._frames)

    def _labels(self, number: int, frame: int) -> dict[int, str]:
        """Write the labels beside the muscles that stand out."""
        body = self.bodies[number]
        chosen = self.found[number]
        if len(chosen) > MAX_LABELS:
            return {}
        return {
            m: _label(body.muscles[m], body.activations[frame, m], body.tensions[frame, m])
            for m in chosen
        }

    def _show_numbers(self, frames: Sequence[int]) -> None:
        """Show the present beside the scene; a page with controls does."""


def _label(name: str, activation: float, tension: float) -> str:
    return f"{name}  {activation:.2f}, {tension:.0f} N" if np.isfinite(activation) else name
