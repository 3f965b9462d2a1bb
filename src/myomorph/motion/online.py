"""Coordinates and derivatives while frames arrive: one filter for motion and forces, its delay known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.model.spatial import rotation_from_quaternion, rotation_from_vector
from myomorph.motion.ik import InverseKinematicsOptions, coordinate_targets, pose_problem, tracked_markers
from myomorph.motion.newton import Settings, frames_shown, solve_poses
from myomorph.motion.pose_problem import PoseProblem
from myomorph.motion.sensors.mounting import SensorMounting, SensorOptions, earth_to_ground, orientation_tasks
from myomorph.motion.tasks.orientations import OrientationArrays
from myomorph.motion.turns import scout_poses
from myomorph.rigid.tree import compile_tree

REACH = 4.0
"""Half width of the filter's window in standard deviations of its bell."""

LOST = 3.0
"""A frame whose marker error is that many times the usual one starts again from several headings."""


@dataclass(frozen=True)
class OnlineFilter:
    """A low-pass that gives value, velocity and acceleration of samples at a rate [Hz] in a moving window, half the
    power at `cutoff` [Hz].

    The window's weights are a bell g(t) = exp(-t^2 / 2 s^2) and its derivatives, s = sqrt(ln 2) / (2 pi cutoff),
    corrected so that parabolas are differentiated exactly. Phase is linear: everything comes `delay` late and otherwise
    unshifted, the forces like the motion.
    """

    rate: float
    cutoff: float = 6.0

    def __post_init__(self) -> None:
        if not (self.rate > 0.0 and np.isfinite(self.rate)):
            raise BadData(f"rate {self.rate} Hz: expected a positive number of frames per second")
        if not 0.0 < self.cutoff <= self.rate / 8.0:
            raise BadData(
                f"cutoff {self.cutoff:g} Hz at {self.rate:g} frames per second: expected at most an eighth of the "
                f"rate, {self.rate / 8.0:g} Hz"
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
        """How late a result comes [s]."""
        return self.half / self.rate

    @property
    def frames_per_sample(self) -> float:
        """Frames that make one independent sample of filtered white noise: its autocorrelation's sum."""
        return max(2.0 * float(np.sqrt(np.pi)) * self.bell * self.rate, 1.0)

    @property
    def weights(self) -> Array:
        """(3, 2 half + 1) of value, velocity and acceleration in the window's middle, oldest sample first."""
        t = np.arange(-self.half, self.half + 1) / self.rate
        g = np.exp(-0.5 * (t / self.bell) ** 2)
        g /= g.sum()
        first = t * g
        second = (t**2 - g @ t**2) * g
        return np.stack([g, first / (first @ t), 2.0 * second / (second @ t**2)])

    def motion(self, motion: Motion) -> Motion:
        """A recorded motion through the filter, with derivatives: the frames that have a whole window."""
        value, velocity, acceleration = (self._whole(motion.values, weight) for weight in self.weights)
        self._even(motion.time)
        return Motion(self._middle(motion.time), motion.names, value, velocity, acceleration)

    def values(self, samples: Array) -> Array:
        """(frames - 2 half, ...) samples of the same clock through the filter, as forces go."""
        return self._whole(samples, self.weights[0])

    def _whole(self, samples: Array, weights: Array) -> Array:
        if len(samples) < len(weights):
            raise BadData(f"the filter needs {len(weights)} frames, but there are {len(samples)}")
        windows = sliding_window_view(np.asarray(samples, dtype=np.float64), len(weights), axis=0)
        return windows @ weights

    def _middle(self, time: Array) -> Array:
        return time[self.half : len(time) - self.half]

    def _even(self, time: Array) -> None:
        steps = np.diff(time)
        if len(steps) and np.abs(steps * self.rate - 1.0).max() > 0.1:
            raise BadData(f"frames are not evenly spaced at {self.rate:g} Hz: resample the recording first")


class MovingWindow:
    """The last samples, `width` numbers each, of a stream, and what the filter makes of them."""

    def __init__(self, filter: OnlineFilter, width: int):
        self._weights = filter.weights
        length = self._weights.shape[1]
        self._rows = np.full((2 * length, width), np.nan)
        self._times = np.full(2 * length, np.nan)
        self._length, self._count = length, 0

    def push(self, time: float, row: Array) -> None:
        """Add the newest sample [s], NaN where it is missing."""
        at = self._count % self._length
        # Every sample stands twice, so that the window is always one piece.
        for place in (at, at + self._length):
            self._rows[place], self._times[place] = row, time
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
        """(3, width) value, velocity and acceleration in the middle; NaN where a sample is missing."""
        start = self._count % self._length
        return self._weights @ self._rows[start : start + self._length]


class OnlineKinematics:
    """Inverse kinematics of one frame after the other of the named markers, each from where the last two lead."""

    def __init__(self, model: Model, names: Sequence[str], options: InverseKinematicsOptions | None = None):
        self._options = options or InverseKinematicsOptions()
        self._tree = compile_tree(model)
        empty = Markers(np.zeros(1), tuple(names), np.full((1, len(names), 3), np.nan))
        self.marker_names, weights = tracked_markers(model, empty, self._options)
        self._columns = [list(names).index(name) for name in self.marker_names]
        self._problem = pose_problem(self._tree, self.marker_names, weights, self._options)
        self._before: list[Array] = []
        self._usual = 0.0

    def solve(self, time: float, positions: Array) -> tuple[Array, float]:
        """Coordinates of one frame of markers (markers, 3) [m], NaN where unseen, and its RMS error [m]."""
        problem = self._frame(time, positions)
        if not frames_shown(problem)[0]:
            self._before = []
            return np.full(len(self._tree.defaults), np.nan), float("nan")
        values, error = self._settle(problem, self._start(problem))
        if self._before and error > LOST * self._usual:
            other, less = self._settle(problem, self._search(problem))
            if less < 0.99 * error:
                values, error = other, less
                self._before = []
        self._usual = error if self._usual == 0.0 else 0.95 * self._usual + 0.05 * error
        self._before = [*self._before[-1:], values]
        return values, error

    def from_start(self, time: float, positions: Array, start: Array, posture: Array) -> tuple[Array, float]:
        """As `solve`, from a pose, coordinates that no marker shows drawn to `posture`, remembering nothing."""
        return self._settle(self._frame(time, positions)._replace(posture=posture), start)

    def from_anywhere(self, time: float, positions: Array, posture: Array) -> tuple[Array, float]:
        """As `from_start`, but from the best of several headings."""
        problem = self._frame(time, positions)
        return self._settle(problem._replace(posture=posture), self._search(problem))

    def _frame(self, time: float, positions: Array) -> PoseProblem:
        """The problem of one frame."""
        observed = np.ascontiguousarray(np.asarray(positions, dtype=np.float64)[None, self._columns])
        targets = coordinate_targets(self._tree, np.array([time]), self._options)
        shown = self._problem.with_markers(observed=observed, errors=np.full(observed.shape[:2], np.nan))
        return shown.with_coordinates(value=targets)._replace(fixed=targets)

    def _start(self, problem: PoseProblem) -> Array:
        if len(self._before) == 2:
            return 2.0 * self._before[1] - self._before[0]
        return self._before[0] if self._before else self._search(problem)

    def _search(self, problem: PoseProblem) -> Array:
        return scout_poses(self._tree, problem, self._settings)[0]

    def _settle(self, problem: PoseProblem, start: Array) -> tuple[Array, float]:
        solved = solve_poses(self._tree, problem, start[None], self._settings)
        return solved.values[0], float(np.sqrt(np.nanmean(self._errors(problem) ** 2)))

    def _errors(self, problem: PoseProblem) -> Array:
        """Residuals that say how well a frame is solved."""
        return problem.markers.errors

    @property
    def _settings(self) -> Settings:
        return self._options.settings


class OnlineOrientations(OnlineKinematics):
    """The same of inertial sensors whose mounting is known: frames of quaternions (sensors, 4) to the earth, NaN where
    one is missing, errors in radians. Headings stay as the mounting has them last; joints without a sensor stay where
    they were last.
    """

    def __init__(
        self,
        model: Model,
        mounting: SensorMounting,
        options: InverseKinematicsOptions | None = None,
        sizes: SensorOptions | None = None,
    ):
        plain, unseen = options or InverseKinematicsOptions(), np.full((1, len(mounting.sensors), 3, 3), np.nan)
        tasks = orientation_tasks(mounting, unseen, np.zeros(1), sizes or SensorOptions())
        super().__init__(model, (), replace(plain, tasks=(*plain.tasks, *tasks)))
        nothing = Markers(np.zeros(1), (), np.empty((1, 0, 3)))
        self._problem = pose_problem(self._tree, (), np.empty(0), self._options, nothing)
        self._place = next(i for i, task in enumerate(self._problem.tasks) if isinstance(task, OrientationArrays))
        turned = rotation_from_vector(mounting.headings[-1][:, None] * mounting.up)
        self._earth, self._mounted = turned @ earth_to_ground(model), np.swapaxes(mounting.rotations, 1, 2)

    def _frame(self, time: float, positions: Array) -> PoseProblem:
        tasks = list(self._problem.tasks)
        rotation = self._earth @ rotation_from_quaternion(positions) @ self._mounted
        tasks[self._place] = tasks[self._place]._replace(
            rotation=np.ascontiguousarray(rotation[None]), errors=np.full((1, len(rotation)), np.nan)
        )
        targets = coordinate_targets(self._tree, np.array([time]), self._options)
        problem = self._problem._replace(tasks=tuple(tasks)).with_coordinates(value=targets)._replace(fixed=targets)
        return problem._replace(posture=self._before[-1]) if self._before else problem

    def _errors(self, problem: PoseProblem) -> Array:
        return problem.tasks[self._place].errors
