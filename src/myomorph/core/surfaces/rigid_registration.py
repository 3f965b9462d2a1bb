"""One bone's surface laid on another's: trimmed iterative closest points, point to plane.

Several starts are tried. Besl and McKay 1992, Chen and Medioni 1992 (point to plane), Chetverikov
et al. 2005 (trimming).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.causes import BONES
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity
from myomorph.core.surfaces.surface_points import Samples, Shape

# Share of the residual that the mirrored source leaves, below which the side is questioned.
MIRRORED = 0.9
# Of a part, the target's points count up to so many times the furthest of the source's that count.
MAX_DISTANCE_RATIO = 3.0
MIN_FACING = 0.7
"""Share of normals that must agree at a good fit for them to be used to tell the two sides of a
thin bone apart.
"""

COARSE = 200  # Points with which the many starts are tried.
MAX_POSES = 4  # Different poses that are looked at more closely.
MIN_SAME_TRACE = 2.9
"""Of the rotation between two poses, above which they are the same: they differ by 18 degrees."""
# A step that moves the surface less, in metres or as a share of the residual, ends the iteration.
MIN_STEP = 1e-5
MIN_STEP_SHARE = 1e-2
MAX_GROWTH = 0.1  # Of the size's logarithm in a step.
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class SurfaceOptions:
    """Options of laying surfaces on each other.

    Attributes
    ----------
    scale : find a size too
    kept : share of the points that counts, the nearest; the rest may have no counterpart [-]
    points : number of the source's points, spread evenly over its surface
    iterations : at most
    starts : rotations about each of the long axis's two directions, where no start is specified
    partial : the source is a part of the bone; None: it is where it has open edges. Of a whole bone
        the target's points count too, without which a free size shrinks into the target
    mirror : try the mirrored source too, to name a bone of the other side

    Raises
    ------
    BadData : a value out of range
    """

    scale: bool = True
    kept: float = 0.9
    points: int = 2000
    iterations: int = 100
    starts: int = 12
    partial: bool | None = None
    mirror: bool = True

    def __post_init__(self) -> None:
        if not 0.2 <= self.kept <= 1.0:
            raise BadData(f"kept is {self.kept:g}: expected a share of the points from 0.2 to 1")
        if self.points < 50 or self.iterations < 1 or self.starts < 1:
            raise BadData("expected at least 50 points, 1 iteration and 1 start")


@read_only
class SurfaceFit:
    """A surface laid on another.

    Attributes
    ----------
    similarity : from the source's frame to the target's
    distances : (vertices,) of the source's vertices to the target, positive outside: the residual
        map [m]
    kept : (vertices,) which are among the share that counts
    converged : whether the last step was small
    notes : what looks wrong, one line each
    """

    similarity: Similarity
    distances: Array
    kept: np.ndarray
    converged: bool
    notes: tuple[Message, ...] = ()

    @property
    def rms(self) -> float:
        """Root mean square distance of the vertices that count [m]."""
        return float(np.sqrt(np.mean(self.distances[self.kept] ** 2)))

    def percentile(self, share: float) -> float:
        """Compute the distance below which a share of all vertices lies.

        Parameters
        ----------
        share : 0 to 100 [%]

        Returns
        -------
        [m]
        """
        return float(np.percentile(np.abs(self.distances), share))


def register_surface(
    source: Surface,
    target: Surface,
    start: Similarity | None = None,
    options: SurfaceOptions | None = None,
) -> SurfaceFit:
    """Fit the similarity that lays a surface on another.

    The source may be a CT that is cut off, the target a model's whole bone. Points of the source
    count by their distance from the planes at the nearest points of the target, and points of the
    target by theirs from the source, of a part only those that it covers. The farthest are left
    out.

    Parameters
    ----------
    source : in its own frame [m]
    target : in its own frame [m]
    start : from picked points; None tries the axes of both shapes in all their rotations
    options : size, share of points that counts; see `SurfaceOptions`

    Returns
    -------
    the similarity from source to target, and distances of the source's vertices

    Raises
    ------
    BadData : a surface has no area
    """
    options = options or SurfaceOptions()
    goal = Shape(target)
    ours = Shape(source)

    def fitted(shape: Shape, begun: Similarity | None = None) -> RoughFit:
        """Fit a shape to the target, from the best rough fit where no start is specified."""
        begun = begun or _few_fits(shape, goal, options)[0].similarity
        return _Fitting(shape, goal, options, options.points).iterated(begun, options.iterations)

    notes: list[Message] = []
    fit = fitted(ours, start)
    if start is None and options.mirror:
        other = fitted(Shape(Surface(source.vertices * MIRROR, source.faces[:, ::-1])))
        if other.rms < MIRRORED * fit.rms:
            notes.append(
                BONES.message(
                    f"the surface fits better mirrored ({1e3 * other.rms:.2f} mm against"
                    f" {1e3 * fit.rms:.2f} mm): is it a bone of the other side?"
                )
            )
    if not fit.converged:
        notes.append(
            BONES.message(f"the fit had not converged after {options.iterations} iterations")
        )
    apart = goal.signed(fit.similarity.apply(source.vertices)) / fit.similarity.scale
    kept = np.abs(apart) <= np.quantile(np.abs(apart), options.kept)
    return SurfaceFit(
        similarity=fit.similarity,
        distances=frozen_array(apart),
        kept=kept,
        converged=fit.converged,
        notes=tuple(notes),
    )


@read_only
class RoughFit:
    """A pose of a surface on another, roughly fitted.

    Attributes
    ----------
    similarity : from the source's frame to the target's
    rms : root mean square distance that it leaves [m]
    converged : whether the last step was small
    """

    similarity: Similarity
    rms: float
    converged: bool


class _Pairs(NamedTuple):
    """Pairs of points of both surfaces.

    Attributes
    ----------
    moved : (n, 3) points of the source in the target's frame [m]
    normals : (n, 3) of the target there
    away : (n, 3) `moved` less the target's points [m]
    """

    moved: Array
    normals: Array
    away: Array

    @property
    def distance(self) -> Array:
        """Distance (n,) of the points [m]."""
        return np.linalg.norm(self.away, axis=1)

    def where(self, kept: np.ndarray) -> _Pairs:
        """Keep pairs (n,) for which `kept` holds."""
        return _Pairs(*(values[kept] for values in self))


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class _Step:
    """A step of the moved source.

    Attributes
    ----------
    turn : (3,) rotation vector about its center [rad]
    shift : (3,) [m]
    growth : factor of its size
    """

    turn: Array
    shift: Array
    growth: float

    @property
    def angle(self) -> float:
        """Angle of the rotation [rad]."""
        return float(np.linalg.norm(self.turn))

    @property
    def rotation(self) -> Array:
        """Matrix (3, 3) of the rotation."""
        return axis_rotation(self.turn / self.angle, self.angle) if self.angle > 0 else np.eye(3)

    def motion(self, radius: float) -> float:
        """Return how far points at a radius [m] move at most [m]."""
        shift = float(np.linalg.norm(self.shift))
        return self.angle * radius + shift + abs(self.growth - 1.0) * radius


class _Fitting:
    """Gauss-Newton on distances to the planes of nearest points, the farthest left out in steps.

    For a small rotation w about the center c of the moved source, a shift d and a growth g, the
    distance of a point x from the plane with the normal n at y changes to

        (x - y) . n + w . ((x - c) x n) + d . n + g (x - c) . n
    """

    def __init__(
        self, shape: Shape, goal: Shape, options: SurfaceOptions, count: int, fine: bool = True
    ):
        self.given = shape
        self.goal = goal
        self.options = options
        self.fine = fine
        self.partial = shape.is_open if options.partial is None else options.partial
        self.ours = shape.samples(count)
        self.theirs = goal.samples(count)
        self.middle = self.ours.points.mean(axis=0)
        self.radius = float(np.sqrt(np.mean(np.sum((self.ours.points - self.middle) ** 2, axis=1))))
        self.count = 7 if options.scale and fine else 6

    def iterated(self, start: Similarity, iterations: int) -> RoughFit:
        """Iterate from a start until steps are small.

        Parameters
        ----------
        start : from source to target
        iterations : at most

        Returns
        -------
        the fit, with its root mean square distance in the source's size [m]
        """
        rotation = np.array(start.rotation)
        translation = np.array(start.translation)
        size = start.scale
        converged = False
        rms = np.inf
        for _ in range(iterations):
            pairs = self.pairs(rotation, translation, size)
            center = size * rotation @ self.middle + translation
            rms = float(np.sqrt(np.mean(pairs.distance**2))) / size
            step = self._step(pairs, center)
            rotation = step.rotation @ rotation
            size = size * step.growth
            translation = center + step.shift - size * rotation @ self.middle
            tolerance = max(MIN_STEP, MIN_STEP_SHARE * rms)
            if step.motion(self.radius) < (1.0 if self.fine else 10.0) * tolerance:
                converged = True
                break
        return RoughFit(Similarity(rotation, translation, size), rms, converged)

    def _step(self, pairs: _Pairs, center: Array) -> _Step:
        """Solve the equations of the class for the step that brings points to the planes.

        Unknowns are scaled so that each moves the surface by about as much. A millionth of the sum
        of their squared slopes is added to the diagonal, for what the planes leave open.

        Parameters
        ----------
        pairs : that count
        center : (3,) of the moved source [m]
        """
        lever = pairs.moved - center
        along = np.einsum("ij,ij->i", lever, pairs.normals)[:, None]
        every = np.hstack([np.cross(lever, pairs.normals), pairs.normals, along])
        per_radius = 1.0 / self.radius
        units = np.concatenate([np.full(3, per_radius), np.ones(3), [per_radius]])[: self.count]
        slopes = every[:, : self.count] * units
        to_planes = np.einsum("ij,ij->i", pairs.away, pairs.normals)
        gram = slopes.T @ slopes + 1e-6 * np.sum(slopes**2) * np.eye(self.count)
        solution = -units * np.linalg.solve(gram, slopes.T @ to_planes)
        growth = 1.0
        if self.count == 7:
            growth = float(np.exp(np.clip(solution[6], -MAX_GROWTH, MAX_GROWTH)))
        return _Step(turn=solution[:3], shift=solution[3:6], growth=growth)

    def pairs(self, rotation: Array, translation: Array, size: float) -> _Pairs:
        """Pair the source's points with the target's nearest, and the reverse.

        Of a part, the target's points count only off the part's rim and not too far.

        Parameters
        ----------
        rotation : (3, 3) from source to target
        translation : (3,) [m]
        size : factor

        Returns
        -------
        the pairs that count
        """
        moved = size * self.ours.points @ rotation.T + translation
        closest = self.goal.nearest(moved, self.fine)
        forth = _Pairs(moved, closest.normals, moved - closest.points)
        forth = forth.where(self._kept(forth, self.ours.normals @ rotation.T, closest.normals))
        back = (self.theirs.points - translation) @ rotation / size
        nearest = self.given.nearest(back, self.fine)
        moved = size * nearest.points @ rotation.T + translation
        there = _Pairs(moved, self.theirs.normals, moved - self.theirs.points)
        kept = self._kept(there, nearest.normals @ rotation.T, self.theirs.normals)
        if self.partial:
            kept &= ~nearest.rim & (
                there.distance <= MAX_DISTANCE_RATIO * forth.distance.max(initial=0.0)
            )
        there = there.where(kept)
        return _Pairs(*(np.concatenate(both) for both in zip(forth, there, strict=True)))

    def _kept(self, pairs: _Pairs, normals: Array, others: Array) -> np.ndarray:
        """Find pairs that face each other, the farthest left out.

        Parameters
        ----------
        pairs : n of both surfaces
        normals, others : (n, 3) of source and target, in the target's frame

        Returns
        -------
        (n,) whether a pair counts
        """
        facing = np.einsum("ij,ij->i", normals, others) > 0
        sided = facing if np.mean(facing) > MIN_FACING else np.ones(len(facing), dtype=bool)
        return sided & (pairs.distance <= np.quantile(pairs.distance[sided], self.options.kept))


def rough_fits(
    source: Surface, target: Surface, options: SurfaceOptions | None = None
) -> list[RoughFit]:
    """Find the few different poses of a surface on another.

    Parameters
    ----------
    source, target : in their own frames [m]
    options : see `SurfaceOptions`

    Returns
    -------
    fits, the best first; `register_surface` refines one
    """
    return _few_fits(Shape(source), Shape(target), options or SurfaceOptions())


def _few_fits(shape: Shape, goal: Shape, options: SurfaceOptions) -> list[RoughFit]:
    """Fit few points from many starts, then the distinct best ones more closely."""
    coarse = _Fitting(shape, goal, options, COARSE, fine=False)
    fits = [coarse.iterated(start, 15) for start in _starts(shape, goal, options.starts)]
    fits.sort(key=lambda fit: fit.rms)
    distinct: list[RoughFit] = []
    for fit in fits:
        if not any(_is_same_pose(fit, other) for other in distinct):
            distinct.append(fit)
        if len(distinct) == MAX_POSES:
            break
    finer = _Fitting(shape, goal, options, COARSE)
    closer = [finer.iterated(rough.similarity, 30) for rough in distinct]
    return sorted(closer, key=lambda rough: rough.rms)


def _is_same_pose(first: RoughFit, second: RoughFit) -> bool:
    """Return whether two fits are hardly rotated against each other."""
    between = first.similarity.rotation.T @ second.similarity.rotation
    return bool(np.trace(between) >= MIN_SAME_TRACE)


def _starts(shape: Shape, goal: Shape, turns: int) -> list[Similarity]:
    """Lay long axis on long axis, either way, rotated about it, and shifted along it for a part.

    Parameters
    ----------
    shape, goal : source and target
    turns : rotations about each of the two directions

    Returns
    -------
    similarities of size 1
    """
    middle, axes, long = _axes(shape.samples(2000))
    goal_middle, goal_axes, goal_long = _axes(goal.samples(2000))
    shift = max(0.0, 0.5 * (goal_long - long))
    shifts = (0.0,) if shift < 0.05 * goal_long else (-shift, 0.0, shift)
    starts = []
    for flip in (0.0, np.pi):
        for index in range(turns):
            about_long = axis_rotation((1, 0, 0), 2 * np.pi * index / turns)
            rotation = goal_axes @ (about_long @ axis_rotation((0, 1, 0), flip)) @ axes.T
            for along in shifts:
                middle_there = goal_middle + along * goal_axes[:, 0]
                starts.append(Similarity(rotation, middle_there - rotation @ middle))
    return starts


def _axes(samples: Samples) -> tuple[Array, Array, float]:
    """Compute the principal axes of samples.

    Parameters
    ----------
    samples : of a surface

    Returns
    -------
    middle (3,) [m], axes (3, 3) as columns of a rotation, the long one first, and the length along
    it [m]
    """
    middle = samples.points.mean(axis=0)
    _, _, rows = np.linalg.svd(samples.points - middle, full_matrices=False)
    axes = rows.T * np.array([1.0, 1.0, np.sign(np.linalg.det(rows))])
    along = (samples.points - middle) @ axes[:, 0]
    return middle, axes, float(np.ptp(along))
