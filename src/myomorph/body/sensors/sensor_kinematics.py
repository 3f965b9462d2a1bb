"""Inverse kinematics of sensors and markers together: what one of them misses the other shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.body.sensors import first_guess, fit_mounting
from myomorph.body.sensors.undetermined import (
    LikelyAngles,
    Seen,
    joint_angles,
    likely_angles,
    undetermined,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, UnknownName, few
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_if_human
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    inverse_kinematics,
    pose_problem,
    tracked_markers,
)
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    SensorOptions,
    bodies_of_sensors,
    orientation_tasks,
    rotations_at,
    weights_seen,
    with_orientations,
)
from myomorph.core.motion.sensors.sensor_fit import SensorFit, with_tasks
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.turns import floating_coordinates
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
SEARCH = 2.0  # The sensors' clock may differ from that of the markers by so much [s]
LOST = 0.02  # A sensor that is missing in a larger share of the frames is reported
# A sensor whose axis of turning is further from that of the others is reported
APART = np.radians(30.0)
LEGS = ("thigh", "shank", "foot")
BRIDGE = 1e-6  # Weight of the root's place in frames in which no marker shows it [1/m^2]


@dataclass(frozen=True, eq=False)
class SensorRecording:
    """Sensors of a trial, and what is known of them.

    Attributes
    ----------
    sensors : recording
    bodies : of sensors that are not named like theirs, "" for one left out
    pose : the calibration pose where it was recorded apart
    pose_time : its start and end, in its own recording or in the trial [s]
    headings : each sensor's axis that points forward in the pose
    same_clock : whether the clock is that of the markers
    """

    sensors: InertialSensors
    bodies: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    pose: InertialSensors | None = None
    pose_time: tuple[float, float] | None = None
    headings: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    same_clock: bool = False


def sensor_kinematics(
    model: Model,
    recording: SensorRecording,
    markers: Markers | None = None,
    marked: KinematicsFit | None = None,
    options: InverseKinematicsOptions | None = None,
    sizes: SensorOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> SensorFit:
    """Find coordinates that sensors and markers agree on best, each weighted by its noise.

    Where each sensor is mounted, its heading and the delay of its clock are found first
    (`fit_mounting`), from the markers' motion or from a calibration pose and the recording itself.

    Parameters
    ----------
    model : calibrated to the body
    recording : sensors, and what is known of them
    markers : None where sensors are all there is
    marked : inverse kinematics of the markers alone; None without markers
    options : of inverse kinematics
    sizes : noise of sensors and markers, and how the mounting is found
    progress : called with the number of frames just done

    Returns
    -------
    motion, with the mounting and what of it is questioned

    Raises
    ------
    BadData : nothing says how the sensors are mounted, a heading is not known, or there is no time
        in common with the markers
    UnknownName : a sensor, an axis or a frame of the model is unknown
    """
    options = options or InverseKinematicsOptions()
    sizes = sizes or SensorOptions()
    raw = recording.sensors.orientations is None
    anywhere = raw and not (
        sizes.imu_magnetometer and recording.sensors.magnetic_fields is not None
    )
    bodies = bodies_of_sensors(model, recording.sensors.names, recording.bodies)
    sensors = with_orientations(recording.sensors.only(tuple(bodies)), sizes.imu_magnetometer)
    if markers is None:
        markers = Markers(sensors.time, (), np.empty((len(sensors), 0, 3)))
    oriented = replace(recording, sensors=sensors)
    mounting = _Finder(
        model, oriented, tuple(bodies.values()), markers, marked, options, sizes
    ).mounting(anywhere)
    reported = mounting.body_rotations(sensors, markers.time, model)
    seen = weights_seen(model, markers, options.marker_weights, options.only_weighted)
    bridges, places = (
        _bridges(model, marked) if marked is not None and not marked.seen.all() else ((), None)
    )
    tasks = orientation_tasks(mounting, reported, seen, sizes)
    fit = inverse_kinematics(model, markers, with_tasks(options, tasks, bridges, places), progress)
    spreads: Mapping[str, float] = FrozenMap({})
    notes = (*sensors.warnings, *mounting.notes)
    if not seen.any():
        likely, more = _lost(
            model, mounting, fit, np.asarray(np.isfinite(reported).all(axis=(2, 3))), options
        )
        notes = (*notes, *more)
        if likely is not None:
            names = [model.coordinate_names[j] for j in likely.columns]
            spreads = FrozenMap(dict(zip(names, likely.spread.tolist(), strict=True)))
            weights = (sizes.imu_marker_noise / likely.spread) ** 2
            bridges = tuple(
                CoordinateTask(*part) for part in zip(names, weights.tolist(), strict=True)
            )
            places = Motion(fit.motion.time, tuple(names), likely.values)
            fit = inverse_kinematics(
                model, markers, with_tasks(options, tasks, bridges, places), progress
            )
    return SensorFit(
        fit=fit,
        mounting=replace(mounting, notes=notes),
        sensors=sensors,
        bridges=bridges,
        places=places,
        spreads=spreads,
    )


def _lost(
    model: Model,
    mounting: SensorMounting,
    fit: KinematicsFit,
    known: np.ndarray,
    options: InverseKinematicsOptions,
) -> tuple[LikelyAngles | None, tuple[str, ...]]:
    """Find likely angles of joints whose sensor is lost.

    Parameters
    ----------
    known : (frames, sensors) whether a sensor reported

    Returns
    -------
    likely angles, and lines on these and on joints without any sensor
    """
    tree = compile_tree(model)
    problem = pose_problem(tree, (), np.empty(0), options)
    bodies = np.array([tree.body_number(body) for body in mounting.bodies], np.int64)
    values = np.where(np.isfinite(fit.motion.values), fit.motion.values, tree.defaults)
    seen = Seen(values=values, known=known, bodies=bodies, joints=joint_angles(tree, problem.free))
    likely = likely_angles(tree, problem, seen, fit.motion.time)
    notes = list[str]()
    ever = np.asarray(known.any(axis=0))
    blind = undetermined(tree, problem, seen, ever, int(np.argmax(known.sum(axis=1)))) & seen.joints
    if blind.any():
        names = [model.coordinate_names[j] for j in problem.free[blind]]
        notes.append(f"no sensor determines {few(names)}: they stay near their defaults")
    for index, name in enumerate(mounting.sensors):
        lost = float(np.mean(~known[:, index]))
        if lost > LOST and ever[index]:
            how = (
                "not determined there"
                if likely is None
                else "filled by how they went with the others before"
            )
            notes.append(
                f"sensor '{name}' is missing in {100 * lost:.0f} % of the frames: angles beside it"
                f" are {how}"
            )
    return likely, tuple(notes)


def _bridges(model: Model, marked: KinematicsFit) -> tuple[tuple[CoordinateTask, ...], Motion]:
    """Pull the root's position towards where markers show it before and after a gap."""
    seen = marked.seen
    motion = marked.motion
    names = [
        name
        for name in floating_coordinates(model)
        if model.coordinate(name).motion == "translational"
    ]
    columns = [np.interp(motion.time, motion.time[seen], motion[name][seen]) for name in names]
    places = Motion(motion.time, tuple(names), np.column_stack(columns)) if names else motion
    return tuple(CoordinateTask(name, BRIDGE) for name in names), places


@dataclass(frozen=True, eq=False)
class _Finder:
    """The search for the mounting of the sensors of one recording.

    Attributes
    ----------
    model : calibrated to the body
    recording : sensors, and what is known of them
    bodies : that each sensor is on
    markers : of the trial
    marked : inverse kinematics of the markers alone; None without markers
    options : of inverse kinematics
    sizes : noise of sensors and markers, and how the mounting is found
    """

    model: Model
    recording: SensorRecording
    bodies: tuple[str, ...]
    markers: Markers
    marked: KinematicsFit | None
    options: InverseKinematicsOptions
    sizes: SensorOptions

    def mounting(self, anywhere: bool) -> SensorMounting:
        """Find the mounting the way that the options and the recording name.

        Raises
        ------
        BadData : nothing says how the sensors are mounted, or a heading is not known
        """
        tree = compile_tree(self.model)
        sensors = self.recording.sensors
        kind = self.sizes.imu_mounting
        if kind == "model":
            return self._as_modelled()
        pose = self._pose()
        delay, notes = self._delay()
        fit = fit_mounting.MountingFit(
            tree, sensors, self.bodies, self._chosen(delay), self.options, self.sizes, pose
        )
        if self.marked is not None and kind == "recording":
            guess, own = self._from_markers(delay, anywhere)
            azimuth = True
            if own and not anywhere:
                anywhere = True
                notes += (
                    (
                        "headings of the sensors are up to"
                        f" {np.degrees(np.ptp(guess.headings)):.0f}° apart, as without"
                        " magnetometer: each sensor's is found by the markers"
                    ),
                )
        elif pose is None:
            raise BadData(
                f"{sensors.source or 'sensors'}: nothing says how they are mounted: record the"
                " calibration pose (--imu-pose FILE, or --imu-pose-time START END), markers, or"
                " use a model with a frame of each sensor's name (--imu-mounting model)"
            )
        else:
            named = first_guess.named_headings(
                self.model, sensors.names, pose, self.recording.headings
            )
            if named is None and anywhere:
                raise BadData(
                    f"{sensors.source}: without magnetic fields every sensor has a heading of its"
                    " own: name each sensor's axis that points forward in the calibration pose"
                    " (--imu-heading SENSOR=AXIS ...)"
                )
            azimuth = named is None
            if named is not None:
                guess = first_guess.from_pose(tree, self.bodies, pose, named)
            else:
                guess = first_guess.by_trying(
                    tree, self.bodies, pose, lambda guess: self._cost(fit, guess, delay)
                )
            notes += self._apart() if azimuth else ()
        start = fit.at(guess, delay)
        notes += _of_heading(guess)
        if kind == "pose":
            return replace(fit.by_pose(start).mounting, notes=notes)
        found = fit.fitted(start, azimuth, anywhere).mounting
        if pose is None:
            return replace(found, notes=(*notes, *_of_mounting(found, None)))
        by_pose = first_guess.from_pose(
            tree, self.bodies, pose, found.heading_at(np.array([pose.time]))[0]
        )
        return replace(found, notes=(*notes, *_of_mounting(found, by_pose)))

    def _apart(self) -> tuple[str, ...]:
        """Warn of sensors of legs that rotate about another axis than the others.

        None without human legs.
        """
        segments = segments_if_human(self.model)
        legs = [
            index
            for index, body in enumerate(self.bodies)
            if body in segments and segments[body].name in LEGS
        ]
        sensors = self.recording.sensors
        earth = rotations_at(sensors, sensors.time, self.model)[:, legs]
        angles = first_guess.turned_from_others(sensors.time, earth, np.asarray(self.model.up))
        apart = [
            f"{sensors.names[legs[i]]} ({np.degrees(angle):.0f}°)"
            for i, angle in enumerate(angles)
            if angle > APART
        ]
        if not apart:
            return ()
        return (
            (
                f"sensors {few(apart)} rotate about another axis than the other sensors of the"
                " legs: either legs moved sideways, or headings differ, as without magnetometer,"
                " and joint angles are wrong there: name the axis of each that points forward"
                " (--imu-heading SENSOR=AXIS ...), or record markers"
            ),
        )

    def _as_modelled(self) -> SensorMounting:
        sensors = self.recording.sensors
        frames = {frame.name: frame for frame in self.model.frames}
        for name in sensors.names:
            if name not in frames:
                raise UnknownName("frame", name, tuple(frames), "--imu-mounting model: the model")
        rotations = np.array([frames[name].pose.rotation for name in sensors.names])
        count = len(sensors.names)
        up = np.asarray(self.model.up)
        # As uncertain as a joint angle in the pose that placed the frames.
        factor = np.diag([self.sizes.imu_pose_error] * 3 * count + [0.0] * count)
        return SensorMounting(
            sensors=sensors.names,
            bodies=self.bodies,
            rotations=rotations,
            knots=sensors.time[:1],
            headings=np.zeros((1, count)),
            delay=0.0,
            factor=factor,
            up=up,
        )

    def _pose(self) -> first_guess.CalibrationPose | None:
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
            return first_guess.calibration_pose(
                self.model, trial.between(*span), rest, 0.5 * sum(span)
            )
        start = trial.between(trial.time[0], trial.time[0] + STILL_TIME)
        if self.marked is not None or len(start) < 2:
            return None
        speeds = first_guess.speeds_of(
            start.time, rotations_at(start, start.time, self.model), start.time
        )
        still = np.nanmax(speeds) < STILL
        return (
            first_guess.calibration_pose(self.model, start, rest, float(start.time[0]))
            if still
            else None
        )

    def _delay(self) -> tuple[float, tuple[str, ...]]:
        """Find the delay of the sensors' clock against the markers', by speeds of rotation [s]."""
        if self.marked is None or self.recording.same_clock:
            return 0.0, ()
        seen = self.marked.seen
        time = self.markers.time
        at = np.arange(time[0], time[-1], 1.0 / first_guess.RATE)
        own = first_guess.speeds_of(time[seen], self._bodies()[seen], at)
        sensors = self.recording.sensors
        earth = rotations_at(sensors, sensors.time, self.model)
        dense = first_guess.speeds_of(sensors.time, earth, sensors.time)

        def speeds(times: Array) -> Array:
            return np.column_stack(
                [np.interp(times, sensors.time, column, np.nan, np.nan) for column in dense.T]
            )

        delay, likeness = first_guess.clock_delay(own, speeds, at, SEARCH)
        if not likeness > first_guess.MIN_LIKENESS:
            return 0.0, (
                (
                    f"sensors and markers do not turn alike at any delay within {SEARCH:g} s"
                    f" (correlation {likeness:.2f}): are they of one trial, and on the bodies that"
                    " they name? Clocks are taken as one"
                ),
            )
        note = (
            f"the sensors' clock is {1e3 * delay:.0f} ms behind the markers' (correlation"
            f" {likeness:.2f})"
        )
        return delay, (note,) if abs(delay) > 1.0 / first_guess.RATE else ()

    def _bodies(self) -> Array:
        """Compute rotations of the sensors' bodies by the markers.

        Returns
        -------
        (frames, sensors, 3, 3)
        """
        assert self.marked is not None
        tree = compile_tree(self.model)
        values = np.where(
            np.isfinite(self.marked.motion.values), self.marked.motion.values, tree.defaults
        )
        return forward_kinematics(tree, values).rotations[
            :, [tree.body_number(body) for body in self.bodies]
        ]

    def _from_markers(self, delay: float, anywhere: bool) -> tuple[first_guess.Guess, bool]:
        assert self.marked is not None
        seen = np.flatnonzero(self.marked.seen)[
            :: max(1, int(self.marked.seen.sum()) // fit_mounting.FRAMES)
        ]
        earth = rotations_at(self.recording.sensors, self.markers.time[seen] + delay, self.model)
        return first_guess.from_motion(
            self._bodies()[seen], earth, np.asarray(self.model.up), anywhere
        )

    def _chosen(self, delay: float) -> fit_mounting.Chosen:
        """Choose frames, spread over the time that sensors and markers share.

        Raises
        ------
        BadData : they share no time
        """
        sensors = self.recording.sensors
        time = self.markers.time
        usable = (time + delay >= sensors.time[0]) & (time + delay <= sensors.time[-1])
        if self.marked is not None:
            usable &= self.marked.seen
        # Frames that show all sensors say most, where there are enough.
        reported = np.isfinite(rotations_at(sensors, time + delay, self.model)).all(axis=(1, 2, 3))
        if (usable & reported).sum() > ENOUGH * usable.sum():
            usable &= reported
        frames = np.flatnonzero(usable)
        if not len(frames):
            raise BadData(f"{sensors.source or 'sensors'}: no time in common with the markers")
        duration = float(time[frames[-1]] - time[frames[0]])
        most = max(
            fit_mounting.FRAMES, int(fit_mounting.FRAMES_PER_KNOT * duration / fit_mounting.KNOTS)
        )
        frames = frames[
            np.unique(np.linspace(0, len(frames) - 1, min(most, len(frames))).astype(int))
        ]
        shown = self.marked is not None
        names, weights = (
            tracked_markers(self.model, self.markers, self.options) if shown else ((), np.empty(0))
        )
        markers = self.markers.frames(frames)
        independent = min(duration / fit_mounting.CORRELATED, fit_mounting.INDEPENDENT)
        return fit_mounting.Chosen(
            time[frames], markers, names, weights, min(1.0, max(independent, 1.0) / len(frames))
        )

    def _cost(self, fit: fit_mounting.MountingFit, guess: first_guess.Guess, delay: float) -> float:
        """Compute the mean cost of some frames with a guess, in squares of the noise."""
        markers = fit.chosen.markers.frames(slice(None, None, 5))
        thin = replace(fit, chosen=fit.chosen._replace(time=markers.time, markers=markers))
        _, _, cost = thin.poses(
            thin.at(guess, delay), np.tile(fit.tree.defaults, (len(thin.chosen.time), 1))
        )
        return float(np.mean(cost[np.isfinite(cost)])) / self.sizes.imu_marker_noise**2


def _of_heading(guess: first_guess.Guess) -> tuple[str, ...]:
    if not guess.ambiguity < AMBIGUOUS:
        return ()
    return (
        (
            "the recording hardly tells which way the body faces in the calibration pose (another"
            f" heading fits {guess.ambiguity:.2f} times as badly): name a sensor's axis that points"
            " forward (--imu-heading SENSOR=AXIS)"
        ),
    )


def _of_mounting(found: SensorMounting, by_pose: first_guess.Guess | None) -> Iterator[str]:
    """Report sensors that are not mounted as the calibration pose says, and drifting headings."""
    if by_pose is not None:
        angles = np.linalg.norm(
            vector_from_rotation(found.rotations @ np.swapaxes(by_pose.rotations, 1, 2)), axis=1
        )
        for name, angle in zip(found.sensors, angles, strict=True):
            if angle > SLIPPED:
                yield (
                    f"sensor '{name}' is turned by {np.degrees(angle):.0f}° on its body against the"
                    " calibration pose: the recording's own mounting is used"
                )
    gained = np.ptp(found.headings, axis=0)
    for name, angle in zip(found.sensors, gained, strict=True):
        if angle > DRIFTED:
            yield f"the heading of sensor '{name}' drifts by {np.degrees(angle):.0f}°: corrected"
