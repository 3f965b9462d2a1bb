"""The body in a web page while something happens to it, by the viewer library `viser`."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.errors import BadData, MyomorphError
from myomorph.model.model import Model
from myomorph.model.spatial import Array
from myomorph.model.surface import Surface
from myomorph.report.body_view import BodyView
from myomorph.report.image import level_color

DEEPER = 1.35
"""Exponent on colors, which the page's lights make paler."""

MARKER = (70, 70, 70)
"""Color of marker points."""


class WebViewer:
    """A page on this machine that shows a body: links in colors, markers as points, a text and a progress bar.

    Parameters
    ----------
    surfaces : meshes by `Mesh.file`; without any, limbs are rounds
    port : of the page, http://localhost:PORT
    title : of the text panel

    Raises
    ------
    MyomorphError : `viser` is not installed
    BadData : the port is taken, or none
    """

    def __init__(
        self, model: Model, surfaces: Mapping[str, Surface] | None = None, port: int = 8080, title: str = "Myomorph"
    ):
        viser = _viser()
        if not 0 < port < 65536:
            raise BadData(f"port {port}: expected 1 to 65535")
        self._view = BodyView(model, surfaces)
        scene = self._view.scene
        try:
            with redirect_stdout(StringIO()):
                self._server = viser.ViserServer(host="127.0.0.1", port=port, label=title, verbose=False)
            self._server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        except OSError as error:
            raise BadData(
                f"port {port} cannot be used ({error.strerror or error}): choose another with --web"
            ) from None
        self.port = int(self._server.get_port())
        page = self._server.scene
        page.set_up_direction(tuple(float(one) for one in scene.up))
        # All that is seen hangs on one frame, which moves back as the subject moves on.
        self._around = page.add_frame("/around", show_axes=False)
        self._start = np.array(scene.origins[0, 1])
        bodies = sorted({one.body for one in scene.solids})
        self._frames = {body: page.add_frame(f"/around/{body}", show_axes=False) for body in bodies}
        self._meshes: list[tuple[int, Any]] = []
        meshed = bool(surfaces) or any(mesh.shape != "mesh" for body in model.bodies for mesh in body.meshes)
        for i, solid in enumerate(scene.solids if meshed else self._view.rounds):
            handle = page.add_mesh_simple(
                f"/around/{solid.body}/{i}",
                np.asarray(solid.surface.vertices, dtype=np.float32),
                np.asarray(solid.surface.faces, dtype=np.uint32),
                color=(200, 196, 188),
                side="double",
            )
            self._meshes.append((solid.body, handle))
        axis = int(np.argmax(np.abs(scene.up)))
        page.add_grid(
            "/around/ground",
            width=30.0,
            height=30.0,
            plane=("yz", "xz", "xy")[axis],
            cell_size=0.5,
            cell_color=(225, 225, 222),
            section_color=(190, 192, 190),
            position=tuple(float(one) for one in scene.floor * scene.up),
        )
        middle = scene.origins[0, 1] + (0.5 * (scene.low + scene.high) - scene.origins[0, 1] @ scene.up) * scene.up
        camera = self._server.initial_camera
        camera.position = tuple(middle + 1.05 * scene.size * _unit(scene.forward + 0.6 * scene.right + 0.15 * scene.up))
        camera.look_at = tuple(middle)
        self._progress = self._server.gui.add_progress_bar(0.0)
        self._text = self._server.gui.add_markdown("")

    def pose(self, coordinates: Array, markers: Array | None = None) -> None:
        """Put the body in a pose (coordinates,) and show markers (n, 3) in ground [m], NaN where hidden."""
        rotations, origins = self._view.poses(coordinates)
        moved = origins[1] - self._start
        with self._server.atomic():
            self._around.position = -(moved - (moved @ self._view.scene.up) * self._view.scene.up)
            for body, frame in self._frames.items():
                frame.wxyz, frame.position = quaternion(rotations[body]), origins[body]
            if markers is not None:
                seen = np.asarray(markers)[np.isfinite(markers).all(axis=1)]
                self._server.scene.add_point_cloud(
                    "/around/markers", seen.astype(np.float32), MARKER, point_size=0.012, point_shape="circle",
                    precision="float32",
                )  # fmt: skip

    def levels(self, levels: ArrayLike, progress: float, text: str) -> None:
        """Color every link by its level in 0..1, and tell how far things are (0..1) and a text in Markdown."""
        colors = (255.0 * level_color(np.asarray(levels, dtype=np.float64)) ** DEEPER).astype(int)
        with self._server.atomic():
            for body, mesh in self._meshes:
                mesh.color = (190, 190, 190) if body == 0 else tuple(int(one) for one in colors[body - 1])
            self._progress.value = 100.0 * min(max(progress, 0.0), 1.0)
            self._text.content = text

    def close(self) -> None:
        """Take the page down."""
        with redirect_stdout(StringIO()):
            self._server.stop()


def quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation matrix (3, 3), w not negative."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(w), float(x), float(y), float(z)


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _viser() -> Any:
    try:
        import viser
    except ImportError as error:
        raise MyomorphError(f"the web page needs the package 'viser' ({error}): pip install 'myomorph[live]'") from None
    return viser
