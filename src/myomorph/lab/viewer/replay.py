"""A page that plays results again: the body moves, curves beside it.

Its muscles have the colors of their activations.
"""

from __future__ import annotations

import re
import threading
import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.selection import MAJOR_MUSCLES, pairs
from myomorph.lab.report.scene.image import ACTIVATION, png
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.viewer.player import Player
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_charts import Curves
from myomorph.lab.viewer.replay_scene import COLORS, LAYERS
from myomorph.lab.viewer.web_page import escaped, quiet

FRAMES = 30.0  # Frames a second that the page is sent [Hz].
SLOW = 3  # Numbers and curves follow with every third frame.
SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
VIEWS = {
    "Front": (1.0, 0.0, 0.05),
    "Right": (0.0, 1.0, 0.05),
    "Back": (-1.0, 0.0, 0.05),
    "Left": (0.0, -1.0, 0.05),
}
ALL = "all"
WIDTH = 330
SMALL = (
    "display:flex;gap:0.7em;align-items:center;font-size:0.78em;opacity:0.85;padding:0.2em 0.6em"
    " 0.5em"
)
MAX_ROWS = 10

Choices = Sequence[Mapping[str, Callable[[], ReportInput]]]
"""For each body that is shown, its recordings by name, each opened when it is asked for."""


class Replay(Player):
    """A page on this machine that plays results again.

    Attributes
    ----------
    choices : of each body, its recordings
    chosen : which of them is shown, the first at first
    served : called with the address once the page can be opened, which loads while results are read
    """

    def __init__(
        self, choices: Choices, port: int | None = None, served: Callable[[str], None] | None = None
    ):
        super().__init__(port)
        self.choices = choices
        self.chosen = [next(iter(choice)) for choice in choices]
        self._stopped = threading.Event()
        try:
            with self.lock:
                self._server.gui.add_markdown("Opening the results ...")
                self._server.on_client_connect(self._welcome)
                if served is not None:
                    served(self.address)
                self._build(
                    [
                        PlayedBody(choice[name]())
                        for choice, name in zip(choices, self.chosen, strict=True)
                    ]
                )
        except BaseException:
            self._stopped.set()
            with quiet():
                self._server.stop()
            raise
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    def choose(self, number: int, name: str) -> None:
        """Show another recording of a body."""
        opened = PlayedBody(self.choices[number][name]())
        with self.lock:
            self.chosen[number] = name
            self.playing = False
            self._build([*self.bodies[:number], opened, *self.bodies[number + 1 :]])
            for client in self._server.get_clients().values():
                self._aim(client)

    def close(self) -> None:
        """Take the page down."""
        self._stopped.set()
        self._thread.join(timeout=2.0)
        super().close()

    def _build(self, bodies: list[PlayedBody]) -> None:
        """Make all that the page shows."""
        self._load(bodies)
        names = [tuple(choice) for choice in self.choices]
        self.panel = Panel(
            player=self,
            server=self._server,
            recordings=names,
            chosen=self.chosen,
            choose=self.choose,
        )
        self._draw(slow=True)

    def _welcome(self, client: Any) -> None:
        """Turn the camera of a browser that has opened the page to the bodies."""
        with self.lock:
            if not self._stopped.is_set():
                self._aim(client)

    def _run(self) -> None:
        """Run the clock: as long as it plays, a frame every thirtieth of a second."""
        before = clock.perf_counter()
        count = 0
        while not self._stopped.wait(max(before + 1.0 / FRAMES - clock.perf_counter(), 0.001)):
            passed = clock.perf_counter() - before
            before = clock.perf_counter()
            if not self.playing:
                continue
            count += 1
            with self.lock:
                self._advance(passed * self.speed, slow=count % SLOW == 0)

    def _show_numbers(self, frames: Sequence[int]) -> None:
        self.panel.update(frames)


class Panel:
    """The controls of a player, and numbers and curves of the present.

    `choose` is called with the number of a body and a name where a user chooses another of its
    recordings.
    """

    def __init__(
        self,
        player: Player,
        server: Any,
        recordings: Sequence[tuple[str, ...]],
        chosen: Sequence[str],
        choose: Callable[[int, str], None],
    ):
        self._player = player
        self._server = server
        self._gui = server.gui
        self._recordings = recordings
        self._chosen = chosen
        self._choose = choose
        self._indices = [
            MuscleIndex(body.muscles, [who.prefix for who in body.subjects])
            for body in player.bodies
        ]
        self._subject = 0
        self._missed = ""
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(WIDTH)
        self._add_time()
        self._add_muscles()
        self._add_layers()
        self._add_views()
        self._add_about()
        self._curves = Curves(
            gui=server.gui, on=self._on, body=player.bodies[0], now=player.own_time(0)
        )

    def update(self, frames: Sequence[int]) -> None:
        """Show the present time and frames in the slider, the numbers and the curves."""
        self._slider.value = round(self._player.now, 3)
        self._play.label = "Pause" if self._player.playing else "Play"
        self._play.icon = "player-pause" if self._player.playing else "player-play"
        self._state.content = self._state_text(frames)
        self._numbers.content = self._numbers_text(frames[self._subject])
        self._curves.move(self._player.own_time(self._subject))

    def find(self, text: str) -> tuple[str, ...]:
        """Find muscles of the chosen body whose names hold a text.

        They stand out until the text is gone.
        """
        index = self._indices[self._subject]
        names = index.matches(text)
        self._missed = text.strip() if not names else ""
        self._muscle.options = (ALL, *(names or index.names))
        self._stand_out(names)
        return names

    def _on(self, control: Any, changed: Callable[[Any], object]) -> None:
        """Call `changed(value)` where a user changes a control, not where the page does."""

        def listen(event: Any) -> None:
            if event.client is not None:
                with self._player.lock, self._server.atomic():
                    changed(event.target.value)

        control.on_update(listen)

    def _add_time(self) -> None:
        gui = self._gui
        player = self._player
        for number, names in enumerate(self._recordings):
            if len(names) > 1:
                label = "Recording" if len(self._recordings) == 1 else f"Recording {number + 1}"
                choice = gui.add_dropdown(label, names, initial_value=self._chosen[number])
                choice.on_update(partial(self._choose_recording, number))
        start, stop = player.span
        self._slider = gui.add_slider("Time [s]", start, max(stop, start + 0.001), 0.001, start)
        self._on(self._slider, player.seek)
        self._play = gui.add_button("Play", icon="player-play")
        self._play.on_click(lambda _: player.play(not player.playing))
        speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
        self._on(speed, lambda value: setattr(player, "speed", float(value)))
        loop = gui.add_checkbox("Loop", player.loop)
        self._on(loop, lambda value: setattr(player, "loop", value))
        self._state = gui.add_markdown("")

    def _add_muscles(self) -> None:
        gui = self._gui
        player = self._player
        with gui.add_folder("Muscles"):
            if len(player.bodies) > 1:
                subjects = tuple(
                    f"{i + 1}: {body.results.head.title}" for i, body in enumerate(player.bodies)
                )
                subject = gui.add_dropdown("Subject", subjects)
                self._on(subject, lambda value: self._choose_subject(subjects.index(value)))
            self._text = gui.add_text(
                "Find", "", hint="Part of a name, as 'soleus' or 'left biceps femoris'"
            )
            self._on(self._text, self.find)
            names = self._indices[0].names
            self._muscle = gui.add_dropdown(
                "Muscle", (ALL, *names), initial_value=ALL, hint="Type to search"
            )
            self._on(self._muscle, lambda name: self._stand_out(() if name == ALL else (name,)))
            if any(body.results.tension is not None for body in player.bodies):
                gui.add_html(_scale())
            self._numbers = gui.add_markdown("")
        for number, shown in enumerate(player.shown):
            shown.on_muscle(partial(self._clicked, number))

    def _add_layers(self) -> None:
        present = {name for shown in self._player.shown for name in shown.layers}
        with self._gui.add_folder("Show"):
            for name in (layer for layer in LAYERS if layer in present):
                box = self._gui.add_checkbox(LAYERS[name], True)
                self._on(box, partial(self._player.toggle, name))
            self._gui.add_html(
                _key([name for name in LAYERS if name in present and name in COLORS])
            )

    def _add_views(self) -> None:
        gui = self._gui
        player = self._player
        with gui.add_folder("View"):
            views = gui.add_button_group("From", tuple(VIEWS))
            views.on_click(lambda event: player.look_from(*VIEWS[event.target.value]))
            follow = gui.add_checkbox("Follow the body", player.follows)
            self._on(follow, player.follow)
            if len(player.bodies) > 1:
                words = "Separation [m]"
                hint = "Bodies side by side"
                spacing = gui.add_slider(words, 0.0, 3.0, 0.1, min(player.spacing, 3.0), hint=hint)
                self._on(spacing, player.part)
            picture = gui.add_button("Save a picture", icon="camera")
            picture.on_click(self._save_picture)

    def _add_about(self) -> None:
        with self._gui.add_folder("About", expand_by_default=False):
            for body in self._player.bodies:
                lines = [f"**{escaped(body.results.head.title)}**"]
                lines += [
                    f"*{note.kind}*: {escaped(note.text)}" for note in body.results.head.notes
                ]
                lines += [f"*warning*: {escaped(text)}" for text in body.results.head.warnings]
                self._gui.add_markdown("\n\n".join(lines))

    def _choose_recording(self, number: int, event: Any) -> None:
        if event.client is None or event.target.value == self._chosen[number]:
            return
        try:
            self._choose(number, event.target.value)
        except MyomorphError as error:
            event.client.add_notification(
                "This recording cannot be displayed", str(error), color="red"
            )
            event.target.value = self._chosen[number]

    def _choose_subject(self, number: int) -> None:
        self._subject = number
        self._text.value = ""
        self._curves.show_body(self._player.bodies[number])
        self.find("")

    def _clicked(self, number: int, muscle: int) -> None:
        if number == self._subject:
            self._text.value = self._player.bodies[number].muscles[muscle]
            self.find(self._text.value)

    def _stand_out(self, names: Sequence[str]) -> None:
        muscles = tuple(self._player.bodies[self._subject].muscles.index(name) for name in names)
        if names:
            self._curves.show_muscles(muscles)
        self._player.stand_out(self._subject, muscles)

    def _save_picture(self, event: Any) -> None:
        client = event.client
        if client is None:
            return
        camera = client.camera
        pixels = client.get_render(
            camera.image_height, camera.image_width, transport_format="png", timeout=30.0
        )
        stem = re.sub(r"\W+", "_", self._player.bodies[0].results.head.title)
        name = f"{stem}_{self._player.now:.3f}s.png"
        client.send_file_download(
            name, png(np.asarray(pixels, dtype=np.uint8)), save_immediately=True
        )

    def _state_text(self, frames: Sequence[int]) -> str:
        lines = []
        for body, frame in zip(self._player.bodies, frames, strict=True):
            line = f"{escaped(body.results.head.title)}: frame {frame + 1} of {len(body.time)}"
            if not body.known[frame]:
                line += ", **pose unknown**"
            tension = body.results.tension
            if tension is not None and np.isnan(body.activations[frame]).all():
                line += ", no muscle tensions here"
            lines.append(line)
        return "\n\n".join(lines)

    def _numbers_text(self, frame: int) -> str:
        body = self._player.bodies[self._subject]
        chosen = self._player.found[self._subject]
        if not chosen:
            return f"no muscle is called '{escaped(self._missed)}'" if self._missed else ""
        if body.results.tension is None:
            return ", ".join(escaped(body.muscles[m]) for m in chosen[:MAX_ROWS])
        rows = ["| | activation | tension |", "|---|---|---|"]
        if body.fibers is not None:
            rows = [
                "| | activation | tension | fiber, optimal lengths | tendon strain |",
                "|---|---|---|---|---|",
            ]
        for m in chosen[:MAX_ROWS]:
            tension = (
                f"{body.tensions[frame, m]:.0f} N" if np.isfinite(body.tensions[frame, m]) else "–"
            )
            active = _shown(body.activations[frame, m], ".2f")
            fibers = zip(body.fibers or (), (".2f", ".1%"), strict=False)
            more = "".join(f" {_shown(values[frame, m], form)} |" for values, form in fibers)
            rows.append(f"| {escaped(body.muscles[m])} | {active} | {tension} |{more}")
        return "\n".join(rows) + (
            f"\n\nand {len(chosen) - MAX_ROWS} more" if len(chosen) > MAX_ROWS else ""
        )


def _shown(value: float, form: str) -> str:
    """Write a number, or a dash where it is not known."""
    return format(value, form) if np.isfinite(value) else "–"


def _scale() -> str:
    """Explain the colors of muscles, as HTML."""
    colors = ",".join(
        f"rgb({r},{g},{b})" for r, g, b in ACTIVATION[:: len(ACTIVATION) // 8].tolist()
    )
    bar = (
        '<span style="flex:1;height:0.6em;border-radius:2px;background:linear-gradient(to'
        f' right,{colors})"></span>'
    )
    return f'<div style="{SMALL}"><span>activation 0</span>{bar}<span>1; thick: tight</span></div>'


def _key(layers: Sequence[str]) -> str:
    """Explain the colors of layers, as HTML."""
    dots = []
    for name in layers:
        color = ",".join(str(channel) for channel in COLORS[name])
        dots.append(f'<span><b style="color:rgb({color})">●</b> {LAYERS[name]}</span>')
    return f'<div style="{SMALL};flex-wrap:wrap">{"".join(dots)}</div>'


class MuscleIndex:
    """Muscles of a model under the names that people give them.

    `prefixes` are what the names of a subject begin with.
    """

    def __init__(self, names: Sequence[str], prefixes: Sequence[str] = ()):
        self.names = tuple(names)
        side_of = {
            name: side for pair in pairs(names) for side, of in pair.members.items() for name in of
        }
        self._words = tuple(_words(name, side_of.get(name, ""), prefixes) for name in names)

    def matches(self, text: str) -> tuple[str, ...]:
        """Find names that hold every word of a text, in their own or their anatomical name.

        A whole name stands alone.

        >>> MuscleIndex(["soleus_r", "soleus_l", "bflh_r"]).matches("biceps femoris")
        ('bflh_r',)
        >>> MuscleIndex(["soleus_r", "soleus_l", "bflh_r"]).matches("left sol")
        ('soleus_l',)
        """
        asked = text.strip().lower()
        exact = tuple(name for name in self.names if name.lower() == asked)
        if exact or not asked:
            return exact
        known = zip(self.names, self._words, strict=True)
        return tuple(name for name, words in known if all(word in words for word in asked.split()))


def _words(name: str, side: str, prefixes: Sequence[str]) -> str:
    bare = next(
        (name.removeprefix(prefix) for prefix in prefixes if prefix and name.startswith(prefix)),
        name,
    )
    base = split_side(bare.rsplit("__", 1)[-1])[0]
    titles = [
        label for label, pattern in MAJOR_MUSCLES if re.fullmatch(pattern, base, re.IGNORECASE)
    ]
    return " ".join([name, name.replace("_", " "), side, *titles]).lower()
