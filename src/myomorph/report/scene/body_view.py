"""A body in its newest pose, colored link by link: for a terminal, and for anything else that shows pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from rich.text import Text

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.model.surface import Surface
from myomorph.report.scene.image import Bytes, level_color
from myomorph.report.scene.raster import Canvas, View
from myomorph.report.scene.scene import Scene, Solid, make_scene
from myomorph.report.scene.shapes import bones, capsule
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

SHRINK = 4  # Pixels rendered for one shown, along each axis.
MIN_LENGTH = 1e-3  # Pieces that are shorter are not drawn [m].
THICK, MIN_RADIUS, MAX_RADIUS = 0.16, 0.014, 0.055
"""Radius of a limb in a small picture: a share of its length, and bounds as shares of the body's height."""


class BodyView:
    """Pictures of one model, its surfaces prepared once: limbs as rounds. `meshed`: whether bodies have surfaces of
    their own; `turn`: of the camera from the front towards the right side [degrees].
    """

    def __init__(self, model: Model, surfaces: Mapping[str, Surface] | None = None, turn: float = 35.0):
        self.model = model
        self._tree = compile_tree(model)
        nowhere = Motion(np.zeros(1), (), np.zeros((1, 0)))
        self.meshed = bool(surfaces) or any(mesh.shape != "mesh" for body in model.bodies for mesh in body.meshes)
        self.scene: Scene = make_scene(replace(model, muscles=()), nowhere, [0], surfaces)
        self._limbs = _limbs(model, self._tree.body_index)
        lengths = np.array([np.linalg.norm(end - start) for _, start, end in self._limbs])
        tall = self.scene.high - self.scene.low
        self._radii = np.repeat(np.clip(THICK * lengths, MIN_RADIUS * tall, MAX_RADIUS * tall)[:, None], 2, axis=1)
        angle = np.deg2rad(turn)
        ahead = np.cos(angle) * self.scene.forward + np.sin(angle) * self.scene.right
        # The viewer stands ahead: the subject's right is on the picture's left.
        self._axes = np.stack([np.cross(self.scene.up, ahead), self.scene.up, ahead])

    def limbs(self, share: float = 1.0) -> tuple[Solid, ...]:
        """The limbs as surfaces, for bodies that have no mesh, a share as thick."""
        return tuple(
            Solid(body, capsule(start, end, share * float(radius)))
            for (body, start, end), radius in zip(self._limbs, self._radii[:, 0], strict=True)
        )

    def poses(self, coordinates: Array) -> tuple[Array, Array]:
        """Rotations (bodies + 1, 3, 3) and origins (bodies + 1, 3) in a pose (coordinates,), the ground first."""
        poses = forward_kinematics(self._tree, np.ascontiguousarray(coordinates, dtype=np.float64)[None])
        return poses.rotations[0], poses.origins[0]

    def pixels(self, coordinates: Array, levels: Array, width: int, height: int) -> Bytes:
        """(height, width, 4) the body in a pose, each link in the color of its level in 0..1."""
        rotations, origins = self.poses(coordinates)
        colors = np.vstack([[0.72, 0.72, 0.72], level_color(np.asarray(levels, dtype=np.float64))])
        scene = self.scene
        middle = origins[1] + (0.5 * (scene.low + scene.high) - scene.origins[0, 1] @ scene.up) * scene.up
        scale = SHRINK * height / (1.12 * max(scene.high - scene.low, 1e-6))
        canvas = Canvas(View(self._axes, middle, scale, SHRINK * width, SHRINK * height))
        bodies = [body for body, _, _ in self._limbs]
        ends = np.array([(start, end) for _, start, end in self._limbs]).reshape(-1, 2, 3)
        placed = np.einsum("bij,bkj->bki", rotations[bodies], ends) + origins[bodies][:, None]
        canvas.tubes(placed[:, 0], placed[:, 1], self._radii, colors[bodies])
        return canvas.picture(SHRINK)


def _limbs(model: Model, numbers: Mapping[str, int]) -> list[tuple[int, Array, Array]]:
    """Body's number, and both ends in its frame, of the pieces that a body is drawn from in few pixels. From a body's
    joint to the joints that it carries, and through its mass center and on: of a trunk without a head of its own, that
    is the head.
    """
    result = []
    for body, (start, joints) in zip(model.bodies, bones(model).values(), strict=True):
        ends = list(joints)
        if not ends or body.mass > 0.02 * model.mass:
            ends.append(start + 1.9 * (body.mass_center - start))
        result += [(numbers[body.name], start, end) for end in ends if np.linalg.norm(end - start) > MIN_LENGTH]
    return result


def half_blocks(pixels: Bytes) -> Text:
    """Pixels as characters, two above each other in one: for terminals that show colors."""
    text = Text(no_wrap=True)
    if len(pixels) % 2:
        pixels = np.concatenate([pixels, np.zeros_like(pixels[:1])])
    for upper, lower in zip(pixels[::2], pixels[1::2], strict=True):
        for above, below in zip(upper, lower, strict=True):
            top, bottom = above[3] > 110, below[3] > 110
            foreground, other = (f"#{int(c[0]):02x}{int(c[1]):02x}{int(c[2]):02x}" for c in (above, below))
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
