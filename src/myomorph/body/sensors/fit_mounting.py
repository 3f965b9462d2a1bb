"""Mountings, headings and clock of sensors that fit a whole recording best, poses eliminated.

    minimise  sum_f w_f ( |r_s|^2 / sigma_o^2 + |e_m|^2 / sigma_m^2 )  + priors

over the poses c of some frames and what is unknown of the sensors, by Gauss-Newton steps: r_s are
rotation vectors from what a sensor reports to its body, e_m errors of markers. sigma_o is
`imu_noise`, or the size of r_s where that is more. The calibration pose is one more frame, whose
joint angles are known to `imu_pose_error`. Headings are a random walk from knot to knot, and mean
joint angles are much the same about knots at which the body does the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.body.sensors.facing import facing_starts
from myomorph.body.sensors.first_guess import CalibrationPose, Guess
from myomorph.body.sensors.frame_sums import FrameRows, FrameSums, marker_rows, sensor_rows
from myomorph.body.sensors.undetermined import body_slopes, joint_angles
from myomorph.core.fit.elimination import Eliminated, eliminated
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.noise import residual_sd
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import LinearPrior, NormalEquations, Residuals
from myomorph.core.fit.solver import Method, Solution, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values, turned
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import rotation_from_vector, vector_from_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.marker_frames import MarkerFrames, marker_frames
from myomorph.core.motion.newton import solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    SensorOptions,
    orientation_tasks,
    rotations_at,
)
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
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
SLIP = 0.2
"""Of a sensor that slipped after the pose, against the pose [rad]: of what a recording leaves open,
a small slip is likelier.
"""
SLIP_COST = 8.0
"""Of a sensor that slipped after the pose, in squares of the noise: one in fifty does (2 ln 50)."""
SHORT = 0.005  # Time over which speeds of rotation are taken [s]
MOUNTINGS = "mountings"
HEADINGS = "headings"
CLOCK = "clock"
"""Blocks of unknowns, in this order."""
CLOCK_ERROR = 0.05  # Standard deviation of the delay about the one that speeds of rotation show [s]


class Chosen(NamedTuple):
    """Frames that take part.

    Attributes
    ----------
    time : (frames,) [s]
    markers : in these frames
    marker_names : of those that count
    marker_weights : (names,)
    share : of a frame that each counts
    """

    time: Array
    markers: Markers
    marker_names: tuple[str, ...]
    marker_weights: Array
    share: float

    @property
    def positions(self) -> Array:
        """(frames, marker names, 3) of the markers that count [m], NaN where unseen."""
        columns = [self.markers.names.index(name) for name in self.marker_names]
        return self.markers.values[:, columns]


class SolvedFrames(NamedTuple):
    """Frames at their best poses with a mounting.

    Attributes
    ----------
    values : (frames, coordinates) [rad or m]
    reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors
    cost : (frames,) [m^2]
    """

    values: Array
    reported: Array
    cost: Array


@read_only
class Misfit:
    """What a mounting leaves of a recording and of the calibration pose.

    Attributes
    ----------
    by_sensor : (sensors,) root mean square of the angle between what each reports and its body
        [rad], NaN where it reported nothing
    in_pose : (sensors,) the same angle in the calibration pose [rad], 0 without one
    noise : standard deviation of these about each axis, freedom of the poses taken off [rad]
    total : of recording and pose, and `SLIP_COST` for each sensor that slipped, in squares of the
        noise that the options state
    frames : as how many independent ones the recording counts
    freedom : numbers of a frame that its pose does not explain, in the mean
    slipped : number of sensors that slipped after the pose
    time : (frames,) of the frames that took part [s]
    errors : (frames, sensors, 3) rotation vectors from what each sensor reports to its body, in the
        axes of the body [rad], NaN where unknown
    """

    by_sensor: Array
    in_pose: Array
    noise: float
    total: float
    frames: float
    freedom: float
    slipped: int
    time: Array
    errors: Array

    @property
    def cost(self) -> float:
        """Of a frame in the mean."""
        return self.total / self.frames


@dataclass(frozen=True, kw_only=True, eq=False)
class MountingFit:
    """The setting in which mountings are looked for.

    Attributes
    ----------
    tree : of the model
    sensors : recording with orientations
    bodies : that each sensor is on
    chosen : frames that take part
    options : without tasks of sensors
    sizes : noise of sensors and markers
    pose : calibration pose, if there is one
    slipped : numbers of sensors that were turned on their bodies after the pose, which says nothing
        of them
    steps : of Gauss and Newton at most
    """

    tree: Tree
    sensors: InertialSensors
    bodies: tuple[str, ...]
    chosen: Chosen
    options: InverseKinematicsOptions
    sizes: SensorOptions
    pose: CalibrationPose | None
    slipped: frozenset[int] = frozenset()
    steps: int = STEPS

    def at(self, guess: Guess, delay: float) -> SensorMounting:
        """Build a mounting from a guess, of which everything is open.

        Parameters
        ----------
        guess : rotations and headings
        delay : of the sensors' clock [s]

        Returns
        -------
        the mounting, its headings the same at all knots
        """
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

    def poses(self, mounting: SensorMounting, starts: Array | None) -> SolvedFrames:
        """Solve for the poses of the frames with a mounting.

        Parameters
        ----------
        mounting : of the sensors
        starts : (frames, coordinates) where each frame begins [rad or m]; None for the default
            pose as the sensors face, one frame after the other

        Returns
        -------
        poses, what the sensors report there, and costs
        """
        chosen = self.chosen
        reported = self._reported(mounting)
        seen = np.isfinite(chosen.positions).all(axis=2)
        tasks = orientation_tasks(mounting, reported, seen @ chosen.marker_weights, self.sizes)
        options = replace(self.options, tasks=(*self.options.tasks, *tasks))
        problem = pose_problem(
            self.tree, chosen.marker_names, chosen.marker_weights, options, chosen.markers
        )
        first = facing_starts(self.tree, self.bodies, reported) if starts is None else starts
        settings = options.settings._replace(chained=starts is None)
        solved = solve_poses(self.tree, problem, first, settings)
        values = np.where(np.isfinite(solved.values), solved.values, first)
        return SolvedFrames(values=values, reported=reported, cost=solved.cost)

    def fitted(
        self,
        start: SensorMounting,
        azimuth: bool,
        anywhere: bool,
        near: SensorMounting | None = None,
    ) -> MountingEstimate:
        """Fit the mounting by Gauss-Newton steps.

        Parameters
        ----------
        start : what is known before, where the search begins
        azimuth : the heading of all mountings is open, as that of a pose is
        anywhere : headings begin anywhere, as those of sensors without magnetometer do
        near : a mounting, as by fewer frames, from which the search begins in the place of `start`

        Returns
        -------
        the mounting, with its estimate
        """
        headings = self._heading_prior(start, azimuth, anywhere)
        if near is not None:
            start = replace(start, rotations=near.rotations, headings=near.headings)
        unknowns = self._unknowns(start)
        residuals: list[Residuals] = [FrameResiduals(fit=self, start=start), headings]
        if self.pose is not None:
            residuals.append(PoseResiduals(fit=self, start=start, pose=self.pose))
        method = Method(iterations=self.steps, tolerance=SETTLED, reweighted=True)
        problem = Problem(unknowns, tuple(residuals))
        return self._estimated(start, minimize(problem, fit=self._open(), method=method))

    def by_pose(self, start: SensorMounting) -> MountingEstimate:
        """Take a mounting from the pose as it is, with what that leaves open.

        Parameters
        ----------
        start : mounting by the pose

        Returns
        -------
        the mounting, with its estimate
        """
        assert self.pose is not None
        headings = self._heading_prior(start, azimuth=False, anywhere=False)
        pose = PoseResiduals(fit=self, start=start, pose=self.pose)
        problem = Problem(self._unknowns(start), (headings, pose))
        solution = minimize(problem, fit=self._open(), method=Method(iterations=0))
        return self._estimated(start, solution)

    def misfit(self, mounting: SensorMounting, starts: Array | None = None) -> Misfit:
        """Measure what a mounting leaves, by one measure for all mountings.

        Parameters
        ----------
        mounting : of the sensors
        starts : (frames, coordinates) where each frame begins [rad or m]; None as in `poses`

        Returns
        -------
        angles [rad] and sums of squares, in units of the noise
        """
        solved = self.poses(mounting, starts)
        problem = pose_problem(self.tree, (), np.empty(0), self.options)
        rotations = self._rotations(solved.values)
        errors = vector_from_rotation(rotations @ np.swapaxes(solved.reported, 2, 3))
        squares = (errors**2).sum(axis=2)
        counts = np.maximum(np.isfinite(squares).sum(axis=0), 1)
        frames = np.isfinite(solved.cost) & np.isfinite(squares).any(axis=1)
        of_frames = float(solved.cost[frames].sum()) / self.sizes.imu_marker_noise**2
        total = self.chosen.share * of_frames + SLIP_COST * len(self.slipped)
        in_pose = np.zeros(len(self.bodies))
        if self.pose is not None:
            eliminated_pose = self.pose_equations(mounting, self.pose.coordinates)[1]
            total += eliminated_pose.cost
            in_pose = self._left_in_pose(mounting, eliminated_pose.moved)
        return Misfit(
            by_sensor=np.sqrt(np.nansum(squares, axis=0) / counts),
            in_pose=in_pose,
            noise=_noise(errors, len(problem.free)),
            total=total,
            frames=max(self.chosen.share * int(frames.sum()), 1e-9),
            freedom=_freedom(errors, len(problem.free)) / len(errors),
            slipped=len(self.slipped),
            time=self.chosen.time,
            errors=np.einsum("fsji,fsj->fsi", solved.reported, errors),
        )

    def _left_in_pose(self, mounting: SensorMounting, moved: Array) -> Array:
        """Compute the angles between sensors and bodies in the calibration pose.

        Parameters
        ----------
        mounting : of the sensors
        moved : (variables,) coordinates of the pose from those that it states [rad or m]

        Returns
        -------
        (sensors,) [rad]
        """
        assert self.pose is not None
        problem = pose_problem(self.tree, (), np.empty(0), self.options)
        pose = np.array(self.pose.coordinates)
        pose[problem.free] += moved
        couple_frames(self.tree.arrays, pose[None])
        heading = mounting.heading_at(np.array([self.pose.time]))[0]
        turned = rotation_from_vector(heading[:, None] * mounting.up) @ self.pose.rotations
        reported = turned @ np.swapaxes(mounting.rotations, 1, 2)
        between = self._rotations(pose[None])[0] @ np.swapaxes(reported, 1, 2)
        return np.asarray(np.linalg.norm(vector_from_rotation(between), axis=1))

    def _rotations(self, values: Array) -> Array:
        """Compute the rotations (frames, sensors, 3, 3) of the sensors' bodies."""
        numbers = [self.tree.body_number(body) for body in self.bodies]
        return forward_kinematics(self.tree, values).rotations[:, numbers]

    def _estimated(self, start: SensorMounting, solution: Solution) -> MountingEstimate:
        """Build the mounting of a solution, and its estimate."""
        estimate = estimate_of(solution)
        # The clock, which is last, is left out.
        covariance = estimate.posterior.covariance[:-1, :-1]
        sizes, directions = np.linalg.eigh(covariance)
        factor = directions * np.sqrt(np.maximum(sizes, 0.0))
        mounting = mounting_of(start, Values(solution.problem.unknowns, solution.x))
        return MountingEstimate(
            mounting=replace(mounting, factor=np.asarray(factor)), estimate=estimate
        )

    def _open(self) -> tuple[str, ...]:
        """Name the blocks that are searched for.

        Without markers there is no clock to compare with.
        """
        if self.chosen.marker_names:
            return (MOUNTINGS, HEADINGS, CLOCK)
        return (MOUNTINGS, HEADINGS)

    def _unknowns(self, start: SensorMounting) -> Unknowns:
        """List rotations from a start's mountings, headings at knots, and the clock's delay."""
        mountings = [
            Unknown(
                name=f"{sensor} mounting {axis}",
                unit="rad",
                where=f"sensor {sensor} on {body}: rotation about {axis}",
                sd=FREE,
            )
            for sensor, body in zip(start.sensors, start.bodies, strict=True)
            for axis in "xyz"
        ]
        headings = [
            Unknown(
                name=f"{sensor} heading at {time:g} s",
                unit="rad",
                where=f"sensor {sensor}: heading",
                start=heading,
            )
            for time, row in zip(start.knots, start.headings, strict=True)
            for sensor, heading in zip(start.sensors, row, strict=True)
        ]
        clock = Unknown(
            name="delay",
            unit="s",
            where="clock of the sensors",
            start=start.delay,
            sd=CLOCK_ERROR,
            scale=np.inf,
        )
        return Unknowns(
            (
                Block(name=MOUNTINGS, unknowns=tuple(mountings), chart=turned),
                Block(name=HEADINGS, unknowns=tuple(headings)),
                Block(name=CLOCK, unknowns=(clock,)),
            )
        )

    def _heading_prior(self, start: SensorMounting, azimuth: bool, anywhere: bool) -> LinearPrior:
        """State what is known of headings before.

        How they differ, what they have in common at the first knot, and how far they drift from
        knot to knot (a random walk).
        """
        count = len(self.bodies)
        knots = len(start.knots)
        # What all headings have in common may be known less well than how they differ.
        common = np.full((count, count), 1.0 / count)
        error = max(self.sizes.imu_heading_error, 1e-4)
        apart = np.pi if anywhere else error
        together = np.pi if azimuth else error
        rows = np.zeros((knots * count, knots * count))
        rows[:count, :count] = (np.eye(count) - common) / apart + common / together
        right = np.zeros(len(rows))
        right[:count] = rows[:count, :count] @ start.headings[0]
        for knot in range(1, knots):
            minutes = (start.knots[knot] - start.knots[knot - 1]) / 60.0
            drift = max(self.sizes.imu_heading_drift * np.sqrt(minutes), 1e-5)
            own = slice(knot * count, (knot + 1) * count)
            last = slice((knot - 1) * count, knot * count)
            rows[own, own] = np.eye(count) / drift
            rows[own, last] = -np.eye(count) / drift
        return LinearPrior(name="headings", blocks=(HEADINGS,), rows=rows, right=right)

    def frame_equations(
        self, mounting: SensorMounting, values: Array, reported: Array
    ) -> NormalEquations:
        """Build the equations of all unknowns, the pose of each frame eliminated.

        Parameters
        ----------
        mounting : at the point
        values : (frames, coordinates) best poses there [rad or m]
        reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors

        Returns
        -------
        (unknowns, unknowns) and (unknowns,), in units of the noise
        """
        data = self._frame_data(mounting, values, reported)
        sums = FrameSums(
            frames=self._rows(data).eliminated(), shares=data.knot_shares, sensors=len(self.bodies)
        )
        if self.chosen.marker_names:
            return sums.equations()
        free = data.problem.free
        # Where a sensor has its vertical no heading changes.
        upright = np.swapaxes(reported, 2, 3) @ mounting.up
        return sums.with_trends(values[:, free], joint_angles(self.tree, free), upright)

    def _frame_data(self, mounting: SensorMounting, values: Array, reported: Array) -> FrameData:
        """Compute errors and slopes of all frames; see `frame_equations`."""
        chosen = self.chosen
        problem = pose_problem(self.tree, chosen.marker_names, chosen.marker_weights, self.options)
        rotations, slopes = self._slopes(values, problem)
        later = self._reported(mounting, SHORT)
        turned = vector_from_rotation(later @ np.swapaxes(reported, 2, 3))
        errors = vector_from_rotation(rotations @ np.swapaxes(reported, 2, 3))
        marked = None
        if chosen.marker_names:
            marked = marker_frames(self.tree, problem, chosen.positions, values)
        return FrameData(
            problem=problem,
            reported=reported,
            errors=errors,
            slopes=slopes,
            velocities=np.nan_to_num(turned / SHORT),
            knot_shares=_knot_shares(mounting.knots, chosen.time),
            marked=marked,
            noise=max(self.sizes.imu_noise, _noise(errors, slopes.shape[-1])),
        )

    def _rows(self, data: FrameData) -> FrameRows:
        """Collect the rows of what sensors and markers report in all frames."""
        scale = np.sqrt(self.chosen.share) / data.noise
        up = np.asarray(self.tree.model.up)
        rows = sensor_rows(data.reported, data.errors, data.slopes, data.velocities, up)
        weighted = rows.scaled(np.array([scale]))
        if data.marked is None:
            return weighted
        marked = marker_rows(data.marked, weighted.of_unknowns.shape[2])
        chosen = self.chosen
        scales = np.sqrt(chosen.share * chosen.marker_weights) / self.sizes.imu_marker_noise
        return weighted.beside(marked.scaled(np.repeat(scales, 3)))

    def _reported(self, mounting: SensorMounting, later: float = 0.0) -> Array:
        """Compute the rotations (frames, sensors, 3, 3) of bodies as the sensors report them.

        Parameters
        ----------
        mounting : of the sensors
        later : time that is added to that of the chosen frames [s]
        """
        delay = mounting.delay + later
        if delay not in self._earths:
            time = self.chosen.time + delay
            self._earths[delay] = rotations_at(self.sensors, time, self.tree.model)
        return mounting.bodies_turned(self._earths[delay], self.chosen.time + later)

    @cached_property
    def _earths(self) -> dict[float, Array]:
        """Rotations (frames, sensors, 3, 3) of the sensors in the chosen frames, by delay [s]."""
        return {}

    def pose_equations(self, mounting: SensorMounting, pose: Array) -> tuple[Ints, Eliminated]:
        """Treat the calibration pose as one more frame.

        Parameters
        ----------
        mounting : at the point
        pose : (coordinates,) of the body there [rad or m]

        Returns
        -------
        coordinates that move with what is unknown, and the equations without them
        """
        assert self.pose is not None
        problem = pose_problem(self.tree, (), np.empty(0), self.options)
        # What a person does in the pose is not known better where the model's joint ends: a knee
        # at its bound may be bent as any other.
        rotations, slopes = self._slopes(pose[None], problem, bounded=False)
        time = np.array([self.pose.time])
        heading = mounting.heading_at(time)[0]
        turned = rotation_from_vector(heading[:, None] * mounting.up) @ self.pose.rotations
        reported = turned @ np.swapaxes(mounting.rotations, 1, 2)
        errors = vector_from_rotation(rotations[0] @ np.swapaxes(reported, 1, 2))
        share = _knot_shares(mounting.knots, time)[0]
        width = self._width(mounting)
        columns = [
            self._sensor_columns(index, reported[index], share, np.zeros(3), width)
            for index in range(len(errors))
        ]
        stiffness = self._pose_stiffness(problem)
        off = stiffness * (pose - self.pose.coordinates)[problem.free]
        scale = self._pose_weights()[:, None, None]
        frame = eliminated(
            np.concatenate([*(scale * slopes[0]), np.diag(stiffness)]),
            np.concatenate([*(scale * np.array(columns)), np.zeros((len(problem.free), width))]),
            np.concatenate([(scale[..., 0] * errors).ravel(), off]),
        )
        return problem.free, frame

    def _pose_weights(self) -> Array:
        """Compute how well each sensor's rotation against its bone is that of the pose.

        Returns
        -------
        (sensors,) inverse standard deviations [1/rad]
        """
        numbers = range(len(self.bodies))
        return np.array([1.0 / (SLIP if one in self.slipped else POSE_NOISE) for one in numbers])

    def _pose_stiffness(self, problem: PoseProblem) -> Array:
        """Compute how well the coordinates of the calibration pose are known.

        The root's inclination is as uncertain as a joint, its heading is that of the model by
        convention.

        Returns
        -------
        (variables,) inverse standard deviations [1/rad or 1/m]
        """
        joints = joint_angles(self.tree, problem.free)
        return np.where(joints, 1.0 / self.sizes.imu_pose_error, 1.0 / POSE_NOISE)

    def _sensor_columns(
        self, index: int, reported: Array, share: Array, velocity: Array, width: int
    ) -> Array:
        """Compute how the rotation vector of a sensor's error grows with what is unknown.

        Parameters
        ----------
        index : of the sensor
        reported : (3, 3) rotation of its body by the sensor
        share : (knots,) of each knot's heading
        velocity : (3,) rotation vector per second of delay [rad/s]
        width : number of unknowns

        Returns
        -------
        (3, unknowns)
        """
        count = len(self.bodies)
        columns = np.zeros((3, width))
        up = np.asarray(self.tree.model.up)
        columns[:, 3 * index : 3 * index + 3] = reported
        for knot in np.flatnonzero(share):
            columns[:, 3 * count + knot * count + index] = -share[knot] * up
        columns[:, -1] = -velocity
        return columns

    def _width(self, mounting: SensorMounting) -> int:
        """Count the unknowns."""
        return len(self.bodies) * (3 + len(mounting.knots)) + 1

    def _slopes(
        self, values: Array, problem: PoseProblem, bounded: bool = True
    ) -> tuple[Array, Array]:
        """Compute rotations of the sensors' bodies, and their slopes; see `body_slopes`."""
        bodies = np.array([self.tree.body_number(body) for body in self.bodies], np.int64)
        return body_slopes(self.tree, problem, values, bodies, bounded)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class FrameData:
    """All frames at their best poses with a mounting.

    Attributes
    ----------
    problem : with the free coordinates
    reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors
    errors : (frames, sensors, 3) rotation vectors from these to the bodies [rad], NaN where unknown
    slopes : (frames, sensors, 3, variables) of the bodies' rotation vectors [rad per rad or m]
    velocities : (frames, sensors, 3) rotation vectors per second of delay [rad/s]
    knot_shares : (frames, knots) of each knot's heading
    marked : errors of the markers; None without markers
    noise : standard deviation of a sensor's errors [rad]
    """

    problem: PoseProblem
    reported: Array
    errors: Array
    slopes: Array
    velocities: Array
    knot_shares: Array
    marked: MarkerFrames | None
    noise: float


def _noise(errors: Array, coordinates: int) -> float:
    """Estimate the standard deviation of errors that poses left.

    Parameters
    ----------
    errors : (frames, sensors, 3) rotation vectors [rad], NaN where unknown
    coordinates : number of free coordinates of a pose

    Returns
    -------
    [rad]
    """
    numbers = int(np.isfinite(errors).sum())
    explained = numbers - _freedom(errors, coordinates)
    return residual_sd(float(np.nansum(errors**2)), numbers, explained)


def _freedom(errors: Array, coordinates: int) -> float:
    """Count the numbers that poses do not explain.

    Parameters
    ----------
    errors : (frames, sensors, 3), NaN where unknown
    coordinates : number of free coordinates of a pose
    """
    numbers = int(np.isfinite(errors).sum())
    # Poses explain as many numbers as they have coordinates, of those that are joints between
    # sensors at most, and never all.
    joints = len(errors) * min(coordinates, 3 * errors.shape[1] - 3)
    return numbers - min(joints, 2 * numbers / 3, numbers - 1)


class MountingEstimate(NamedTuple):
    """A mounting, and the estimate that it is of.

    Attributes
    ----------
    mounting : with the factor of its covariance
    estimate : unknowns with their posterior
    """

    mounting: SensorMounting
    estimate: Estimate


def mounting_of(start: SensorMounting, values: Values) -> SensorMounting:
    """Apply values of the unknowns, which are counted from a start.

    Parameters
    ----------
    start : mounting
    values : rotation vectors [rad], headings [rad] and delay [s]

    Returns
    -------
    the mounting there
    """
    turns = rotation_from_vector(values[MOUNTINGS].reshape(-1, 3))
    return replace(
        start,
        rotations=turns @ start.rotations,
        headings=values[HEADINGS].reshape(start.headings.shape),
        delay=float(values[CLOCK][0]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class FramesAt:
    """Sensors and markers of the recording at a mounting, every frame at its best pose.

    Attributes
    ----------
    fit : setting of the search
    mounting : at the point
    values : (frames, coordinates) best poses [rad or m]
    reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors
    costs : (frames,) in squares of the noise
    """

    fit: MountingFit
    mounting: SensorMounting
    values: Array
    reported: Array
    costs: Array

    @property
    def cost(self) -> float:
        """Sum of squares over the frames, each of its share."""
        return float(self.fit.chosen.share * self.costs.sum())

    @property
    def count(self) -> int:
        """Numbers that sensors and markers report."""
        markers = int(np.isfinite(self.fit.chosen.markers.values).sum())
        return 3 * int(np.isfinite(self.reported).all(axis=(2, 3)).sum()) + markers

    def normal(self) -> NormalEquations:
        """Return the equations with poses eliminated.

        Noise and weights are by the residuals here.
        """
        return self.fit.frame_equations(self.mounting, self.values, self.reported)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameResiduals:
    """A recording as residuals of the sensors' mountings, headings and clock.

    Attributes
    ----------
    fit : setting of the search
    start : mounting that unknowns are counted from
    name, blocks, prior : of these residuals; they are no prior
    """

    fit: MountingFit
    start: SensorMounting
    name: str = field(default="recording", init=False)
    blocks: tuple[str, ...] = field(default=(MOUNTINGS, HEADINGS, CLOCK), init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: FramesAt | None) -> FramesAt:
        """Solve for poses from those of the mounting before."""
        mounting = mounting_of(self.start, values)
        solved = self.fit.poses(mounting, None if before is None else before.values)
        return FramesAt(
            fit=self.fit,
            mounting=mounting,
            values=solved.values,
            reported=solved.reported,
            costs=solved.cost,
        )


@read_only
class PoseAt:
    """The calibration pose at a mounting: its coordinates, and how they follow the mounting.

    Attributes
    ----------
    values : of the unknowns
    pose : (coordinates,) [rad or m]
    free : coordinates that move with the unknowns
    eliminated : equations without the pose
    """

    values: Values
    pose: Array
    free: Ints
    eliminated: Eliminated

    @property
    def cost(self) -> float:
        """Sum of squares that is left."""
        return self.eliminated.cost

    @property
    def count(self) -> int:
        """Coordinates that are known."""
        return len(self.free)

    def normal(self) -> NormalEquations:
        """Return the equations with the pose eliminated."""
        return self.eliminated.equations

    def followed(self, tree: Tree, values: Values) -> Array:
        """Move the pose along with a step to other values.

        Parameters
        ----------
        tree : of the model
        values : of the unknowns

        Returns
        -------
        (coordinates,) [rad or m]
        """
        turns = rotation_from_vector(values[MOUNTINGS].reshape(-1, 3))
        before = rotation_from_vector(self.values[MOUNTINGS].reshape(-1, 3))
        turned_by = vector_from_rotation(turns @ np.swapaxes(before, 1, 2)).ravel()
        step = values.x - self.values.x
        step[: len(turned_by)] = turned_by
        pose = np.array(self.pose)
        pose[self.free] += self.eliminated.moved + self.eliminated.follows @ step
        couple_frames(tree.arrays, pose[None])
        return pose


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseResiduals:
    """The calibration pose as residuals of mountings and headings.

    Attributes
    ----------
    fit : setting of the search
    start : mounting that unknowns are counted from
    pose : as specified
    name, blocks, prior : of these residuals; they are no prior
    """

    fit: MountingFit
    start: SensorMounting
    pose: CalibrationPose
    name: str = field(default="calibration pose", init=False)
    blocks: tuple[str, ...] = field(default=(MOUNTINGS, HEADINGS, CLOCK), init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: PoseAt | None) -> PoseAt:
        """Begin with the pose as specified, and follow each step."""
        mounting = mounting_of(self.start, values)
        pose = np.array(self.pose.coordinates)
        if before is not None:
            pose = before.followed(self.fit.tree, values)
        free, frame = self.fit.pose_equations(mounting, pose)
        return PoseAt(values=values, pose=pose, free=free, eliminated=frame)


def _knot_shares(knots: Array, time: Array) -> Array:
    """Compute weights of a linear interpolation, held at the ends.

    Parameters
    ----------
    knots : (knots,) [s]
    time : (times,) [s]

    Returns
    -------
    (times, knots)
    """
    shares = [np.interp(time, knots, of_knot) for of_knot in np.eye(len(knots))]
    return np.column_stack(shares).reshape(len(time), -1)
