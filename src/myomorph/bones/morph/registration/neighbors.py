"""Where a bone lies beside its mapped neighbors."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.bones.morph.maps.fields import BoneMap, nearest_bones
from myomorph.core.model.model import Model
from myomorph.core.model.spatial import Transform
from myomorph.core.surfaces.linear_maps import Similarity


def start_by_neighbors(
    model: Model, body: str, mapped: Mapping[str, BoneMap], poses: Mapping[str, Transform]
) -> Similarity | None:
    """Return where a body lies in the frame of the target's bones, as its neighbors suggest.

    It hangs on its nearest mapped bone as in the source. None where no bone is mapped yet. `poses`:
    of the source's bodies in ground, in the posture that the scan is most like.
    """
    near = next(iter(nearest_bones(model, body, mapped)), None)
    if near is None:
        return None
    beside = poses[near].inverse() @ poses[body]
    whole = mapped[near].whole
    return Similarity(
        whole.rotation @ beside.rotation, whole.apply(beside.translation), whole.scale
    )
