"""The moving skeleton as compact text for the page's script."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.report.scene.image import ACTIVATION, base64_text
from myomorph.report.scene.pictures import plain_color
from myomorph.report.scene.scene import Scene
from myomorph.report.scene.shapes import reduced

MOST_FRAMES = 150
MOST_BYTES = 2_500_000
MOST_TRIANGLES = 12000
HIDDEN = -32768


def frames_to_play(frames: int, points: int, bodies: int) -> int:
    """How many frames fit the budget, for a number of muscle points and bodies."""
    each = 6 * points + 48 * bodies
    return int(np.clip(MOST_BYTES // max(each, 1), 24, min(MOST_FRAMES, max(frames, 1))))


def player(scene: Scene) -> str:
    """The scene as JSON: coarse surfaces, poses, muscle points and activations.

    Points are 16-bit integers over a box around the movement: `point = low + value * step`.
    """
    surfaces, bodies = _coarse(scene)
    points = (
        np.concatenate([muscle.points for muscle in scene.muscles], axis=1)
        if scene.muscles
        else np.zeros((len(scene.time), 0, 3))
    )
    cloud = np.concatenate([scene.origins[:, 1:].reshape(-1, 3), points.reshape(-1, 3)])
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    step = max(float((high - low).max()), 1e-9) / 60000.0
    middle = low + 30000.0 * step
    used = np.unique(bodies).astype(np.int64) if len(bodies) else np.zeros(0, np.int64)
    poses = np.concatenate(
        [scene.rotations[:, used].reshape(len(scene.time), -1, 9), scene.origins[:, used]], axis=2
    ).astype(np.float32)
    activation = (
        np.stack([muscle.activation for muscle in scene.muscles], axis=1)
        if scene.muscles
        else np.zeros((len(scene.time), 0))
    )
    told = np.where(np.isnan(activation), 255, np.clip(np.nan_to_num(activation) * 254.0, 0, 254)).astype(np.uint8)
    forces = np.concatenate([scene.force_starts, scene.force_vectors / scene.weight], axis=2)
    value: dict[str, Any] = {
        "time": [round(float(one), 5) for one in scene.time],
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
        "plain": _css(plain_color(scene)),
        "names": [muscle.name for muscle in scene.muscles],
        "counts": [int(muscle.points.shape[1]) for muscle in scene.muscles],
        "radii": [round(float(muscle.radius), 6) for muscle in scene.muscles],
        "middle": _short(middle),
        "step": step,
        "points": base64_text(_packed(points, middle, step)),
        "activation": base64_text(told),
        "colors": base64_text(ACTIVATION),
        "forces": np.where(np.isfinite(forces), np.round(forces, 4), 0.0).reshape(len(scene.time), -1).tolist(),
    }
    # A name must not be able to end the script element that carries this.
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def _css(color: tuple[float, float, float]) -> str:
    return "rgb(" + ",".join(str(round(255 * one)) for one in color) + ")"


def _packed(points: Array, middle: Array, step: float) -> np.ndarray:
    scaled = np.round((points - middle) / step)
    return np.where(np.isnan(scaled), HIDDEN, np.nan_to_num(scaled)).astype(np.int16)


def _short(values: Array) -> list[float]:
    return [round(float(one), 6) for one in values]


def _coarse(scene: Scene) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Surfaces with as many triangles as a browser draws smoothly, and their bodies."""
    shrunk = reduced([solid.surface for solid in scene.solids], scene.size, MOST_TRIANGLES)
    told = []
    bodies = []
    for solid, surface in zip(scene.solids, shrunk, strict=True):
        if not len(surface.faces):
            continue
        low = surface.vertices.min(axis=0)
        step = max(float(np.ptp(surface.vertices, axis=0).max()), 1e-9) / 60000.0
        packed = np.round((surface.vertices - low) / step - 30000.0).astype(np.int16)
        told.append(
            {
                "low": _short(low + 30000.0 * step),
                "step": step,
                "vertices": base64_text(packed),
                "faces": base64_text(surface.faces.astype(np.uint16 if len(surface.vertices) < 65536 else np.uint32)),
                "wide": len(surface.vertices) >= 65536,
            }
        )
        bodies.append(solid.body)
    return told, np.array(bodies, dtype=np.int64)
