"""One bone's surface laid on another by an affine map, from the shapes alone.

The moments of the convex hull up to the second follow an affine map exactly, whatever the triangles
are and whatever holes the surface has. Two hulls brought to unit moments therefore differ by a
rotation alone: it is looked for among rotations spread over all of them, and each way that fits is
refined by closest points both ways, point to plane. An exact affine copy of a bone comes back to
rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.core.model.arrays import Array
from myomorph.core.surfaces.linear_maps import AffineMap
from myomorph.core.surfaces.surface_points import Samples, Shape

# Rotations that are tried: no rotation is further than some 25 degrees from one of them.
GRID = 800
FEW = 80
MANY = 160
TARGET = 1500
"""Points of the source with which all rotations, and those that are left, are tried; points of the
target.
"""

WAYS = 6  # Ways to lie that are refined.
APART = 2.7
SAME = 2.9
"""Traces of the rotation between two ways, 32 degrees and 18, above which they are one: before and
after refinement.
"""

NORMAL = 0.25  # How much normals count against distances, in unit moments.
FURTHEST = 1.0  # Distance above which all points count alike, in unit moments.
ROUNDS = 12  # Steps of the rotation.
POINTS = 400
STEPS = 25
SETTLED = 1e-7
"""Of each surface, and steps of an affine map at most, until one moves it less than this share of
its length.
"""

FACING = 0.3  # Cosine between normals of points that may be pairs.
TRIMMED = 0.95  # Share of the pairs that count, the nearest.
DAMPED = 1e-4  # Of a step, so that directions that the shapes do not show stay as they are.
# Weight of all landmarks together, each as exact as the surfaces, against the surfaces.
LANDMARK = 0.3
INDEPENDENT = 10.0
"""Distances that shapes of other kinds leave go together over the bone: so many of all of them tell
something of their own.
"""

STRAIN = 0.2
"""Standard deviation of the logarithms of the stretches between two bones of one kind, over that of
their mean.
"""

# Distances below this share of the bone's length say nothing of which way to lie is the right one.
EXACT = 2e-4


@dataclass(frozen=True, eq=False)
class Way:
    """A way in which a bone may lie on another."""

    affine: AffineMap  # from the source to the target, in shares of each one's length
    distance: float  # root mean square between points that face each other, both ways

    @property
    def strain(self) -> float:
        """Return the standard deviation of the logarithms of the stretches.

        It is 0 where no direction becomes longer than another.
        """
        logs = np.log(np.linalg.svd(self.affine.matrix, compute_uv=False))
        return float(np.linalg.norm(logs - logs.mean()))

    @property
    def cost(self) -> float:
        """The distance, more where bones of one kind do not stretch so."""
        return (self.distance + EXACT) * float(np.exp(0.5 * (self.strain / STRAIN) ** 2))


def hull_moments(points: Array) -> tuple[Array, Array]:
    """Return centroid and second central moments per volume of the hull of points.

    Parameters
    ----------
    points : (n, 3) [m]

    Returns
    -------
    centroid (3,) [m] and moments (3, 3) [m^2]
    """
    center = points.mean(axis=0)
    corners = (points - center)[scipy.spatial.ConvexHull(points).simplices]
    volumes = np.abs(np.linalg.det(corners)) / 6.0
    sums = corners.sum(axis=1)
    first = 0.25 * volumes @ sums / volumes.sum()
    second = np.einsum("n,nki,nkj->ij", volumes, corners, corners) + np.einsum(
        "n,ni,nj->ij", volumes, sums, sums
    )
    return center + first, second / (20.0 * volumes.sum()) - np.outer(first, first)


def affine_ways(ours: Shape, goal: Shape) -> list[Way]:
    """Different ways to lie, the likeliest first."""
    middle, root = _root_moments(ours)
    goal_middle, goal_root = _root_moments(goal)
    mine = _normal(ours.samples(MANY), middle, root)
    theirs = _normal(goal.samples(TARGET), goal_middle, goal_root)
    back = np.linalg.inv(root)
    ways = []
    for rotation in _rotations(mine, theirs, lambda turned: _unlikely(goal_root @ turned @ back)):
        matrix = goal_root @ rotation @ back
        ways.append(lay_affinely(ours, goal, AffineMap(matrix, goal_middle - matrix @ middle)))
    return sorted(ways, key=lambda way: way.cost)


def _root_moments(shape: Shape) -> tuple[Array, Array]:
    """Middle (3,) and symmetric root (3, 3) of the second moments of a hull."""
    middle, second = hull_moments(shape.vertices)
    values, vectors = np.linalg.eigh(second)
    return middle, (vectors * np.sqrt(values)) @ vectors.T


def _normal(samples: Samples, middle: Array, root: Array) -> Samples:
    """Bring samples of a surface to unit moments."""
    return Samples(
        (samples.points - middle) @ np.linalg.inv(root), unit(samples.normals @ root), samples.rim
    )


def _unlikely(matrices: Array) -> Array:
    """Factors (n,) on distances in unit moments by how the maps (n, 3, 3) stretch."""
    logs = np.log(np.linalg.svd(matrices, compute_uv=False))
    strains = np.linalg.norm(logs - logs.mean(axis=1, keepdims=True), axis=1)
    return np.asarray(np.exp(0.5 * (strains / (2.0 * STRAIN)) ** 2))


def _rotations(
    samples: Samples, theirs: Samples, unlikely: Callable[[Array], Array]
) -> list[Array]:
    """Return the few rotations (3, 3) that lay samples of unit moments on others, best first."""
    tree = scipy.spatial.cKDTree(theirs.points)

    def found(rotations: Array, step: int) -> tuple[Array, np.ndarray, Array]:
        moved = samples.points[::step] @ rotations.swapaxes(1, 2)
        distances, nearest = tree.query(moved.reshape(-1, 3))
        away = distances.reshape(moved.shape[:2])
        index = nearest.reshape(moved.shape[:2])
        facing = np.sum(
            (samples.normals[::step] @ rotations.swapaxes(1, 2)) * theirs.normals[index], axis=2
        )
        return (
            (np.minimum(away, FURTHEST) ** 2 + NORMAL * (1.0 - facing)).mean(axis=1),
            index,
            facing,
        )

    grid = rotation_grid(GRID)
    turned = grid[_distinct(grid, found(grid, MANY // FEW)[0] * unlikely(grid), APART, 16)]
    for _ in range(ROUNDS):
        _, index, facing = found(turned, 1)
        pulls = theirs.points[index] * (facing > 0.0)[:, :, None]
        turns = theirs.normals[index] * (facing > 0.0)[:, :, None]
        both = (
            pulls.swapaxes(1, 2) @ samples.points + NORMAL * turns.swapaxes(1, 2) @ samples.normals
        )
        u, _, vt = np.linalg.svd(both)
        signs = np.ones((len(turned), 3))
        signs[:, 2] = np.linalg.det(u @ vt)
        turned = (u * signs[:, None]) @ vt
    return list(turned[_distinct(turned, found(turned, 1)[0] * unlikely(turned), SAME, WAYS)])


def _distinct(rotations: Array, cost: Array, same: float, count: int) -> list[int]:
    """Numbers of the best rotations that differ from better ones."""
    chosen: list[int] = []
    for number in np.argsort(cost).tolist():
        if all(np.trace(rotations[number].T @ rotations[j]) < same for j in chosen):
            chosen.append(number)
        if len(chosen) == count:
            break
    return chosen


def rotation_grid(count: int) -> Array:
    """Spread rotations evenly over all (super-Fibonacci spirals, Alexa 2022).

    Parameters
    ----------
    count : of rotations

    Returns
    -------
    (count, 3, 3)
    """
    step = np.arange(count) + 0.5
    share = step / count
    turn = 2.0 * np.pi * step
    first = turn / np.sqrt(2.0)
    second = turn / 1.533751168755204288118041
    inner = np.sqrt(share)
    outer = np.sqrt(1.0 - share)
    parts = (
        inner * np.sin(first),
        inner * np.cos(first),
        outer * np.sin(second),
        outer * np.cos(second),
    )
    return np.asarray(
        scipy.spatial.transform.Rotation.from_quat(np.column_stack(parts)).as_matrix()
    )


def lay_affinely(
    ours: Shape, goal: Shape, start: AffineMap, landmarks: FeaturePoints | None = None
) -> Way:
    """Find the affine map near a start with which both surfaces are nearest to each other.

    `ours`, `goal`: surfaces of about unit length; `landmarks`: pull beside the surfaces.
    """
    samples = ours.samples(POINTS)
    theirs = goal.samples(POINTS)
    middle = samples.points.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((samples.points - middle) ** 2, axis=1))))
    units = np.concatenate([np.full(9, spread), np.ones(3)])
    affine = AffineMap(np.array(start.matrix), np.array(start.offset))
    distance = np.inf
    for _ in range(STEPS):
        pairs = _pairs(samples, theirs, ours, goal, affine)
        distance = pairs[3]
        if len(pairs[0]) < len(units):
            break
        gram, right = _of_surfaces(pairs, affine, middle, units)
        count = len(pairs[0])
        if landmarks is not None:
            _add_landmarks((gram, right), landmarks, affine, middle, units, count)
        _add_strain((gram, right), affine, distance, spread, count)
        step = np.linalg.solve(gram, right) / units
        grown = affine.matrix + step[:9].reshape(3, 3)
        if np.linalg.det(grown) * np.linalg.det(affine.matrix) <= 0.0:
            break
        offset = affine.matrix @ middle + affine.offset + step[9:] - grown @ middle
        affine = AffineMap(grown, offset)
        if np.abs(step * units).max() < SETTLED:
            break
    return Way(affine, distance)


def _of_surfaces(
    pairs: tuple[Array, Array, Array, float], affine: AffineMap, middle: Array, units: Array
) -> tuple[Array, Array]:
    """Return the normal equations of a change of the affine map by distances along normals.

    Unknowns are the nine entries of its matrix about `middle` (3,) and its offset, in `units`
    (12,). `pairs`: as `_pairs`.
    """
    places, goals, normals, _ = pairs
    lever = places - middle
    rows = np.hstack([(normals[:, :, None] * lever[:, None]).reshape(-1, 9), normals]) / units
    left = np.einsum("ij,ij->i", goals - places @ affine.matrix.T - affine.offset, normals)
    return rows.T @ rows, rows.T @ left


def _add_landmarks(
    equations: tuple[Array, Array],
    landmarks: FeaturePoints,
    affine: AffineMap,
    middle: Array,
    units: Array,
    count: int,
) -> None:
    """Add the pull of landmarks, beside that of `count` pairs of points."""
    gram, right = equations
    share = LANDMARK * count / len(landmarks)
    for point, to in zip(landmarks.source, landmarks.target, strict=True):
        pulled = np.hstack([np.kron(np.eye(3), point - middle), np.eye(3)]) / units
        gram += share * pulled.T @ pulled
        right += share * pulled.T @ (to - affine.matrix @ point - affine.offset)


def _add_strain(
    equations: tuple[Array, Array], affine: AffineMap, distance: float, spread: float, count: int
) -> None:
    """Draw the matrix to the rotation and size nearest to it, beside `count` pairs of points.

    `distance`: root mean square of the pairs; `spread`: of the source's points.
    """
    gram, right = equations
    u, stretches, vt = np.linalg.svd(affine.matrix)
    size = float(stretches.mean())
    held = count * max(distance, SETTLED) ** 2 / (INDEPENDENT * (STRAIN * size) ** 2) / spread**2
    gram[np.diag_indices(12)] += DAMPED * count + np.repeat([held, 0.0], [9, 3])
    right[:9] += held * spread * (size * u @ vt - affine.matrix).ravel()


def _pairs(
    samples: Samples, theirs: Samples, ours: Shape, goal: Shape, laid: AffineMap
) -> tuple[Array, Array, Array, float]:
    """Return points (n, 3) of the source, where they belong, and the normals there.

    Pairs of both directions are among them. The last value is their root mean square distance.
    """
    back = np.linalg.inv(laid.matrix)
    here = laid.apply(samples.points)
    closest = goal.nearest(here, fine=True)
    away = np.linalg.norm(closest.points - here, axis=1)
    near = counting(away, closest.normals, unit(samples.normals @ back), FACING, TRIMMED)
    if goal.is_open:
        near &= ~closest.rim
    asked = ours.nearest((theirs.points - laid.offset) @ back.T, fine=True)
    apart = np.linalg.norm(theirs.points - laid.apply(asked.points), axis=1)
    reached = counting(apart, theirs.normals, unit(asked.normals @ back), FACING, TRIMMED)
    if ours.is_open:
        reached &= ~asked.rim
    both = apart if goal.is_open else np.concatenate([away, apart])
    return (
        np.concatenate([samples.points[near], asked.points[reached]]),
        np.concatenate([closest.points[near], theirs.points[reached]]),
        np.concatenate([closest.normals[near], theirs.normals[reached]]),
        float(np.sqrt(np.mean(both**2))),
    )


def counting(away: Array, normals: Array, others: Array, cosine: float, share: float) -> np.ndarray:
    """Return the pairs that face each other, but for a share of them, the furthest.

    Parameters
    ----------
    away : (n,) distances of the pairs
    normals : (n, 3) of the one surface
    others : (n, 3) of the other
    cosine : least cosine between normals that face each other
    share : of the pairs that face each other to keep

    Returns
    -------
    (n,) whether a pair counts
    """
    facing = np.einsum("ij,ij->i", normals, others) > cosine
    if facing.any():
        facing &= away <= np.quantile(away[facing], share)
    return np.asarray(facing)


def unit(vectors: Array) -> Array:
    """Scale vectors to length one; zero stays zero.

    Parameters
    ----------
    vectors : (..., 3)

    Returns
    -------
    (..., 3)
    """
    sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(sizes > 0.0, sizes, 1.0)
