"""A body in a web page while the chain follows it: bones, muscles by activation, forces.

Markers and numbers stand beside.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface
from myomorph.core.muscles.drawn_paths import drawn_paths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.lab.report.scene.image import activation_color
from myomorph.lab.report.scene.shapes import tube
from myomorph.lab.viewer.replay_body import (
    MIN_FORCE,
    SLACK,
    TALL,
    TIGHT,
    WEIGHT,
    Tubes,
    arrows,
    tubes,
)
from myomorph.lab.viewer.replay_scene import COLORS, add_arrows, add_batch, bone_solids, move_batch
from myomorph.lab.viewer.web_page import DEEPER, BodyView, Page, escaped

STRONGEST = 8
TURNED = 8  # Muscles and torques that the table holds.
STAY = 2.0
# How long rows of the table stay in place [s], and what is left of a peak a frame later.
FADE = 0.98
THIN = 0.4  # Thickness of limbs without meshes, so that muscles are seen beside them.


@read_only
class Shown:
    """What the page is sent of one frame."""

    coordinates: Array  # (coordinates,) as the markers show them, NaN where unknown
    # activations, forces: (muscles,) NaN where unknown
    activations: Array
    forces: Array
    torques: Array  # (coordinates,) NaN where unknown
    wrenches: Array  # (bodies, 6) external moment about the ground's origin and force
    markers: Array  # (markers, 3) NaN where hidden, or with 0 rows
    state: str  # why torques are unknown, "" where they are known
    facts: Mapping[str, str]  # lines of text, by what they tell
    # torque_limits, force_limits: (2, coordinates), (2, muscles) limits of 90 %, None where unknown
    torque_limits: Array | None = None
    force_limits: Array | None = None


class ChainViewer(Page):
    """A page that shows the newest frame of the chain; without meshes limbs are rounds."""

    def __init__(
        self, model: Model, surfaces: Mapping[str, Surface] | None, port: int, wrenches: int
    ):
        super().__init__(port, "Myomorph live")
        self._model = model
        view = BodyView(model, surfaces)
        self._paths = compile_paths(model)
        self._strength = np.array(
            [max(muscle.max_isometric_force, 1e-9) for muscle in model.muscles]
        )
        scene = view.scene
        self._size = min(scene.size, TALL * (scene.high - scene.low))
        gravity = float(np.linalg.norm(model.gravity)) or 9.81
        self._weight = max(gravity * model.mass, 1e-9)
        self._show_body(
            view, bone_solids(scene, self._size) if view.meshed else view.limbs(THIN), 0.9
        )
        rest = np.array([coordinate.default for coordinate in model.coordinates])
        unknown = np.full(len(model.muscles), np.nan)
        self._muscles = add_batch(
            self._page, "/around/muscles", tube(), self._strings(rest, unknown, unknown)
        )
        none = np.full((wrenches, 2, 3), np.nan)
        self._arrows = (
            add_arrows(self._page, "/around/", none, self._size, COLORS["measured"])
            if wrenches
            else []
        )
        self._text = self._server.gui.add_markdown("")
        self._rows = Rows(model)

    def show(self, shown: Shown) -> None:
        """Draw one frame."""
        with self._server.atomic():
            if np.isfinite(shown.coordinates).all():
                self._pose(shown.coordinates)
                move_batch(
                    self._muscles, self._strings(shown.coordinates, shown.activations, shown.forces)
                )
                if self._arrows:
                    ends = force_ends(
                        shown.wrenches, self._view.scene.up, self._weight, WEIGHT * self._size
                    )
                    for handle, tubes_of in zip(
                        self._arrows, arrows(ends, self._size, np.zeros(3)), strict=True
                    ):
                        move_batch(handle, tubes_of, colors=False)
            if len(shown.markers):
                self._show_markers(shown.markers, COLORS["recorded"])
            self._text.content = live_text(
                self._model, shown, self._rows.of(shown, clock.monotonic())
            )

    def _strings(self, coordinates: Array, activations: Array, forces: Array) -> Tubes:
        """Muscles as tubes: activation as color, tension as cross-section."""
        drawn = drawn_paths(self._paths, np.ascontiguousarray(coordinates)[None])
        share = np.sqrt(
            np.clip(np.nan_to_num(np.abs(forces)) / self._strength.max(initial=1e-9), 0.0, 1.0)
        )
        colors = activation_color(activations) ** DEEPER
        return tubes(drawn.places[0], drawn.muscle, self._size * (SLACK + TIGHT * share), colors)


def force_ends(wrenches: Array, up: Array, weight: float, length: float) -> Array:
    """Find the arrows of forces, from the floor.

    Parameters
    ----------
    wrenches : (bodies, 6) moment about the ground's origin [N m] and force [N]
    up : (3,) unit vector against gravity
    weight : of the body [N]
    length : of the arrow of the force `weight` [m]

    Returns
    -------
    (bodies, 2, 3) start and end [m], NaN for small forces
    """
    moments = wrenches[:, :3]
    forces = wrenches[:, 3:]
    lift = forces @ up
    acts = np.isfinite(lift) & (np.abs(lift) > MIN_FORCE * weight)
    start = np.cross(up, moments) / np.where(acts, lift, 1.0)[:, None]
    ends = np.stack([start, start + length / weight * forces], axis=1)
    return np.where(acts[:, None, None], ends, np.nan)


class Rows:
    """Muscles and coordinates that a table shows.

    They are those that were strongest of late, kept for a while.
    """

    def __init__(self, model: Model):
        self._turning = np.array(
            [coordinate.motion == "rotational" for coordinate in model.coordinates], np.bool_
        )
        self._forces = np.zeros(len(model.muscles))
        self._torques = np.zeros(len(model.coordinates))
        self._sorted = -np.inf
        self._chosen: tuple[list[int], list[int]] = ([], [])

    def of(self, shown: Shown, now: float) -> tuple[list[int], list[int]]:
        """Choose the indices of muscles, and of coordinates, at a time [s]."""
        if not shown.state:
            np.maximum(FADE * self._forces, np.nan_to_num(shown.forces), out=self._forces)
            np.maximum(
                FADE * self._torques,
                np.abs(np.nan_to_num(shown.torques)) * self._turning,
                out=self._torques,
            )
        if not shown.state and now - self._sorted > STAY:
            self._sorted = now
            strongest = np.argsort(-self._forces)[:STRONGEST]
            turned = np.argsort(-self._torques)[:TURNED]
            self._chosen = sorted(strongest.tolist()), sorted(turned.tolist())
        return self._chosen


def live_text(model: Model, shown: Shown, rows: tuple[Sequence[int], Sequence[int]]) -> str:
    """Facts, and some muscles and coordinates by their indices, as Markdown."""
    lines = [f"{name} {value}  " for name, value in shown.facts.items()]
    if shown.state:
        lines += ["", f"**Torques unknown: {shown.state}**"]
    muscles, coordinates = rows
    names = model.muscle_names
    pulls = {}
    turns = {}
    for m in muscles:
        active = _number(shown.activations[m], ".2f")
        force = _number(shown.forces[m], ".0f", " N")
        pulls[m] = f"{escaped(names[m])} | {active} | {force}"
    names = model.coordinate_names
    for j in coordinates:
        angle = _number(np.rad2deg(shown.coordinates[j]), ".0f", "°")
        torque = _number(shown.torques[j], ".0f", " N·m")
        turns[j] = f"{escaped(names[j])} | {angle} | {torque}"
    lines += _table("Muscle | activation | tension", pulls, shown.force_limits)
    lines += _table("Coordinate | angle | torque", turns, shown.torque_limits)
    return "\n".join(lines)


def _table(head: str, rows: Mapping[int, str], limits: Array | None) -> list[str]:
    """Rows by the columns of their limits, which stand behind them where they are known."""
    if limits is None:
        return ["", f"| {head} |", "|---|--:|--:|", *(f"| {cells} |" for cells in rows.values())]
    known = {at: " to ".join(_number(limits[end, at], ".0f") for end in (0, 1)) for at in rows}
    lines = (f"| {cells} | {known[at]} |" for at, cells in rows.items())
    return ["", f"| {head} | 90 % limits |", "|---|--:|--:|--:|", *lines]


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if np.isfinite(value) else "—"
