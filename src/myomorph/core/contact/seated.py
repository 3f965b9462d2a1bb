"""Whether somebody sits: level thighs under a trunk that is upright."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_of
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import compile_tree

LEVEL = 0.5
"""Cosine of the angle between a thigh and the vertical, below which the thigh counts as level."""
UPRIGHT = 0.5
"""Cosine of the angle between the trunk and the vertical, above which the trunk is upright."""


def is_seated(model: Model, motion: Motion, frames: NDArray[np.bool_]) -> bool:
    """Tell whether a person sits in most of some frames.

    Four-legged animals have level thighs as well, but a level trunk.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time [rad or m]
    frames : (frames,) whose pose is judged

    Returns
    -------
    False for a body without thighs, shanks or a trunk
    """
    if not frames.any():
        return False
    segments = segments_of(model)
    joints = {joint.child: joint.parent for joint in model.joints}
    hips = [
        name
        for name, parent in joints.items()
        if segments[name].name == "thigh" and segments.get(parent) is not None
        if segments[parent].name != "thigh"
    ]
    shanks = {parent: name for name, parent in joints.items() if segments[name].name == "shank"}
    trunks = [body for body in model.bodies if segments[body.name].name == "upper_trunk"]
    pairs = [(thigh, shanks[thigh]) for thigh in hips if thigh in shanks]
    if not pairs or not trunks:
        return False
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion)[frames])
    place = {name: _origins(poses, tree.body_index[name]) for pair in pairs for name in pair}
    thighs = np.mean([_cosine(place[hip] - place[knee], model.up) for hip, knee in pairs], axis=0)
    trunk = max(trunks, key=lambda body: body.mass)
    number = np.array([tree.body_index[trunk.name]], np.int64)
    chest = poses.points(number, trunk.mass_center[None])[:, 0]
    middle = np.mean([place[hip] for hip, _ in pairs], axis=0)
    upright = _cosine(chest - middle, model.up)
    return bool(np.mean((np.abs(thighs) < LEVEL) & (upright > UPRIGHT)) > 0.5)


def _origins(poses: Poses, number: int) -> Array:
    """Origin of a body over time (frames, 3) [m]."""
    return poses.origins[:, number]


def _cosine(vectors: Array, direction: Array) -> Array:
    """Cosine of the angles between vectors (frames, 3) and a unit vector (frames,)."""
    return np.asarray(vectors @ direction / np.maximum(np.linalg.norm(vectors, axis=1), 1e-12))
