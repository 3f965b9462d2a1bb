"""The body of a movie: bones, muscles as spindles, arrows of forces, and the floor behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import from_extra
from myomorph.core.muscles.muscle_paths import muscle_paths
from myomorph.core.rigid.bone_poses import BonePoses, bone_poses
from myomorph.lab.report.scene.pictures import MUSCLE
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.scene import MusclePath, solid_corners
from myomorph.lab.report.scene.shapes import normals
from myomorph.lab.report.scene.spindles import FACES, spindles
from myomorph.lab.report.trial.answer.pose_pictures import (
    SHRINK,
    camera_axes,
    ramp_color,
)
from myomorph.lab.viewer.player import GOES_AWAY
from myomorph.lab.viewer.replay_body import PlayedBody
from myomorph.lab.viewer.replay_scene import COLORS

if TYPE_CHECKING:
    from PIL.Image import Image

BONE = (0.90, 0.92, 0.94)
"""Cool, so that muscles at rest stand out."""
MARGIN = 0.04
"""Free space around the body, as a share of its extent."""
FLOOR = (222, 222, 222)
FLOOR_STEP = 0.11
FLOOR_LINES = 9
FLOOR_WIDTH = 0.22
"""Distance of the floor's lines from each other, their number ahead and behind, and half their
length; distances as shares of the body's size."""
SHAFT = 0.006
HEAD = 0.05
"""Radius of an arrow's shaft and length of its head, as shares of the body's size."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class MovieCamera:
    """A camera of one scale that goes along with the body.

    Attributes
    ----------
    axes : (3, 3) rows: to the right of the picture, up in it, towards the viewer
    centers : (frames, 3) point in the middle of each picture, in ground [m]
    scale : pixels of the picture per meter
    width, height : of the picture [pixels]
    """

    axes: Array
    centers: Array
    scale: float
    width: int
    height: int

    def view(self, frame: int) -> View:
        """Return the view of a frame, `SHRINK` times as large as its picture."""
        return View(
            axes=self.axes,
            center=self.centers[frame],
            scale=self.scale * SHRINK,
            width=self.width * SHRINK,
            height=self.height * SHRINK,
        )


class BodyPainter:
    """Pictures of a body at some of its frames.

    Parameters
    ----------
    body : that is played
    frames : of the body, each once, in order
    size : width and height of every picture [pixels]
    """

    def __init__(self, body: PlayedBody, frames: Sequence[int], size: tuple[int, int]):
        self._body = body
        self._frames = tuple(frames)
        motion = body.motion.frames([body.posed_frame(frame) for frame in frames])
        self._poses = bone_poses(body.model, motion)
        self._paths = _paths(body, self._frames)
        self._normals = tuple(normals(solid.surface) for solid in body.scene.solids)
        self.camera = _camera(body, self._poses, self._paths, size)

    def picture(self, index: int) -> Image:
        """Draw the body at one of its frames, on white."""
        view = self.camera.view(index)
        canvas = Canvas(view)
        self._draw_bones(canvas, index)
        self._draw_muscles(canvas, index)
        for layer, ends in (("measured", self._body.measured), ("estimated", self._body.estimated)):
            color = np.array(COLORS[layer]) / 255.0
            _draw_arrows(canvas, ends[self._frames[index]], self._body.size, color)
        image = from_extra("view", "PIL.Image", "pillow")
        body = image.fromarray(canvas.picture(SHRINK))
        page: Image = self._floor(view)
        page.paste(body, mask=body)
        return page

    def _draw_bones(self, canvas: Canvas, index: int) -> None:
        for solid, normal in zip(self._body.scene.solids, self._normals, strict=True):
            turn = self._poses.rotations[index, solid.body]
            vertices = solid.surface.vertices @ turn.T + self._poses.origins[index, solid.body]
            canvas.surface(vertices, normal @ turn.T, solid.surface.faces, BONE)

    def _draw_muscles(self, canvas: Canvas, index: int) -> None:
        solved = self._body.results.tension is not None
        for spindle in spindles(self._paths, self._body.model.muscles, index):
            active = float(self._paths[spindle.muscle].activation[index])
            color = ramp_color("light", active) if solved else np.array(MUSCLE)
            canvas.surface(spindle.vertices, spindle.normals, FACES, color)

    def _floor(self, view: View) -> Image:
        """Draw lines across the way, which stay where they are in the laboratory."""
        scene = self._body.scene
        middle = view.center - (view.center @ scene.up - scene.floor) * scene.up
        ahead = float(middle @ scene.forward)
        step = FLOOR_STEP * self._body.size
        nearest = round(ahead / step)
        numbers = np.arange(nearest - FLOOR_LINES, nearest + FLOOR_LINES + 1)
        places = middle + (numbers * step - ahead)[:, None] * scene.forward
        half = FLOOR_WIDTH * self._body.size * scene.right
        ends = view.project(np.stack([places - half, places + half], axis=1))[..., :2]
        page = from_extra("view", "PIL.Image", "pillow").new(
            "RGB", (view.width, view.height), "white"
        )
        drawing = from_extra("view", "PIL.ImageDraw", "pillow").Draw(page)
        for line in ends:
            drawing.line([tuple(point) for point in line.tolist()], fill=FLOOR, width=SHRINK)
        reduced: Image = page.reduce(SHRINK)
        return reduced


def _paths(body: PlayedBody, frames: Sequence[int]) -> tuple[MusclePath, ...]:
    """Lines of all muscles at some frames of a body, with their activations."""
    motion = body.motion.frames([body.posed_frame(frame) for frame in frames])
    paths = muscle_paths(body.model, motion)
    active = body.activations[list(frames)]
    return tuple(
        MusclePath(name=name, points=paths.line(name), radius=0.0, activation=active[:, index])
        for index, name in enumerate(paths.muscles)
    )


def _camera(
    body: PlayedBody, poses: BonePoses, paths: Sequence[MusclePath], size: tuple[int, int]
) -> MovieCamera:
    """Place the camera so that the body fills the picture, at one scale over all frames.

    Parameters
    ----------
    body : that is played
    poses, paths : of the frames
    size : width and height of the picture [pixels]
    """
    axes = camera_axes(body.scene)
    way = _way(body, poses)
    corners = solid_corners(body.scene.solids, poses.rotations, poses.origins)
    lines = [path.points for path in paths]
    points = np.concatenate([poses.origins[:, 1:], *corners, *lines], axis=1) - way[:, None]
    in_picture = points @ axes[:2].T
    low = np.nanmin(in_picture, axis=(0, 1))
    high = np.nanmax(in_picture, axis=(0, 1))
    extent = (1.0 + 2.0 * MARGIN) * np.maximum(high - low, 1e-6)
    return MovieCamera(
        axes=axes,
        centers=way + 0.5 * (low + high) @ axes[:2],
        scale=float((np.array(size) / extent).min()),
        width=size[0],
        height=size[1],
    )


def _way(body: PlayedBody, poses: BonePoses) -> Array:
    """Find where the camera goes along: a straight line at constant speed, or a place.

    So the loop of a walk closes, and the body still sways.

    Parameters
    ----------
    body : that is played
    poses : of the frames

    Returns
    -------
    (frames, 3) in ground, level with the floor's origin [m]
    """
    up = body.scene.up
    root = poses.origins[:, 1]
    level = root - np.outer(root @ up, up)
    if len(level) < 2 or body.travelled <= GOES_AWAY * body.scene.size:
        return np.tile(level.mean(axis=0), (len(level), 1))
    clock = poses.time - poses.time[0]
    slope, start = np.polyfit(clock, level, 1)
    return np.asarray(start + np.outer(clock, slope))


def _draw_arrows(canvas: Canvas, ends: Array, size: float, color: Array) -> None:
    """Draw arrows of forces.

    Parameters
    ----------
    canvas : to draw on
    ends : (forces, 2, 3) start and end in ground, NaN where none acts [m]
    size : of the body [m]
    color : (3,) in 0..1
    """
    for start, tip in ends[np.isfinite(ends).all(axis=(1, 2))]:
        length = max(float(np.linalg.norm(tip - start)), 1e-12)
        head = min(HEAD * size, 0.4 * length)
        neck = tip - (tip - start) * head / length
        radius = min(SHAFT * size, 0.06 * length)
        radii = np.array([[radius, radius], [2.6 * radius, 0.1 * radius]])
        canvas.tubes(np.stack([start, neck]), np.stack([neck, tip]), radii, np.tile(color, (2, 1)))
