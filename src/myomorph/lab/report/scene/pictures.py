"""Pictures of a scene: the body from the side and from the front at some instants."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.report.scene.image import ACTIVATION, activation_color, base64_text, data_uri, png
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.scene import Scene, solid_corners
from myomorph.lab.report.scene.shapes import normals, reduced

BONE = (0.93, 0.89, 0.80)
FORCE = (0.10, 0.58, 0.46)
MUSCLE = (0.72, 0.24, 0.24)
UNKNOWN = (0.55, 0.52, 0.52)
SHRINK = 2
DRAWERS = 2  # Threads that draw.
VIEWS: Mapping[str, float] = FrozenMap({"side": 0.0, "oblique": 40.0, "front": 90.0, "left": 180.0})
"""From where a picture is taken, as the angle [deg] from the subject's right side towards its
front.
"""


@dataclass(frozen=True)
class Picture:
    """One rendered view."""

    frame: int  # index in the scene
    view: str  # of `VIEWS`
    image: bytes  # a PNG file
    # width, height: of it [pixels]
    width: int
    height: int

    @property
    def address(self) -> str:
        """The image as an address that needs no file."""
        return data_uri(self.image)


def pictures(
    scene: Scene,
    size: tuple[int, int] = (460, 420),
    colors: Array | None = None,
    views: Sequence[str] = ("side", "front"),
    scale: float | None = None,
) -> list[Picture]:
    """Draw every frame of the scene from each of the views, at one scale and one floor.

    So they can be compared. What is transparent is background.

    Parameters
    ----------
    scene : bodies and muscles in some frames
    size : height and width of a picture at most [px]
    colors : (bodies, 3) from 0 to 1, the ground first; bone by default
    views : names of the directions to look from
    scale : pixels for a metre; by default what fits

    Returns
    -------
    Pictures of all frames of the first view, then of the next
    """
    shading = [normals(solid.surface) for solid in scene.solids]
    corners = _corners(scene)
    framed = {name: _framing(scene, corners, _axes(scene, name)) for name in views}
    scale = fitting_scale(scene, *size, views) if scale is None else scale

    def drawn(name: str, frame: int) -> Picture:
        centers, wide, tall = framed[name]
        width = max(int(np.ceil(wide * scale)), 40)
        high = max(int(np.ceil(tall * scale)), 40)
        view = View(
            axes=_axes(scene, name),
            center=centers[frame],
            scale=scale * SHRINK,
            width=width * SHRINK,
            height=high * SHRINK,
        )
        canvas = Canvas(view)
        _draw(canvas, scene, frame, shading, colors)
        # Steps of four levels nobody sees, nor colors of the background: a quarter fewer bytes.
        lean = canvas.picture(SHRINK) & np.array([252, 252, 252, 255], dtype=np.uint8)
        lean[lean[..., 3] == 0] = 0
        return Picture(frame=frame, view=name, image=png(lean), width=width, height=high)

    # Drawing and packing run without the interpreter's lock.
    with ThreadPoolExecutor(DRAWERS) as pool:
        return list(pool.map(drawn, *zip(*product(framed, range(len(scene.time))), strict=True)))


def fitting_scale(scene: Scene, height: int, widest: int, views: Sequence[str]) -> float:
    """Pixels for a metre with which all pictures of a scene fit."""
    corners = _corners(scene)
    framed = [_framing(scene, corners, _axes(scene, name)) for name in views]
    return min(min(height / max(tall, 1e-6), widest / max(wide, 1e-6)) for _, wide, tall in framed)


def proportion(scene: Scene, view: str) -> float:
    """Width over height of the scene's pictures from one view."""
    _, wide, tall = _framing(scene, _corners(scene), _axes(scene, view))
    return wide / max(tall, 1e-6)


def _axes(scene: Scene, view: str) -> Array:
    """Rows: to the right of the picture, up in it, towards the viewer."""
    turn = np.deg2rad(VIEWS[view])
    ahead = np.cos(turn)
    aside = np.sin(turn)
    across = ahead * scene.forward - aside * scene.right
    towards = ahead * scene.right + aside * scene.forward
    return np.stack([across, scene.up, towards])


def plain_color(scene: Scene) -> tuple[float, float, float]:
    """Color of a muscle without activation: its own, but grey among others that have one."""
    known = any(np.isfinite(muscle.activation).any() for muscle in scene.muscles)
    return UNKNOWN if known else MUSCLE


def _corners(scene: Scene) -> Array:
    """Find the corners of the boxes around all solids and all points of muscle paths.

    The result is (frames, n, 3) in ground.
    """
    solids = solid_corners(scene.solids, scene.rotations, scene.origins)
    return np.concatenate(
        [scene.origins[:, 1:], *(muscle.points for muscle in scene.muscles), *solids], axis=1
    )


def _framing(scene: Scene, corners: Array, axes: Array) -> tuple[Array, float, float]:
    """Middle of every picture (frames, 3), and the width and height that hold all of them [m]."""
    across = corners @ axes[0]
    upward = corners @ axes[1]
    middle = (np.nanmin(across, axis=1) + np.nanmax(across, axis=1)) / 2
    wide = float((np.nanmax(across, axis=1) - np.nanmin(across, axis=1)).max()) * 1.06
    low = min(float(np.nanmin(upward)), scene.floor)
    high = float(np.nanmax(upward))
    depth = np.nanmean(corners @ axes[2], axis=1)
    centers = middle[:, None] * axes[0] + (low + high) / 2 * axes[1] + depth[:, None] * axes[2]
    return centers, wide, (high - low) * 1.05


def _draw(
    canvas: Canvas, scene: Scene, frame: int, shading: list[Array], paint: Array | None
) -> None:
    for solid, normal in zip(scene.solids, shading, strict=True):
        turn = scene.rotations[frame, solid.body]
        vertices = solid.surface.vertices @ turn.T + scene.origins[frame, solid.body]
        color = np.array(BONE) if paint is None else paint[solid.body]
        canvas.surface(vertices, normal @ turn.T, solid.surface.faces, color)
    tubes = [*_muscle_tubes(scene, frame), *_arrow_tubes(scene, frame)]
    if tubes:
        canvas.tubes(*(np.concatenate(parts) for parts in zip(*tubes, strict=True)))


class _Tubes(NamedTuple):
    """Tubes of one muscle or arrow, as `Canvas.tubes` takes them."""

    starts: Array  # (tubes, 3) [m]
    ends: Array  # (tubes, 3) [m]
    radii: Array  # (tubes, 2) at both ends [m]
    colors: Array  # (tubes, 3)


def _muscle_tubes(scene: Scene, frame: int) -> Iterator[_Tubes]:
    plain = plain_color(scene)
    active = np.array([muscle.activation[frame] for muscle in scene.muscles])
    painted = np.where(np.isnan(active)[:, None], plain, activation_color(active))
    for muscle, color in zip(scene.muscles, painted, strict=True):
        points = muscle.points[frame]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            continue
        yield _Tubes(
            starts=points[:-1],
            ends=points[1:],
            radii=np.full((len(points) - 1, 2), muscle.radius),
            colors=np.tile(color, (len(points) - 1, 1)),
        )


def _arrow_tubes(scene: Scene, frame: int) -> Iterator[_Tubes]:
    # Half the body's height for one body weight shows both a quiet stance and a landing.
    meters_per_newton = 0.35 * scene.size / scene.weight
    for index in range(scene.force_starts.shape[1]):
        start = scene.force_starts[frame, index]
        force = scene.force_vectors[frame, index]
        if not (np.isfinite(start).all() and np.isfinite(force).all()):
            continue
        tip = start + force * meters_per_newton
        along = (tip - start) / max(float(np.linalg.norm(tip - start)), 1e-12)
        thick = 0.006 * scene.size
        neck = tip - along * min(4.5 * thick, 0.5 * float(np.linalg.norm(tip - start)))
        yield _Tubes(
            starts=np.stack([start, neck]),
            ends=np.stack([neck, tip]),
            radii=np.array([[thick * 0.6, thick * 0.6], [thick * 1.9, 0.1 * thick]]),
            colors=np.tile(FORCE, (2, 1)),
        )


MAX_FRAMES = 150
MAX_BYTES = 2_500_000
MAX_TRIANGLES = 12000
HIDDEN = -32768


def frames_to_play(frames: int, points: int, bodies: int) -> int:
    """How many frames fit the budget, for a number of muscle points and bodies."""
    each = 6 * points + 48 * bodies
    return int(np.clip(MAX_BYTES // max(each, 1), 24, min(MAX_FRAMES, max(frames, 1))))


def player(scene: Scene) -> str:
    """Write the scene as JSON: coarse surfaces, poses, muscle points and activations.

    Points are 16-bit integers over a box around the movement: `point = low + value * step`.
    """
    surfaces, bodies = _coarse(scene)
    none = np.zeros((len(scene.time), 0, 3))
    points = np.concatenate([none, *(muscle.points for muscle in scene.muscles)], axis=1)
    cloud = np.concatenate([scene.origins[:, 1:].reshape(-1, 3), points.reshape(-1, 3)])
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    low = cloud.min(axis=0)
    high = cloud.max(axis=0)
    step = max(float((high - low).max()), 1e-9) / 60000.0
    middle = low + 30000.0 * step
    used = np.unique(bodies).astype(np.int64) if len(bodies) else np.zeros(0, np.int64)
    turns = scene.rotations[:, used].reshape(len(scene.time), -1, 9)
    poses = np.concatenate([turns, scene.origins[:, used]], axis=2).astype(np.float32)
    forces = np.concatenate([scene.force_starts, scene.force_vectors / scene.weight], axis=2)
    value: dict[str, Any] = {
        "time": [round(float(instant), 5) for instant in scene.time],
        "up": _short(scene.up),
        "forward": _short(scene.forward),
        "right": _short(scene.right),
        "size": float(scene.size),
        "floor": float(scene.floor),
        "low": float(min(scene.low, scene.floor)),
        "high": float(scene.high),
        "bodies": [int(np.searchsorted(used, body)) for body in bodies],
        "poseCount": len(used),
        "poses": base64_text(poses),
        "solids": surfaces,
        "plain": (
            "rgb(" + ",".join(str(round(255 * channel)) for channel in plain_color(scene)) + ")"
        ),
        "names": [muscle.name for muscle in scene.muscles],
        "counts": [int(muscle.points.shape[1]) for muscle in scene.muscles],
        "radii": [round(float(muscle.radius), 6) for muscle in scene.muscles],
        "middle": _short(middle),
        "step": step,
        "points": base64_text(_packed((points - middle) / step)),
        "activation": base64_text(_activation_bytes(scene)),
        "colors": base64_text(ACTIVATION),
        "forces": (
            np.where(np.isfinite(forces), np.round(forces, 4), 0.0)
            .reshape(len(scene.time), -1)
            .tolist()
        ),
    }
    # A name must not be able to end the script element that carries this.
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def _packed(points: Array) -> np.ndarray:
    """Round points in steps to 16-bit integers; those that are not there are `HIDDEN`."""
    scaled = np.round(points)
    return np.where(np.isnan(scaled), HIDDEN, np.nan_to_num(scaled)).astype(np.int16)


def _activation_bytes(scene: Scene) -> np.ndarray:
    """Activations (frames, muscles) from 0 to 254, 255 where not known."""
    none = np.zeros((len(scene.time), 0))
    activation = np.concatenate(
        [none, *(muscle.activation[:, None] for muscle in scene.muscles)], axis=1
    )
    return np.where(
        np.isnan(activation), 255, np.clip(np.nan_to_num(activation) * 254.0, 0, 254)
    ).astype(np.uint8)


def _short(values: Array) -> list[float]:
    return [round(float(value), 6) for value in values]


def _coarse(scene: Scene) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Surfaces with as many triangles as a browser draws smoothly, and their bodies."""
    shrunk = reduced([solid.surface for solid in scene.solids], scene.size, MAX_TRIANGLES)
    words = []
    bodies = []
    for solid, surface in zip(scene.solids, shrunk, strict=True):
        if not len(surface.faces):
            continue
        wide = len(surface.vertices) >= 65536
        low = surface.vertices.min(axis=0)
        step = max(float(np.ptp(surface.vertices, axis=0).max()), 1e-9) / 60000.0
        packed = np.round((surface.vertices - low) / step - 30000.0).astype(np.int16)
        faces = base64_text(surface.faces.astype(np.uint32 if wide else np.uint16))
        places = {
            "low": _short(low + 30000.0 * step),
            "step": step,
            "vertices": base64_text(packed),
        }
        words.append(places | {"faces": faces, "wide": wide})
        bodies.append(solid.body)
    return words, np.array(bodies, dtype=np.int64)
