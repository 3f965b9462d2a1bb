"""A body in a web page while the chain follows it: bones, muscles by activation, forces, markers, and numbers."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.muscles.path import compile_paths
from myomorph.muscles.path_shape import drawn_paths
from myomorph.report.scene.body_view import BodyView
from myomorph.report.scene.image import activation_color
from myomorph.report.scene.scene import Solid
from myomorph.report.scene.shapes import coarser, cone, reduced, tube
from myomorph.viewer.replay_body import LEAST_FORCE, SLACK, TALL, TIGHT, WEIGHT, Tubes, arrows, tubes
from myomorph.viewer.replay_scene import COLORS
from myomorph.viewer.web_page import DEEPER, Links, add_floor, add_lights, open_server, quiet, view_from

DETAIL, SIMPLE, MOST_TRIANGLES = 0.003, 300, 60_000
"""Smallest detail of bones, as a share of the body's size; triangles of shapes that keep all, and of all bones."""

STRONGEST, TURNED = 8, 8
"""Muscles and torques that the table holds."""

STAY, FADE = 2.0, 0.98
"""How long the rows of the table stay where they are [s], and what is left of a largest value a frame later."""

THIN = 0.4
"""Thickness of limbs without meshes, so that muscles are seen beside them."""


@dataclass(frozen=True, eq=False)
class Shown:
    """What the page is told of one frame.

    Attributes
    ----------
    coordinates : (coordinates,) as the markers show them, NaN where unknown
    activations, forces : (muscles,) NaN where unknown
    torques : (coordinates,) NaN where unknown
    wrenches : (bodies, 6) external moment about the ground's origin and force
    markers : (markers, 3) NaN where hidden, or with 0 rows
    state : why torques are unknown, "" where they are known
    facts : lines of text, by what they tell
    """

    coordinates: Array
    activations: Array
    forces: Array
    torques: Array
    wrenches: Array
    markers: Array
    state: str
    facts: Mapping[str, str]


class ChainViewer:
    """A page on this machine.

    Parameters
    ----------
    surfaces : meshes by `Mesh.file`; without any, limbs are rounds
    port : of the page, http://localhost:PORT
    wrenches : external forces that may come

    Raises
    ------
    MyomorphError : `viser` is not installed
    BadData : the port is taken, or none
    """

    def __init__(self, model: Model, surfaces: Mapping[str, Surface] | None, port: int, wrenches: int):
        self._model, self._view = model, BodyView(model, surfaces)
        self._paths = compile_paths(model)
        self._strength = np.array([max(one.max_isometric_force, 1e-9) for one in model.muscles])
        scene = self._view.scene
        self._size = min(scene.size, TALL * (scene.high - scene.low))
        gravity = float(np.linalg.norm(model.gravity)) or 9.81
        self._weight = max(gravity * model.mass, 1e-9)
        self._server = open_server(port, "Myomorph live")
        self.port = int(self._server.get_port())
        self._page = page = self._server.scene
        page.set_up_direction(tuple(float(one) for one in scene.up))
        add_lights(page, scene)
        # All that is seen hangs on one frame, which moves back as the subject moves on.
        self._around = page.add_frame("/around", show_axes=False)
        self._start = np.array(scene.origins[0, 1])
        self._links = Links(page, "/around", self._solids(bool(surfaces)))
        add_floor(page, "/around/ground", scene.up, scene.floor)
        middle = scene.origins[0, 1] + (0.5 * (scene.low + scene.high) - scene.origins[0, 1] @ scene.up) * scene.up
        camera = self._server.initial_camera
        camera.position = tuple(view_from(scene, middle, scene.forward + 0.9 * scene.right + 0.15 * scene.up))
        camera.look_at = tuple(middle)
        rest = np.array([one.default for one in model.coordinates])
        unknown = np.full(len(model.muscles), np.nan)
        self._muscles = self._batch("muscles", tube(), self._strings(rest, unknown, unknown))
        none = np.full((wrenches, 2, 3), np.nan)
        shafts, heads = arrows(none, self._size, np.array(COLORS["measured"]) / 255.0)
        self._arrows = [self._batch("shafts", tube(), shafts), self._batch("heads", cone(), heads)] if wrenches else []
        self._text = self._server.gui.add_markdown("")
        self._rows = Rows(model)

    def show(self, shown: Shown) -> None:
        """Draw one frame."""
        known = bool(np.isfinite(shown.coordinates).all())
        with self._server.atomic():
            if known:
                rotations, origins = self._view.poses(shown.coordinates)
                up, moved = self._view.scene.up, origins[1] - self._start
                self._around.position = -(moved - (moved @ up) * up)
                self._links.pose(rotations, origins)
                _move(self._muscles, self._strings(shown.coordinates, shown.activations, shown.forces))
                self._draw_forces(shown.wrenches)
            if len(shown.markers):
                seen = shown.markers[np.isfinite(shown.markers).all(axis=1)]
                self._page.add_point_cloud(
                    "/around/markers", seen.astype(np.float32), COLORS["recorded"], point_size=0.012,
                    point_shape="circle", precision="float32",
                )  # fmt: skip
            self._text.content = live_text(self._model, shown, self._rows.of(shown, clock.monotonic()))

    def close(self) -> None:
        """Take the page down."""
        with quiet():
            self._server.stop()

    def _solids(self, surfaces: bool) -> tuple[Solid, ...]:
        scene = self._view.scene
        if not (surfaces or any(mesh.shape != "mesh" for body in self._model.bodies for mesh in body.meshes)):
            return self._view.limbs(THIN)
        shapes = [
            one.surface if len(one.surface.faces) < SIMPLE else coarser(one.surface, DETAIL * self._size)
            for one in scene.solids
        ]
        shapes = reduced(shapes, self._size, MOST_TRIANGLES)
        return tuple(Solid(one.body, shape) for one, shape in zip(scene.solids, shapes, strict=True))

    def _strings(self, coordinates: Array, activations: Array, forces: Array) -> Tubes:
        """Muscles as tubes: activation as color, tension as cross-section."""
        drawn = drawn_paths(self._paths, np.ascontiguousarray(coordinates)[None])
        share = np.sqrt(np.clip(np.nan_to_num(np.abs(forces)) / self._strength.max(initial=1e-9), 0.0, 1.0))
        colors = activation_color(activations) ** DEEPER
        return tubes(drawn.places[0], drawn.muscle, self._size * (SLACK + TIGHT * share), colors)

    def _draw_forces(self, wrenches: Array) -> None:
        if not self._arrows:
            return
        ends = force_ends(wrenches, self._view.scene.up, self._weight, WEIGHT * self._size)
        for handle, part in zip(self._arrows, arrows(ends, self._size, np.zeros(3)), strict=True):
            handle.batched_positions, handle.batched_wxyzs = part.positions, part.wxyzs
            handle.batched_scales = part.scales

    def _batch(self, name: str, shape: Surface, shown: Tubes) -> Any:
        return self._page.add_batched_meshes_simple(
            f"/around/{name}", shape.vertices.astype(np.float32), shape.faces.astype(np.uint32),
            batched_wxyzs=shown.wxyzs, batched_positions=shown.positions, batched_scales=shown.scales,
            batched_colors=shown.colors, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip


def _move(handle: Any, shown: Tubes) -> None:
    for name, values in (
        ("positions", shown.positions), ("wxyzs", shown.wxyzs), ("scales", shown.scales), ("colors", shown.colors)
    ):  # fmt: skip
        setattr(handle, f"batched_{name}", values)


def force_ends(wrenches: Array, up: Array, weight: float, length: float) -> Array:
    """(bodies, 2, 3) start and end of the arrows of forces, from where they meet the floor; NaN for small ones.

    Parameters
    ----------
    wrenches : (bodies, 6) moment about the ground's origin and force
    weight, length : of the subject [N], and of an arrow of that force [m]
    """
    moments, forces = wrenches[:, :3], wrenches[:, 3:]
    lift = forces @ up
    acts = np.isfinite(lift) & (np.abs(lift) > LEAST_FORCE * weight)
    start = np.cross(up, moments) / np.where(acts, lift, 1.0)[:, None]
    ends = np.stack([start, start + length / weight * forces], axis=1)
    found: Array = np.where(acts[:, None, None], ends, np.nan)
    return found


class Rows:
    """Muscles and coordinates that a table tells of: those that were strongest of late, kept for a while."""

    def __init__(self, model: Model):
        self._turning = np.array([one.motion == "rotational" for one in model.coordinates], np.bool_)
        self._forces, self._torques = np.zeros(len(model.muscles)), np.zeros(len(model.coordinates))
        self._sorted = -np.inf
        self._chosen: tuple[list[int], list[int]] = ([], [])

    def of(self, shown: Shown, now: float) -> tuple[list[int], list[int]]:
        """Indices of muscles, and of coordinates, at a time [s]."""
        if not shown.state:
            np.maximum(FADE * self._forces, np.nan_to_num(shown.forces), out=self._forces)
            np.maximum(FADE * self._torques, np.abs(np.nan_to_num(shown.torques)) * self._turning, out=self._torques)
        if not shown.state and now - self._sorted > STAY:
            self._sorted = now
            strongest, turned = np.argsort(-self._forces)[:STRONGEST], np.argsort(-self._torques)[:TURNED]
            self._chosen = sorted(strongest.tolist()), sorted(turned.tolist())
        return self._chosen


def live_text(model: Model, shown: Shown, rows: tuple[Sequence[int], Sequence[int]]) -> str:
    """Facts, and some muscles and coordinates by their indices, as Markdown."""
    lines = [f"{name} {value}  " for name, value in shown.facts.items()]
    if shown.state:
        lines += ["", f"**Torques unknown: {shown.state}**"]
    muscles, coordinates = rows
    lines += ["", "| Muscle | activation | tension |", "|---|--:|--:|"]
    names = model.muscle_names
    lines += [
        f"| {names[m]} | {_told(shown.activations[m], '.2f')} | {_told(shown.forces[m], '.0f', ' N')} |"
        for m in muscles
    ]
    lines += ["", "| Coordinate | angle | torque |", "|---|--:|--:|"]
    names = model.coordinate_names
    lines += [
        f"| {names[j]} | {_told(np.rad2deg(shown.coordinates[j]), '.0f', '°')} | "
        f"{_told(shown.torques[j], '.0f', ' N·m')} |"
        for j in coordinates
    ]
    return "\n".join(lines)


def _told(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if np.isfinite(value) else "—"
