"""Bodies in the space of a page: what is made once, and what moves from frame to frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.lab.report.scene.scene import Scene, Solid
from myomorph.lab.report.scene.shapes import coarser, cone, reduced, sphere, tube
from myomorph.lab.viewer.replay_body import Instant, PlayedBody, Tubes, arrows
from myomorph.lab.viewer.web_page import BONE, Links, quaternions

LAYERS: Mapping[str, str] = {
    "bones": "Bones",
    "muscles": "Muscles",
    "axes": "Joint axes",
    "measured": "Plate forces",
    "estimated": "Contact forces",
    "recorded": "Markers",
    "modelled": "Model markers",
    "center": "Center of mass",
    "floor": "Floor",
}
"""What can be shown or hidden, and how it is called."""

COLORS: Mapping[str, tuple[int, int, int]] = {
    "measured": (26, 148, 117),
    "estimated": (233, 138, 21),
    "recorded": (38, 92, 214),
    "modelled": (230, 72, 150),
    "center": (30, 30, 34),
}
"""Of layers that have one; markers as in OpenSim, blue as measured and pink as modelled."""

# Of the first body, the second, ...
BONES = (BONE, (176, 196, 212), (196, 206, 176), (208, 186, 202))

MAX_JOINTS = 2
AXIS_LENGTH = 0.1
AXIS_RADIUS = 0.003
"""Models with more joints that move have no axes drawn; sizes as shares of the body's size."""
MARKER_RADIUS = 0.0052
CENTER_RADIUS = 0.014
TRACE_STEPS = 500
DETAIL = 0.003  # Smallest detail of bones that is kept, as a share of the body's size.
MAX_TRIANGLES = 60_000
SIMPLE = 300  # Triangles of all bones at most, and of shapes that keep all their edges.


class ShownBody:
    """One body on a page, below the node `root`; its number gives its color."""

    def __init__(self, page: Any, root: str, body: PlayedBody, number: int = 0):
        self.body = body
        self._page = page
        self._root = root
        self.node = page.add_frame(root, show_axes=False)
        first = body.at(int(np.flatnonzero(body.known)[0]))
        self._links = Links(
            page=page,
            root=root,
            solids=bone_solids(body.scene, body.size),
            colors=self._bone_colors(number),
        )
        self._layers: dict[str, list[Any]] = {name: [] for name in LAYERS}
        self._layers["bones"] = list(self._links.handles.values())
        self._layers |= self._added(first)
        self._joints = _moving_joints(body.model)
        self._layers["axes"] = [
            page.add_frame(
                f"{root}/axes{i}",
                axes_length=AXIS_LENGTH * body.size,
                axes_radius=AXIS_RADIUS * body.size,
            )
            for i in range(len(self._joints))
        ]
        self._add_plates()
        self._visible = dict.fromkeys(LAYERS, True)
        self._labels: list[Any] = []

    def _added(self, first: Instant) -> dict[str, list[Any]]:
        """Add muscles, forces, markers and centers of mass, as far as the body has any."""
        size = self.body.size
        layers: dict[str, list[Any]] = {}
        if len(first.tubes.positions):
            layers["muscles"] = [
                add_batch(self._page, f"{self._root}/muscles", tube(), first.tubes)
            ]
        for name in (layer for layer in ("measured", "estimated") if len(getattr(first, layer))):
            layers[name] = add_arrows(
                self._page, f"{self._root}/{name}_", getattr(first, name), size, COLORS[name]
            )
        for name in (layer for layer in ("recorded", "modelled") if len(getattr(first, layer))):
            layers[name] = [self._add_balls(name, len(getattr(first, name)), MARKER_RADIUS * size)]
        if np.isfinite(self.body.centers).any():
            balls = self._add_balls("center", len(first.centers), CENTER_RADIUS * size)
            traces = [self._add_trace(index) for index in range(len(first.centers))]
            layers["center"] = [balls, *(line for lines in traces for line in lines)]
        return layers

    @property
    def layers(self) -> tuple[str, ...]:
        """Those that this body has."""
        return tuple(name for name in LAYERS if self._layers[name] or name == "floor")

    def toggle(self, layer: str, visible: bool) -> None:
        """Show a layer, or hide it."""
        self._visible[layer] = visible
        for handle in self._layers[layer]:
            handle.visible = visible

    def draw(self, instant: Instant) -> None:
        """Move everything to where it is at an instant; what is hidden stays as it was."""
        if self._visible["bones"]:
            self._links.pose(instant.rotations, instant.origins)
        for handle, (body, frame) in zip(self._layers["axes"], self._joints, strict=True):
            handle.position = instant.origins[body] + instant.rotations[body] @ frame.translation
            handle.wxyz = quaternions((instant.rotations[body] @ frame.rotation)[None])[0]
        if self._visible["muscles"] and self._layers["muscles"]:
            move_batch(self._layers["muscles"][0], instant.tubes)
        for name, ends in (("measured", instant.measured), ("estimated", instant.estimated)):
            if self._visible[name] and self._layers[name]:
                parts = arrows(ends, self.body.size, np.zeros(3))
                for handle, part in zip(self._layers[name], parts, strict=True):
                    move_batch(handle, part, colors=False)
        for name, places in (("recorded", instant.recorded), ("modelled", instant.modelled)):
            if self._visible[name] and self._layers[name]:
                self._place(self._layers[name][0], places)
        if self._visible["center"] and self._layers["center"]:
            self._place(self._layers["center"][0], instant.centers)

    def label(self, texts: Mapping[int, str], frame: int) -> None:
        """Name muscles at their middles, by their indices; nothing takes the names away."""
        while len(self._labels) > len(texts):
            self._labels.pop().remove()
        for index, (muscle, text) in enumerate(texts.items()):
            place = self.body.middle_of(frame, muscle)
            if index == len(self._labels):
                name = f"{self._root}/label{index}"
                self._labels.append(
                    self._page.add_label(name, text, position=place, anchor="bottom-left")
                )
            self._labels[index].text = text
            self._labels[index].position = place

    def on_muscle(self, clicked: Any) -> None:
        """Call `clicked(index of the muscle)` where a muscle is clicked."""
        if self._layers["muscles"]:
            owner = self.body.tube_muscles
            self._layers["muscles"][0].on_click(
                lambda event: clicked(int(owner[event.instance_index]))
            )

    def _add_balls(self, name: str, count: int, radius: float) -> Any:
        none = np.zeros((count, 3), dtype=np.float32)
        turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (count, 1))
        colors = np.tile(np.array(COLORS[name], dtype=np.uint8), (count, 1))
        return add_batch(
            self._page,
            f"{self._root}/{name}",
            sphere(radius),
            Tubes(positions=none, wxyzs=turns, scales=none, colors=colors),
        )

    @staticmethod
    def _place(handle: Any, places: Array) -> None:
        seen = np.asarray(np.isfinite(places).all(axis=1))
        handle.batched_positions = np.where(seen[:, None], places, 0.0).astype(np.float32)
        handle.batched_scales = np.repeat(seen[:, None], 3, axis=1).astype(np.float32)

    def _bone_colors(self, number: int) -> dict[int, tuple[int, int, int]]:
        """Choose a color for every subject, by the numbers of its bodies.

        The colors of `number` subjects come before.
        """
        names = self.body.model.body_names
        return {
            names.index(name) + 1: BONES[(number + index) % len(BONES)]
            for index, subject in enumerate(self.body.subjects)
            for name in subject.bodies
        }

    def _add_trace(self, subject: int) -> list[Any]:
        """Show the path of a center of mass in space, and its shadow on the floor."""
        scene = self.body.scene
        centers = self.body.centers[:, subject]
        path = centers[:: max(len(centers) // TRACE_STEPS, 1)]
        path = path[np.isfinite(path).all(axis=1)]
        if len(path) < 2:
            return []
        shadow = path + (scene.floor + 0.002 - path @ scene.up)[:, None] * scene.up
        return [
            self._lines(
                f"trace{subject}", np.stack([path[:-1], path[1:]], axis=1), COLORS["center"], 2.0
            ),
            self._lines(
                f"shadow{subject}",
                np.stack([shadow[:-1], shadow[1:]], axis=1),
                (120, 120, 126),
                1.5,
            ),
        ]

    def _add_plates(self) -> None:
        corners = [
            plate.corners[outline(plate.corners)] for plate in self.body.results.recorded.plates
        ]
        if not corners:
            return
        lift = 0.001 * self.body.scene.up
        edges = (
            np.concatenate(
                [np.stack([corner, np.roll(corner, -1, axis=0)], axis=1) for corner in corners]
            )
            + lift
        )
        self._layers["floor"].append(self._lines("plates", edges, (70, 78, 84), 2.5))
        faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
        sheet = self._page.add_mesh_simple(
            f"{self._root}/sheets",
            (np.concatenate(corners) + lift).astype(np.float32),
            np.concatenate([faces + 4 * index for index in range(len(corners))]),
            color=(150, 164, 172),
            opacity=0.45,
            side="double",
            cast_shadow=False,
        )
        self._layers["floor"].append(sheet)

    def _lines(self, name: str, points: Array, color: tuple[int, int, int], width: float) -> Any:
        return self._page.add_line_segments(
            f"{self._root}/{name}",
            points.astype(np.float32),
            np.array(color, dtype=np.uint8),
            thickness=width,
            thickness_units="screen",
        )


def _moving_joints(model: Model) -> list[tuple[int, Transform]]:
    """Find bodies beyond joints that move against another body, and the joints' frames in them.

    There are none where many do.
    """
    free = {coordinate.name for coordinate in model.coordinates if not coordinate.locked}
    joints = [
        joint for joint in model.joints if joint.parent != GROUND and free & {*joint.coordinates}
    ]
    frames = [(model.body_names.index(joint.child) + 1, joint.child_frame) for joint in joints]
    return frames if len(frames) <= MAX_JOINTS else []


def bone_solids(scene: Scene, size: float) -> tuple[Solid, ...]:
    """Make the solids of a body of a size [m], with no more triangles than a page can draw."""
    shapes = [
        solid.surface
        if len(solid.surface.faces) < SIMPLE
        else coarser(solid.surface, DETAIL * size)
        for solid in scene.solids
    ]
    shapes = reduced(shapes, size, MAX_TRIANGLES)
    return tuple(
        Solid(solid.body, shape) for solid, shape in zip(scene.solids, shapes, strict=True)
    )


def add_batch(page: Any, name: str, shape: Surface, shown: Tubes) -> Any:
    """Add copies of one surface, each with its own position, rotation, scale and color."""
    return page.add_batched_meshes_simple(
        name,
        shape.vertices.astype(np.float32),
        shape.faces.astype(np.uint32),
        batched_wxyzs=shown.wxyzs,
        batched_positions=shown.positions,
        batched_scales=shown.scales,
        batched_colors=shown.colors,
        lod="off",
        cast_shadow=False,
        receive_shadow=False,
    )


def move_batch(handle: Any, shown: Tubes, colors: bool = True) -> None:
    """Put copies elsewhere, and give them other colors where `colors`."""
    handle.batched_positions = shown.positions
    handle.batched_wxyzs = shown.wxyzs
    handle.batched_scales = shown.scales
    if colors:
        handle.batched_colors = shown.colors


def add_arrows(
    page: Any, name: str, ends: Array, size: float, color: tuple[int, int, int]
) -> list[Any]:
    """Add shafts and heads of arrows to a page.

    Parameters
    ----------
    page : of `viser`
    name : that the names of the parts begin with
    ends : (arrows, 2, 3) start and end of each [m]
    size : of the body beside them [m]
    color : red, green, blue from 0 to 255

    Returns
    -------
    The page's handles of shafts and heads
    """
    shafts, heads = arrows(ends, size, np.array(color) / 255.0)
    return [
        add_batch(page, f"{name}shafts", tube(), shafts),
        add_batch(page, f"{name}heads", cone(), heads),
    ]


def outline(corners: Array) -> list[int]:
    """Order the corners of a plate along its outline, whatever order they come in.

    Parameters
    ----------
    corners : (corners, 3) [m]

    Returns
    -------
    Indices of corners
    """
    middle = corners.mean(axis=0)
    x = corners[0] - middle
    y = np.cross(np.cross(x, corners[1] - middle), x)
    across = [axis / max(float(np.linalg.norm(axis)), 1e-12) for axis in (x, y)]
    angles = np.arctan2((corners - middle) @ across[1], (corners - middle) @ across[0])
    return [int(index) for index in np.argsort(angles)]
