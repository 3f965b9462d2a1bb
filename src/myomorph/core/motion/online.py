"""Coordinates and derivatives while frames arrive, by one filter of known delay.

Markers never fit a model exactly, so that the pose jumps when one of them is lost or comes back.
The jump is what the same frame gives with the markers before and after: it is taken off at once,
and given back along the path of a critically damped spring. What no marker shows any more keeps its
last value; without any marker the whole body does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import rotation_from_quaternion, rotation_from_vector
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    coordinate_targets,
    pose_problem,
    tracked_markers,
)
from myomorph.core.motion.newton import frames_shown, solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    SensorOptions,
    earth_to_ground,
    orientation_tasks,
)
from myomorph.core.motion.starts import scout_poses
from myomorph.core.motion.tasks.orientations import OrientationArrays
from myomorph.core.motion.turns import floating_coordinates, nearest_turn, of_one_turn
from myomorph.core.rigid.tree import compile_tree

REACH = 4.0  # Half width of the filter's window in standard deviations of its bell
# A frame whose marker error is that many times the usual one starts again from several headings
LOST = 3.0


@dataclass(frozen=True)
class OnlineFilter:
    """A low-pass in a moving window that gives value, velocity and acceleration.

    The window's weights are a bell and its derivatives,

        g(t) = exp(-t^2 / 2 s^2),   s = sqrt(ln 2) / (2 pi cutoff),

    corrected so that parabolas are differentiated exactly. Phase is linear: everything comes
    `delay` late and otherwise unshifted, the forces like the motion.

    Attributes
    ----------
    rate : of the samples [Hz]
    cutoff : frequency at which half the power passes, at most an eighth of the rate [Hz]

    Raises
    ------
    BadData : a rate or cutoff out of range
    """

    rate: float
    cutoff: float = 6.0

    def __post_init__(self) -> None:
        if not (self.rate > 0.0 and np.isfinite(self.rate)):
            raise BadData(f"rate {self.rate} Hz: expected a positive number of frames per second")
        if not 0.0 < self.cutoff <= self.rate / 8.0:
            raise BadData(
                f"cutoff {self.cutoff:g} Hz at {self.rate:g} frames per second: expected at most an"
                f" eighth of the rate, {self.rate / 8.0:g} Hz"
            )

    @property
    def bell(self) -> float:
        """Standard deviation s of the window [s]."""
        return float(np.sqrt(np.log(2.0)) / (2.0 * np.pi * self.cutoff))

    @property
    def half(self) -> int:
        """Frames on each side of the one in the middle."""
        return int(np.ceil(REACH * self.bell * self.rate))

    @property
    def delay(self) -> float:
        """Delay of a result [s]."""
        return self.half / self.rate

    @property
    def frames_per_sample(self) -> float:
        """Frames that make one independent sample of filtered white noise.

        The sum of its autocorrelation, 2 sqrt(pi) s rate, at least 1.
        """
        return max(2.0 * float(np.sqrt(np.pi)) * self.bell * self.rate, 1.0)

    @property
    def weights(self) -> Array:
        """Weights (3, 2 half + 1) of value, velocity and acceleration, oldest sample first.

        They belong to the window's middle [1, per s, per s^2].
        """
        t = np.arange(-self.half, self.half + 1) / self.rate
        g = np.exp(-0.5 * (t / self.bell) ** 2)
        g /= g.sum()
        first = t * g
        second = (t**2 - g @ t**2) * g
        return np.stack([g, first / (first @ t), 2.0 * second / (second @ t**2)])

    def motion(self, motion: Motion) -> Motion:
        """Filter a recorded motion, with derivatives, over the frames that have a whole window.

        Parameters
        ----------
        motion : (frames, coordinates) [rad or m] at the filter's rate

        Returns
        -------
        (frames - 2 half, coordinates) with `velocities` and `accelerations`, at the times of the
        windows' middles

        Raises
        ------
        BadData : fewer frames than a window, or frames that are not evenly spaced at the rate
        """
        value_weight, velocity_weight, acceleration_weight = self.weights
        value = self._whole(motion.values, value_weight)
        velocity = self._whole(motion.values, velocity_weight)
        acceleration = self._whole(motion.values, acceleration_weight)
        time = motion.time
        steps = np.diff(motion.time)
        if len(steps) and np.abs(steps * self.rate - 1.0).max() > 0.1:
            raise BadData(
                f"frames are not evenly spaced at {self.rate:g} Hz: resample the recording first"
            )
        return Motion(
            time=time[self.half : len(time) - self.half],
            names=motion.names,
            values=value,
            velocities=velocity,
            accelerations=acceleration,
        )

    def values(self, samples: Array) -> Array:
        """Filter samples of the same clock, as forces.

        Parameters
        ----------
        samples : (frames, ...)

        Returns
        -------
        (frames - 2 half, ...)

        Raises
        ------
        BadData : fewer frames than a window
        """
        return self._whole(samples, self.weights[0])

    def _whole(self, samples: Array, weights: Array) -> Array:
        """Weight whole windows (window,) of samples (frames, ...): (frames - window + 1, ...)."""
        if len(samples) < len(weights):
            raise BadData(f"the filter needs {len(weights)} frames, but there are {len(samples)}")
        windows = sliding_window_view(np.asarray(samples, dtype=np.float64), len(weights), axis=0)
        return windows @ weights


class MovingWindow:
    """The last samples of a stream, `width` numbers each, and their filtered values."""

    def __init__(self, filter: OnlineFilter, width: int):
        self._weights = filter.weights
        length = self._weights.shape[1]
        self._rows = np.full((2 * length, width), np.nan)
        self._times = np.full(2 * length, np.nan)
        self._length = length
        self._count = 0

    def push(self, time: float, row: Array) -> None:
        """Add the newest sample.

        Parameters
        ----------
        time : [s]
        row : (width,), NaN where it is missing
        """
        at = self._count % self._length
        # Every sample stands twice, so that the window is always one piece.
        for place in (at, at + self._length):
            self._rows[place] = row
            self._times[place] = time
        self._count += 1

    @property
    def full(self) -> bool:
        """Whether a whole window has arrived."""
        return self._count >= self._length

    @property
    def time(self) -> float:
        """Time of the sample in the middle [s]."""
        return float(self._times[self._count % self._length + self._length // 2])

    @property
    def filtered(self) -> Array:
        """(3, width) value, velocity and acceleration in the middle; NaN if a sample is missing."""
        start = self._count % self._length
        return self._weights @ self._rows[start : start + self._length]


class OnlineKinematics:
    """Inverse kinematics of one frame after the other of the named markers.

    Each starts from the straight line through the last two poses.

    Parameters
    ----------
    model : with some of these markers
    names : of the markers that will arrive, in their order
    options : of inverse kinematics

    Raises
    ------
    BadData : model and names share no marker that has a weight
    """

    def __init__(
        self, model: Model, names: Sequence[str], options: InverseKinematicsOptions | None = None
    ):
        self._options = options or InverseKinematicsOptions()
        self._tree = compile_tree(model)
        empty = Markers(np.zeros(1), tuple(names), np.full((1, len(names), 3), np.nan))
        self.marker_names, weights = tracked_markers(model, empty, self._options)
        self._columns = [list(names).index(name) for name in self.marker_names]
        self._problem = pose_problem(self._tree, self.marker_names, weights, self._options)
        self._before: list[Array] = []
        self._usual = 0.0

    def solve(self, time: float, positions: Array) -> tuple[Array, float]:
        """Solve the pose of one frame.

        A frame whose error is three times the usual one is solved again from several headings.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) in the order of the names [m], NaN where unseen

        Returns
        -------
        (coordinates,) [rad or m] and their root mean square marker error [m]; NaN where too few
        markers are seen
        """
        problem = self._frame(time, positions)
        if not frames_shown(problem)[0]:
            self._before = []
            return np.full(len(self._tree.defaults), np.nan), float("nan")
        if not self._before:
            values, error = self._settle_anew(problem)
        else:
            values, error = self._settle(problem, self._ahead())
        if self._before and error > LOST * self._usual:
            other, less = self._settle_anew(problem)
            if less < 0.99 * error:
                values = other
                error = less
                self._before = []
        self._usual = error if self._usual == 0.0 else 0.95 * self._usual + 0.05 * error
        self._before = [*self._before[-1:], values]
        return values, error

    def from_start(
        self, time: float, positions: Array, start: Array, posture: Array
    ) -> tuple[Array, float]:
        """Solve the pose of one frame from another pose, remembering nothing.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) in the order of the names [m], NaN where unseen
        start : (coordinates,) pose to begin with [rad or m]
        posture : (coordinates,) to which coordinates that no marker shows are drawn [rad or m]

        Returns
        -------
        (coordinates,) [rad or m] and their root mean square marker error [m]
        """
        problem = self._frame(time, positions)._replace(posture=posture[None])
        return self._settle(problem, start)

    def from_anywhere(self, time: float, positions: Array, posture: Array) -> tuple[Array, float]:
        """Solve the pose of one frame from the best of several headings, remembering nothing.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) in the order of the names [m], NaN where unseen
        posture : (coordinates,) to which coordinates that no marker shows are drawn [rad or m]

        Returns
        -------
        (coordinates,) [rad or m] and their root mean square marker error [m]
        """
        problem = self._frame(time, positions)
        return self._settle_anew(problem._replace(posture=posture[None]))

    def _frame(self, time: float, positions: Array) -> PoseProblem:
        """Build the problem of one frame from markers (markers, 3) [m]."""
        observed = np.ascontiguousarray(
            np.asarray(positions, dtype=np.float64)[None, self._columns]
        )
        targets = coordinate_targets(self._tree, np.array([time]), self._options)
        shown = self._problem.with_markers(
            observed=observed, errors=np.full(observed.shape[:2], np.nan)
        )
        return shown.with_coordinates(value=targets)._replace(fixed=targets)

    def _ahead(self) -> Array:
        """Extrapolate the last two poses: (coordinates,) [rad or m]."""
        if len(self._before) == 2:
            return 2.0 * self._before[1] - self._before[0]
        return self._before[0]

    def _settle_anew(self, problem: PoseProblem) -> tuple[Array, float]:
        """Solve one frame from several headings, without whole turns away from the default pose.

        Returns
        -------
        (coordinates,) [rad or m] and their root mean square error
        """
        start = scout_poses(self._tree, problem, self._options.settings)[0]
        values, error = self._settle(problem, start)
        return of_one_turn(self._tree, problem, values[None])[0], error

    def _settle(self, problem: PoseProblem, start: Array) -> tuple[Array, float]:
        """Solve one frame from a pose (coordinates,): the pose and its root mean square error."""
        solved = solve_poses(self._tree, problem, start[None], self._options.settings)
        return solved.values[0], float(np.sqrt(np.nanmean(self._errors(problem) ** 2)))

    def _errors(self, problem: PoseProblem) -> Array:
        """Return the residuals (1, markers) by which a solution is judged [m]."""
        return problem.markers.errors


class OnlineOrientations(OnlineKinematics):
    """Inverse kinematics, frame by frame, of inertial sensors whose mounting is known.

    `solve` takes quaternions (sensors, 4) to the earth, NaN where one is missing, and returns
    errors in radians. Headings stay as the mounting has them last; joints without a sensor stay
    where they were last.

    Parameters
    ----------
    model : with the sensors' bodies
    mounting : of the sensors, in the order in which they arrive
    options : of inverse kinematics
    sizes : noise of the sensors
    """

    def __init__(
        self,
        model: Model,
        mounting: SensorMounting,
        options: InverseKinematicsOptions | None = None,
        sizes: SensorOptions | None = None,
    ):
        plain = options or InverseKinematicsOptions()
        unseen = np.full((1, len(mounting.sensors), 3, 3), np.nan)
        tasks = orientation_tasks(mounting, unseen, np.zeros(1), sizes or SensorOptions())
        super().__init__(model, (), replace(plain, tasks=(*plain.tasks, *tasks)))
        nothing = Markers(np.zeros(1), (), np.empty((1, 0, 3)))
        self._problem = pose_problem(self._tree, (), np.empty(0), self._options, nothing)
        self._place = next(
            i for i, task in enumerate(self._problem.tasks) if isinstance(task, OrientationArrays)
        )
        turned = rotation_from_vector(mounting.headings[-1][:, None] * mounting.up)
        self._earth = turned @ earth_to_ground(model)
        self._mounted = np.swapaxes(mounting.rotations, 1, 2)

    def _frame(self, time: float, positions: Array) -> PoseProblem:
        """Build the problem of one frame from quaternions (sensors, 4) to the earth."""
        tasks = list(self._problem.tasks)
        rotation = self._earth @ rotation_from_quaternion(positions) @ self._mounted
        tasks[self._place] = tasks[self._place]._replace(
            rotation=np.ascontiguousarray(rotation[None]),
            errors=np.full((1, len(rotation)), np.nan),
        )
        targets = coordinate_targets(self._tree, np.array([time]), self._options)
        problem = (
            self._problem._replace(tasks=tuple(tasks))
            .with_coordinates(value=targets)
            ._replace(fixed=targets)
        )
        return problem._replace(posture=self._before[-1][None]) if self._before else problem

    def _errors(self, problem: PoseProblem) -> Array:
        """Return the residuals (1, sensors) by which a solution is judged [rad]."""
        return problem.tasks[self._place].errors


# Time constant with which a jump is given back: 9 % of it are left after four of them [s]
BLEND = 0.05
SEARCH = 0.5  # Least time between two searches from several headings [s]


@dataclass(frozen=True, eq=False)
class SteadyFrame:
    """One pose.

    Attributes
    ----------
    coordinates : (coordinates,) [rad or m], NaN before any marker was seen
    error : root mean square over the markers [m], NaN where `held`
    seen : number of markers seen
    held : no marker is seen, and this is the last pose
    owed : root mean square, over coordinates in radians and metres, of the jump still to be given
        back
    """

    coordinates: Array
    error: float
    seen: int
    held: bool
    owed: float


class SteadyKinematics:
    """Inverse kinematics frame by frame, continuous where markers come and go.

    Parameters
    ----------
    model : with some of these markers
    names : of the markers that will arrive, in their order
    options : of inverse kinematics
    blend : time constant with which jumps are given back [s]

    Raises
    ------
    BadData : `blend` is not above 0, or model and names share no marker that has a weight
    """

    def __init__(
        self,
        model: Model,
        names: Sequence[str],
        options: InverseKinematicsOptions | None = None,
        blend: float = BLEND,
    ):
        if not blend > 0.0:
            raise BadData(f"jumps are blended out in {blend:g} s: expected above 0")
        self._inverse = OnlineKinematics(model, names, options)
        self.marker_names = self._inverse.marker_names
        self._blend = blend
        self._defaults = compile_tree(model).defaults.copy()
        count = len(self._defaults)
        columns = [list(names).index(marker_name) for marker_name in self.marker_names]
        self._tracked = np.zeros(len(names), np.bool_)
        self._tracked[columns] = True
        floating = floating_coordinates(model)
        self._turning = np.array(
            [
                coordinate.motion == "rotational"
                and (not coordinate.clamped or coordinate.name in floating)
                for coordinate in model.coordinates
            ]
        )
        self._positions = np.full((len(names), 3), np.nan)
        self._seen = np.zeros(len(names), np.bool_)
        self._ever = np.zeros(len(names), np.bool_)
        # What the markers give, now and one frame before, and what is shown less that, with its
        # rate.
        self._found: Array | None = None
        self._before: Array | None = None
        self._time = self._time_before = self._searched = -np.inf
        self._offset = np.zeros(count)
        self._rate = np.zeros(count)
        self._shown = np.full(count, np.nan)
        self._usual = 0.0

    def solve(self, time: float, positions: Array) -> SteadyFrame:
        """Solve the pose of one frame.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) in the order of the names [m], NaN where unseen

        Returns
        -------
        the pose, with what is left of earlier jumps
        """
        positions = np.asarray(positions, dtype=np.float64)
        seen = np.isfinite(positions).all(axis=1) & self._tracked
        if not seen.any():
            return self._hold(time)
        if self._found is None:
            values, error = self._inverse.from_anywhere(time, positions, self._defaults)
        else:
            self._give_back(time - self._time)
            common = seen & self._seen
            if not np.array_equal(seen, self._seen):
                self._take_off_lost(common)
            # What no marker shows is drawn to its default, or while markers are lost to the last
            # pose.
            posture = self._found if (self._ever & ~seen).any() else self._defaults
            start = self._ahead(time)
            values, error = self._inverse.from_start(time, positions, start, posture)
            values, error = self._searched_again(time, positions, values, error)
            if not np.array_equal(seen, common):
                self._take_off_found(time, positions, common, start, values)
        self._usual = error if self._usual == 0.0 else 0.95 * self._usual + 0.05 * error
        self._before, self._time_before = (
            (self._found, self._time) if self._seen.any() else (None, -np.inf)
        )
        self._found = values
        self._time = time
        self._positions = positions.copy()
        self._seen = seen
        self._ever |= seen
        self._shown = values + self._offset
        left = float(np.sqrt(np.mean(self._offset**2)))
        return SteadyFrame(
            coordinates=self._shown, error=error, seen=int(seen.sum()), held=False, owed=left
        )

    def _hold(self, time: float) -> SteadyFrame:
        """Keep everything where it was shown: no marker is seen."""
        if self._found is not None:
            self._found = self._shown.copy()
            self._before = None
            self._offset[:] = 0.0
            self._rate[:] = 0.0
            self._time = time
        self._seen = np.zeros_like(self._seen)
        return SteadyFrame(coordinates=self._shown, error=float("nan"), seen=0, held=True, owed=0.0)

    def _ahead(self, time: float) -> Array:
        """Extrapolate the last two frames to a time [s]: (coordinates,) [rad or m]."""
        assert self._found is not None
        span = self._time - self._time_before
        if self._before is None or not 0.0 < time - self._time < 3.0 * span:
            return self._found.copy()
        return self._found + (time - self._time) / span * (self._found - self._before)

    def _give_back(self, step: float) -> None:
        """Move the offset towards 0 as a critically damped spring does.

        With the offset o, its rate v and x = step / blend,

            o -> e^-x (o + x (v blend + o)),   v -> e^-x (v - x (v blend + o) / blend)

        Parameters
        ----------
        step : time since the last frame [s]
        """
        x = max(step, 0.0) / self._blend
        pushed = self._rate * self._blend + self._offset
        decay = np.exp(-x)
        self._rate = decay * (self._rate - x * pushed / self._blend)
        self._offset = decay * (self._offset + x * pushed)

    def _take_off_lost(self, common: np.ndarray) -> None:
        """Take off the jump of the frame before when solved without the markers that are lost now.

        Parameters
        ----------
        common : (markers,) whether a marker is seen in both frames
        """
        if not common.any() or np.array_equal(common, self._seen) or self._found is None:
            return
        left = np.where(common[:, None], self._positions, np.nan)
        values, _ = self._inverse.from_start(self._time, left, self._found.copy(), self._found)
        self._offset -= values - self._found
        # From here on the markers that are left determine where the body is.
        if self._before is not None:
            self._before = self._before + (values - self._found)
        self._found = values

    def _take_off_found(
        self, time: float, positions: Array, common: np.ndarray, start: Array, values: Array
    ) -> None:
        """Take off the jump of this frame that markers bring which came back just now.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) [m]
        common : (markers,) whether a marker is seen in both frames
        start, values : (coordinates,) pose to begin with and solved pose [rad or m]
        """
        assert self._found is not None
        if common.any():
            left = np.where(common[:, None], positions, np.nan)
            without, _ = self._inverse.from_start(time, left, start, self._found)
        else:
            without = self._found
        self._offset -= self._turned(values - without)

    def _searched_again(
        self, time: float, positions: Array, values: Array, error: float
    ) -> tuple[Array, float]:
        """Search other headings where the markers fit badly, and take off the jump to a better one.

        Parameters
        ----------
        time : [s]
        positions : (markers, 3) [m]
        values : (coordinates,) solved [rad or m]
        error : of `values` [m]

        Returns
        -------
        the better pose (coordinates,) [rad or m] and its error [m]
        """
        blind = not self._seen.any()
        if not blind and (error <= LOST * self._usual or time - self._searched < SEARCH):
            return values, error
        self._searched = time
        other, less = self._inverse.from_anywhere(time, positions, self._defaults)
        if not less < 0.99 * error:
            return values, error
        turned = self._turned(other - values)
        if not blind:
            self._offset -= turned
        return values + turned, less

    def _turned(self, change: Array) -> Array:
        """Take a change (coordinates,) of angles by the shorter way round [rad or m]."""
        return np.where(self._turning, nearest_turn(change, np.zeros_like(change)), change)
