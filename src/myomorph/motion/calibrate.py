"""Markers put on a model where a recording of a known pose shows them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Marker, Model, index_of
from myomorph.model.series import Markers, Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree


def place_markers(model: Model, motion: Motion, markers: Markers, bodies: Mapping[str, str]) -> tuple[Marker, ...]:
    """Markers at the mean of where a recording shows them on their bodies.

    location = mean over frames of R_body^T (x_marker - p_body)

    Parameters
    ----------
    motion : pose of the model in each frame of `markers`
    markers : recorded in the model's ground; a frame that does not show a marker does not count for it
    bodies : the body of each marker to place

    Raises
    ------
    BadData : the motion has other frames than the markers, or a marker is never seen
    UnknownName : a marker that was not recorded, or a body that the model does not have
    """
    if len(motion) != len(markers):
        raise BadData(f"the motion has {len(motion)} frames, but the markers have {len(markers)}")
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    placed = []
    for name, body in bodies.items():
        if body not in tree.body_index:
            raise UnknownName("body", body, tuple(tree.body_index))
        column = markers.values[:, index_of("marker", name, markers.names, "the recording")]
        b = tree.body_index[body]
        local = np.einsum("fji,fj->fi", poses.rotations[:, b], column - poses.origins[:, b])
        seen = np.isfinite(local).all(axis=1)
        if not seen.any():
            raise BadData(f"marker '{name}' is not seen in any of the {len(markers)} frames")
        placed.append(Marker(name, body, local[seen].mean(axis=0)))
    return tuple(placed)
