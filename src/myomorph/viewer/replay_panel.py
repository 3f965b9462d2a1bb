"""The controls of a page that plays results again."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from myomorph.model.errors import MyomorphError
from myomorph.report.scene.image import ACTIVATION, png
from myomorph.viewer.replay_body import PlayedBody
from myomorph.viewer.replay_muscles import MuscleIndex
from myomorph.viewer.replay_plots import Curves
from myomorph.viewer.replay_scene import COLORS, LAYERS, MOST_LABELS, ShownBody

SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
VIEWS = {"Front": (1.0, 0.0, 0.05), "Right": (0.0, 1.0, 0.05), "Back": (-1.0, 0.0, 0.05), "Left": (0.0, -1.0, 0.05)}
ALL = "all"
WIDTH = 330
SMALL = "display:flex;gap:0.7em;align-items:center;font-size:0.78em;opacity:0.85;padding:0.2em 0.6em 0.5em"
MOST_ROWS = 10


class Played(Protocol):
    """What the controls read and move of the page that plays."""

    lock: threading.RLock
    choices: Sequence[Mapping[str, Callable[[], Any]]]
    chosen: list[str]
    bodies: list[PlayedBody]
    shown: list[ShownBody]
    playing: bool
    speed: float
    loop: bool
    follows: bool
    apart: float
    now: float

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of the page's clock [s]."""

    def own_time(self, number: int) -> float:
        """The present by a body's own clock [s]."""

    def choose(self, number: int, name: str) -> None:
        """Show another recording of a body."""

    def seek(self, now: float) -> None:
        """Go to a time of the page's clock [s]."""

    def play(self, playing: bool) -> None:
        """Play on, or pause."""

    def redraw(self) -> None:
        """Draw everything as it is now."""

    def toggle(self, layer: str, visible: bool) -> None:
        """Show a layer of all bodies, or hide it."""

    def follow(self, follows: bool) -> None:
        """Let the view go with the first body, or stay."""

    def look_from(self, ahead: float, right: float, up: float) -> None:
        """Turn every browser's camera to the bodies."""

    def part(self, distance: float) -> None:
        """Move every body to the right of the one before it [m]."""


class Panel:
    """Everything that a user turns, and what it tells of the present.

    Parameters
    ----------
    replay : the page that it controls
    server : `viser`'s
    """

    def __init__(self, replay: Played, server: Any):
        self._replay, self._server, self._gui = replay, server, server.gui
        self._indices = [MuscleIndex(one.muscles, [who.prefix for who in one.subjects]) for one in replay.bodies]
        self._found: list[tuple[int, ...]] = [()] * len(replay.bodies)
        self._subject, self._missed = 0, ""
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(WIDTH)
        self._add_time()
        self._add_muscles()
        self._add_layers()
        self._add_views()
        self._add_about()
        self._curves = Curves(server.gui, self._on, replay.bodies[0], replay.own_time(0))

    def found(self, number: int) -> tuple[int, ...]:
        """Indices of the muscles that were searched for in a body."""
        return self._found[number]

    def labels(self, number: int, frame: int) -> dict[int, str]:
        """What to write beside those muscles."""
        body, found = self._replay.bodies[number], self._found[number]
        if len(found) > MOST_LABELS:
            return {}
        return {m: _label(body.muscles[m], body.activations[frame, m], body.tensions[frame, m]) for m in found}

    def update(self, now: float, frames: Sequence[int]) -> None:
        """Show the present time in the slider, the numbers and the curves."""
        self._slider.value = round(now, 3)
        self._play.label = "Pause" if self._replay.playing else "Play"
        self._play.icon = "player-pause" if self._replay.playing else "player-play"
        self._state.content = self._state_text(frames)
        self._numbers.content = self._numbers_text(frames[self._subject])
        self._curves.move(self._replay.own_time(self._subject))

    def find(self, text: str) -> tuple[str, ...]:
        """Muscles of the chosen body whose names hold a text; they stand out until the text is gone."""
        index = self._indices[self._subject]
        names = index.matches(text)
        self._missed = text.strip() if not names else ""
        self._muscle.options = (ALL, *(names or index.names))
        self._stand_out(names)
        return names

    def _on(self, control: Any, told: Callable[[Any], object]) -> None:
        """Call `told(value)` where a user changes a control, not where the page does."""

        def changed(event: Any) -> None:
            if event.client is not None:
                with self._replay.lock, self._server.atomic():
                    told(event.target.value)

        control.on_update(changed)

    def _add_time(self) -> None:
        gui, replay = self._gui, self._replay
        for number, one in enumerate(replay.choices):
            if len(one) > 1:
                label = "Recording" if len(replay.choices) == 1 else f"Recording {number + 1}"
                choice = gui.add_dropdown(label, tuple(one), initial_value=replay.chosen[number])
                choice.on_update(partial(self._choose, number))
        start, stop = replay.span
        self._slider = gui.add_slider("Time [s]", start, max(stop, start + 0.001), 0.001, start)
        self._on(self._slider, replay.seek)
        self._play = gui.add_button("Play", icon="player-play")
        self._play.on_click(lambda _: replay.play(not replay.playing))
        speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
        self._on(speed, lambda value: setattr(replay, "speed", float(value)))
        loop = gui.add_checkbox("Loop", replay.loop)
        self._on(loop, lambda value: setattr(replay, "loop", value))
        self._state = gui.add_markdown("")

    def _add_muscles(self) -> None:
        gui, replay = self._gui, self._replay
        with gui.add_folder("Muscles"):
            if len(replay.bodies) > 1:
                subjects = tuple(f"{i + 1}: {one.given.head.title}" for i, one in enumerate(replay.bodies))
                subject = gui.add_dropdown("Subject", subjects)
                self._on(subject, lambda value: self._choose_subject(subjects.index(value)))
            self._text = gui.add_text("Find", "", hint="Part of a name, as 'soleus' or 'left biceps femoris'")
            self._on(self._text, self.find)
            names = self._indices[0].names
            self._muscle = gui.add_dropdown("Muscle", (ALL, *names), initial_value=ALL, hint="Type to search")
            self._on(self._muscle, lambda name: self._stand_out(() if name == ALL else (name,)))
            if any(one.given.tension is not None for one in replay.bodies):
                gui.add_html(_scale())
            self._numbers = gui.add_markdown("")
        for number, shown in enumerate(replay.shown):
            shown.on_muscle(partial(self._clicked, number))

    def _add_layers(self) -> None:
        present = {name for shown in self._replay.shown for name in shown.layers}
        with self._gui.add_folder("Show"):
            for name in (one for one in LAYERS if one in present):
                box = self._gui.add_checkbox(LAYERS[name], True)
                self._on(box, partial(self._replay.toggle, name))
            self._gui.add_html(_key([name for name in LAYERS if name in present and name in COLORS]))

    def _add_views(self) -> None:
        gui, replay = self._gui, self._replay
        with gui.add_folder("View"):
            views = gui.add_button_group("From", tuple(VIEWS))
            views.on_click(self._look)
            follow = gui.add_checkbox("Follow the body", replay.follows)
            self._on(follow, replay.follow)
            if len(replay.bodies) > 1:
                apart = gui.add_slider("Apart [m]", 0.0, 3.0, 0.1, min(replay.apart, 3.0), hint="Bodies side by side")
                self._on(apart, replay.part)
            picture = gui.add_button("Save a picture", icon="camera")
            picture.on_click(self._save_picture)

    def _add_about(self) -> None:
        with self._gui.add_folder("About", expand_by_default=False):
            for one in self._replay.bodies:
                told = [f"**{_plain(one.given.head.title)}**"]
                told += [f"*{note.kind}*: {_plain(note.text)}" for note in one.given.head.notes]
                told += [f"*warning*: {_plain(text)}" for text in one.given.head.warnings]
                self._gui.add_markdown("\n\n".join(told))

    def _look(self, event: Any) -> None:
        self._replay.look_from(*VIEWS[event.target.value])

    def _choose(self, number: int, event: Any) -> None:
        if event.client is None or event.target.value == self._replay.chosen[number]:
            return
        try:
            self._replay.choose(number, event.target.value)
        except MyomorphError as error:
            event.client.add_notification("This recording cannot be shown", str(error), color="red")
            event.target.value = self._replay.chosen[number]

    def _choose_subject(self, number: int) -> None:
        self._subject = number
        self._text.value = ""
        self._curves.show_body(self._replay.bodies[number])
        self.find("")

    def _clicked(self, number: int, muscle: int) -> None:
        if number == self._subject:
            self._text.value = self._replay.bodies[number].muscles[muscle]
            self.find(self._text.value)

    def _stand_out(self, names: Sequence[str]) -> None:
        body = self._replay.bodies[self._subject]
        self._found = [()] * len(self._found)
        self._found[self._subject] = tuple(body.muscles.index(name) for name in names)
        if names:
            self._curves.show_muscles(self._found[self._subject])
        self._replay.redraw()

    def _save_picture(self, event: Any) -> None:
        client = event.client
        if client is None:
            return
        camera = client.camera
        pixels = client.get_render(camera.image_height, camera.image_width, transport_format="png", timeout=30.0)
        stem = re.sub(r"\W+", "_", self._replay.bodies[0].given.head.title)
        name = f"{stem}_{self._replay.now:.3f}s.png"
        client.send_file_download(name, png(np.asarray(pixels, dtype=np.uint8)), save_immediately=True)

    def _state_text(self, frames: Sequence[int]) -> str:
        told = []
        for body, frame in zip(self._replay.bodies, frames, strict=True):
            line = f"{_plain(body.given.head.title)}: frame {frame + 1} of {len(body.time)}"
            if not body.known[frame]:
                line += ", **pose unknown**"
            tension = body.given.tension
            if tension is not None and np.isnan(body.activations[frame]).all():
                line += ", no muscle tensions here"
            told.append(line)
        return "\n\n".join(told)

    def _numbers_text(self, frame: int) -> str:
        body, found = self._replay.bodies[self._subject], self._found[self._subject]
        if not found:
            return f"no muscle is called '{_plain(self._missed)}'" if self._missed else ""
        if body.given.tension is None:
            return ", ".join(_plain(body.muscles[m]) for m in found[:MOST_ROWS])
        rows = ["| | activation | tension |", "|---|---|---|"]
        for m in found[:MOST_ROWS]:
            tension = f"{body.tensions[frame, m]:.0f} N" if np.isfinite(body.tensions[frame, m]) else "–"
            active = f"{body.activations[frame, m]:.2f}" if np.isfinite(body.activations[frame, m]) else "–"
            rows.append(f"| {_plain(body.muscles[m])} | {active} | {tension} |")
        return "\n".join(rows) + (f"\n\nand {len(found) - MOST_ROWS} more" if len(found) > MOST_ROWS else "")


def _label(name: str, activation: float, tension: float) -> str:
    return f"{name}  {activation:.2f}, {tension:.0f} N" if np.isfinite(activation) else name


def _scale() -> str:
    """What the colors of muscles mean, as HTML."""
    colors = ",".join(f"rgb({r},{g},{b})" for r, g, b in ACTIVATION[:: len(ACTIVATION) // 8].tolist())
    bar = f"flex:1;height:0.6em;border-radius:2px;background:linear-gradient(to right,{colors})"
    return (
        f'<div style="{SMALL}"><span>activation 0</span><span style="{bar}"></span><span>1; thick: tight</span></div>'
    )


def _key(layers: Sequence[str]) -> str:
    """What the colors of layers mean, as HTML."""
    dots = [
        f'<span><b style="color:rgb({",".join(str(one) for one in COLORS[name])})">●</b> {LAYERS[name]}</span>'
        for name in layers
    ]
    return f'<div style="{SMALL};flex-wrap:wrap">{"".join(dots)}</div>'


def _plain(text: str) -> str:
    """A text whose signs Markdown would take for its own."""
    return "".join(f"\\{one}" if one in "\\`*_{}[]()#+!|<>" else one for one in text)
