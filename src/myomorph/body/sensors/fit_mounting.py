"""Mountings, headings and clock of sensors that fit a whole recording best, poses eliminated.

    minimise  sum_f w_f ( |r_s|^2 / sigma_o^2 + |e_m|^2 / sigma_m^2 )  + priors

over the poses c of some frames and what is unknown of the sensors, by Gauss-Newton steps: r_s are
rotation vectors from what a sensor reports to its body, e_m errors of markers. sigma_o is
`imu_noise`, or the size of r_s where that is more. The calibration pose is one more frame, whose
joint angles are known to `imu_pose_error`. Headings are a random walk from knot to knot, and mean
joint angles are much the same about knots at which the body does the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from myomorph.body.sensors.first_guess import CalibrationPose, Guess
from myomorph.body.sensors.undetermined import body_slopes, joint_angles
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import rotation_from_vector, vector_from_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.marker_influence import marker_frames
from myomorph.core.motion.newton import solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.sensors.mounting import SensorMounting, SensorOptions, orientation_tasks
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.tree import Tree

STEPS = 30
SETTLED = 1e-4  # The steps end when no mounting or heading moves further [rad]
CORRELATED = 0.5  # Frames nearer than this to each other err alike, so that they count as one [s]
INDEPENDENT = 20.0
"""A recording counts as so many frames at most: skin that follows the movement errs alike in every
stride.
"""
KNOTS = 20.0  # Time between knots of the headings [s]
FRAMES = 160
FRAMES_PER_KNOT = 12  # Of a recording that take part
FREE = 1.5  # Standard deviation of a mounting before anything is known of it [rad]
POSE_NOISE = 0.02  # Of a sensor against its bone while the body stands still [rad]
SLIP = 0.1
"""A sensor that the recording turns further from the pose than this has slipped since: its pose
counts less [rad].
"""
# Standard deviation of the mean of a joint angle about a knot, against that over the recording
# [rad]
TREND = 0.07
ALIKE = 0.1
"""Knots whose sensors have verticals further apart in the mean see other movements, as sitting and
walking [rad].
"""
SHORT = 0.005  # Time over which speeds of rotation are taken [s]
CLOCK_ERROR = 0.05  # Standard deviation of the delay about the one that speeds of rotation show [s]


class Chosen(NamedTuple):
    """Frames that take part: their markers, those that count with weights, and the share of a frame
    each counts.
    """

    time: Array
    markers: Markers
    marker_names: tuple[str, ...]
    marker_weights: Array
    share: float


@dataclass(frozen=True, eq=False)
class MountingFit:
    """What is known while mountings are looked for; options without tasks of sensors, the
    calibration pose if any.
    """

    tree: Tree
    sensors: InertialSensors
    bodies: tuple[str, ...]
    chosen: Chosen
    options: InverseKinematicsOptions
    sizes: SensorOptions
    pose: CalibrationPose | None

    def at(self, guess: Guess, delay: float) -> SensorMounting:
        """A guess as a mounting of which everything is open."""
        time = self.chosen.time
        knots = np.linspace(time[0], time[-1], 1 + round((time[-1] - time[0]) / KNOTS))
        count = len(self.bodies) * (3 + len(knots))
        return SensorMounting(
            sensors=self.sensors.names,
            bodies=self.bodies,
            rotations=guess.rotations,
            knots=knots,
            headings=np.tile(guess.headings, (len(knots), 1)),
            delay=delay,
            factor=np.zeros((count, count)),
            up=np.asarray(self.tree.model.up),
        )

    def poses(self, mounting: SensorMounting, starts: Array | None) -> tuple[Array, Array, Array]:
        """Coordinates of the frames, what the sensors report of the bodies, and the cost of each
        frame.
        """
        chosen = self.chosen
        model = self.tree.model
        reported = mounting.body_rotations(self.sensors, chosen.time, model)
        seen = np.asarray(np.isfinite(chosen.markers.values).all(axis=2))
        columns = [chosen.markers.names.index(name) for name in chosen.marker_names]
        tasks = orientation_tasks(
            mounting, reported, seen[:, columns] @ chosen.marker_weights, self.sizes
        )
        options = replace(self.options, tasks=(*self.options.tasks, *tasks))
        problem = pose_problem(
            self.tree, chosen.marker_names, chosen.marker_weights, options, chosen.markers
        )
        first = np.tile(self.tree.defaults, (len(chosen.time), 1)) if starts is None else starts
        solved = solve_poses(self.tree, problem, first, options.settings, chained=starts is None)
        return np.where(np.isfinite(solved.values), solved.values, first), reported, solved.cost

    def fitted(self, start: SensorMounting, azimuth: bool, anywhere: bool) -> SensorMounting:
        """The mounting after Gauss-Newton steps. `azimuth`: the heading of all mountings is open,
        as that of a pose is; `anywhere`: headings begin anywhere, as those of sensors without
        magnetometer do.
        """
        mounting = start
        values = None
        pose = None if self.pose is None else np.array(self.pose.coordinates)
        for _ in range(STEPS):
            values, reported, _ = self.poses(mounting, values)
            normal, right = self._priors(start, mounting, azimuth, anywhere)
            self._add_frames(normal, right, mounting, values, reported)
            if self.pose is not None and pose is not None:
                slopes = self._add_pose(normal, right, mounting, pose)
            step = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
            mounting = self._stepped(mounting, step)
            if self.pose is not None and pose is not None:
                pose[slopes[0]] += slopes[1] + slopes[2] @ step
                couple_frames(self.tree.arrays, pose[None])
            if np.abs(step[:-1]).max() < SETTLED:
                break
        return replace(mounting, factor=_factor(normal))

    def by_pose(self, start: SensorMounting) -> SensorMounting:
        """A mounting that is taken from the pose as it is, with what that leaves open."""
        assert self.pose is not None
        normal, right = self._priors(start, start, False, False)
        self._add_pose(normal, right, start, np.array(self.pose.coordinates))
        return replace(start, factor=_factor(normal))

    def _stepped(self, mounting: SensorMounting, step: Array) -> SensorMounting:
        count = len(self.bodies)
        turned = rotation_from_vector(step[: 3 * count].reshape(-1, 3)) @ mounting.rotations
        headings = mounting.headings + step[3 * count : -1].reshape(mounting.headings.shape)
        return replace(
            mounting, rotations=turned, headings=headings, delay=mounting.delay + float(step[-1])
        )

    def _priors(
        self, start: SensorMounting, now: SensorMounting, azimuth: bool, anywhere: bool
    ) -> tuple[Array, Array]:
        """Normal matrix and right side of what is known before: mountings, headings, clock."""
        count = len(self.bodies)
        knots = len(now.knots)
        width = 3 * count + knots * count + 1
        normal = np.zeros((width, width))
        right = np.zeros(width)
        away = vector_from_rotation(now.rotations @ np.swapaxes(start.rotations, 1, 2)).ravel()
        normal[: 3 * count, : 3 * count] = np.eye(3 * count) / FREE**2
        right[: 3 * count] = -away / FREE**2
        moved = now.headings - start.headings
        # What all headings have in common may be known less well than how they differ.
        common = np.full((count, count), 1.0 / count)
        error = max(self.sizes.imu_heading_error, 1e-4)
        apart = np.pi if anywhere else error
        together = np.pi if azimuth else error
        first = slice(3 * count, 4 * count)
        normal[first, first] += (np.eye(count) - common) / apart**2 + common / together**2
        right[first] -= normal[first, first] @ moved[0]
        for index in range(count):
            column = 3 * count + index
            for knot in range(1, knots):
                minutes = (now.knots[knot] - now.knots[knot - 1]) / 60.0
                stiffness = 1.0 / max(self.sizes.imu_heading_drift * np.sqrt(minutes), 1e-5) ** 2
                a = column + (knot - 1) * count
                b = column + knot * count
                gained = now.headings[knot, index] - now.headings[knot - 1, index]
                normal[np.ix_((a, b), (a, b))] += stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
                right[a] += stiffness * gained
                right[b] -= stiffness * gained
        # Without markers there is no clock to compare with.
        stiffness = 1.0 / (CLOCK_ERROR if self.chosen.marker_names else 1e-9) ** 2
        normal[-1, -1] += stiffness
        right[-1] -= stiffness * (now.delay - start.delay)
        return normal, right

    def _add_frames(
        self, normal: Array, right: Array, mounting: SensorMounting, values: Array, reported: Array
    ) -> None:
        chosen = self.chosen
        sizes = self.sizes
        problem = pose_problem(self.tree, chosen.marker_names, chosen.marker_weights, self.options)
        rotations, slopes = self._slopes(values, problem)
        later = mounting.body_rotations(self.sensors, chosen.time + SHORT, self.tree.model)
        clock = np.nan_to_num(vector_from_rotation(later @ np.swapaxes(reported, 2, 3)) / SHORT)
        errors = vector_from_rotation(rotations @ np.swapaxes(reported, 2, 3))
        marked = None
        if chosen.marker_names:
            columns = [chosen.markers.names.index(name) for name in chosen.marker_names]
            marked = marker_frames(self.tree, problem, chosen.markers.values[:, columns], values)
        shares = _knot_shares(mounting.knots, chosen.time)
        near = shares.argmax(axis=1)
        noise = max(sizes.imu_noise, _noise(errors, slopes.shape[-1]))
        width = len(right)
        followed = [list[tuple[Array, Array]]() for _ in mounting.knots]
        for frame in range(len(values)):
            known = np.flatnonzero(np.isfinite(errors[frame, :, 0]))
            scale = np.sqrt(chosen.share) / noise
            J = []
            X = []
            r = []
            for index in known:
                J.append(scale * slopes[frame, index])
                parts = (reported[frame, index], shares[frame], clock[frame, index])
                X.append(scale * self._sensor_columns(int(index), *parts, width))
                r.append(scale * errors[frame, index])
            if marked is not None:
                seen = np.isfinite(marked.errors[frame]).all(axis=1)
                scales = (
                    np.sqrt(chosen.share * chosen.marker_weights[seen]) / sizes.imu_marker_noise
                )
                J.append(
                    (scales[:, None, None] * marked.slopes[frame, seen]).reshape(
                        -1, len(problem.free)
                    )
                )
                r.append((-scales[:, None] * marked.errors[frame, seen]).ravel())
                X.append(np.zeros((len(r[-1]), width)))
            if J:
                moved = _eliminate(
                    np.concatenate(J), np.concatenate(X), np.concatenate(r), normal, right
                )
                followed[near[frame]].append((values[frame, problem.free] + moved[0], moved[1]))
        if not chosen.marker_names:
            # Where a sensor has its vertical no heading changes.
            upright = np.swapaxes(reported, 2, 3) @ mounting.up
            knots = [
                (part, np.nanmean(upright[near == knot], axis=0))
                for knot, part in enumerate(followed)
                if part
            ]
            self._add_trends(normal, right, joint_angles(self.tree, problem.free), knots)

    def _add_trends(
        self,
        normal: Array,
        right: Array,
        joints: Array,
        parts: list[tuple[list[tuple[Array, Array]], Array]],
    ) -> None:
        """Means of joint angles about knots at which the body does the same: headings that drift
        would part them. `parts` has by knot, of each frame, its coordinates and how they follow
        what is unknown, and the mean verticals.
        """
        angles = [np.mean([own[joints] for own, _ in frames], axis=0) for frames, _ in parts]
        slopes = np.array(
            [np.mean([follows[joints] for _, follows in frames], axis=0) for frames, _ in parts]
        )
        # A mounting does not change: what it makes of the means is none of a trend's.
        slopes[..., : 3 * len(self.bodies)] = 0.0
        for i, j in combinations(range(len(parts)), 2):
            apart = np.sqrt(np.nanmean(((parts[i][1] - parts[j][1]) ** 2).sum(axis=-1)))
            weight = np.exp(-0.5 * (apart / ALIKE) ** 2) / (len(parts) * TREND**2)
            X = slopes[i] - slopes[j]
            normal += weight * X.T @ X
            right -= weight * X.T @ (angles[i] - angles[j])

    def _add_pose(
        self, normal: Array, right: Array, mounting: SensorMounting, pose: Array
    ) -> tuple[Ints, Array, Array]:
        """The calibration pose as one more frame; returns which coordinates move with what is
        unknown, and how.
        """
        assert self.pose is not None
        problem = pose_problem(self.tree, (), np.empty(0), self.options)
        rotations, slopes = self._slopes(pose[None], problem)
        heading = mounting.heading_at(np.array([self.pose.time]))[0]
        turned = rotation_from_vector(heading[:, None] * mounting.up) @ self.pose.rotations
        reported = turned @ np.swapaxes(mounting.rotations, 1, 2)
        errors = vector_from_rotation(rotations[0] @ np.swapaxes(reported, 1, 2))
        share = _knot_shares(mounting.knots, np.array([self.pose.time]))[0]
        columns = [
            self._sensor_columns(index, reported[index], share, np.zeros(3), len(right))
            for index in range(len(errors))
        ]
        joints = joint_angles(self.tree, problem.free)
        # The root: its inclination is as uncertain as a joint, its heading is that of the model by
        # convention.
        stiffness = np.where(joints, 1.0 / self.sizes.imu_pose_error, 1.0 / POSE_NOISE)
        # Cauchy's weights along the way that a sensor slipped; across it the pose counts as before.
        sizes = np.linalg.norm(errors, axis=1)[:, None, None]
        along = errors[:, :, None] * errors[:, None, :] / np.maximum(sizes, 1e-12) ** 2
        scale = (np.eye(3) + (1.0 / np.sqrt(1.0 + (sizes / SLIP) ** 2) - 1.0) * along) / POSE_NOISE
        J = np.concatenate([*(scale @ slopes[0]), np.diag(stiffness)])
        X = np.concatenate(
            [*(scale @ np.array(columns)), np.zeros((len(problem.free), len(right)))]
        )
        away = stiffness * (pose - self.pose.coordinates)[problem.free]
        r = np.concatenate([(scale @ errors[:, :, None]).ravel(), away])
        return problem.free, *_eliminate(J, X, r, normal, right)

    def _sensor_columns(
        self, index: int, reported: Array, share: Array, clock: Array, width: int
    ) -> Array:
        """(3, unknowns) how the rotation vector of a sensor grows with what is unknown."""
        count = len(self.bodies)
        columns = np.zeros((3, width))
        columns[:, 3 * index : 3 * index + 3] = reported
        for knot in np.flatnonzero(share):
            columns[:, 3 * count + knot * count + index] = -share[knot] * np.asarray(
                self.tree.model.up
            )
        columns[:, -1] = -clock
        return columns

    def _slopes(self, values: Array, problem: PoseProblem) -> tuple[Array, Array]:
        bodies = np.array([self.tree.body_number(body) for body in self.bodies], np.int64)
        return body_slopes(self.tree, problem, values, bodies)


def _noise(errors: Array, coordinates: int) -> float:
    """Standard deviation of the errors (frames, sensors, 3) that poses of so many coordinates left
    [rad].
    """
    numbers = int(np.isfinite(errors).sum())
    # Poses explain as many numbers as they have coordinates, of those that are joints between
    # sensors at most.
    explained = len(errors) * min(coordinates, 3 * errors.shape[1] - 3)
    return float(np.sqrt(np.nansum(errors**2) / max(numbers - explained, numbers / 3, 1)))


def _factor(normal: Array) -> Array:
    """Factor of the covariance of mountings and headings; the clock is left out."""
    sizes, directions = np.linalg.eigh(np.linalg.inv(normal)[:-1, :-1])
    return np.asarray(directions * np.sqrt(np.maximum(sizes, 0.0)))


def _eliminate(J: Array, X: Array, r: Array, normal: Array, right: Array) -> tuple[Array, Array]:
    """Add X^T P X and -X^T P r, with P the projection off the columns of J: the pose follows
    whatever is unknown. Returns what it moves by, -J^+ r, and how it follows, -J^+ X.
    """
    basis, sizes, directions = np.linalg.svd(J, full_matrices=False)
    kept = sizes > 1e-6 * sizes.max(initial=0.0)
    basis = basis[:, kept]
    rest = X - basis @ (basis.T @ X)
    normal += X.T @ rest
    right -= rest.T @ r
    inverse = -(directions[kept].T / sizes[kept]) @ basis.T
    return inverse @ r, inverse @ X


def _knot_shares(knots: Array, time: Array) -> Array:
    """(times, knots) weights of a linear interpolation, held at the ends."""
    return np.column_stack(
        [np.interp(time, knots, column) for column in np.eye(len(knots))]
    ).reshape(len(time), -1)
