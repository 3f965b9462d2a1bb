"""Simple shapes in the place of a head and a thorax whose meshes are not there: a body without them is hard to read."""

from __future__ import annotations

import re

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.model.surface import Surface
from myomorph.report.scene.shapes import bones, ellipsoid
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

TRUNK = re.compile(r"(?:^|_)(?:torso|trunk|thorax|ribcage|upper_?body)(?:$|_)", re.IGNORECASE)
HEAD = re.compile(r"(?:^|_|neck)(?:head|skull|cranium)(?:$|_|neck)", re.IGNORECASE)

SHOULDERS, HEAD_CENTER = 1.42, 1.82
"""Heights over the joint of a trunk that ends at the lumbar spine, in units of that of its mass center (gait2354)."""

THORAX = np.array([0.31, 0.48, 0.23])
"""Half sizes of a thorax to the side, upwards and forward, in units of its height from the joint to the shoulders."""

SKULL = np.array([0.19, 0.29, 0.24])
"""The same of a head, in units of the height of the trunk's mass center over its joint."""


def stand_ins(model: Model) -> dict[str, list[Surface]]:
    """Shapes of the trunk, with a head where no body of its own is one, and of heads, in their bodies' frames. Only for
    trunks and heads that have a mass center away from their joint, which shows their size.
    """
    tree = compile_tree(model)
    still = Motion(np.zeros(1), (), np.zeros((1, 0)))
    rotations = forward_kinematics(tree, tree.coordinates_of(still)).rotations[0]
    model_bones = bones(model)
    trunk = next((body for body in model.bodies if TRUNK.search(body.name) and body.mass > 0.0), None)
    if trunk is None:
        return {}
    start, joints = model_bones[trunk.name]
    turn = rotations[tree.body_index[trunk.name]]
    up = turn.T @ model.up
    rise = float((trunk.mass_center - start) @ up)
    size = float(np.linalg.norm(trunk.mass_center - start))
    if size <= 0.0:
        return {}
    axes = np.stack([_across(model, up, turn), up, np.zeros(3)])
    axes[2] = np.cross(axes[0], up)
    headed = any(HEAD.search(body.name) for body in model.bodies)
    if rise > 0.3 * size:
        along = (trunk.mass_center - start) / size
        tall = SHOULDERS * size
        if headed:
            # Without the head the mass center lies lower: the joints of arms and neck show the height.
            tall = max([1.05 * float((joint - start) @ up) for joint in joints], default=tall)
        middle = start + 0.53 * tall * along
        shapes = [ellipsoid(middle, axes, tall * THORAX)]
        head = start + HEAD_CENTER * size * along
    else:
        # A thorax whose frame lies at its top, as at the jugular notch: its mass center is in its middle.
        tall = 2.3 * max(-rise, 0.6 * size)
        shapes = [ellipsoid(trunk.mass_center, axes, tall * THORAX)]
        head = trunk.mass_center + 0.72 * tall * up
        size = tall / SHOULDERS
    if not headed:
        shapes.append(ellipsoid(head, axes, size * SKULL))
    result = {trunk.name: shapes}
    for body in model.bodies:
        start, joints = model_bones[body.name]
        reach = float(np.linalg.norm(body.mass_center - start))
        if HEAD.search(body.name) and body is not trunk and not joints and reach > 0.0:
            there = rotations[tree.body_index[body.name]].T @ turn @ axes.T
            result[body.name] = [ellipsoid(body.mass_center, there.T, max(reach, 0.3 * size) * SKULL / SKULL[1])]
    return result


def _across(model: Model, up: Array, turn: Array) -> Array:
    """Unit vector to the side in the trunk's frame: models look along x, with y or z up."""
    side = turn.T @ np.cross([1.0, 0.0, 0.0], model.up)
    side = side - (side @ up) * up
    length = float(np.linalg.norm(side))
    return np.asarray(side / length if length > 1e-6 else turn.T @ np.array([0.0, 1.0, 0.0]))
