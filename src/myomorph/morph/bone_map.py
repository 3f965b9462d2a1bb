"""A bone of the source and the bone it becomes, with the map between them: what a transfer of muscles needs to know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.morph.fields import FeaturePoints, PointMap
from myomorph.morph.procrustes import Similarity

Basis: TypeAlias = Literal["bone", "landmarks", "neighbors", "surrounding", "given"]


@dataclass(frozen=True, eq=False)
class BoneMap:
    """How what is fixed to a body of the source becomes fixed to a body of the target.

    Attributes
    ----------
    body : of the source
    target_body : of the target; another name where the species have another skeleton
    map : from the source body's frame to the target body's
    whole : the similarity that the map comes nearest to: turns joint axes and wrap objects, tells left from right
    basis : "bone" (surfaces and their features), "landmarks" (points alone), "neighbors" (scaled as the bodies around),
        "surrounding" (a virtual link, mapped by the features of several bones), "given"
    source, target : surfaces in their bodies' frames, None where there is none
    features : what the map was made from
    measures : how good it is, by name with its unit ("residual [m]", "coverage", "folded"), for tables
    notes : what looks wrong or was assumed, one line each
    """

    body: str
    target_body: str
    map: PointMap
    whole: Similarity
    basis: Basis
    source: Surface | None = None
    target: Surface | None = None
    features: FeaturePoints | None = None
    measures: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()


def muscle_sizes(source: Model, bones: Mapping[str, BoneMap]) -> dict[str, float]:
    """How many times larger the target is around each muscle: mean scale of the maps of its points' bones."""
    found: dict[str, float] = {}
    for muscle in source.muscles:
        owners = dict.fromkeys(point.body for point in muscle.path.points)
        scales = [bones[body].whole.scale for body in owners if body in bones]
        found[muscle.name] = float(np.mean(scales)) if scales else 1.0
    return found
