"""Poses from which frames are solved: the default pose, turned the way that the sensors face."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.core.motion.starts import root_coordinates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

UPRIGHT = 0.9  # Cosine of the angle from the vertical of the axis about which a root turns
NUDGE = 0.1  # By which a coordinate is moved to see its axis [rad]


def facing_starts(tree: Tree, bodies: tuple[str, ...], reported: Array) -> Array:
    """Turn the default pose about the vertical as the sensor nearest to the root has turned.

    Somebody who walks back faces the other way than in the calibration pose, and a search that
    begins there ends in bent knees that point backwards.

    Parameters
    ----------
    tree : of the model
    bodies : that each sensor is on
    reported : (frames, sensors, 3, 3) rotations of the bodies to ground, NaN where unknown

    Returns
    -------
    (frames, coordinates) [rad or m]
    """
    starts = np.tile(tree.defaults, (len(reported), 1))
    column = _turning_coordinate(tree)
    if column is None:
        return starts
    numbers = [tree.body_number(body) for body in bodies]
    nearest = int(np.argmin([_depth(tree, number) for number in numbers]))
    default = forward_kinematics(tree, tree.defaults[None]).rotations[0, numbers[nearest]]
    turned = reported[:, nearest] @ default.T
    known = np.isfinite(turned).all(axis=(1, 2))
    if known.any():
        angles = np.unwrap(_angles_about(np.asarray(tree.model.up), turned[known]))
        frames = np.arange(len(turned))
        starts[:, column] += np.interp(frames, frames[known], angles)
    return starts


def _depth(tree: Tree, body: int) -> int:
    """Count the bodies between a body and ground."""
    depth = 0
    while body > 0:
        body = int(tree.arrays.parent[body])
        depth += 1
    return depth


def _turning_coordinate(tree: Tree) -> int | None:
    """Find the root's coordinate that turns the body about the vertical, None without."""
    up = np.asarray(tree.model.up)
    for column in root_coordinates(tree):
        if tree.model.coordinates[column].motion != "rotational":
            continue
        moved = np.tile(tree.defaults, (2, 1))
        moved[1, column] += NUDGE
        rotations = forward_kinematics(tree, moved).rotations
        last = rotations.shape[1] - 1
        axis = vector_from_rotation(rotations[1, last] @ rotations[0, last].T) / NUDGE
        if axis @ up > UPRIGHT:
            return column
    return None


def _angles_about(axis: Array, rotations: Array) -> Array:
    """Compute the angle about an axis that is nearest to a rotation (its twist).

    Parameters
    ----------
    axis : (3,) unit vector
    rotations : (times, 3, 3)

    Returns
    -------
    (times,) [rad]
    """
    skew = rotations - np.swapaxes(rotations, 1, 2)
    sine = 0.5 * np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]]) @ axis
    # Of the twist angle a: trace R - u^T R u = 2 cos a where the axis stays upright.
    along = np.einsum("i,fij,j->f", axis, rotations, axis)
    cosine = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - along)
    return np.asarray(np.arctan2(sine, cosine))
