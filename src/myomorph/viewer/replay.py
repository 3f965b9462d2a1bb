"""A result in a web page: the body moves, its muscles in the colors of their activations, curves beside it."""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from myomorph.report.trial.given import ReportInput
from myomorph.viewer.replay_body import PlayedBody
from myomorph.viewer.replay_panel import Panel
from myomorph.viewer.replay_scene import ShownBody
from myomorph.viewer.web_page import add_floor, add_lights, open_server, quiet, view_from

FRAMES = 30.0
"""Frames a second that the page is sent [Hz]."""

TOO_NEAR, SIDE_BY_SIDE = 0.1, 0.45
"""Distance of two bodies below which they begin side by side, and how far apart they then are, in sizes of the body."""

GOES_AWAY = 0.4
"""Way over the floor from which on the view follows, in sizes of the body."""

NEAR = 0.82
"""Distance of the camera in sizes of the body."""

FIRST_VIEW = (0.75, 0.7, 0.16)
"""From where the camera looks at first: ahead, to the right and above."""

SLOW = 3
"""Numbers and curves follow with every third frame."""

Choices = Sequence[Mapping[str, Callable[[], ReportInput]]]
"""For each body that is shown, its recordings by name, each opened when it is asked for."""


class Replay:
    """A page on this machine that plays results again.

    Everything that is shown hangs on one frame, which moves back as the first body moves on where the view follows it.

    Parameters
    ----------
    choices : of each body, its recordings; the first of each is shown first
    port : of the page; any free one where not given
    served : called with the port once the page can be opened, which loads while the results are read

    Attributes
    ----------
    lock : what changes the page holds it, for the clock and every control run in threads of their own

    Raises
    ------
    MyomorphError : a recording cannot be opened or has no motion, `viser` is not installed, or the port is taken
    """

    def __init__(self, choices: Choices, port: int | None = None, served: Callable[[int], None] | None = None):
        self.choices = choices
        self.chosen = [next(iter(one)) for one in choices]
        self.lock = threading.RLock()
        self._stopped = threading.Event()
        self.playing, self.speed, self.loop, self.follows = False, 1.0, True, False
        self.now, self.drawn = 0.0, 0
        self._server = open_server(port, "Myomorph")
        self.port = int(self._server.get_port())
        try:
            with self.lock:
                self._server.gui.add_markdown("Opening the results ...")
                self._server.on_client_connect(self._aim)
                if served is not None:
                    served(self.port)
                self.bodies = [PlayedBody(one[name]()) for one, name in zip(choices, self.chosen, strict=True)]
                self._build()
        except BaseException:
            self._stopped.set()
            with quiet():
                self._server.stop()
            raise
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of the page's clock [s]."""
        return self._span

    def choose(self, number: int, name: str) -> None:
        """Show another recording of a body."""
        opened = PlayedBody(self.choices[number][name]())
        with self.lock:
            self.chosen[number], self.bodies[number] = name, opened
            self.playing = False
            self._build()
            for client in self._server.get_clients().values():
                self._aim(client)

    def seek(self, now: float) -> None:
        """Go to a time of the page's clock [s]."""
        with self.lock:
            self.now = float(np.clip(now, *self._span))
            self._draw(slow=True)

    def play(self, playing: bool) -> None:
        """Play on, or pause; at the end it begins again."""
        with self.lock:
            if playing and self.now >= self._span[1] - 1e-9:
                self.now = self._span[0]
            self.playing = playing
            self._draw(slow=True)

    def redraw(self) -> None:
        """Draw everything as it is now, though no frame has passed."""
        with self.lock:
            self._frames = [-1] * len(self.bodies)
            self._draw(slow=True)

    def own_time(self, number: int) -> float:
        """The present by a body's own clock [s]."""
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

    def look_from(self, ahead: float, right: float, up: float) -> None:
        """Turn every browser's camera to the bodies, from a direction in the first one's own axes."""
        for client in self._server.get_clients().values():
            self._aim(client, (ahead, right, up))

    def part(self, distance: float) -> None:
        """Move every body to the right of the one before it, by a distance beyond where it was [m]."""
        with self.lock:
            self.apart = distance
            for i, shown in enumerate(self.shown):
                shown.node.position = i * distance * self.bodies[0].scene.right

    def close(self) -> None:
        """Take the page down."""
        self._stopped.set()
        self._thread.join(timeout=2.0)
        with quiet():
            self._server.stop()

    def wait(self) -> None:
        """Serve until the program is interrupted."""
        while not self._stopped.wait(0.5):
            pass

    def _build(self) -> None:
        """Make all that the page shows."""
        page, scene = self._server.scene, self.bodies[0].scene
        page.reset()
        self._server.gui.reset()
        page.set_up_direction(tuple(float(one) for one in scene.up))
        add_lights(page, scene)
        self._offsets = _together(self.bodies)
        ends = [(one.time[0] - late, one.time[-1] - late) for one, late in zip(self.bodies, self._offsets, strict=True)]
        self._span = float(min(one for one, _ in ends)), float(max(one for _, one in ends))
        self.now = self._span[0]
        self.around = page.add_frame("/around", show_axes=False)
        self.floor = add_floor(page, "/around/ground", scene.up, scene.floor)
        self.shown = [ShownBody(page, f"/around/body{i}", one, i) for i, one in enumerate(self.bodies)]
        self._frames = [-1] * len(self.bodies)
        roots = [one.at(self._frame(i)).middle for i, one in enumerate(self.bodies)]
        together = len(roots) > 1 and float(np.linalg.norm(np.ptp(roots, axis=0))) < TOO_NEAR * scene.size
        self.apart = round(SIDE_BY_SIDE * scene.size, 1) if together else 0.0
        self.part(self.apart)
        self._start = np.array(self.bodies[0].at(self._frame(0)).origins[1])
        self.follows = self.bodies[0].travelled > GOES_AWAY * scene.size
        self.panel = Panel(self, self._server)
        self._draw(slow=True)

    def _aim(self, client: Any, direction: tuple[float, float, float] = FIRST_VIEW) -> None:
        """Turn a browser's camera to the bodies; a browser that is early waits until there are some."""
        with self.lock:
            if not self._stopped.is_set():
                client.camera.up_direction = self.bodies[0].scene.up
                client.camera.position, client.camera.look_at = self._camera(*direction)

    def _camera(self, ahead: float, right: float, up: float) -> tuple[np.ndarray, np.ndarray]:
        """Where a camera sees all bodies from a direction, and the middle that it looks at, where the page has them."""
        scene = self.bodies[0].scene
        roots = [
            one.at(self._frame(i)).middle + self.around.position + shown.node.position
            for i, (one, shown) in enumerate(zip(self.bodies, self.shown, strict=True))
        ]
        place = np.mean(roots, axis=0)
        middle: np.ndarray = place + (0.5 * (scene.floor + scene.high) - place @ scene.up) * scene.up
        spread = float(np.linalg.norm(np.ptp(roots, axis=0))) / scene.size
        direction = ahead * scene.forward + right * scene.right + up * scene.up
        return view_from(scene, middle, direction, NEAR * (1.0 + 0.7 * spread)), middle

    def _frame(self, number: int) -> int:
        return self.bodies[number].frame_at(self.own_time(number))

    def _run(self) -> None:
        """The clock: as long as it plays, a frame every thirtieth of a second."""
        before, count = clock.perf_counter(), 0
        while not self._stopped.wait(max(before + 1.0 / FRAMES - clock.perf_counter(), 0.001)):
            passed, before = clock.perf_counter() - before, clock.perf_counter()
            if not self.playing:
                continue
            count += 1
            with self.lock:
                self._advance(passed * self.speed, slow=count % SLOW == 0)

    def _advance(self, seconds: float, slow: bool) -> None:
        start, stop = self._span
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
                instant = self.bodies[i].at(frame, self.panel.found(i))
                shown.draw(instant)
                if i == 0:
                    self._follow(instant.origins[1])
                self.drawn += 1
                shown.label(self.panel.labels(i, frame), frame)
            if slow:
                self.panel.update(self.now, self._frames)

    def _follow(self, root: np.ndarray) -> None:
        up = self.bodies[0].scene.up
        moved = (root - self._start) if self.follows else np.zeros(3)
        self.around.position = -(moved - (moved @ up) * up)


def _together(bodies: Sequence[PlayedBody]) -> list[float]:
    """What to take off each body's clock: nothing, unless recordings share no time; then all begin at 0 [s]."""
    first, last = max(one.time[0] for one in bodies), min(one.time[-1] for one in bodies)
    if len(bodies) == 1 or first < last:
        return [0.0] * len(bodies)
    return [float(one.time[0]) for one in bodies]
