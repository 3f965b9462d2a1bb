"""Key poses as pictures: bones, and muscles as spindles, for light and dark pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.lab.report.scene.image import data_uri, png
from myomorph.lab.report.scene.pictures import DRAWERS
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.scene import Scene, solid_corners
from myomorph.lab.report.scene.shapes import normals
from myomorph.lab.report.scene.spindles import FACES, spindles

Theme = Literal["light", "dark"]
THEMES: tuple[Theme, ...] = get_args(Theme)

AZIMUTH = 27.0
"""Angle of the view from the subject's right side towards its front [degrees]."""
ELEVATION = 6.0
"""Angle of the view from above [degrees]."""
PIXELS = 640
"""Height of the tallest picture."""
SHRINK = 2
MARGIN = 0.02
"""Free space around the body [m]."""

FULL = 0.6
"""Activation in the last color of the ramp, the same on all pages, so that they compare."""
RAMPS: Mapping[Theme, tuple[str, ...]] = FrozenMap(
    {
        "light": ("#dccfc6", "#e9a26f", "#cf4f2f", "#7d0f26"),
        "dark": ("#6b6774", "#b5613a", "#f59a3c", "#fff3c0"),
    }
)
"""Colors from rest to `FULL`, monotonic in lightness: more active is further from the page."""
BONES: Mapping[Theme, str] = FrozenMap({"light": "#e8e6df", "dark": "#a9aeb6"})


@dataclass(frozen=True)
class PosePicture:
    """One pose in one theme, or in both: addresses of images that need no file.

    Attributes
    ----------
    light, dark : addresses
    width : of either [pixels]
    """

    light: str
    dark: str
    width: int


def pose_pictures(model: Model, scene: Scene) -> tuple[PosePicture, ...]:
    """Every frame of a scene, all at one scale and with one floor.

    Parameters
    ----------
    model : whose muscles' volumes give the spindles their size
    scene : the body in its key poses, with activations where they are known
    """
    axes = camera_axes(scene)
    boxes = [_box(scene, frame, axes) for frame in range(len(scene.time))]
    bottom = min(box[2] for box in boxes)
    top = max(box[3] for box in boxes)
    scale = PIXELS * SHRINK / max(top - bottom, 1e-6)
    views = [_view(axes, box, (bottom, top), scale) for box in boxes]
    shapes = [_shapes(model, scene, frame) for frame in range(len(scene.time))]
    # Drawing and packing run without the interpreter's lock.
    with ThreadPoolExecutor(DRAWERS) as pool:
        light = pool.map(partial(_image, "light"), views, shapes)
        dark = pool.map(partial(_image, "dark"), views, shapes)
        images = zip(light, dark, views, strict=True)
        return tuple(PosePicture(one, other, view.width // SHRINK) for one, other, view in images)


@read_only
class Shape:
    """A surface in ground, lit by its normals.

    Attributes
    ----------
    vertices, normals : (points, 3)
    faces : (triangles, 3) numbers of vertices
    activation : of a muscle, NaN where unknown; None of a bone
    """

    vertices: Array
    normals: Array
    faces: np.ndarray
    activation: float | None


def _view(
    axes: Array, box: tuple[float, float, float, float], heights: tuple[float, float], scale: float
) -> View:
    """Return the camera of a pose; all have one scale and one floor."""
    left, right, _, _ = box
    middle = 0.5 * (left + right) * axes[0] + 0.5 * sum(heights) * axes[1]
    return View(
        axes=axes,
        center=middle,
        scale=scale,
        width=int((right - left) * scale) // SHRINK * SHRINK,
        height=PIXELS * SHRINK,
    )


def _shapes(model: Model, scene: Scene, frame: int) -> list[Shape]:
    """Return bones and spindles of a frame."""
    shapes = []
    for solid in scene.solids:
        turn = scene.rotations[frame, solid.body]
        vertices = solid.surface.vertices @ turn.T + scene.origins[frame, solid.body]
        lit = normals(solid.surface) @ turn.T
        shapes.append(
            Shape(vertices=vertices, normals=lit, faces=solid.surface.faces, activation=None)
        )
    for spindle in spindles(scene.muscles, model.muscles, frame):
        active = float(scene.muscles[spindle.muscle].activation[frame])
        shapes.append(
            Shape(
                vertices=spindle.vertices,
                normals=spindle.normals,
                faces=FACES,
                activation=active,
            )
        )
    return shapes


def camera_axes(scene: Scene) -> Array:
    """Turn the camera to a body.

    Parameters
    ----------
    scene : the body's axes are taken

    Returns
    -------
    (3, 3) rows: to the right of the picture, up in it, towards the viewer
    """
    azimuth = np.radians(AZIMUTH)
    elevation = np.radians(ELEVATION)
    level = np.cos(azimuth) * scene.right + np.sin(azimuth) * scene.forward
    towards = np.cos(elevation) * level + np.sin(elevation) * scene.up
    across = np.cross(scene.up, towards)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(towards, across), towards])


def _box(scene: Scene, frame: int, axes: Array) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the body in a frame, along the picture's axes [m]."""
    corners = solid_corners(
        scene.solids, scene.rotations[frame : frame + 1], scene.origins[frame : frame + 1]
    )
    paths = [muscle.points[frame : frame + 1] for muscle in scene.muscles]
    points = np.concatenate([scene.origins[frame : frame + 1, 1:], *corners, *paths], axis=1)[0]
    across = points @ axes[0]
    upward = points @ axes[1]
    return (
        float(np.nanmin(across)) - MARGIN,
        float(np.nanmax(across)) + MARGIN,
        float(np.nanmin(upward)) - MARGIN,
        float(np.nanmax(upward)) + MARGIN,
    )


def _image(theme: Theme, view: View, shapes: Sequence[Shape]) -> str:
    """Draw one pose in the colors of a theme, as an address."""
    canvas = Canvas(view)
    bone = _rgb(BONES[theme])
    for shape in shapes:
        color = bone if shape.activation is None else ramp_color(theme, shape.activation)
        canvas.surface(shape.vertices, shape.normals, shape.faces, color)
    lean = canvas.picture(SHRINK) & np.array([252, 252, 252, 255], dtype=np.uint8)
    lean[lean[..., 3] == 0] = 0
    return data_uri(png(lean))


def ramp_color(theme: Theme, activation: float) -> Array:
    """Return the color of an activation; of one that is not known that of rest.

    Parameters
    ----------
    theme : light or dark
    activation : 0 to 1, NaN where it is not known

    Returns
    -------
    (3,) in 0..1
    """
    stops = np.array([_rgb(code) for code in RAMPS[theme]])
    share = 0.0 if np.isnan(activation) else min(max(activation / FULL, 0.0), 1.0)
    at = share * (len(stops) - 1)
    return np.array([np.interp(at, np.arange(len(stops)), stops[:, i]) for i in range(3)])


def _rgb(code: str) -> Array:
    """(3,) color in 0..1 of '#rrggbb'."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
