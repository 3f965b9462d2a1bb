"""A body on its way: its map, and what the map does to places, directions and sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.spatial import Transform
from myomorph.morph.maps.fields import BoneMap, radii_around
from myomorph.morph.maps.linear import AffineMap, fit_affine
from myomorph.morph.shapes.surface_points import Shape

NEIGHBORHOOD = 0.1
"""What a map does around a place is taken over this share of the bone's length: a blended map's derivative at one point
says more of the feature points nearby than of the bone."""

BESIDE = 0.13
"""What the map adds to the radius of a point, over its distance from the bone's surface. Beyond 1 % of a bone's length
90 % of the muscle points of five bones were off by 0.12 to 0.16 of it, in the deformations 100 to 109 of
`benchmarks/accuracy/morph/correspondence.py`; bones of persons show nothing of what is beside them."""

SAMPLES = 150  # Of a bone's vertices or features tell what becomes of the bone as a whole.
UNKNOWN_LENGTH = 0.1
"""Of a body of which neither surface nor features tell a length [m]; its map is the same everywhere."""

_SPHERE = np.vstack([np.eye(3), -np.eye(3), np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T / np.sqrt(3.0)])


@dataclass(frozen=True, eq=False)
class Transfer:
    """What is fixed to a body of the source, transferred to the target."""

    bone: BoneMap  # the body's map
    body: str  # of the target, to which things are fixed afterwards

    def __post_init__(self) -> None:
        if np.linalg.det(self.bone.whole.rotation) < 0.0 or np.linalg.det(self.linear) <= 0.0:
            raise BadData(
                f"the map of '{self.bone.body}' turns right into left: mirror the model first (myomorph.morph.mirror), "
                "or give the bone of the same side"
            )

    def points(self, points: ArrayLike) -> Array:
        """Points (..., 3) of the source body in the target body [m]."""
        return self.bone.map.apply(points)

    @cached_property
    def samples(self) -> Array:
        """(n, 3) points that stand for the source's bone: of its surface, else its features [m]."""
        bone = self.bone
        points = UNKNOWN_LENGTH * _SPHERE
        if bone.source is not None and len(bone.source.vertices):
            points = bone.source.vertices
        elif bone.features is not None and len(bone.features) > 3:
            points = bone.features.source
        return points[:: max(1, len(points) // SAMPLES)]

    @cached_property
    def linear(self) -> Array:
        """(3, 3) of the affine map that comes nearest over the whole bone."""
        return fit_affine(self.samples, self.points(self.samples)).matrix

    @cached_property
    def length(self) -> float:
        """Of the source's bone: its greatest extent along an axis of its frame [m]."""
        return float(np.ptp(self.samples, axis=0).max())

    @property
    def size(self) -> float:
        """Length of the target's bone over that of the source's."""
        return self.bone.whole.scale

    @cached_property
    def volume(self) -> float:
        """Volume of the target's bone over that of the source's."""
        return float(np.linalg.det(self.linear))

    def within(self, points: ArrayLike) -> Array:
        """Distances (n,) within which points (n, 3) of the source belong with 90 % [m]; NaN where nothing is known.
        Those of the matched points around them, and what the map adds beside the bone.
        """
        asked = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        features = self.bone.features
        if features is None or features.radii is None or not len(asked):
            return np.full(len(asked), np.nan)
        if self.shapes is None:
            away = np.min(np.linalg.norm(asked[:, None] - features.source, axis=2), axis=1)
        else:
            away = np.linalg.norm(asked - self.shapes[0].closest(asked)[0], axis=1)
        return np.hypot(radii_around(features.source, features.radii, asked), BESIDE * self.size * away)

    def near(self, place: ArrayLike) -> Array:
        """(3, 3) of the affine map that comes nearest around a place (3,) of the source body."""
        radius = NEIGHBORHOOD * self.length
        moved = self.points(np.asarray(place) + radius * _SPHERE)
        matrix: Array = 3.0 / (len(_SPHERE) * radius) * moved.T @ _SPHERE
        return matrix if np.linalg.det(matrix) > 0.0 else self.linear

    @property
    def rotation(self) -> Array:
        """(3, 3) by which directions fixed to the bone turn: that of the whole bone, so of a long one's shaft."""
        return self.bone.whole.rotation

    def turn(self, place: ArrayLike) -> Array:
        """Rotation (3, 3) of what is around a place (3,) of the source body: a condyle may turn against the shaft."""
        return nearest_rotation(self.near(place))

    def pose(self, pose: Transform) -> Transform:
        """A frame fixed to the source body, fixed to the target's."""
        return Transform(self.rotation @ pose.rotation, self.points(pose.translation))

    @cached_property
    def shapes(self) -> tuple[Shape, Shape] | None:
        """Surfaces of source and target, where both have one."""
        bone = self.bone
        if bone.source is None or bone.target is None:
            return None
        return Shape(bone.source), Shape(bone.target)


Transfers = Mapping[str, Transfer]


def nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) nearest to a matrix that keeps right right (its polar factor)."""
    u, _, vt = np.linalg.svd(matrix)
    return (u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def scaled_map(body: str, size: float) -> AffineMap:
    """The map of a body that keeps its frame and changes its size."""
    if not (np.isfinite(size) and size > 0.0):
        raise BadData(f"the size of '{body}' would be {size}: its neighbors' maps are no good")
    return AffineMap(size * np.eye(3), np.zeros(3))
