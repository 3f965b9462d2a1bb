"""The base of every page that plays: a server on this machine, and bodies in their pose.

The page has lights, a floor and a camera.
"""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from io import StringIO
from typing import Any

import numpy as np
from rich.text import Text
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.surface import Surface, joined_surfaces
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.report.scene.image import Bytes, level_color
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.scene import Scene, Solid, make_scene
from myomorph.lab.report.scene.shapes import bones, capsule, outward
from myomorph.lab.viewer.page_guard import PageGuard

SHRINK = 4  # Pixels rendered for one shown, along each axis.
MIN_LENGTH = 1e-3  # Pieces that are shorter are not drawn [m].
TURN = np.deg2rad(35.0)  # Of the camera from the front towards the right side [rad].
THICK = 0.16
MIN_RADIUS = 0.014
MAX_RADIUS = 0.055
"""Radius of a limb in a small picture: a share of its length, and bounds as shares of the body's
height.
"""


class BodyView:
    """Pictures of one model, surfaces prepared once.

    `meshed` are bodies that have surfaces of their own, not rounds.
    """

    def __init__(self, model: Model, surfaces: Mapping[str, Surface] | None = None):
        self.model = model
        self._tree = compile_tree(model)
        self.meshed = bool(surfaces) or any(
            mesh.shape != "mesh" for body in model.bodies for mesh in body.meshes
        )
        self.scene: Scene = make_scene(replace(model, muscles=()), DEFAULT_POSE, [0], surfaces)
        self._limbs = _limbs(model, self._tree.body_index)
        lengths = np.array([np.linalg.norm(end - start) for _, start, end in self._limbs])
        tall = self.scene.high - self.scene.low
        self._radii = np.repeat(
            np.clip(THICK * lengths, MIN_RADIUS * tall, MAX_RADIUS * tall)[:, None], 2, axis=1
        )
        ahead = np.cos(TURN) * self.scene.forward + np.sin(TURN) * self.scene.right
        # The viewer stands ahead: the subject's right is on the picture's left.
        self._axes = np.stack([np.cross(self.scene.up, ahead), self.scene.up, ahead])

    def limbs(self, share: float = 1.0) -> tuple[Solid, ...]:
        """Make the limbs as surfaces, for bodies that have no mesh, a share as thick."""
        return tuple(
            Solid(body, capsule(start, end, share * float(radius)))
            for (body, start, end), radius in zip(self._limbs, self._radii[:, 0], strict=True)
        )

    def poses(self, coordinates: Array) -> tuple[Array, Array]:
        """Compute where the bodies are in a pose, the ground first.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]

        Returns
        -------
        (bodies + 1, 3, 3) rotations, and (bodies + 1, 3) origins in ground [m]
        """
        poses = forward_kinematics(
            self._tree, np.ascontiguousarray(coordinates, dtype=np.float64)[None]
        )
        return poses.rotations[0], poses.origins[0]

    def pixels(self, coordinates: Array, levels: Array, width: int, height: int) -> Bytes:
        """Draw the body in a pose, each link in the color of its level.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]
        levels : (bodies,) from 0 to 1
        width, height : of the picture [px]

        Returns
        -------
        (height, width, 4) red, green, blue, opacity
        """
        rotations, origins = self.poses(coordinates)
        colors = np.vstack([[0.72, 0.72, 0.72], level_color(np.asarray(levels, dtype=np.float64))])
        scene = self.scene
        middle = (
            origins[1]
            + (0.5 * (scene.low + scene.high) - scene.origins[0, 1] @ scene.up) * scene.up
        )
        scale = SHRINK * height / (1.12 * max(scene.high - scene.low, 1e-6))
        canvas = Canvas(
            View(
                axes=self._axes,
                center=middle,
                scale=scale,
                width=SHRINK * width,
                height=SHRINK * height,
            )
        )
        bodies = [body for body, _, _ in self._limbs]
        ends = np.array([(start, end) for _, start, end in self._limbs]).reshape(-1, 2, 3)
        placed = np.einsum("bij,bkj->bki", rotations[bodies], ends) + origins[bodies][:, None]
        canvas.tubes(placed[:, 0], placed[:, 1], self._radii, colors[bodies])
        return canvas.picture(SHRINK)


def _limbs(model: Model, numbers: Mapping[str, int]) -> list[tuple[int, Array, Array]]:
    """Find the pieces that a body is drawn from in few pixels: number of the body, and both ends.

    Ends are in the body's frame. Pieces go from a body's joint to the joints that it carries, and
    through its mass center and on: of a trunk without a head of its own, that is the head.
    """
    result = []
    for body, (start, joints) in zip(model.bodies, bones(model).values(), strict=True):
        ends = list(joints)
        if not ends or body.mass > 0.02 * model.mass:
            ends.append(start + 1.9 * (body.mass_center - start))
        result += [
            (numbers[body.name], start, end)
            for end in ends
            if np.linalg.norm(end - start) > MIN_LENGTH
        ]
    return result


def half_blocks(pixels: Bytes) -> Text:
    """Write pixels as characters, two above each other in one: for terminals that show colors.

    Parameters
    ----------
    pixels : (height, width, 4) red, green, blue, opacity

    Returns
    -------
    The text, a line for every two rows
    """
    text = Text(no_wrap=True)
    if len(pixels) % 2:
        pixels = np.concatenate([pixels, np.zeros_like(pixels[:1])])
    for upper, lower in zip(pixels[::2], pixels[1::2], strict=True):
        for above, below in zip(upper, lower, strict=True):
            top = above[3] > 110
            bottom = below[3] > 110
            foreground = f"#{int(above[0]):02x}{int(above[1]):02x}{int(above[2]):02x}"
            other = f"#{int(below[0]):02x}{int(below[1]):02x}{int(below[2]):02x}"
            if top and bottom:
                text.append("▀", f"{foreground} on {other}")
            elif top:
                text.append("▀", foreground)
            elif bottom:
                text.append("▄", other)
            else:
                text.append(" ")
        text.append("\n")
    text.rstrip()
    return text


HOST = "127.0.0.1"  # Pages are for this machine only.
BONE = (214, 207, 193)  # Color of links without a value.
DEEPER = 1.35  # Exponent on colors, which the page's lights make paler.
MARKER = (70, 70, 70)  # Color of recorded markers.


class Page:
    """A page on this machine on which bodies move.

    All that is seen hangs on one frame, which moves back as the first body moves on where the view
    follows it. `port` is any free one by default.
    """

    def __init__(self, port: int | None, title: str):
        self._server = open_server(port, title)
        self._page = self._server.scene
        self.port = int(self._server.get_port())
        self.address = str(self._server.myomorph_guard.address(self.port))

    def close(self) -> None:
        """Take the page down."""
        with quiet():
            self._server.stop()

    def _lay_floor(self, scene: Scene, root: Array) -> None:
        """Empty the page, and give it lights, the floor of a scene, and the frame of bodies.

        That frame starts at `root` (3,) [m].
        """
        page = self._page
        page.reset()
        self._server.gui.reset()
        page.set_up_direction(tuple(float(component) for component in scene.up))
        add_lights(page, scene)
        self.around = page.add_frame("/around", show_axes=False)
        self.floor = add_floor(page, "/around/ground", scene.up, scene.floor)
        self._up = scene.up
        self._start = np.array(root)

    def _show_body(self, view: BodyView, solids: Sequence[Solid], right: float) -> None:
        """Lay the floor of one body, show its links, and aim the browsers' cameras.

        They look at it from ahead and so far to its right.
        """
        self._view = view
        scene = view.scene
        root = scene.origins[0, 1]
        self._lay_floor(scene, root)
        self._links = Links(self._page, "/around", solids)
        middle = root + (0.5 * (scene.low + scene.high) - root @ scene.up) * scene.up
        camera = self._server.initial_camera
        camera.position = tuple(
            view_from(scene, middle, scene.forward + right * scene.right + 0.15 * scene.up)
        )
        camera.look_at = tuple(middle)

    def _pose(self, coordinates: Array) -> None:
        """Put that body in a pose (coordinates,), carried back to the middle of the floor."""
        rotations, origins = self._view.poses(coordinates)
        self._carry_back(origins[1])
        self._links.pose(rotations, origins)

    def _carry_back(self, root: Array) -> None:
        """Move all that is seen back as the first body moves on.

        It moves by the way over the floor from where the body began to `root` [m].
        """
        moved = root - self._start
        self.around.position = -(moved - (moved @ self._up) * self._up)

    def _show_markers(self, markers: Array, color: tuple[int, int, int]) -> None:
        """Show markers (n, 3) in ground as points, NaN where hidden [m]."""
        seen = np.asarray(markers)[np.isfinite(markers).all(axis=1)]
        self._page.add_point_cloud(
            "/around/markers",
            seen.astype(np.float32),
            color,
            point_size=0.012,
            point_shape="circle",
            precision="float32",
        )


def open_server(port: int | None, title: str) -> Any:
    """Open a page on this machine by `viser`, on a given port or on any free one.

    It opens for whoever has the token of its guard, which it holds as `myomorph_guard`.
    """
    try:
        # Brings viser: loaded only where it is needed.
        import viser
    except ImportError as error:
        raise MyomorphError(
            f"the web page needs the package 'viser' ({error}): pip install 'myomorph[view]'"
        ) from None
    if port is not None:
        if not 0 < port < 65536:
            raise BadData(f"port {port}: expected 1 to 65535")
        # Viser would go on to the next port without a word.
        with socket.socket() as probe:
            if os.name == "posix":
                # A page that has just ended does not hold its port.
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError as error:
                raise BadData(
                    f"port {port} cannot be used ({error.strerror or error}): name another"
                ) from None
    guard = PageGuard()
    with quiet(), guard.over_servers():
        server = viser.ViserServer(host=HOST, port=port or 0, label=title, verbose=False)
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.myomorph_guard = guard
    return server


def escaped(text: str) -> str:
    """Write a text so that Markdown, and HTML in it, take none of its characters for their own.

    Parameters
    ----------
    text : such as the name of a muscle, which a stranger's model may have chosen
    """
    # An underscore within a word is none of Markdown's.
    special = r"([\\`*{}\[\]()#+!|~$]|(?<!\w)_|_(?!\w))"
    text = re.sub(special, r"\\\1", " ".join(text.split()))
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


@contextmanager
def quiet() -> Iterator[None]:
    """Viser greets and takes leave on the terminal; here it does not."""
    with redirect_stdout(StringIO()):
        yield


def add_floor(page: Any, name: str, up: Array, height: float) -> Any:
    """Add a grid of half metres on the floor to a page.

    Parameters
    ----------
    page : of `viser`
    name : of the grid
    up : (3,) unit vector against gravity
    height : of the floor along `up` [m]

    Returns
    -------
    The page's handle of the grid
    """
    axis = int(np.argmax(np.abs(up)))
    return page.add_grid(
        name,
        width=30.0,
        height=30.0,
        plane=("yz", "xz", "xy")[axis],
        cell_size=0.5,
        cell_color=(225, 225, 222),
        section_color=(190, 192, 190),
        position=tuple(float(component) for component in height * up),
    )


def add_lights(page: Any, scene: Scene) -> None:
    """Add even light from above, and a lamp from ahead and the right.

    Lights of viser's own bleach what is colored.
    """
    page.configure_default_lights(False)
    page.configure_environment_map(None)
    page.add_light_hemisphere(
        "/lights/sky",
        sky_color=(255, 255, 255),
        ground_color=(176, 170, 160),
        intensity=1.7,
        position=tuple(float(component) for component in scene.up),
    )
    for name, place, intensity in (
        ("key", 0.7 * scene.forward + 0.8 * scene.right + 1.2 * scene.up, 1.7),
        ("fill", -0.8 * scene.forward - 0.6 * scene.right + 0.6 * scene.up, 0.7),
    ):
        page.add_light_directional(
            f"/lights/{name}",
            intensity=intensity,
            position=tuple(float(component) for component in 5.0 * place),
        )


class Links:
    """The links of one body on a page, each one mesh, in the bodies' frames and colors."""

    def __init__(
        self,
        page: Any,
        root: str,
        solids: Sequence[Solid],
        colors: Mapping[int, tuple[int, int, int]] = FrozenMap({}),
    ):
        self.handles: dict[int, Any] = {}
        for body in sorted({solid.body for solid in solids}):
            surface = joined_surfaces(
                [outward(solid.surface) for solid in solids if solid.body == body]
            )
            self.handles[body] = page.add_mesh_simple(
                f"{root}/link{body}",
                np.asarray(surface.vertices, dtype=np.float32),
                np.asarray(surface.faces, dtype=np.uint32),
                color=colors.get(body, BONE),
                side="front",
                cast_shadow=False,
                receive_shadow=False,
            )

    def pose(self, rotations: Array, origins: Array) -> None:
        """Put the links where their bodies are.

        Parameters
        ----------
        rotations : (bodies + 1, 3, 3) to ground, the ground first
        origins : (bodies + 1, 3) in ground [m]
        """
        turned = quaternions(rotations)
        for body, handle in self.handles.items():
            handle.wxyz = turned[body]
            handle.position = origins[body]


def view_from(scene: Scene, middle: Array, direction: Array, distance: float = 1.05) -> Array:
    """Find where a camera sees the body from a direction.

    Parameters
    ----------
    scene : of the body
    middle : (3,) that the camera looks at [m]
    direction : (3,) from the middle to the camera, of any norm
    distance : in sizes of the body

    Returns
    -------
    (3,) in ground [m]
    """
    return middle + distance * scene.size * direction / np.linalg.norm(direction)


def quaternions(rotations: Array) -> Array:
    """Convert rotation matrices to quaternions.

    Parameters
    ----------
    rotations : (n, 3, 3)

    Returns
    -------
    (n, 4) as (w, x, y, z), w not negative
    """
    return Rotation.from_matrix(rotations).as_quat(canonical=True, scalar_first=True)
