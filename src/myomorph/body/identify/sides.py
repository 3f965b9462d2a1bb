"""Left and right are alike: what is known of a body's symmetry, as rows beside measured ones.

The change of a right body from its shape is that of the left one, mirrored, but for a small
difference. With E the change of a pseudo-inertia, P = L (1 + E) L^T (`pseudo_inertia`), a row of
E_right - mirrored E_left has the standard deviation of that difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from myomorph.body.identify.pseudo_inertia import SMALLEST_SHARE, possible_reference, tangents
from myomorph.body.identify.stated_rows import StatedRows
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import inertial_parameters, parameters_of, pseudo_inertias
from myomorph.core.model.model import Model
from myomorph.core.model.sides import mirror_names, split_side
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SIDE_SD = 0.05
"""Relative standard deviation of the difference between both sides of a body, which is assumed:
several times that of lengths, since muscles differ more than bones.
"""
MAX_MISMATCH = 0.3
"""Difference of a model's own sides, in changes of their pseudo-inertia, above which its bodies are
not taken for mirror images.
"""


class MirrorPair(NamedTuple):
    """Two bodies that are mirror images of each other.

    Attributes
    ----------
    right, left : their numbers
    mirror : (3, 3) that turns vectors in the left body's frame into those of the right one's
    """

    right: int
    left: int
    mirror: Array


@read_only
class Sides(StatedRows):
    """Rows of unit noise that both sides of a body are alike.

    Attributes
    ----------
    pairs : names of right and left bodies
    mirrors : the same bodies, with what mirrors them
    rows : (10 pairs, 10 bodies) A
    right : (10 pairs,) b of A x = b
    """

    pairs: tuple[tuple[str, str], ...]
    mirrors: tuple[MirrorPair, ...]


def sides_of(model: Model, shape: Array, sd: float = SIDE_SD) -> Sides:
    """State that bodies of both sides are alike.

    Parameters
    ----------
    model : with its own inertial parameters, standing symmetrically in its default pose
    shape : (bodies, 10) before anything is measured; differences of its sides stay
    sd : relative standard deviation of what differs beside them

    Returns
    -------
    rows of all pairs of bodies whose own parameters in the model are mirror images
    """
    own = possible_reference(inertial_parameters(model))
    means = possible_reference(shape)
    pairs = []
    mirrors = []
    rows = [np.zeros((0, own.size))]
    right = [np.zeros(0)]
    for i, j, mirrored in _mirrored_pairs(model):
        if min(own[[i, j], 0].min(), means[[i, j], 0].min()) <= SMALLEST_SHARE * model.mass:
            continue
        changes = np.linalg.inv(tangents(own[[i]])[0])
        if np.linalg.norm(changes @ (own[i] - mirrored @ own[j])) > MAX_MISMATCH:
            continue
        weighed = np.linalg.inv(tangents(means[[i]])[0]) / sd
        row = np.zeros((10, *own.shape))
        row[:, i] = weighed
        row[:, j] = -weighed @ mirrored
        flat = row.reshape(10, -1)
        pairs.append((model.body_names[i], model.body_names[j]))
        # First moments are vectors.
        mirrors.append(MirrorPair(right=i, left=j, mirror=mirrored[1:4, 1:4]))
        rows.append(flat)
        right.append(flat @ shape.ravel())
    return Sides(
        pairs=tuple(pairs),
        mirrors=tuple(mirrors),
        rows=np.vstack(rows),
        right=np.concatenate(right),
    )


def _mirrored_pairs(model: Model) -> Iterator[tuple[int, int, Array]]:
    """Find bodies of both sides, and how parameters of the left become those of the right one.

    The plane between them is that of the default pose: across it lies the mean way from bodies on
    the left to those on the right.

    Yields
    ------
    numbers of the right and the left body, and the mirror (10, 10) of parameters
    """
    names = model.body_names
    pairs = [
        (names.index(name), names.index(other))
        for name, other in mirror_names(names).items()
        if split_side(name)[1] == "right"
    ]
    if not pairs:
        return
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    rotations = poses.rotations[0, 1:]
    origins = poses.origins[0, 1:]
    across = np.sum([origins[i] - origins[j] for i, j in pairs], axis=0)
    length = np.linalg.norm(across)
    if not length > 0.0:
        return
    reflection = np.eye(3) - 2.0 * np.outer(across, across) / length**2
    for i, j in pairs:
        turn = np.eye(4)
        turn[:3, :3] = rotations[i].T @ reflection @ rotations[j]
        units = pseudo_inertias(np.eye(10))
        yield i, j, parameters_of(turn @ units @ turn.T).T
