"""One bone's surface laid on another's: trimmed iterative closest points, point to plane, with several starts.

Besl and McKay 1992, Chen and Medioni 1992 (point to plane), Chetverikov et al. 2005 (trimming).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from myomorph.model.errors import BadData
from myomorph.model.spatial import Array, axis_rotation, frozen_array
from myomorph.model.surface import Surface
from myomorph.morph.procrustes import Similarity

PATCH = 1e-4
"""Area over which errors of two surfaces go together, for standard deviations [m^2]."""

FACING = 0.7
"""Share of normals that must agree at a good fit for them to be used to tell the two sides of a thin bone apart."""


COARSE = 200
"""Points with which the many starts are tried."""

SETTLED = 1e-5
"""A step that moves the surface less ends the iteration [m]."""

MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class SurfaceOptions:
    """How surfaces are laid on each other.

    Attributes
    ----------
    scale : find a size too
    kept : share of the points that counts, the nearest; the rest may have no counterpart
    points : of the source, spread evenly over its surface
    iterations : at most
    starts : turns about each of the long axis's two directions, where no start is given
    mirror : try the mirrored source too, to name a bone of the other side
    """

    scale: bool = True
    kept: float = 0.9
    points: int = 2000
    iterations: int = 100
    starts: int = 12
    mirror: bool = True

    def __post_init__(self) -> None:
        if not 0.2 <= self.kept <= 1.0:
            raise BadData(f"kept is {self.kept:g}: expected a share of the points from 0.2 to 1")
        if self.points < 50 or self.iterations < 1 or self.starts < 1:
            raise BadData("expected at least 50 points, 1 iteration and 1 start")


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """A surface laid on another.

    Attributes
    ----------
    similarity : from the source's frame to the target's
    distances : (vertices,) of the source's vertices to the target, positive outside: the residual map [m]
    kept : (vertices,) which are among the share that counts
    covariance : (7, 7) of rotation vector [rad], translation of the source's middle [m] and logarithm of scale, in
        the target's frame, as if errors were independent from square centimetre to square centimetre
    converged : whether the last step was small
    notes : what looks wrong, one line each
    """

    similarity: Similarity
    distances: Array
    kept: np.ndarray
    covariance: Array
    converged: bool
    notes: tuple[str, ...] = ()

    @property
    def rms(self) -> float:
        """Root mean square distance of the vertices that count [m]."""
        return float(np.sqrt(np.mean(self.distances[self.kept] ** 2)))

    def percentile(self, share: float) -> float:
        """Distance below which that share (0 to 100) of all vertices lies [m]."""
        return float(np.percentile(np.abs(self.distances), share))


def register_surface(
    source: Surface, target: Surface, start: Similarity | None = None, options: SurfaceOptions | None = None
) -> SurfaceFit:
    """The similarity that lays a surface (a CT, perhaps cut off) on another (a model's whole bone).

    Parameters
    ----------
    start : from picked points; None tries the axes of both shapes in all their turns

    Raises
    ------
    BadData : a surface without area
    """
    options = options or SurfaceOptions()
    goal, given = _Goal(target), _sampled(source, options.points)
    notes: list[str] = []
    if start is None:
        found = _from_starts(given, goal, options)
        if options.mirror:
            other = _from_starts(_Samples(given.points * MIRROR, given.normals * MIRROR, given.area), goal, options)
            if other.rms < 0.7 * found.rms:
                notes.append(
                    f"the surface fits better mirrored ({1e3 * other.rms:.2f} mm against {1e3 * found.rms:.2f} mm): is "
                    "it a bone of the other side?"
                )
    else:
        found = _iterated(given, goal, start, options.iterations, options, fine=True)
    if not found.converged:
        notes.append(f"the fit had not settled after {options.iterations} iterations")
    apart = goal.signed(found.similarity.apply(source.vertices)) / found.similarity.scale
    kept = np.abs(apart) <= np.quantile(np.abs(apart), options.kept)
    return SurfaceFit(
        similarity=found.similarity,
        distances=frozen_array(apart),
        kept=kept,
        covariance=frozen_array(_covariance(found, given, options)),
        converged=found.converged,
        notes=tuple(notes),
    )


@dataclass(frozen=True, eq=False)
class _Samples:
    """Points (n, 3) and outward normals (n, 3) spread over a surface of an area [m^2]."""

    points: Array
    normals: Array
    area: float


@dataclass(frozen=True, eq=False)
class _Found:
    similarity: Similarity
    rms: float
    converged: bool
    slopes: Array


class _Goal:
    """The surface that is laid on: its nearest points and normals."""

    def __init__(self, surface: Surface):
        self.vertices = np.array(surface.vertices)
        self.faces = np.array(surface.faces)
        self.normals, areas = _face_normals(surface)
        if not areas.sum() > 0:
            raise BadData("the surface to lay on has no area")
        self.samples = _sampled(surface, 4000)
        self.tree = cKDTree(self.samples.points)

    def nearest(self, points: Array, fine: bool) -> tuple[Array, Array]:
        """Nearest points and their normals, (n, 3) each; `fine` to the triangles themselves."""
        if not fine:
            index = self.tree.query(points)[1]
            return self.samples.points[index], self.samples.normals[index]
        import igl

        _, face, closest = igl.point_mesh_squared_distance(np.ascontiguousarray(points), self.vertices, self.faces)
        return closest, self.normals[face]

    def signed(self, points: Array) -> Array:
        """Distances (n,), positive outside [m]."""
        closest, normals = self.nearest(points, fine=True)
        away = points - closest
        side = np.sign(np.einsum("ij,ij->i", away, normals))
        distances: Array = np.where(side < 0, -1.0, 1.0) * np.linalg.norm(away, axis=1)
        return distances


def _face_normals(surface: Surface) -> tuple[Array, Array]:
    """Outward unit normals (faces, 3) and areas (faces,)."""
    corners = surface.vertices[surface.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(crossed, axis=1)
    middle = surface.vertices.mean(axis=0)
    volume = np.einsum("ij,ij->", corners[:, 0] - middle, np.cross(corners[:, 1] - middle, corners[:, 2] - middle))
    outward = -1.0 if volume < 0 else 1.0
    return outward * crossed / np.where(sizes > 0, sizes, 1.0)[:, None], 0.5 * sizes


def _sampled(surface: Surface, count: int) -> _Samples:
    """Points spread evenly over the surface; the same each time."""
    normals, areas = _face_normals(surface)
    if not areas.sum() > 0:
        raise BadData("a surface has no area")
    random = np.random.default_rng(0)
    # One point in every equal share of the area, in the order of the faces, spreads better than chance.
    places = (np.arange(count) + random.random(count)) / count * areas.sum()
    face = np.minimum(np.searchsorted(np.cumsum(areas), places), len(areas) - 1)
    a, b = np.sqrt(random.random(count)), random.random(count)
    shares = np.stack([1.0 - a, a * (1.0 - b), a * b], axis=1)
    points = np.einsum("ij,ijk->ik", shares, surface.vertices[surface.faces[face]])
    return _Samples(points, normals[face], float(areas.sum()))


def _iterated(
    given: _Samples, goal: _Goal, start: Similarity, iterations: int, options: SurfaceOptions, fine: bool
) -> _Found:
    """Gauss-Newton on distances to the planes of the nearest points, the furthest left out in each step."""
    rotation, translation, size = np.array(start.rotation), np.array(start.translation), start.scale
    middle = given.points.mean(axis=0)
    radius = float(np.sqrt(np.mean(np.sum((given.points - middle) ** 2, axis=1))))
    count = 7 if options.scale and fine else 6
    converged, slopes, rms = False, np.zeros((1, count)), np.inf
    for _ in range(iterations):
        moved = size * given.points @ rotation.T + translation
        closest, normals = goal.nearest(moved, fine)
        away = moved - closest
        facing = np.einsum("ij,ij->i", given.normals @ rotation.T, normals)
        apart = np.einsum("ij,ij->i", away, normals)
        distance = np.linalg.norm(away, axis=1)
        sided = facing > 0 if np.mean(facing > 0) > FACING else np.ones(len(facing), dtype=bool)
        kept = sided & (distance <= np.quantile(distance[sided], options.kept))
        center = size * rotation @ middle + translation
        lever = (moved - center)[kept]
        normal = normals[kept]
        slopes = np.concatenate(
            [np.cross(lever, normal), normal, np.einsum("ij,ij->i", lever, normal)[:, None]], axis=1
        )[:, :count]
        rms = float(np.sqrt(np.mean(distance[kept] ** 2))) / size
        columns = np.concatenate([np.full(3, 1.0 / radius), np.ones(3), [1.0 / radius]])[:count]
        scaled = slopes * columns
        gram = scaled.T @ scaled
        step = -columns * np.linalg.solve(gram + 1e-6 * np.trace(gram) * np.eye(count), scaled.T @ apart[kept])
        angle = float(np.linalg.norm(step[:3]))
        turn = axis_rotation(step[:3] / angle, angle) if angle > 0 else np.eye(3)
        growth = float(np.exp(np.clip(step[6], -0.1, 0.1))) if count == 7 else 1.0
        rotation, size = turn @ rotation, size * growth
        translation = center + step[3:6] - size * rotation @ middle
        if angle * radius + np.linalg.norm(step[3:6]) + abs(growth - 1.0) * radius < (
            SETTLED if fine else 10 * SETTLED
        ):
            converged = True
            break
    return _Found(Similarity(rotation, translation, size), rms, converged, slopes)


def _from_starts(given: _Samples, goal: _Goal, options: SurfaceOptions) -> _Found:
    """The best of many coarse fits, refined."""
    every = max(1, len(given.points) // COARSE)
    few = _Samples(given.points[::every], given.normals[::every], given.area)
    found = [_iterated(few, goal, start, 15, options, fine=False) for start in _starts(given, goal, options.starts)]
    found.sort(key=lambda one: one.rms)
    distinct: list[_Found] = []
    for one in found:
        if all(np.trace(one.similarity.rotation.T @ other.similarity.rotation) < 2.9 for other in distinct):
            distinct.append(one)
        if len(distinct) == 4:
            break
    finer = [_iterated(few, goal, one.similarity, 30, options, fine=True) for one in distinct]
    best = min(finer, key=lambda one: one.rms)
    return _iterated(given, goal, best.similarity, options.iterations, options, fine=True)


def _starts(given: _Samples, goal: _Goal, turns: int) -> list[Similarity]:
    """Long axis on long axis, either way, turned about it, and shifted along it for a bone that is cut off."""
    (middle, axes, long), (goal_middle, goal_axes, goal_long) = (_axes(one) for one in (given, goal.samples))
    shift = max(0.0, 0.5 * (goal_long - long))
    shifts = (0.0,) if shift < 0.05 * goal_long else (-shift, 0.0, shift)
    starts = []
    for flip in (0.0, np.pi):
        for k in range(turns):
            spin = axis_rotation((1, 0, 0), 2 * np.pi * k / turns) @ axis_rotation((0, 1, 0), flip)
            rotation = goal_axes @ spin @ axes.T
            starts += [
                Similarity(rotation, goal_middle + along * goal_axes[:, 0] - rotation @ middle) for along in shifts
            ]
    return starts


def _axes(samples: _Samples) -> tuple[Array, Array, float]:
    """Middle (3,), principal axes (3, 3) as columns of a rotation, the long one first, and the length along it."""
    middle = samples.points.mean(axis=0)
    _, _, rows = np.linalg.svd(samples.points - middle, full_matrices=False)
    axes = rows.T * np.array([1.0, 1.0, np.sign(np.linalg.det(rows))])
    along = (samples.points - middle) @ axes[:, 0]
    return middle, axes, float(np.ptp(along))


def _covariance(found: _Found, given: _Samples, options: SurfaceOptions) -> Array:
    """Covariance (7, 7) of a step from the solution, zero for a scale that was not looked for."""
    rows, count = found.slopes.shape
    independent = max(given.area * options.kept / PATCH, count + 1.0)
    radius = np.sqrt(given.area) * found.similarity.scale
    units = np.concatenate([np.full(3, radius), np.ones(3), [radius]])[:count]
    information = (found.slopes / units).T @ (found.slopes / units) * (independent / rows)
    # A direction that the shape does not show at all keeps a large variance instead of none.
    information += 1e-9 * np.trace(information) * np.eye(count)
    result = np.zeros((7, 7))
    found_variance = (found.rms * found.similarity.scale) ** 2 * np.linalg.inv(information)
    result[:count, :count] = found_variance / np.outer(units, units)
    return result
