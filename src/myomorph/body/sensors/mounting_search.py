"""The search for the mounting of sensors: from markers, from a calibration pose, or as modelled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.sensors import first_guess, fit_mounting
from myomorph.body.sensors.facing import facing_starts
from myomorph.body.sensors.first_guess import CalibrationPose, Guess
from myomorph.body.sensors.fit_mounting import Chosen, Misfit, MountingFit
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
# A mounting of a sensor that slipped is reported where the recording turns it further from the
# calibration pose's [rad]
SLIPPED = 0.2
STANDS_OTHERWISE = 0.4
"""And that of one that did not: below, whoever stands with other joint angles explains it [rad]."""
DRIFTED = 0.09  # A heading that turns further in a recording is reported [rad]
MAX_DELAY = 2.0  # The sensors' clock may differ from that of the markers by so much [s]
# A sensor whose axis of turning is further from that of the others is reported
APART = np.radians(30.0)
LEGS = ("thigh", "shank", "foot")
MAX_SLIPS = 2  # Sensors that may have slipped
TRIED_SLIPS = 3  # Of those that miss the calibration pose most, so many are freed of it in turn
MIN_SLIP = 0.04  # One that misses it by less did not slip [rad]
EVIDENCE = 40.0  # By so much, in squares of the noise, a slip has to lower the cost
TRIED_FRAMES = 32  # So many frames are looked at where headings are tried
ROUGH_FRAMES = 16  # And where other ways to read a recording are
COARSE = 40
COARSE_STEPS = 12
"""Frames on which ways to read a recording are compared, in the place of `fit_mounting.FRAMES`, and
Gauss-Newton steps there: a reading that is wrong does not converge.
"""
ROUGH_HEADINGS = 12


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


class SolvedMounting(NamedTuple):
    """A mounting that was solved to its end.

    Attributes
    ----------
    mounting : with what looks wrong
    misfit : what it leaves
    ambiguous : whether another heading of the calibration pose leaves hardly more
    """

    mounting: SensorMounting
    misfit: Misfit
    ambiguous: bool = False

    def noted(self, notes: tuple[Message, ...], ambiguous: bool) -> SolvedMounting:
        """Replace the mounting's messages, and whether its heading is ambiguous."""
        mounting = replace(self.mounting, notes=notes)
        return self._replace(mounting=mounting, ambiguous=ambiguous)


class _Delay(NamedTuple):
    """Delay of the sensors' clock behind the markers'.

    Attributes
    ----------
    seconds : the delay [s]
    notes : what is worth knowing of it
    """

    seconds: float
    notes: tuple[Message, ...] = ()


class Draft(NamedTuple):
    """A mounting by few frames of a recording.

    Attributes
    ----------
    solved : mounting, and what it leaves
    slipped : numbers of sensors that slipped after the pose
    begin : where the search began
    delay : of the sensors' clock
    near : what is said where another heading leaves hardly more
    """

    solved: SolvedMounting
    slipped: frozenset[int]
    begin: _Begin
    delay: _Delay
    near: tuple[Message, ...]

    def as_solved(self) -> SolvedMounting:
        """Return the mounting with all that is said of it."""
        notes = (*self.delay.notes, *self.solved.mounting.notes, *self.near)
        return self.solved.noted(notes, bool(self.near))


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
    frames : of a short recording that take part; a long one has as many more as usual
    """

    model: Model
    recording: SensorRecording
    bodies: tuple[str, ...]
    tracked: TrackedMarkers
    options: InverseKinematicsOptions
    frames: int = fit_mounting.FRAMES

    @property
    def coarse(self) -> MountingSearch:
        """The same search on few frames."""
        return replace(self, frames=COARSE)

    @property
    def sensors(self) -> InertialSensors:
        """Recorded orientations."""
        return self.recording.sensors

    @property
    def sizes(self) -> SensorOptions:
        """Noise, and how the mounting is found."""
        return self.recording.sizes

    def solution(self, anywhere: bool, slips: bool = True) -> SolvedMounting:
        """Find the mounting the way that the options and the recording name.

        Where the heading of the calibration pose is not known, each that may be is solved to its
        end on few frames, and that which leaves least is taken. So are sensors that slipped. All
        frames are solved from there.

        Parameters
        ----------
        anywhere : whether each sensor has a heading of its own
        slips : whether a sensor may have slipped after the pose

        Returns
        -------
        the mounting with what looks wrong, and what it leaves

        Raises
        ------
        BadData : nothing says how the sensors are mounted, or a heading is not known
        UnknownName : a sensor, an axis or a frame of the model is unknown
        """
        if self.sizes.imu_mounting != "recording":
            return self._without_recording(anywhere)
        return self.on_all_frames(self.coarse.on_few_frames(anywhere, slips))

    def _without_recording(self, anywhere: bool) -> SolvedMounting:
        """Take the mounting from the calibration pose alone, or from the model."""
        if self.sizes.imu_mounting == "model":
            mounting = self._as_modelled()
            return SolvedMounting(mounting=mounting, misfit=self._fit(0.0, None).misfit(mounting))
        delay = self._delay()
        fit = self._fit(delay.seconds, self._pose())
        ended = [
            self._by_pose(fit, begin, delay.seconds)
            for begin in self._begins_by_pose(fit, delay.seconds, anywhere)
        ]
        ended.sort(key=lambda solved: solved.misfit.cost)
        near = _of_heading(ended)
        return ended[0].noted((*delay.notes, *ended[0].mounting.notes, *near), bool(near))

    def on_few_frames(self, anywhere: bool, slips: bool) -> Draft:
        """Solve the mounting on the frames of this search; see `solution`."""
        pose = self._pose()
        delay = self._delay()
        fit = self._fit(delay.seconds, pose)
        begins = self._begins(fit, delay.seconds, anywhere)
        ended = [(self._fitted(fit, begin, delay.seconds), begin) for begin in begins]
        ended.sort(key=lambda pair: pair[0].misfit.cost)
        best, begin = ended[0]
        draft = Draft(
            solved=best,
            slipped=frozenset(),
            begin=begin,
            delay=delay,
            near=_of_heading([solved for solved, _ in ended]),
        )
        if slips and pose is not None:
            return self._with_slips(fit, draft)
        return draft

    def on_all_frames(self, draft: Draft) -> SolvedMounting:
        """Solve the mounting from where few frames led to.

        Parameters
        ----------
        draft : of the same recording on few frames

        Returns
        -------
        the mounting with what looks wrong, and what it leaves
        """
        delay = draft.delay
        fit = replace(self._fit(delay.seconds, self._pose()), slipped=draft.slipped)
        solved = self._fitted(fit, draft.begin, delay.seconds, draft.solved.mounting)
        notes = (*delay.notes, *solved.mounting.notes, *draft.near)
        return solved.noted(notes, bool(draft.near))

    def rough_cost(self, anywhere: bool, angles: Sequence[float] = ()) -> float:
        """Compute the least cost of a few frames with mountings where the search would begin.

        Parameters
        ----------
        anywhere : whether each sensor has a heading of its own
        angles : headings of the calibration pose that are tried [rad]; empty for all round the
            circle

        Returns
        -------
        mean of the frames, in squares of the noise
        """
        kind = self.sizes.imu_mounting
        if kind == "model":
            return self._thin(self._fit(0.0, None), ROUGH_FRAMES).misfit(self._as_modelled()).cost
        pose = self._pose()
        delay = self._delay().seconds
        fit = self._thin(self._fit(delay, pose), ROUGH_FRAMES)
        if self.tracked.fit is not None and kind == "recording":
            begin = self._begin_by_markers(self.tracked.fit, delay, anywhere)
            return fit.misfit(fit.at(begin.guess, delay)).cost
        named = self._named_headings(pose)
        if pose is None or named is not None:
            begins = self._begins_by_pose(fit, delay, anywhere)
            return min(self._cost(fit, begin.guess, delay) for begin in begins)
        circle = np.arange(0.0, 2.0 * np.pi, 2.0 * np.pi / ROUGH_HEADINGS)
        count = len(self.bodies)
        guesses = [
            first_guess.from_pose(fit.tree, self.bodies, pose, np.full(count, angle))
            for angle in (angles or circle)
        ]
        return min(self._cost(fit, guess, delay) for guess in guesses)

    def _begins(self, fit: MountingFit, delay: float, anywhere: bool) -> tuple[_Begin, ...]:
        """Begin with what markers show, or else with the calibration pose."""
        if self.tracked.fit is not None and self.sizes.imu_mounting == "recording":
            return (self._begin_by_markers(self.tracked.fit, delay, anywhere),)
        return self._begins_by_pose(fit, delay, anywhere)

    def _fit(self, delay: float, pose: CalibrationPose | None) -> MountingFit:
        """Set the problem: frames of the recording, and the calibration pose."""
        return MountingFit(
            tree=compile_tree(self.model),
            sensors=self.sensors,
            bodies=self.bodies,
            chosen=self._chosen(delay),
            options=self.options,
            sizes=self.sizes,
            pose=pose,
            steps=fit_mounting.STEPS if self.frames > COARSE else COARSE_STEPS,
        )

    def _by_pose(self, fit: MountingFit, begin: _Begin, delay: float) -> SolvedMounting:
        """Take the mounting from the pose alone."""
        start = fit.at(begin.guess, delay)
        by_pose = replace(fit.by_pose(start).mounting, notes=begin.notes)
        return SolvedMounting(mounting=by_pose, misfit=fit.misfit(by_pose))

    def _with_slips(self, fit: MountingFit, draft: Draft) -> Draft:
        """Free sensors of the calibration pose one by one, as long as that is decisive."""
        for _ in range(MAX_SLIPS):
            # As much as is left is the most that a slip can lower the cost by.
            if draft.solved.misfit.total < EVIDENCE:
                break
            freed = self._slipped(fit, draft)
            if freed is None:
                break
            draft = freed
        return draft

    def _fitted(
        self,
        fit: MountingFit,
        begin: _Begin,
        delay: float,
        near: SensorMounting | None = None,
    ) -> SolvedMounting:
        """Fit the mounting to recording and pose, from a mounting near to the solution if any."""
        start = fit.at(begin.guess, delay)
        found = fit.fitted(start, begin.azimuth, begin.anywhere, near).mounting
        of_pose = None
        if fit.pose is not None:
            headings = found.heading_at(np.array([fit.pose.time]))[0]
            of_pose = first_guess.from_pose(fit.tree, self.bodies, fit.pose, headings)
        notes = (*begin.notes, *_of_mounting(found, of_pose, fit.slipped))
        return SolvedMounting(mounting=replace(found, notes=notes), misfit=fit.misfit(found))

    def _slipped(self, fit: MountingFit, draft: Draft) -> Draft | None:
        """Find a sensor that slipped after the calibration pose, where that is decisive.

        Parameters
        ----------
        fit : setting
        draft : with the sensors that are known to have slipped

        Returns
        -------
        None where none is shown
        """
        left = np.array(draft.solved.misfit.in_pose)
        left[list(draft.slipped)] = 0.0
        tried = [int(index) for index in np.argsort(-left)[:TRIED_SLIPS] if left[index] > MIN_SLIP]
        found = list[Draft]()
        for index in tried:
            slipped = draft.slipped | {index}
            freed = replace(fit, slipped=slipped)
            solved = self._fitted(freed, draft.begin, draft.delay.seconds)
            found.append(draft._replace(solved=solved, slipped=slipped))
        best = min(found, key=lambda one: one.solved.misfit.total, default=None)
        if best is None or best.solved.misfit.total > draft.solved.misfit.total - EVIDENCE:
            return None
        return best

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
                    f"headings of the sensors are up to {spread:.0f}° apart, as without a"
                    " magnetometer: each is found from the markers",
                    severity="good to know",
                ),
            )
        return _Begin(guess=guess, azimuth=True, anywhere=anywhere or own, notes=notes)

    def _named_headings(self, pose: CalibrationPose | None) -> Array | None:
        """Find headings by the axes that the user named, None without."""
        if pose is None:
            return None
        axes = self.recording.headings
        return first_guess.named_headings(self.model, self.sensors.names, pose, axes)

    def _begins_by_pose(self, fit: MountingFit, delay: float, anywhere: bool) -> tuple[_Begin, ...]:
        """Begin with mountings by which sensors report the calibration pose.

        Raises
        ------
        BadData : there is no pose, or the heading of each sensor is not known
        UnknownName : a sensor or an axis is unknown
        """
        sensors = self.sensors
        pose = fit.pose
        if pose is None:
            raise BadData(
                f"{sensors.source or 'sensors'}: their mounting is unknown: record the"
                " calibration pose (--imu-pose FILE, or --imu-pose-time START END), markers, or"
                " use a model with a frame of each sensor's name (--imu-mounting model)"
            )
        headings = self._named_headings(pose)
        if headings is not None:
            guess = first_guess.from_pose(fit.tree, self.bodies, pose, headings)
            return (_Begin(guess=guess, azimuth=False, anywhere=anywhere, notes=()),)
        if anywhere:
            raise BadData(
                f"{sensors.source}: without magnetic fields every sensor has a heading of its"
                " own: name each sensor's axis that points forward in the calibration pose"
                " (--imu-heading SENSOR=AXIS ...)"
            )
        thin = self._thin(fit, min(TRIED_FRAMES, self.frames // 2))
        guesses = first_guess.by_trying(
            fit.tree, self.bodies, pose, lambda guess: self._cost(thin, guess, delay)
        )
        notes = self._of_axes()
        return tuple(
            _Begin(guess=guess, azimuth=True, anywhere=False, notes=notes) for guess in guesses
        )

    def apart(self) -> dict[str, float]:
        """Find sensors of legs that rotate about another axis than the others.

        Returns
        -------
        angle between the axes by sensor [rad]; none without human legs
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
        return {
            sensors.names[leg]: float(angle)
            for leg, angle in zip(legs, angles, strict=True)
            if angle > APART
        }

    def _of_axes(self) -> tuple[Message, ...]:
        """Warn of sensors of legs that rotate about another axis than the others."""
        apart = [f"{name} ({np.degrees(angle):.0f}°)" for name, angle in self.apart().items()]
        if not apart:
            return ()
        text = SENSORS.message(
            f"sensors {few(apart)} rotate about another axis than the other sensors of the"
            " legs: either legs moved sideways, or headings differ, as without magnetometer,"
            " and joint angles are wrong there: name the axis of each that points forward"
            " (--imu-heading SENSOR=AXIS ...), or record markers",
            severity="changes results",
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
                f"sensors and markers do not rotate alike at any delay within {MAX_DELAY:g} s"
                f" (correlation {likeness:.2f}): are they of one trial, and on the bodies that"
                " they name? Their clocks are assumed to agree"
            )
            return _Delay(0.0, (text,))
        if abs(delay) <= 1.0 / first_guess.RATE:
            return _Delay(delay)
        text = CLOCKS.message(
            f"the sensors' clock is {1e3 * delay:.0f} ms behind the markers' (correlation"
            f" {likeness:.2f})",
            size=1e3 * abs(delay),
            severity="good to know",
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
        thinned = self.frames / fit_mounting.FRAMES
        count = min(max(self.frames, int(thinned * by_knots)), len(usable))
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

    def _thin(self, fit: MountingFit, frames: int) -> MountingFit:
        """Take fewer of the chosen frames."""
        every = max(1, len(fit.chosen.time) // frames)
        markers = fit.chosen.markers.frames(slice(None, None, every))
        return replace(fit, chosen=fit.chosen._replace(time=markers.time, markers=markers))

    def _cost(self, fit: MountingFit, guess: Guess, delay: float) -> float:
        """Compute the mean cost of frames with a guess, in squares of the noise."""
        mounting = fit.at(guess, delay)
        reported = mounting.body_rotations(fit.sensors, fit.chosen.time, self.model)
        starts = facing_starts(fit.tree, self.bodies, reported)
        cost = fit.poses(mounting, starts).cost
        return float(np.mean(cost[np.isfinite(cost)])) / self.sizes.imu_marker_noise**2


def _of_heading(solved: Sequence[SolvedMounting]) -> tuple[Message, ...]:
    """Question a heading that leaves hardly less than another one.

    Parameters
    ----------
    solved : the best first
    """
    if len(solved) < 2:
        return ()
    floor = first_guess.FLOOR
    ratio = (solved[1].misfit.cost + floor) / (solved[0].misfit.cost + floor)
    if not ratio < AMBIGUOUS:
        return ()
    text = SENSORS.message(
        "the recording hardly shows which way the body faces in the calibration pose (another"
        f" heading fits {ratio:.2f} times as badly): name a sensor's axis that points"
        " forward (--imu-heading SENSOR=AXIS)",
        severity="changes results",
    )
    return (text,)


def _of_mounting(
    found: SensorMounting, by_pose: Guess | None, slipped: frozenset[int]
) -> Iterator[Message]:
    """Report sensors that are not mounted as the calibration pose says, and drifting headings."""
    if by_pose is not None:
        turned = found.rotations @ np.swapaxes(by_pose.rotations, 1, 2)
        angles = np.linalg.norm(vector_from_rotation(turned), axis=1)
        for index, (name, angle) in enumerate(zip(found.sensors, angles, strict=True)):
            if angle > (SLIPPED if index in slipped else STANDS_OTHERWISE):
                yield (
                    SENSORS.message(
                        f"sensor '{name}' is rotated by {np.degrees(angle):.0f}° on its body from"
                        " the calibration pose: the recording's own mounting is used"
                    )
                )
    drifts = np.ptp(found.headings, axis=0)
    for name, angle in zip(found.sensors, drifts, strict=True):
        if angle > DRIFTED:
            yield SENSORS.message(
                f"the heading of sensor '{name}' drifts by {np.degrees(angle):.0f}°: corrected",
                severity="good to know",
            )
