"""Whether somebody sits: level thighs under a trunk that is upright."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Body, Model
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
    return bool(frames.any() and seated_frames(model, motion)[frames].mean() > 0.5)


def seated_frames(model: Model, motion: Motion) -> NDArray[np.bool_]:
    """Flag frames in which a person's thighs are level under an upright trunk.

    Parameters
    ----------
    model : of the body
    motion : coordinates (frames, coordinates) over time [rad or m]

    Returns
    -------
    (frames,) False for a body without thighs, shanks or a trunk
    """
    legs = _legs(model)
    trunk = _trunk(model)
    if not legs or trunk is None:
        return np.zeros(len(motion), bool)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    hips = [_origins(poses, tree.body_index[thigh]) for thigh, _ in legs]
    knees = [_origins(poses, tree.body_index[shank]) for _, shank in legs]
    thighs = np.mean(
        [_cosine(hip - knee, model.up) for hip, knee in zip(hips, knees, strict=True)], axis=0
    )
    number = np.array([tree.body_index[trunk.name]], np.int64)
    chest = poses.points(number, trunk.mass_center[None])[:, 0]
    upright = _cosine(chest - np.mean(hips, axis=0), model.up)
    return np.asarray((np.abs(thighs) < LEVEL) & (upright > UPRIGHT))


def _legs(model: Model) -> list[tuple[str, str]]:
    """Find thighs on the pelvis, each with its shank."""
    segments = segments_of(model)
    parents = {joint.child: joint.parent for joint in model.joints}
    shanks = {parent: name for name, parent in parents.items() if segments[name].name == "shank"}
    return [
        (name, shanks[name])
        for name, parent in parents.items()
        if segments[name].name == "thigh" and name in shanks and parent not in shanks
    ]


def _trunk(model: Model) -> Body | None:
    """Find the heaviest body of the upper trunk, None for none."""
    segments = segments_of(model)
    trunks = [body for body in model.bodies if segments[body.name].name == "upper_trunk"]
    return max(trunks, key=lambda body: body.mass, default=None)


def _origins(poses: Poses, number: int) -> Array:
    """Origin of a body over time (frames, 3) [m]."""
    return poses.origins[:, number]


def _cosine(vectors: Array, direction: Array) -> Array:
    """Cosine of the angles between vectors (frames, 3) and a unit vector (frames,)."""
    return np.asarray(vectors @ direction / np.maximum(np.linalg.norm(vectors, axis=1), 1e-12))
