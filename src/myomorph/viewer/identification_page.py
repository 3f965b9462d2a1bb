"""The body in a web page while something happens to it, by the viewer library `viser`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.report.scene.body_view import BodyView
from myomorph.report.scene.image import level_color
from myomorph.viewer.web_page import DEEPER, MARKER, Links, add_floor, add_lights, open_server, quiet, view_from


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
        self._server = open_server(port, title)
        self._view = BodyView(model, surfaces)
        scene = self._view.scene
        self.port = int(self._server.get_port())
        page = self._server.scene
        page.set_up_direction(tuple(float(one) for one in scene.up))
        add_lights(page, scene)
        # All that is seen hangs on one frame, which moves back as the subject moves on.
        self._around = page.add_frame("/around", show_axes=False)
        self._start = np.array(scene.origins[0, 1])
        meshed = bool(surfaces) or any(mesh.shape != "mesh" for body in model.bodies for mesh in body.meshes)
        self._links = Links(page, "/around", scene.solids if meshed else self._view.rounds)
        add_floor(page, "/around/ground", scene.up, scene.floor)
        middle = scene.origins[0, 1] + (0.5 * (scene.low + scene.high) - scene.origins[0, 1] @ scene.up) * scene.up
        camera = self._server.initial_camera
        camera.position = tuple(view_from(scene, middle, scene.forward + 0.6 * scene.right + 0.15 * scene.up))
        camera.look_at = tuple(middle)
        self._progress = self._server.gui.add_progress_bar(0.0)
        self._text = self._server.gui.add_markdown("")

    def pose(self, coordinates: Array, markers: Array | None = None) -> None:
        """Put the body in a pose (coordinates,) and show markers (n, 3) in ground [m], NaN where hidden."""
        rotations, origins = self._view.poses(coordinates)
        moved = origins[1] - self._start
        with self._server.atomic():
            self._around.position = -(moved - (moved @ self._view.scene.up) * self._view.scene.up)
            self._links.pose(rotations, origins)
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
            for body, mesh in self._links.handles.items():
                mesh.color = (190, 190, 190) if body == 0 else tuple(int(one) for one in colors[body - 1])
            self._progress.value = 100.0 * min(max(progress, 0.0), 1.0)
            self._text.content = text

    def close(self) -> None:
        """Take the page down."""
        with quiet():
            self._server.stop()
