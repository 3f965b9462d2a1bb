"""Maps of whole models with known effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.transfer.body_transfer import nearest_rotation
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.scale import slides_freely
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity


def given(body: str, matrix: Array, offset: Array, **surfaces: object) -> BoneMap:
    """Return the affine map of a body.

    Parameters
    ----------
    body : name, of source and target
    matrix : (3, 3) linear part
    offset : (3,) [m]
    surfaces : other fields of `BoneMap`

    Returns
    -------
    the map, whose similarity has the nearest rotation and the cube root of the determinant
    """
    size = float(np.cbrt(abs(np.linalg.det(matrix))))
    sign = np.sign(np.linalg.det(matrix))
    whole = Similarity(sign * nearest_rotation(sign * matrix), offset, size)
    bare = BoneMap(
        body=body,
        target_body=body,
        map=AffineMap(matrix, offset),
        whole=whole,
        basis="given",
    )
    return replace(bare, **surfaces)


def similar(model: Model, size: float, seed: int | None = None) -> dict[str, BoneMap]:
    """Every body larger by a factor, in a frame of its own if there is a seed."""
    found = {}
    rng = np.random.default_rng(seed)
    for body in model.body_names:
        turn = np.eye(3) if seed is None else rotation_from_euler_xyz(rng.uniform(-3.0, 3.0, 3))
        found[body] = given(
            body, size * turn, np.zeros(3) if seed is None else rng.uniform(-0.5, 0.5, 3)
        )
    return found


def sheared(model: Model, matrix: Array) -> dict[str, BoneMap]:
    """Return the whole body stretched by one matrix as it stands in its default pose.

    The frames rotate with it.

    Parameters
    ----------
    model : the source
    matrix : (3, 3) in ground

    Returns
    -------
    the map of each body by its name
    """
    found = {}
    for body, pose in standing_poses(model).items():
        turn = nearest_rotation(matrix) @ pose.rotation
        found[body] = given(body, turn.T @ matrix @ pose.rotation, np.zeros(3))
    return found


def poses_of(model: Model, count: int, seed: int = 0, sliding: bool = False) -> Motion:
    """Coordinates somewhere in their ranges, sliding ones at their defaults unless wanted."""
    rng = np.random.default_rng(seed)
    values = np.empty((count, len(model.coordinates)))
    for j, one in enumerate(model.coordinates):
        low, high = np.clip(one.range, one.default - 1.5, one.default + 1.5)
        moves = (one.motion == "rotational" or sliding) and not one.locked
        values[:, j] = rng.uniform(low, high, count) if moves else one.default
    return Motion(np.arange(float(count)), model.coordinate_names, values)


def grown(model: Model, motion: Motion, size: float) -> Motion:
    """Return the motion of a model in its twin, larger by a factor: translations are larger."""
    sliding = {
        axis.coordinates[0]
        for joint in model.joints
        for axis in joint.axes
        if axis.kind == "translation" and axis.coordinates and slides_freely(axis.function)
    }
    factors = [size if name in sliding else 1.0 for name in motion.names]
    return Motion(motion.time, motion.names, motion.values * factors)
