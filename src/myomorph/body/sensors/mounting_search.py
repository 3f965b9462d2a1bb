"""The search for the mounting of sensors: from markers, from a calibration pose, or as modelled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.sensors import first_guess, fit_mounting
from myomorph.body.sensors.first_guess import CalibrationPose, Guess
from myomorph.body.sensors.fit_mounting import Chosen, MountingFit
from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import CLOCKS, SENSORS
from myomorph.core.model.errors import BadData, UnknownName, few
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_if_human
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit, tracked_markers
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    SensorOptions,
    rotations_at,
    with_orientations,
)
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

# Share of the frames that show all sensors, from which on only these say how the sensors are
# mounted
ENOUGH = 0.2
STILL = 0.25
STILL_TIME = 0.5
"""A body that turns slower [rad/s] for so long [s] at the start stands in its calibration pose."""
# Ratio of the second best heading's cost to the best's below which the heading is questioned
AMBIGUOUS = 1.3
# A mounting that the recording turns further from the calibration pose's is reported [rad]
SLIPPED = 0.2
DRIFTED = 0.09  # A heading that turns further in a recording is reported [rad]
MAX_DELAY = 2.0  # The sensors' clock may differ from that of the markers by so much [s]
# A sensor whose axis of turning is further from that of the others is reported
APART = np.radians(30.0)
LEGS = ("thigh", "shank", "foot")
TRIED_FRAMES = 5  # Each so many of the chosen frames is looked at where headings are tried


class _Begin(NamedTuple):
    """Where the fit of a mounting begins, and what is not known there.

    Attributes
    ----------
    guess : mountings and headings
    azimuth : whether the heading of all mountings is open, as that of a pose is
    anywhere : whether each sensor's heading begins anywhere
    notes : what looks wrong
    """

    guess: Guess
    azimuth: bool
    anywhere: bool
    notes: tuple[Message, ...]


class _Delay(NamedTuple):
    """Delay of the sensors' clock behind the markers'.

    Attributes
    ----------
    seconds : the delay [s]
    notes : what is worth knowing of it
    """

    seconds: float
    notes: tuple[Message, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class MountingSearch:
    """The search for the mounting of the sensors of one recording.

    Attributes
    ----------
    model : calibrated to the body
    recording : sensors with orientations, and what is known of them
    bodies : that each sensor is on
    tracked : markers of the trial, and their motion
    options : of inverse kinematics
    """

    model: Model
    recording: SensorRecording
    bodies: tuple[str, ...]
    tracked: TrackedMarkers
    options: InverseKinematicsOptions

    @property
    def sensors(self) -> InertialSensors:
        """Recorded orientations."""
        return self.recording.sensors

    @property
    def sizes(self) -> SensorOptions:
        """Noise, and how the mounting is found."""
        return self.recording.sizes

    def mounting(self, anywhere: bool) -> SensorMounting:
        """Find the mounting the way that the options and the recording name.

        Parameters
        ----------
        anywhere : whether each sensor has a heading of its own

        Returns
        -------
        the mounting, with what looks wrong

        Raises
        ------
        BadData : nothing says how the sensors are mounted, or a heading is not known
        UnknownName : a sensor, an axis or a frame of the model is unknown
        """
        kind = self.sizes.imu_mounting
        if kind == "model":
            return self._as_modelled()
        pose = self._pose()
        delay = self._delay()
        fit = MountingFit(
            tree=compile_tree(self.model),
            sensors=self.sensors,
            bodies=self.bodies,
            chosen=self._chosen(delay.seconds),
            options=self.options,
            sizes=self.sizes,
            pose=pose,
        )
        if self.tracked.fit is not None and kind == "recording":
            begin = self._begin_by_markers(self.tracked.fit, delay.seconds, anywhere)
        else:
            begin = self._begin_by_pose(fit, delay.seconds, anywhere)
        start = fit.at(begin.guess, delay.seconds)
        notes = (*delay.notes, *begin.notes, *_of_heading(begin.guess))
        if kind == "pose":
            return replace(fit.by_pose(start).mounting, notes=notes)
        found = fit.fitted(start, begin.azimuth, begin.anywhere).mounting
        of_pose = None
        if pose is not None:
            headings = found.heading_at(np.array([pose.time]))[0]
            of_pose = first_guess.from_pose(fit.tree, self.bodies, pose, headings)
        return replace(found, notes=(*notes, *_of_mounting(found, of_pose)))

    def _begin_by_markers(self, marked: KinematicsFit, delay: float, anywhere: bool) -> _Begin:
        """Begin with the mounting by which sensors follow the bodies that markers show."""
        seen = np.flatnonzero(marked.seen)
        stride = max(1, int(marked.seen.sum()) // fit_mounting.FRAMES)
        looked = seen[::stride]
        time = self.tracked.markers.time[looked] + delay
        earth = rotations_at(self.sensors, time, self.model)
        bodies = self._bodies(marked)[looked]
        up = np.asarray(self.model.up)
        guess, own = first_guess.from_motion(bodies, earth, up, anywhere)
        notes: tuple[Message, ...] = ()
        if own and not anywhere:
            spread = np.degrees(np.ptp(guess.headings))
            notes = (
                SENSORS.message(
                    f"headings of the sensors are up to {spread:.0f}° apart, as without"
                    " magnetometer: each sensor's is found by the markers",
                    gravity="good to know",
                ),
            )
        return _Begin(guess=guess, azimuth=True, anywhere=anywhere or own, notes=notes)

    def _begin_by_pose(self, fit: MountingFit, delay: float, anywhere: bool) -> _Begin:
        """Begin with the mounting by which sensors report the calibration pose.

        Raises
        ------
        BadData : there is no pose, or the heading of each sensor is not known
        UnknownName : a sensor or an axis is unknown
        """
        sensors = self.sensors
        pose = fit.pose
        if pose is None:
            raise BadData(
                f"{sensors.source or 'sensors'}: nothing says how they are mounted: record the"
                " calibration pose (--imu-pose FILE, or --imu-pose-time START END), markers, or"
                " use a model with a frame of each sensor's name (--imu-mounting model)"
            )
        axes = self.recording.headings
        headings = first_guess.named_headings(self.model, sensors.names, pose, axes)
        if headings is not None:
            guess = first_guess.from_pose(fit.tree, self.bodies, pose, headings)
            return _Begin(guess=guess, azimuth=False, anywhere=anywhere, notes=())
        if anywhere:
            raise BadData(
                f"{sensors.source}: without magnetic fields every sensor has a heading of its"
                " own: name each sensor's axis that points forward in the calibration pose"
                " (--imu-heading SENSOR=AXIS ...)"
            )
        guess = first_guess.by_trying(
            fit.tree, self.bodies, pose, lambda guess: self._cost(fit, guess, delay)
        )
        return _Begin(guess=guess, azimuth=True, anywhere=False, notes=self._apart())

    def _apart(self) -> tuple[Message, ...]:
        """Warn of sensors of legs that rotate about another axis than the others.

        None without human legs.
        """
        segments = segments_if_human(self.model)
        legs = [
            index
            for index, body in enumerate(self.bodies)
            if body in segments and segments[body].name in LEGS
        ]
        sensors = self.sensors
        earth = rotations_at(sensors, sensors.time, self.model)[:, legs]
        angles = first_guess.turned_from_others(sensors.time, earth, np.asarray(self.model.up))
        apart = [
            f"{sensors.names[leg]} ({np.degrees(angle):.0f}°)"
            for leg, angle in zip(legs, angles, strict=True)
            if angle > APART
        ]
        if not apart:
            return ()
        text = SENSORS.message(
            f"sensors {few(apart)} rotate about another axis than the other sensors of the"
            " legs: either legs moved sideways, or headings differ, as without magnetometer,"
            " and joint angles are wrong there: name the axis of each that points forward"
            " (--imu-heading SENSOR=AXIS ...), or record markers",
            gravity="changes results",
        )
        return (text,)

    def _as_modelled(self) -> SensorMounting:
        """Take the model's frames of the sensors' names as mountings."""
        names = self.sensors.names
        frames = {frame.name: frame for frame in self.model.frames}
        for name in names:
            if name not in frames:
                raise UnknownName(
                    "frame", name, existing=tuple(frames), where="--imu-mounting model: the model"
                )
        count = len(names)
        # As uncertain as a joint angle in the pose that placed the frames.
        error = self.sizes.imu_pose_error
        return SensorMounting(
            sensors=names,
            bodies=self.bodies,
            rotations=np.array([frames[name].pose.rotation for name in names]),
            knots=self.sensors.time[:1],
            headings=np.zeros((1, count)),
            delay=0.0,
            factor=np.diag([error] * 3 * count + [0.0] * count),
            up=np.asarray(self.model.up),
        )

    def _pose(self) -> CalibrationPose | None:
        """Read the calibration pose.

        It is recorded apart, at the time stated, or at the start where the body stands still.
        """
        recording = self.recording
        rest = compile_tree(self.model).defaults
        trial = recording.sensors
        span = recording.pose_time
        if recording.pose is not None:
            apart = with_orientations(recording.pose.only(trial.names), self.sizes.imu_magnetometer)
            used = apart if span is None else apart.between(*span)
            return first_guess.calibration_pose(self.model, used, rest, float(trial.time[0]))
        if span is not None:
            used = trial.between(*span)
            return first_guess.calibration_pose(self.model, used, rest, 0.5 * sum(span))
        start = trial.between(trial.time[0], trial.time[0] + STILL_TIME)
        if self.tracked.fit is not None or len(start) < 2:
            return None
        rotations = rotations_at(start, start.time, self.model)
        speeds = first_guess.speeds_of(start.time, rotations, start.time)
        if not np.nanmax(speeds) < STILL:
            return None
        return first_guess.calibration_pose(self.model, start, rest, float(start.time[0]))

    def _delay(self) -> _Delay:
        """Find the delay of the sensors' clock against the markers', by speeds of rotation."""
        marked = self.tracked.fit
        if marked is None or self.recording.same_clock:
            return _Delay(0.0)
        time = self.tracked.markers.time
        at = np.arange(time[0], time[-1], 1.0 / first_guess.RATE)
        by_markers = first_guess.speeds_of(time[marked.seen], self._bodies(marked)[marked.seen], at)
        sensors = self.sensors
        earth = rotations_at(sensors, sensors.time, self.model)
        recorded = first_guess.speeds_of(sensors.time, earth, sensors.time)

        def by_sensors(times: Array) -> Array:
            columns = [
                np.interp(times, sensors.time, column, np.nan, np.nan) for column in recorded.T
            ]
            return np.column_stack(columns)

        delay, likeness = first_guess.clock_delay(by_markers, by_sensors, at, MAX_DELAY)
        if not likeness > first_guess.MIN_LIKENESS:
            text = CLOCKS.message(
                f"sensors and markers do not turn alike at any delay within {MAX_DELAY:g} s"
                f" (correlation {likeness:.2f}): are they of one trial, and on the bodies that"
                " they name? Clocks are taken as one"
            )
            return _Delay(0.0, (text,))
        if abs(delay) <= 1.0 / first_guess.RATE:
            return _Delay(delay)
        text = CLOCKS.message(
            f"the sensors' clock is {1e3 * delay:.0f} ms behind the markers' (correlation"
            f" {likeness:.2f})",
            size=1e3 * abs(delay),
            gravity="good to know",
        )
        return _Delay(delay, (text,))

    def _bodies(self, marked: KinematicsFit) -> Array:
        """Compute rotations of the sensors' bodies by the markers.

        Returns
        -------
        (frames, sensors, 3, 3)
        """
        tree = compile_tree(self.model)
        values = np.where(np.isfinite(marked.motion.values), marked.motion.values, tree.defaults)
        numbers = [tree.body_number(body) for body in self.bodies]
        return forward_kinematics(tree, values).rotations[:, numbers]

    def _chosen(self, delay: float) -> Chosen:
        """Choose frames, spread over the time that sensors and markers share.

        Raises
        ------
        BadData : they share no time
        """
        markers = self.tracked.markers
        usable = np.flatnonzero(self._usable(delay))
        if not len(usable):
            raise BadData(f"{self.sensors.source or 'sensors'}: no time in common with the markers")
        duration = float(markers.time[usable[-1]] - markers.time[usable[0]])
        by_knots = int(fit_mounting.FRAMES_PER_KNOT * duration / fit_mounting.KNOTS)
        count = min(max(fit_mounting.FRAMES, by_knots), len(usable))
        frames = usable[np.unique(np.linspace(0, len(usable) - 1, count).astype(int))]
        names: tuple[str, ...] = ()
        weights = np.empty(0)
        if self.tracked.fit is not None:
            names, weights = tracked_markers(self.model, markers, self.options)
        independent = min(duration / fit_mounting.CORRELATED, fit_mounting.INDEPENDENT)
        return Chosen(
            time=markers.time[frames],
            markers=markers.frames(frames),
            marker_names=names,
            marker_weights=weights,
            share=min(1.0, max(independent, 1.0) / len(frames)),
        )

    def _usable(self, delay: float) -> np.ndarray:
        """Find frames in which sensors, and markers where there are any, report.

        Frames that show all sensors say most: they alone count where there are enough.

        Parameters
        ----------
        delay : of the sensors' clock [s]

        Returns
        -------
        (frames,)
        """
        sensors = self.sensors
        time = self.tracked.markers.time + delay
        usable = (time >= sensors.time[0]) & (time <= sensors.time[-1])
        if self.tracked.fit is not None:
            usable &= self.tracked.fit.seen
        reported = np.isfinite(rotations_at(sensors, time, self.model)).all(axis=(1, 2, 3))
        if (usable & reported).sum() > ENOUGH * usable.sum():
            usable &= reported
        return np.asarray(usable)

    def _cost(self, fit: MountingFit, guess: Guess, delay: float) -> float:
        """Compute the mean cost of some frames with a guess, in squares of the noise."""
        markers = fit.chosen.markers.frames(slice(None, None, TRIED_FRAMES))
        thin = replace(fit, chosen=fit.chosen._replace(time=markers.time, markers=markers))
        starts = np.tile(fit.tree.defaults, (len(markers.time), 1))
        cost = thin.poses(thin.at(guess, delay), starts).cost
        return float(np.mean(cost[np.isfinite(cost)])) / self.sizes.imu_marker_noise**2


def _of_heading(guess: Guess) -> tuple[Message, ...]:
    """Question a heading that fits hardly better than another one."""
    if not guess.ambiguity < AMBIGUOUS:
        return ()
    text = SENSORS.message(
        "the recording hardly tells which way the body faces in the calibration pose (another"
        f" heading fits {guess.ambiguity:.2f} times as badly): name a sensor's axis that points"
        " forward (--imu-heading SENSOR=AXIS)",
        gravity="changes results",
    )
    return (text,)


def _of_mounting(found: SensorMounting, by_pose: Guess | None) -> Iterator[Message]:
    """Report sensors that are not mounted as the calibration pose says, and drifting headings."""
    if by_pose is not None:
        turned = found.rotations @ np.swapaxes(by_pose.rotations, 1, 2)
        angles = np.linalg.norm(vector_from_rotation(turned), axis=1)
        for name, angle in zip(found.sensors, angles, strict=True):
            if angle > SLIPPED:
                yield (
                    SENSORS.message(
                        f"sensor '{name}' is turned by {np.degrees(angle):.0f}° on its body against"
                        " the calibration pose: the recording's own mounting is used"
                    )
                )
    drifts = np.ptp(found.headings, axis=0)
    for name, angle in zip(found.sensors, drifts, strict=True):
        if angle > DRIFTED:
            yield SENSORS.message(
                f"the heading of sensor '{name}' drifts by {np.degrees(angle):.0f}°: corrected",
                gravity="good to know",
            )
