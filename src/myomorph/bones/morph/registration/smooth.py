"""One surface deformed smoothly toward another, from an affine map of it.

What the affine map leaves is a random smooth displacement, as far as is known before: a sum of
three Gaussian processes over the source,

    cov(u(x), u(y)) = sum_k s_k^2 exp(-|x - y|^2 / (2 h_k^2)) ,

wide and large to narrow and small. Surfaces tell of it what planes (y_i, n_i) at nearest points
tell, found both ways anew in each step,

    min  sum_i w (n_i . (x_i + u(x_i) - y_i))^2 + |c|^2 ,
    u = sum_j c_j phi_j ,   w = N / (n s^2) ,

with s going from coarse to fine. Points may slide along the surface at little cost; where they go
along it is what is likeliest of the displacement, and how sure that is the matrix of the last step
tells (`SmoothFit.spread`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.affine import counting, unit
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.surfaces.linear_maps import AffineMap
from myomorph.core.surfaces.surface_points import Samples, Shape

OVERSAMPLED = 6  # Random points for every evenly spread one.
FACING = 0.2  # Cosine between normals above which two surfaces face the same way.
NEIGHBORS = 64  # Samples of the target that are asked for one that faces the same way.


@dataclass(frozen=True)
class MatchOptions:
    """How the points of two bones find each other.

    Attributes
    ----------
    features : feature points of a bone; "dense": points spread over the matched surfaces, and
        landmarks if there are some; "landmarks": landmarks alone
    feature_count : number of feature points of a dense match, spread evenly
    match_points : number of points of each surface in the non-rigid registration
    stiffness : stiffness of the deformation relative to the default
    match_kernel_width : distance over which points move together, in standard deviations of the
        bone's points along an axis
    landmark_error : standard deviation of a picked landmark, relative to the bone's length
    match_tolerance : match distance, relative to the bone's length: source points farther from the
        target are not matched, target parts farther from the source are not covered
    """

    features: Literal["dense", "landmarks"] = "dense"
    feature_count: int = 600
    match_points: int = 2000
    stiffness: float = 1.0
    match_kernel_width: float = 2.0
    landmark_error: float = 0.005
    match_tolerance: float = 0.02

    def __post_init__(self) -> None:
        if not 20 <= self.feature_count <= 5000 or not 100 <= self.match_points <= 5000:
            raise BadData(
                "expected 20 to 5000 feature points, and 100 to 5000 points in the registration"
            )
        if not self.stiffness > 0 or not 0.5 <= self.match_kernel_width <= 100:
            raise BadData("expected a stiffness above 0 and a match_kernel_width from 0.5 to 100")
        for name in ("landmark_error", "match_tolerance"):
            if not 0.0 < getattr(self, name) <= 0.2:
                raise BadData(
                    f"{name} is {getattr(self, name):g}: expected a share of the bone's length up"
                    " to 0.2"
                )


def spread_points(shape: Shape, count: int) -> Array:
    """Choose points of a surface, each as far as can be from those before it.

    Parameters
    ----------
    shape : surface to sample
    count : of points

    Returns
    -------
    (count, 3) points, in the surface's unit
    """
    points = shape.samples(OVERSAMPLED * count).points
    chosen = np.empty(count, dtype=np.intp)
    chosen[0] = 0
    nearest = np.sum((points - points[0]) ** 2, axis=1)
    for index in range(1, count):
        chosen[index] = int(np.argmax(nearest))
        nearest = np.minimum(nearest, np.sum((points - points[chosen[index]]) ** 2, axis=1))
    return points[chosen]


def onto(goal: Shape, points: Array, normals: Array) -> Samples:
    """Find the nearest points of a surface that face the same way, so a thin bone keeps its sides.

    Parameters
    ----------
    goal : surface
    points : (n, 3) to find the nearest of, in the surface's unit
    normals : (n, 3) unit vectors that the surface there should face along

    Returns
    -------
    (n,) samples of the surface
    """
    result = goal.nearest(points, fine=True)
    wrong = np.flatnonzero(np.einsum("ij,ij->i", result.normals, normals) < FACING)
    if not len(wrong):
        return result
    dense, tree = goal.dense
    near = tree.query(points[wrong], NEIGHBORS)[1]
    facing = np.einsum("ijk,ik->ij", dense.normals[near], normals[wrong]) > FACING
    turned = np.flatnonzero(facing.any(axis=1))
    index = near[turned, np.argmax(facing[turned], axis=1)]
    values = {field: getattr(result, field).copy() for field in ("points", "normals", "rim")}
    for field, value in values.items():
        value[wrong[turned]] = getattr(dense, field)[index]
    return replace(result, **values)


WIDTHS = (1.0, 0.5, 0.2)
SIZES = (0.02, 0.008, 0.003)
"""Of the three processes: widths in shares of the widest, standard deviations along an axis in
shares of the bone's length. Chosen on persons 1, 7, 13, 19 and 25 of LLP26; on made deformations
others do the same.
"""

# Standard deviation of what is left of the affine map, lengths in shares of the bone's.
AFFINE = 0.05
EXACTNESS = (0.01, 0.004, 0.002, 0.001, 0.001, 0.001, 0.0005, 0.0005, 0.0005, 0.0005)
"""Of the planes in each step, in shares of the bone's length."""

UNLIKE = 1.0
"""Planes are no more exact than so many times the distance that is left: where one surface is cut
into coarse triangles or has another shape, drawing it closer would slide its points.
"""

# Errors of planes go together around each: so many of all of them tell something of their own.
INDEPENDENT = 400.0
CENTERS = 200
RANK = 1e-5
"""Points of the kernel, and the share of its greatest eigenvalue below which a direction is left
out.
"""

TETHER = 0.001
"""Share of a step's cost that holds points back along the surface. Ten times as much holds them so
hard that a shaft has not slid to its place when the steps end: 9 mm of a tibia.
"""

TRIMMED = 0.98  # Share of the pairs that count, the nearest.
PAIR_FACING = 0.3  # Cosine between normals of points that may be pairs.
# Share of the bone's length that counts as much as a right angle between normals, in looking for
# pairs.
NORMAL = 0.1
TILT = 1e-4  # Distance over which the derivatives along the surface are taken.


@read_only
class SmoothFit:
    """A displacement after an affine map, lengths in shares of the bone's."""

    before: AffineMap  # what it starts from
    basis: Callable[[Array], Array]  # phi_j of points (n, 3): (n, k)
    coefficients: Array  # (k, 3) of them
    information: Array  # (3 k, 3 k) how well the coefficients are known, axis by axis
    # root mean square distance from the source's points to the target, of those that count
    rms: float

    def apply(self, points: Array) -> Array:
        """Displace points of the source onto the target, or as near as is smooth.

        Parameters
        ----------
        points : (n, 3) of the source, in shares of the bone's length

        Returns
        -------
        (n, 3) on the target, in shares of its length
        """
        return self.before.apply(points) + self.basis(points) @ self.coefficients

    @property
    def bending(self) -> float:
        """Return how unlikely the displacement is.

        It sums the squares of the coefficients in their standard deviations.
        """
        return float(np.sum(self.coefficients**2))

    def spread(self, points: Array) -> Array:
        """Return the standard deviation of the targets of source points, all axes together.

        Parameters
        ----------
        points : (n, 3) of the source, in shares of the bone's length

        Returns
        -------
        (n,) standard deviations, in shares of the bone's length
        """
        rows = self.basis(points)
        inverse = np.linalg.inv(self.information).reshape(3, rows.shape[1], 3, rows.shape[1])
        return np.sqrt(
            sum(np.einsum("nk,kl,nl->n", rows, inverse[a, :, a], rows) for a in range(3))
        )


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two surfaces to be laid on each other, in shares of the bone's length.

    Attributes
    ----------
    ours, goal : surfaces of source and target
    landmarks : on both, which pull beside the surfaces; None without
    """

    ours: Shape
    goal: Shape
    landmarks: FeaturePoints | None = None

    @property
    def turned(self) -> SurfacePair:
        """The same from target to source."""
        marks = self.landmarks
        if marks is not None:
            marks = FeaturePoints(marks.names, marks.target, marks.source)
        return SurfacePair(self.goal, self.ours, marks)


def fit_smoothly(
    surfaces: SurfacePair,
    before: AffineMap,
    options: MatchOptions,
    exactness: tuple[float, ...] = EXACTNESS,
) -> SmoothFit:
    """Fit the smooth displacement that brings a surface, laid on another, onto it.

    Lengths are shares of the bone's.
    """
    sparse = _Moving(surfaces.ours.samples(options.match_points), before)
    dense = _Moving(surfaces.ours.samples(2 * options.match_points), before)
    theirs = surfaces.goal.samples(options.match_points)
    basis = _basis(surfaces.ours, options)
    for moving in (sparse, dense):
        moving.follow(basis)
    size = sparse.rows.shape[1]
    pulled = np.zeros((size, size))
    drawn = np.zeros((3, size))
    if surfaces.landmarks is not None:
        pulled, drawn = _landmark_pull(surfaces.landmarks, basis, before, options.landmark_error)
    displacement: Array = np.zeros((size, 3))
    information = np.eye(3 * size)
    rms = np.inf
    for exact in exactness:
        pairs = _pairs(sparse, dense, theirs, surfaces.goal, displacement)
        rms = pairs.rms
        exact = max(exact, UNLIKE * rms) if np.isfinite(rms) else exact
        information, right = _equations(
            pairs, TETHER, INDEPENDENT / (exact**2 * max(len(pairs.rows), 1))
        )
        for a in range(3):
            information[a, :, a] += pulled
        whole = information.reshape(3 * size, 3 * size)
        whole[np.diag_indices(3 * size)] += 1.0
        displacement = (
            np.asarray(np.linalg.solve(whole, (right + drawn).ravel()), float).reshape(3, size).T
        )
    return SmoothFit(
        before=before,
        basis=basis,
        coefficients=displacement,
        information=information.reshape(3 * size, 3 * size),
        rms=rms,
    )


def _basis(ours: Shape, options: MatchOptions) -> Callable[[Array], Array]:
    """Functions of points whose sum with independent coefficients of variance 1 is the process."""
    points = ours.samples(options.match_points).points
    middle = points.mean(axis=0)
    width = options.match_kernel_width * float(np.sqrt(np.mean((points - middle) ** 2)))
    centers = spread_points(ours, CENTERS)

    def kernel(asked: Array) -> Array:
        squares = scipy.spatial.distance.cdist(asked, centers, "sqeuclidean")
        parts = (
            s**2 * np.exp(-squares / (2.0 * (width * h) ** 2))
            for h, s in zip(WIDTHS, SIZES, strict=True)
        )
        return np.asarray(sum(parts)) / options.stiffness

    values, vectors = np.linalg.eigh(kernel(centers))
    kept = values > RANK * values[-1]
    roots = vectors[:, kept] / np.sqrt(values[kept])

    def basis(asked: Array) -> Array:
        return np.hstack(
            [kernel(asked) @ roots, AFFINE * (asked - middle), np.full((len(asked), 1), AFFINE)]
        )

    return basis


class _Moving:
    """Points of the source on their way, with their normals."""

    def __init__(self, samples: Samples, before: AffineMap):
        self.samples = samples
        self.laid = before.apply(samples.points)
        first = unit(
            np.cross(samples.normals, np.eye(3)[np.argmin(np.abs(samples.normals), axis=1)])
        )
        self.along = first, np.cross(samples.normals, first)
        self.turned = tuple(2.0 * TILT * direction @ before.matrix.T for direction in self.along)

    def follow(self, basis: Callable[[Array], Array]) -> None:
        """Take the functions of a basis at the points, and their differences along the surface."""
        points = self.samples.points
        self.rows = basis(points)
        self.slopes = tuple(
            basis(points + TILT * axis) - basis(points - TILT * axis) for axis in self.along
        )

    def at(self, coefficients: Array) -> Samples:
        """Where they are."""
        first_start, second_start = self.turned
        first_slope, second_slope = self.slopes
        first = first_start + first_slope @ coefficients
        second = second_start + second_slope @ coefficients
        return Samples(
            self.laid + self.rows @ coefficients, unit(np.cross(first, second)), self.samples.rim
        )


@read_only
class _Pairs:
    """Points of the source and the planes that they are drawn to.

    Beside them are rows of the basis, distances that are left, and how far the points moved. `rms`
    is the root mean square distance of the source's points.
    """

    rows: Array
    normals: Array
    along: Array
    moved: Array
    rms: float


def _pairs(
    moving: _Moving, dense: _Moving, theirs: Samples, goal: Shape, coefficients: Array
) -> _Pairs:
    here = moving.at(coefficients)
    many = dense.at(coefficients)
    closest = onto(goal, here.points, here.normals)
    away = np.linalg.norm(closest.points - here.points, axis=1)
    near = counting(away, closest.normals, here.normals, PAIR_FACING, TRIMMED) & ~closest.rim
    tree = scipy.spatial.cKDTree(np.column_stack([many.points, NORMAL * many.normals]))
    back = tree.query(np.column_stack([theirs.points, NORMAL * theirs.normals]))[1]
    off = np.abs(np.einsum("ij,ij->i", theirs.points - many.points[back], theirs.normals))
    reached = counting(off, theirs.normals, many.normals[back], PAIR_FACING, TRIMMED)
    first = np.flatnonzero(near)
    index = back[reached]
    laid = np.concatenate([moving.laid[first], dense.laid[index]])
    goals = np.concatenate([closest.points[near], theirs.points[reached]])
    normals = np.concatenate([closest.normals[near], theirs.normals[reached]])
    return _Pairs(
        np.concatenate([moving.rows[first], dense.rows[index]]),
        normals,
        np.einsum("ij,ij->i", normals, goals - laid),
        np.concatenate([here.points[first], many.points[index]]) - laid,
        float(np.sqrt(np.mean(away[near] ** 2))) if near.any() else np.inf,
    )


def _equations(pairs: _Pairs, tether: float, weight: float) -> tuple[Array, Array]:
    """Matrix (3, k, 3, k) and right side (3, k) of the coefficients, axis by axis."""
    rows = pairs.rows
    normals = pairs.normals
    size = rows.shape[1]
    matrix = np.empty((3, size, 3, size))
    right = np.empty((3, size))
    for a in range(3):
        for b in range(a, 3):
            share = (1.0 - tether) * normals[:, a] * normals[:, b] + (tether if a == b else 0.0)
            matrix[a, :, b] = weight * rows.T @ (share[:, None] * rows)
            matrix[b, :, a] = matrix[a, :, b].T
        right[a] = (
            weight
            * rows.T
            @ ((1.0 - tether) * normals[:, a] * pairs.along + tether * pairs.moved[:, a])
        )
    return matrix, right


SOFTER = 0.25
NARROWER = 0.5  # Factors on the stiffness and on the width of the other displacement.
POINTS = 1200  # Of each surface in the other displacements, at most.
FLOOR = 1e-4  # What is added to the differences, in shares of the bone's length.
COEFFICIENTS = (2.867, 0.431, 0.258, 0.491)
MAX_DISTANCE = 0.0592
"""Constant, and of the logarithms of the differences from the softer, the way back, and of what is
left; the share of the bone's length that radii come near, as not even an affine map misses by more.
Fitted to attachments: 41 random deformations of seven bones of a leg, and persons 1, 5, 9, ... 21
of LLP26 as the model has them, which count threefold, and from a template cut into 80 to 700
triangles, as OpenSim's bones are; tried on others (`benchmarks/accuracy/morph/correspondence.py`).
"""


def _landmark_pull(
    landmarks: FeaturePoints, basis: Callable[[Array], Array], before: AffineMap, error: float
) -> tuple[Array, Array]:
    """Return the normal equations of the pull of landmarks, (size, size) and (3, size).

    `error`: of a landmark, as a share of the bone's length.
    """
    rows = basis(landmarks.source)
    exact = 1.0 / error**2
    pulled = exact * rows.T @ rows
    drawn = exact * (landmarks.target - before.apply(landmarks.source)).T @ rows
    return pulled, drawn


def match_radii(
    surfaces: SurfacePair, fit: SmoothFit, points: Array, options: MatchOptions
) -> Array:
    """Return the distances within which points of the source belong with 90 %.

    Parameters
    ----------
    surfaces : of source and target
    fit : between them
    points : (n, 3) of the source, in shares of the bone's length
    options : of the match

    Returns
    -------
    (n,) distances, in shares of the bone's length
    """
    few = replace(options, match_points=min(POINTS, options.match_points))
    narrow = max(0.5, NARROWER * options.match_kernel_width)
    softer = replace(few, stiffness=SOFTER * options.stiffness, match_kernel_width=narrow)
    here = fit.apply(points)
    beside = [fit_smoothly(surfaces, fit.before, softer).apply(points) - here]
    back = fit_smoothly(surfaces.turned, fit.before.inverse(), few).apply(here) - points
    stretch = float(np.linalg.svd(fit.before.matrix, compute_uv=False).mean())
    beside.append(stretch * back)
    apart = [np.linalg.norm(difference, axis=1) for difference in beside] + [
        np.full(len(points), fit.rms)
    ]
    constant, *factors = COEFFICIENTS
    logs = sum(b * np.log(distance + FLOOR) for b, distance in zip(factors, apart, strict=True))
    return np.asarray(1.0 / np.hypot(np.exp(-constant - logs), 1.0 / MAX_DISTANCE))
