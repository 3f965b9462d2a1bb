"""Bones of one side for both: a body without a bone takes the mirrored map of its other side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.morph.bone_map import BoneMap
from myomorph.morph.fields import FeaturePoints, PointMap
from myomorph.morph.other_side import other_side_of
from myomorph.morph.procrustes import Similarity
from myomorph.morph.reflection import Reflection, flip

ALIKE = 0.02
"""The source's own bones must be mirror images of each other within this share of their length."""


@dataclass(frozen=True, eq=False)
class MirroredMap:
    """A map seen in two mirrors: points go to the other side of the source, by its map, and back in the target."""

    inner: PointMap
    source: Reflection
    target: Reflection

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of the source's frame in the target's [m]."""
        return self.target.points(self.inner.apply(self.source.points(points)))

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives (..., 3, 3) of the mapped points."""
        slopes: Array = self.target.matrix @ self.inner.jacobian(self.source.points(points)) @ self.source.matrix
        return slopes


def with_mirrored_bones(
    model: Model,
    bones: Mapping[str, BoneMap],
    surfaces: Mapping[str, Surface],
    together: bool = False,
    axis: str = "z",
) -> dict[str, BoneMap]:
    """The maps, and the mirrored ones of bodies that have none while their other side has one.

    Parameters
    ----------
    surfaces : of the source's own bones, in their bodies' frames
    together : the target's bones share one frame, in which the plane of symmetry is that of a mapped bone in the middle
    axis : of ground across the source's plane of symmetry

    Raises
    ------
    BadModel : right and left bodies of the source do not face each other along `axis`
    """
    side = other_side_of(model, axis)
    middle = _shared_plane(bones, side.planes, side.middle) if together else None
    found = dict(bones)
    for body in model.body_names:
        twin = side.named("bodies", body)
        if body in bones or twin == body or twin not in bones:
            continue
        plane = side.planes[twin]
        goal = middle or flip(int(np.argmax(np.abs(bones[twin].whole.rotation @ plane.normal))))
        found[body] = _mirrored(bones[twin], body, plane, goal, surfaces)
    return found


def _shared_plane(
    bones: Mapping[str, BoneMap], planes: Mapping[str, Reflection], middle: frozenset[str]
) -> Reflection | None:
    for body, bone in bones.items():
        if body in middle:
            normal = bone.whole.rotation @ planes[body].normal
            through = bone.whole.apply(planes[body].offset * planes[body].normal)
            return Reflection(normal, float(normal @ through))
    return None


def _mirrored(
    bone: BoneMap, body: str, plane: Reflection, goal: Reflection, surfaces: Mapping[str, Surface]
) -> BoneMap:
    turned = goal.matrix @ bone.whole.rotation @ plane.matrix
    origin = goal.points(bone.whole.apply(plane.points(np.zeros(3))))
    features = bone.features
    notes = [f"{body}: the mirrored bone of {bone.body}", *_unlike(body, bone.body, plane, surfaces)]
    return replace(
        bone,
        body=body,
        target_body=body,
        map=MirroredMap(bone.map, plane, goal),
        whole=Similarity(turned, origin, bone.whole.scale),
        source=surfaces.get(body) or _reflected(bone.source, plane),
        target=_reflected(bone.target, goal),
        features=None
        if features is None
        else FeaturePoints(
            features.names, plane.points(features.source), goal.points(features.target), features.weights
        ),
        notes=tuple(notes),
    )


def _reflected(surface: Surface | None, plane: Reflection) -> Surface | None:
    return None if surface is None else Surface(plane.points(surface.vertices), surface.faces[:, ::-1])


def _unlike(body: str, twin: str, plane: Reflection, surfaces: Mapping[str, Surface]) -> list[str]:
    """A note where the source's own two bones are no mirror images of each other in their bodies' frames."""
    if body not in surfaces or twin not in surfaces:
        return []
    image, own = plane.points(surfaces[twin].vertices), surfaces[body].vertices
    apart = float(np.sqrt(np.mean(cKDTree(own).query(image)[0] ** 2)))
    length = float(np.ptp(own, axis=0).max())
    if apart <= ALIKE * length:
        return []
    return [
        f"{body}: the source's own bone lies {1e3 * apart:.1f} mm from the mirrored one of {twin}: give the bone itself"
    ]
