"""One surface deformed smoothly toward another: coherent point drift, and closest points with few degrees of freedom.

Coherent point drift (Myronenko and Song 2010, by rustcpd) chooses among ways to lie and starts what differs much. Then,
as iterative closest points lay a rigid surface on another (Chen and Medioni 1992), the displacement is
u(x) = sum_k exp(-|x - c_k|^2 / (2 h^2)) w_k over a few hundred points c_k of the surface, and each step solves

    min  mean_i (n_i . (x_i + u(x_i) - y_i))^2 + lambda w^T K w

for the planes (y_i, n_i) of nearest points, from the source's points and from the target's. Points may slide along the
surface at little cost, so where they go along it is what bends the displacement least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData, from_extra
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.shapes.surface_points import Samples, Shape

OVERSAMPLED = 6
"""Random points for every evenly spread one."""

FACING = 0.2
"""Cosine between normals above which two surfaces face the same way."""

NEIGHBORS = 64
"""Samples of the target that are asked for one that faces the same way."""

DRIFT_ITERATIONS, SETTLED = 150, 1e-5

DRIFT_STIFFNESS, DRIFT_REACH = 10.0, 4.0
"""Of coherent point drift (its alpha and beta): between persons softer settings slide along the bone more."""

DRIFT_RANK = 300
"""Of the kernel's approximation: with the kernel width of the options a hundred give the same to 0.01 mm on a femur."""


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
    match_kernel_width : distance over which points move together, in standard deviations of the bone's points along
        an axis
    landmark_error : standard deviation of a picked landmark, as a share of the bone's length
    match_tolerance : of nearness, as a share of the bone's length: points further away are not matched, parts further
        away not reached
    """

    features: Literal["dense", "landmarks"] = "dense"
    feature_count: int = 600
    match_points: int = 2000
    stiffness: float = 1.0
    match_kernel_width: float = 2.0
    landmark_error: float = 0.01
    match_tolerance: float = 0.02

    def __post_init__(self) -> None:
        if not 20 <= self.feature_count <= 5000 or not 100 <= self.match_points <= 5000:
            raise BadData("expected 20 to 5000 feature points, and 100 to 5000 points in the registration")
        if not self.stiffness > 0 or not 0.5 <= self.match_kernel_width <= 100:
            raise BadData("expected a stiffness above 0 and a match_kernel_width from 0.5 to 100")
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
        self.found = from_extra("morph", "rustcpd").register_deformable(
            self._normal(fixed),
            self._normal(moving),
            alpha=DRIFT_STIFFNESS,
            beta=DRIFT_REACH,
            low_rank=min(DRIFT_RANK, len(moving) - 1),
            low_rank_method="pivoted_cholesky",
            low_rank_tolerance=1e-6,
            constraints=pinned or None,
            constraint_error=(options.landmark_error / self.size) ** 2,
            max_iterations=DRIFT_ITERATIONS,
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
    values = {field: getattr(found, field).copy() for field in ("points", "normals", "rim")}
    for field, one in values.items():
        one[wrong[turned]] = getattr(dense, field)[index]
    return replace(found, **values)


Moves: TypeAlias = Callable[[Array], Array]
"""Points (n, 3) to points (n, 3)."""

STIFF = 1e-5
"""Lambda at a stiffness of 1, lengths in shares of the bone's. On made deformations of four bones 1e-6 and 1e-5 leave a
third of what 1e-4 does, between persons they do the same."""

CENTERS, RANK = 200, 1e-8
"""Points of the kernel, and the share of its greatest eigenvalue below which a direction is left out."""

ITERATIONS, RENEWED = 15, 4
"""Steps, and after how many the normals are computed anew."""

TETHER = 0.02
"""Share of a step's cost that holds points back along the surface, so that they slide no further than they must."""

TRIMMED = 0.98
"""Share of the pairs that count, the nearest."""

PAIR_FACING = 0.3
"""Cosine between normals of points that may be pairs."""

NORMAL = 0.1
"""Share of the bone's length that counts as much as a right angle between normals, in looking for pairs."""

LANDMARK = 0.01
"""Weight of a landmark against the whole surface, where it is known to a hundredth of the bone's length."""


@read_only
@dataclass(frozen=True, eq=False)
class SmoothFit:
    """A displacement after a first map.

    Attributes
    ----------
    before : what it starts from
    centers : (k, 3) where that puts the kernel's points
    weights : (k, 3)
    width : of the kernel
    rms : root mean square distance from the source's points to the target, of those that count
    """

    before: Moves
    centers: Array
    weights: Array
    width: float
    rms: float

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the source on the target, or as near as is smooth."""
        moved = self.before(points)
        return moved + _kernel(moved, self.centers, self.width) @ self.weights


def fit_smoothly(
    ours: Shape, goal: Shape, before: Moves, landmarks: FeaturePoints | None, options: MatchOptions
) -> SmoothFit:
    """The smooth displacement that brings a surface, laid on another, onto it; lengths in shares of the bone's."""
    given, theirs = ours.samples(options.match_points), goal.samples(options.match_points)
    laid = before(given.points)
    width = options.match_kernel_width * float(np.sqrt(np.mean((theirs.points - theirs.points.mean(axis=0)) ** 2)))
    centers = before(spread_points(ours, CENTERS))
    values, vectors = np.linalg.eigh(_kernel(centers, centers, width))
    kept = values > RANK * values[-1]
    basis = vectors[:, kept] / np.sqrt(values[kept])
    directions = _kernel(laid, centers, width) @ basis
    marks = _Marks(landmarks, before, lambda points: _kernel(points, centers, width) @ basis, options)
    found = np.zeros((directions.shape[1], 3))
    fit = SmoothFit(before, centers, basis @ found, width, np.inf)
    for step in range(ITERATIONS):
        here = laid + directions @ found
        if step % RENEWED == 0:
            normals = moved_normals(given, fit.apply)
        pairs = _pairs(Samples(here, normals, given.rim), theirs, goal)
        found = _solved(pairs, directions, here - laid, laid, marks, STIFF * options.stiffness)
        fit = SmoothFit(before, centers, basis @ found, width, pairs.rms)
    return fit


def moved_normals(samples: Samples, moves: Moves, step: float = 1e-4) -> Array:
    """Normals (n, 3) of a surface after it moved."""
    first = np.cross(samples.normals, np.eye(3)[np.argmin(np.abs(samples.normals), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(samples.normals, first)
    there, across = (moves(samples.points + step * way) - moves(samples.points - step * way) for way in (first, second))
    crossed = np.cross(there, across)
    sizes = np.linalg.norm(crossed, axis=1, keepdims=True)
    return crossed / np.where(sizes > 0, sizes, 1.0)


def _kernel(points: Array, centers: Array, width: float) -> Array:
    return np.exp(-cdist(points, centers, "sqeuclidean") / (2.0 * width**2))


@read_only
@dataclass(frozen=True, eq=False)
class _Pairs:
    """Which point of the source is drawn to which plane, and the root mean square distance of the source's points."""

    index: np.ndarray
    goals: Array
    normals: Array
    rms: float


def _pairs(here: Samples, theirs: Samples, goal: Shape) -> _Pairs:
    found = onto(goal, here.points, here.normals)
    away = np.linalg.norm(found.points - here.points, axis=1)
    near = _counting(away, found.normals, here.normals)
    if goal.is_open:
        near &= ~found.rim
    tree = cKDTree(np.column_stack([here.points, NORMAL * here.normals]))
    back = tree.query(np.column_stack([theirs.points, NORMAL * theirs.normals]))[1]
    off = np.abs(np.einsum("ij,ij->i", theirs.points - here.points[back], theirs.normals))
    reached = _counting(off, theirs.normals, here.normals[back])
    return _Pairs(
        np.concatenate([np.flatnonzero(near), back[reached]]),
        np.concatenate([found.points[near], theirs.points[reached]]),
        np.concatenate([found.normals[near], theirs.normals[reached]]),
        float(np.sqrt(np.mean(away[near] ** 2))) if near.any() else np.inf,
    )


def _counting(away: Array, normals: Array, others: Array) -> np.ndarray:
    """Pairs that face each other, the furthest left out."""
    facing = np.einsum("ij,ij->i", normals, others) > PAIR_FACING
    if facing.any():
        facing &= away <= np.quantile(away[facing], TRIMMED)
    return np.asarray(facing)


class _Marks:
    """Landmarks as rows of the equations."""

    def __init__(self, points: FeaturePoints | None, before: Moves, directions: Moves, options: MatchOptions):
        laid = np.empty((0, 3)) if points is None else before(points.source)
        self.rows = directions(laid)
        self.away = np.empty((0, 3)) if points is None else points.target - laid
        self.weight = LANDMARK * (0.01 / options.landmark_error) ** 2


def _solved(pairs: _Pairs, directions: Array, moved: Array, laid: Array, marks: _Marks, stiff: float) -> Array:
    """Coefficients (k, 3) of the kernel's directions."""
    rows, normals = directions[pairs.index], pairs.normals
    count, size = rows.shape
    along = np.einsum("ij,ij->i", normals, pairs.goals - laid[pairs.index])
    weight = marks.weight * count
    pulled = weight * marks.rows.T @ marks.rows
    matrix, right = np.empty((3, size, 3, size)), np.empty((3, size))
    for a in range(3):
        for b in range(a, 3):
            share = (1.0 - TETHER) * normals[:, a] * normals[:, b] + (TETHER if a == b else 0.0)
            matrix[a, :, b] = rows.T @ (share[:, None] * rows) + (pulled if a == b else 0.0)
            matrix[b, :, a] = matrix[a, :, b].T
        drawn = (1.0 - TETHER) * normals[:, a] * along + TETHER * moved[pairs.index, a]
        right[a] = rows.T @ drawn + weight * marks.rows.T @ marks.away[:, a]
    whole = matrix.reshape(3 * size, 3 * size)
    whole[np.diag_indices(3 * size)] += stiff * max(count, 1)
    return np.linalg.solve(whole, right.ravel()).reshape(3, size).T
