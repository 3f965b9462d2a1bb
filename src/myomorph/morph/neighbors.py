"""Bodies for which the target has no bone: made larger or smaller with those around them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.model.model import GROUND, Model
from myomorph.morph.bone_map import BoneMap
from myomorph.morph.carrier import few, scaled_map
from myomorph.morph.procrustes import Similarity


def with_neighbors(model: Model, bones: Mapping[str, BoneMap]) -> dict[str, BoneMap]:
    """Maps of all bodies and of the ground, in which a body without one takes the size of its nearest neighbors.

    Such a body keeps its frame; its size is the geometric mean over the bodies nearest in the tree that have a bone.
    The ground neither turns nor moves, whatever hangs on it.

    Parameters
    ----------
    bones : at least one, by body of the model
    """
    ties = {name: set[str]() for name in (GROUND, *model.body_names)}
    for joint in model.joints:
        ties[joint.parent].add(joint.child)
        ties[joint.child].add(joint.parent)
    found = dict(bones)
    sizes = {name: bone.whole.scale for name, bone in bones.items()}
    while len(found) < len(ties):
        # The ground passes nothing on: what hangs on it beside a subject is not of its size.
        beside = {
            name: [sizes[one] for one in ties[name] if one in sizes and (one != GROUND or GROUND in bones)]
            for name in ties
            if name not in found
        }
        near = {name: float(np.exp(np.mean(np.log(given)))) for name, given in beside.items() if given}
        for name, size in near.items() if near else [(name, 1.0) for name in beside]:
            found[name] = _resized(name, size)
            sizes[name] = size
    return {name: found[name] for name in ties}


def _resized(body: str, size: float) -> BoneMap:
    whole = Similarity(np.eye(3), np.zeros(3), size)
    return BoneMap(body, body, scaled_map(body, size), whole, "neighbors")


def neighbor_notes(bones: Mapping[str, BoneMap]) -> list[str]:
    """One line on the bodies that were scaled with their neighbors."""
    scaled = {name: bone.whole.scale for name, bone in bones.items() if bone.basis == "neighbors" and name != GROUND}
    if not scaled:
        return []
    low, high = min(scaled.values()), max(scaled.values())
    by = f"by {low:.3g}" if high - low < 5e-4 * high else f"by {low:.3g} to {high:.3g}"
    return [f"scaled with their neighbors {by}, as no bone is given: {few(scaled)}"]
