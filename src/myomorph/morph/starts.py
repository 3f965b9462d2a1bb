"""Where a bone of a scan roughly lies, by the bones around it that are found already."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.model.model import Model
from myomorph.model.spatial import Transform
from myomorph.morph.bone_map import BoneMap
from myomorph.morph.procrustes import Similarity


def start_by_neighbors(
    model: Model, body: str, found: Mapping[str, BoneMap], poses: Mapping[str, Transform]
) -> Similarity | None:
    """Where a body lies in the frame that all bones share, if it hangs on its nearest mapped bone as in the source.

    Parameters
    ----------
    found : maps of bones so far; their target surfaces share one frame
    poses : of the source's bodies in ground, in the posture that the scan is most like

    Returns
    -------
    from the source body's frame to the shared one, None where no bone is mapped yet
    """
    near = _nearest(model, body, found)
    if near is None:
        return None
    beside = poses[near].inverse() @ poses[body]
    whole = found[near].whole
    return Similarity(whole.rotation @ beside.rotation, whole.apply(beside.translation), whole.scale)


def _nearest(model: Model, body: str, found: Mapping[str, BoneMap]) -> str | None:
    """The mapped body with the fewest joints between."""
    beside: dict[str, list[str]] = {name: [] for name in model.body_names}
    for joint in model.joints:
        if joint.parent in beside:
            beside[joint.parent].append(joint.child)
            beside[joint.child].append(joint.parent)
    reached, layer = {body}, [body]
    while layer:
        layer = [other for one in layer for other in beside[one] if other not in reached]
        reached.update(layer)
        for one in layer:
            if one in found:
                return one
    return None
