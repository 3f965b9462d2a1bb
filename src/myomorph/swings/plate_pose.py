"""Where a force plate lies among the markers: its pose by least squares over marked placements.

Each placement gives a line in the plate's axes, the line of action of the measured force, and in
the laboratory a point that it passes through and its direction ([S] III: "the weight with optical
markers"). With R, p the plate's axes and the center of its top surface, f the unit force, r its
line's point nearest to the center, c the point and u the direction in the laboratory, the residuals
across the line are

    angle:     the part of R f across u,    distance:     the part of c - p - R r across R f.

A weight at rest shows the tilt (u is vertical) and, by its places, the turn about the vertical and
the place in the plane; never the height. Pushes of a rod in oblique directions show the height too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from myomorph.core.contact.plate_placements import Placement
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Evaluation, Rows
from myomorph.core.fit.solver import Method, Solution, minimize
from myomorph.core.fit.unknowns import Block, Bools, Unknown, Unknowns, Values, turned
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.spatial import (
    axis_rotation,
    least_rotation,
    vector_from_rotation,
)

MAX_SD = 0.02  # Position with a larger standard deviation counts as not shown [m]
LEVER_ARM = 0.2  # Length by which a rotation counts as a displacement [m]
# A step smaller than 1e-9 m, in these units of rotation and position, ends the search.
METHOD = Method(iterations=50, tolerance=1e-9 / MAX_SD, min_gain=0.0, hidden_sd=1.0)
# From each start, of which the best goes on: a step smaller than 0.2 mm is enough
ROUGH_METHOD = replace(METHOD, iterations=8, tolerance=1e-2)
ROTATION_COUNT = 6  # Starts about the vertical
FORCE_SD = 0.5  # Of a placement's mean force [N]
MOMENT_SD = 0.1  # Of a placement's mean moment [N m]
POINT_SD = 0.001  # Of the marked point [m]
DIRECTION_SD = 0.002  # Of the marked direction [rad]


@read_only
class Pose:
    """Axes and center of a plate's top surface, in the laboratory.

    Attributes
    ----------
    rotation : (3, 3) the plate's axes as columns
    center : (3,) [m]
    """

    rotation: Array
    center: Array

    @property
    def unknowns(self) -> Unknowns:
        """The pose as unknowns that start at it, without priors nor bounds."""
        vector = vector_from_rotation(self.rotation)
        rotation = tuple(
            Unknown(
                name=f"plate rotation {axis}",
                unit="rad",
                where="axes of the force plate in the laboratory",
                start=float(value),
                scale=MAX_SD / LEVER_ARM,
            )
            for axis, value in zip("xyz", vector, strict=True)
        )
        center = tuple(
            Unknown(
                name=f"plate center {axis}",
                unit="m",
                where="center of the force plate's top surface in the laboratory",
                start=float(value),
                scale=MAX_SD,
            )
            for axis, value in zip("xyz", self.center, strict=True)
        )
        return Unknowns(
            (
                Block(name="rotation", unknowns=rotation, chart=turned),
                Block(name="center", unknowns=center),
            )
        )


@read_only
class PlatePose(Pose):
    """A pose and what is known of it.

    Attributes
    ----------
    posterior : of rotation vector [rad] and center [m] about the laboratory's axes, with the noise
        that the residuals show
    cost : sum of squared residuals in standard deviations
    """

    posterior: Posterior
    cost: float

    @property
    def covariance(self) -> Array:
        """(6, 6) of rotation vector [rad] and center [m], 0 along what is not shown."""
        return self.posterior.covariance

    @property
    def unknown(self) -> Array:
        """(6, k) unit directions of (0.2 m times rotation vector, center) that nothing shows."""
        return self.posterior.hidden.T


def perpendiculars(directions: Array) -> Array:
    """Two unit vectors across each direction.

    Parameters
    ----------
    directions : (n, 3) unit

    Returns
    -------
    (n, 2, 3) across the direction and each other
    """
    # The axis that the direction has the smallest part in is never parallel to it.
    aside = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, aside)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def cross_matrices(vectors: Array) -> Array:
    """Matrices [v]x with [v]x a = v x a.

    Parameters
    ----------
    vectors : (..., 3)

    Returns
    -------
    (..., 3, 3)
    """
    # Columns v x e_i are the rows of e_i x v with the sign of a transpose.
    return np.cross(np.eye(3), vectors[..., None, :])


@read_only
class LineResiduals:
    """Residuals of lines of action and surface contacts, by a plate's pose (`core.fit.Residuals`).

    Attributes
    ----------
    nearest : (placements, 3) point of each line nearest to the plate's center, in its axes [m]
    forces : (placements, 3) unit forces, in the plate's axes
    sides : (placements, 2, 3) unit vectors across the forces, in the plate's axes
    points : (placements, 3) that the lines pass through, in the laboratory [m]
    directions : (placements, 3) of the lines, unit, in the laboratory
    beside : (placements, 2, 3) unit vectors across the directions, in the laboratory
    noise : (placements, 4) standard deviations of the residuals [rad], [rad], [m], [m]
    contacts : (placements, 3) points on the plate's surface, in the laboratory, NaN where not
        known [m]
    force_matrices : (placements, 3, 3) [f]x of the forces
    side_matrices : (placements, 2, 3, 3) [s]x of the sides
    """

    nearest: Array
    forces: Array
    sides: Array
    points: Array
    directions: Array
    beside: Array
    noise: Array
    contacts: Array
    force_matrices: Array
    side_matrices: Array
    name: str = field(default="lines of placements", init=False)
    blocks: tuple[str, ...] = field(default=("rotation", "center"), init=False)
    prior: bool = field(default=False, init=False)

    @classmethod
    def of(cls, placements: Sequence[Placement]) -> LineResiduals:
        """Placements as arrays."""
        lines = [placement.line for placement in placements]
        forces = np.array([force for _, force in lines])
        directions = np.array([placement.direction for placement in placements])
        sizes = np.array([placement.size for placement in placements])
        angle_sd = np.hypot(DIRECTION_SD, FORCE_SD / sizes)
        distance_sd = np.hypot(POINT_SD, MOMENT_SD / sizes)
        contacts = [
            np.full(3, np.nan) if placement.contact is None else placement.contact
            for placement in placements
        ]
        sides = perpendiculars(forces)
        return cls(
            nearest=np.array([nearest for nearest, _ in lines]),
            forces=forces,
            sides=sides,
            points=np.array([placement.point for placement in placements]),
            directions=directions,
            beside=perpendiculars(directions),
            noise=np.stack([angle_sd, angle_sd, distance_sd, distance_sd], axis=1),
            contacts=np.array(contacts),
            force_matrices=cross_matrices(forces),
            side_matrices=cross_matrices(sides),
        )

    def chosen(self, kept: Bools) -> LineResiduals:
        """Those of some placements.

        Parameters
        ----------
        kept : (placements,)

        Returns
        -------
        in the same order
        """
        return LineResiduals(
            nearest=self.nearest[kept],
            forces=self.forces[kept],
            sides=self.sides[kept],
            points=self.points[kept],
            directions=self.directions[kept],
            beside=self.beside[kept],
            noise=self.noise[kept],
            contacts=self.contacts[kept],
            force_matrices=self.force_matrices[kept],
            side_matrices=self.side_matrices[kept],
        )

    @property
    def count(self) -> int:
        """Of rows: 4 for each placement, then one for each contact."""
        return 4 * len(self.points) + len(self._touched)

    @cached_property
    def _touched(self) -> Array:
        """(contacts, 3) points on the plate's surface that are known."""
        return self.contacts[np.isfinite(self.contacts[:, 0])]

    def at(self, values: Values, before: Evaluation | None) -> Rows:
        """Residuals at the values of the pose."""
        return self.rows(_pose(values.x))

    def offsets(self, pose: Pose) -> Array:
        """Offsets from each line's nearest point to the marked point.

        Parameters
        ----------
        pose : of the plate

        Returns
        -------
        (placements, 3) in the plate's axes [m]
        """
        return (self.points - pose.center) @ pose.rotation - self.nearest

    def unweighted(self, pose: Pose) -> Array:
        """Residuals: the angle's two parts, then those of the distance.

        Parameters
        ----------
        pose : of the plate

        Returns
        -------
        (placements, 4) [rad], [rad], [m], [m]
        """
        return self._unweighted(self.beside @ pose.rotation, self.offsets(pose))

    def _unweighted(self, beside: Array, offsets: Array) -> Array:
        """As above, of `beside` and `offsets` in the plate's axes."""
        angles = beside @ self.forces[:, :, None]
        distances = self.sides @ offsets[:, :, None]
        return np.concatenate([angles[:, :, 0], distances[:, :, 0]], axis=1)

    def rows(self, pose: Pose) -> Rows:
        """Residuals in standard deviations and their slopes by rotation vector and center.

        A small turn w moves the rotated force by w x R f, and the part of the distance along a
        side s, which follows the force, by

            -s . (w x R r) - (s . (w x R f)) a = w . (s x (R r + a R f)),   a = (c - p - R r) . R f

        Parameters
        ----------
        pose : of the plate

        Returns
        -------
        4 rows for each placement, then one for each contact
        """
        offsets = self.offsets(pose)
        along = np.sum(offsets * self.forces, axis=1)
        feet = self.nearest + along[:, None] * self.forces  # r + a f, in the plate's axes
        # The cross products are those of the plate's axes, R (s x a) = R s x R a.
        beside = self.beside @ pose.rotation
        by_angle = np.swapaxes(self.force_matrices @ np.swapaxes(beside, 1, 2), 1, 2)
        by_side = (self.side_matrices @ feet[:, None, :, None])[..., 0]
        slopes = np.zeros((len(self.points), 4, 6))
        slopes[:, :2, :3] = by_angle @ pose.rotation.T
        slopes[:, 2:, :3] = by_side @ pose.rotation.T
        slopes[:, 2:, 3:] = -self.sides @ pose.rotation.T
        residuals = (self._unweighted(beside, offsets) / self.noise).reshape(-1)
        weighted = (slopes / self.noise[:, :, None]).reshape(-1, 6)
        if not len(self._touched):
            return Rows(residuals=residuals, slopes=weighted)
        heights = self._heights(pose)
        return Rows(
            residuals=np.concatenate([residuals, heights.residuals]),
            slopes=np.concatenate([weighted, heights.slopes]),
        )

    def _heights(self, pose: Pose) -> Rows:
        """Heights (c - p) . n of the contacts above the surface with the normal n."""
        normal = pose.rotation[:, 2]
        offsets = self._touched - pose.center
        slopes = np.empty((len(offsets), 6))
        slopes[:, :3] = offsets @ cross_matrices(normal).T
        slopes[:, 3:] = -normal
        return Rows(residuals=offsets @ normal / POINT_SD, slopes=slopes / POINT_SD)


@read_only
class Misfits:
    """How far lines of action lie off what was marked.

    Attributes
    ----------
    distances : (placements,) from the marked point to the measured line [m]
    angles : (placements,) between marked and measured direction [rad]
    """

    distances: Array
    angles: Array

    @classmethod
    def of(cls, line_residuals: Array) -> Misfits:
        """Sizes of residuals.

        Parameters
        ----------
        line_residuals : (placements, 4) [rad], [rad], [m], [m]

        Returns
        -------
        one distance and one angle for each placement
        """
        sines = np.linalg.norm(line_residuals[:, :2], axis=1)
        return cls(
            distances=np.linalg.norm(line_residuals[:, 2:], axis=1),
            angles=np.arcsin(np.minimum(sines, 1.0)),
        )


def solve_pose(lines: LineResiduals, start: Pose) -> PlatePose:
    """Search from a start for the pose; what the placements do not show stays as it is there."""
    solution = minimize(Problem(start.unknowns, (lines,)), method=METHOD)
    return _plate_pose(solution, lines.count)


def best_pose(lines: LineResiduals, nominal: Pose | None) -> PlatePose:
    """Search from a nominal pose and from starts all around the force, and keep the best."""
    rough = [
        minimize(Problem(start.unknowns, (lines,)), method=ROUGH_METHOD)
        for start in _starts(lines, nominal)
    ]
    return solve_pose(lines, _pose(min(rough, key=lambda solution: solution.search.cost).x))


def left_out_poses(lines: LineResiduals, start: Pose) -> list[Pose]:
    """For each placement, the pose that the others give, from a start."""
    unknowns = start.unknowns
    others = ~np.eye(len(lines.points), dtype=np.bool_)
    problems = [Problem(unknowns, (lines.chosen(kept),)) for kept in others]
    return [_pose(minimize(problem, method=METHOD).x) for problem in problems]


def left_out_residuals(lines: LineResiduals, poses: Sequence[Pose]) -> Array:
    """Residuals of each placement at a pose of its own.

    Parameters
    ----------
    lines : of all placements
    poses : one for each placement

    Returns
    -------
    (placements, 4) [rad], [rad], [m], [m]
    """
    return np.array([lines.unweighted(pose)[index] for index, pose in enumerate(poses)])


def _starts(lines: LineResiduals, nominal: Pose | None) -> list[Pose]:
    """List a nominal pose, and rotations about the mean direction that bring the force onto it."""
    force = lines.forces.mean(axis=0)
    mean_direction = lines.directions.mean(axis=0)
    up = mean_direction / np.linalg.norm(mean_direction)
    level = least_rotation(force / np.linalg.norm(force), up)
    starts = [] if nominal is None else [nominal]
    for index in range(ROTATION_COUNT):
        rotation = axis_rotation(up, 2.0 * np.pi * index / ROTATION_COUNT) @ level
        middle = lines.points.mean(axis=0) - rotation @ lines.nearest.mean(axis=0)
        center = middle if nominal is None else nominal.center
        starts.append(Pose(rotation=rotation, center=center))
    return starts


def _pose(x: Array) -> Pose:
    """Of the values (6,) of rotation vector and center."""
    angle = float(np.linalg.norm(x[:3]))
    rotation = axis_rotation(x[:3] / angle, angle) if angle > 0.0 else np.eye(3)
    return Pose(rotation=rotation, center=x[3:])


def _plate_pose(solution: Solution, count: int) -> PlatePose:
    """Take the variance of the noise for the posterior from the residuals that are left."""
    posterior = Posterior.of(solution, hidden_sd=METHOD.hidden_sd)
    shown = len(posterior.x) - len(posterior.hidden)
    freedom = max(count - shown, 1)
    variance = solution.search.cost / freedom
    pose = _pose(solution.x)
    return PlatePose(
        rotation=pose.rotation,
        center=pose.center,
        posterior=replace(
            posterior,
            covariance=posterior.covariance * variance,
            after=np.where(np.isinf(posterior.after), np.inf, posterior.after * variance),
            freedom=float(freedom),
        ),
        cost=solution.search.cost,
    )
