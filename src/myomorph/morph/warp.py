"""One surface deformed smoothly toward another: coherent point drift (Myronenko and Song 2010), by rustcpd."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import rustcpd

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.morph.fields import FeaturePoints
from myomorph.morph.procrustes import Similarity
from myomorph.morph.surface_points import Samples, Shape

OVERSAMPLED = 6
"""Random points for every evenly spread one."""

FACING = 0.2
"""Cosine between normals above which two surfaces face the same way."""

NEIGHBORS = 64
"""Samples of the target that are asked for one that faces the same way."""

ITERATIONS, SETTLED = 150, 1e-5

DRIFT_STIFFNESS, DRIFT_REACH = 10.0, 4.0
"""Of coherent point drift (its alpha and beta): between persons softer settings slide along the bone more."""

RANK = 300
"""Of the kernel's approximation: with the reach of the options a hundred give the same to 0.01 mm on a femur."""


@dataclass(frozen=True)
class MatchOptions:
    """How the points of two bones find each other.

    Attributes
    ----------
    features : "dense" takes points spread over the matched surfaces, and landmarks where there are some; "landmarks"
        takes the landmarks alone
    feature_count : points that a dense match gives, spread evenly
    match_points : of each surface in the non-rigid registration
    stiffness : of the deformation, 1 by default
    reach : over which points move together, in standard deviations of the bone's points along an axis
    landmark_error : standard deviation of a picked landmark, as a share of the bone's length
    match_tolerance : of nearness, as a share of the bone's length: points further away are not matched, parts further
        away not reached
    """

    features: Literal["dense", "landmarks"] = "dense"
    feature_count: int = 600
    match_points: int = 2000
    stiffness: float = 1.0
    reach: float = 2.0
    landmark_error: float = 0.01
    match_tolerance: float = 0.02

    def __post_init__(self) -> None:
        if not 20 <= self.feature_count <= 5000 or not 100 <= self.match_points <= 5000:
            raise BadData("expected 20 to 5000 feature points, and 100 to 5000 points in the registration")
        if not self.stiffness > 0 or not 0.5 <= self.reach <= 100:
            raise BadData("expected a stiffness above 0 and a reach from 0.5 to 100")
        for name in ("landmark_error", "match_tolerance"):
            if not 0.0 < getattr(self, name) <= 0.2:
                raise BadData(f"{name} is {getattr(self, name):g}: expected a share of the bone's length up to 0.2")


class Drift:
    """The start, and a smooth deformation after it by coherent point drift."""

    def __init__(self, ours: Shape, goal: Shape, start: Similarity, pulls: FeaturePoints | None, options: MatchOptions):
        self.start = start
        self.samples = spread_points(ours, options.match_points)
        moving, fixed = start.apply(self.samples), spread_points(goal, options.match_points)
        self.middle = fixed.mean(axis=0)
        self.size = float(np.sqrt(np.mean((fixed - self.middle) ** 2)))
        pinned: list[tuple[int, int]] = []
        if pulls is not None:
            pinned = [(len(moving) + k, len(fixed) + k) for k in range(len(pulls))]
            moving = np.concatenate([moving, start.apply(pulls.source)])
            fixed = np.concatenate([fixed, pulls.target])
        self.found = rustcpd.register_deformable(
            self._normal(fixed),
            self._normal(moving),
            alpha=DRIFT_STIFFNESS,
            beta=DRIFT_REACH,
            low_rank=min(RANK, len(moving) - 1),
            low_rank_method="pivoted_cholesky",
            low_rank_tolerance=1e-6,
            constraints=pinned or None,
            constraint_error=(options.landmark_error / self.size) ** 2,
            max_iterations=ITERATIONS,
            tolerance=SETTLED,
        )

    def _normal(self, points: Array) -> Array:
        return np.ascontiguousarray((points - self.middle) / self.size)

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the source near the target."""
        moved: Array = self.found.transform(self._normal(self.start.apply(points)))
        return moved * self.size + self.middle


def spread_points(shape: Shape, count: int) -> Array:
    """Points (count, 3) of a surface, each as far as can be from those before it."""
    points = shape.samples(OVERSAMPLED * count).points
    chosen = np.empty(count, dtype=np.intp)
    chosen[0] = 0
    nearest = np.sum((points - points[0]) ** 2, axis=1)
    for k in range(1, count):
        chosen[k] = int(np.argmax(nearest))
        nearest = np.minimum(nearest, np.sum((points - points[chosen[k]]) ** 2, axis=1))
    return points[chosen]


def onto(goal: Shape, points: Array, normals: Array) -> Samples:
    """Nearest points of a surface that face the same way as normals (n, 3), so that a thin bone keeps its sides."""
    found = goal.nearest(points, fine=True)
    wrong = np.flatnonzero(np.einsum("ij,ij->i", found.normals, normals) < FACING)
    if not len(wrong):
        return found
    dense, tree = goal.dense
    near = tree.query(points[wrong], NEIGHBORS)[1]
    facing = np.einsum("ijk,ik->ij", dense.normals[near], normals[wrong]) > FACING
    turned = np.flatnonzero(facing.any(axis=1))
    index = near[turned, np.argmax(facing[turned], axis=1)]
    for field in ("points", "normals", "rim"):
        getattr(found, field)[wrong[turned]] = getattr(dense, field)[index]
    return found
