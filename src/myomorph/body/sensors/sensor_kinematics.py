"""Inverse kinematics of sensors and markers together: what one of them misses the other shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.sensors.mounting_search import MountingSearch
from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.body.sensors.undetermined import (
    LikelyAngles,
    Seen,
    joint_angles,
    likely_angles,
    undetermined,
)
from myomorph.body.sensors.whole_solutions import WholeSolution, whole_solution
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import SENSORS, UNSEEN
from myomorph.core.model.errors import few
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    inverse_kinematics,
    pose_problem,
)
from myomorph.core.motion.sensors.dropouts import gaps_filled, without_dropouts
from myomorph.core.motion.sensors.mounting import (
    SensorMounting,
    bodies_of_sensors,
    orientation_tasks,
    weights_seen,
    with_orientations,
)
from myomorph.core.motion.sensors.sensor_fit import SensorFit, with_tasks
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.tree import compile_tree

MAX_LOST = 0.02  # A sensor that is missing in a larger share of the frames is reported
BRIDGE = 1e-6  # Weight of the root's place in frames in which no marker shows it [1/m^2]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bridges:
    """What bridges gaps.

    Attributes
    ----------
    tasks : pulls of coordinates
    places : what they pull to; None without gaps
    spreads : standard deviation about there, of joints whose sensor is lost [rad]
    """

    tasks: tuple[CoordinateTask, ...] = ()
    places: Motion | None = None
    spreads: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))


def sensor_kinematics(
    model: Model,
    recording: SensorRecording,
    tracked: TrackedMarkers | None = None,
    options: InverseKinematicsOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> SensorFit:
    """Find coordinates that sensors and markers agree on best, each weighted by its noise.

    Where each sensor is mounted, its heading and the delay of its clock are found first
    (`MountingSearch`), from the markers' motion or from a calibration pose and the recording
    itself.

    Parameters
    ----------
    model : calibrated to the body
    recording : sensors, and what is known of them
    tracked : markers of the trial; None where sensors are all there is
    options : of inverse kinematics
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
    sizes = recording.sizes
    solution = _best_reading(model, recording, tracked, options)
    sensors = solution.search.sensors
    tracked = solution.search.tracked
    markers = tracked.markers
    mounting = solution.solved.mounting
    reported = mounting.body_rotations(sensors, markers.time, model)
    marker_weights = weights_seen(model, markers, options.marker_weights, options.only_weighted)
    tasks = orientation_tasks(mounting, reported, marker_weights, sizes)
    bridges = _of_root(model, tracked.fit)

    def solved(bridges: _Bridges) -> KinematicsFit:
        whole = with_tasks(options, tasks, bridges.tasks, bridges.places)
        return inverse_kinematics(model, markers, whole, progress)

    fit = solved(bridges)
    notes = (*sensors.warnings, *mounting.notes)
    if not marker_weights.any():
        lost = _lost(model, mounting, fit, reported, options)
        notes = (*notes, *lost.notes)
        if lost.likely is not None:
            bridges = _of_joints(model, lost.likely, fit.motion.time, sizes.imu_marker_noise)
            fit = solved(bridges)
    return SensorFit(
        fit=fit,
        mounting=replace(mounting, notes=notes),
        sensors=sensors,
        bridges=bridges.tasks,
        places=bridges.places,
        spreads=bridges.spreads,
    )


def _best_reading(
    model: Model,
    recording: SensorRecording,
    tracked: TrackedMarkers | None,
    options: InverseKinematicsOptions,
) -> WholeSolution:
    """Find orientations and mountings of the sensors, the recording read as it fits best."""
    bodies = bodies_of_sensors(model, recording.sensors.names, recording.bodies)
    recorded = without_dropouts(recording.sensors.only(tuple(bodies)))
    oriented = with_orientations(recorded, recording.sizes.imu_magnetometer)
    search = MountingSearch(
        model=model,
        recording=replace(recording, sensors=oriented),
        bodies=tuple(bodies.values()),
        tracked=tracked or _no_markers(oriented),
        options=options,
    )
    return whole_solution(
        search,
        anywhere=_headings_are_anywhere(recording),
        conventions=oriented.orientations is recorded.orientations,
    )


def _headings_are_anywhere(recording: SensorRecording) -> bool:
    """Whether each sensor has a heading of its own, as raw signals without magnetometer have."""
    sensors = recording.sensors
    if not recording.sizes.imu_magnetometer:
        return True
    return sensors.orientations is None and sensors.magnetic_fields is None


def _no_markers(sensors: InertialSensors) -> TrackedMarkers:
    """Take the times of the sensors for those of the motion; what they lack stays empty."""
    time = gaps_filled(sensors.time)
    none = Markers(time, (), np.empty((len(time), 0, 3)))
    return TrackedMarkers(markers=none, fit=None)


class _Lost(NamedTuple):
    """What of the joints is not determined.

    Attributes
    ----------
    likely : angles of joints whose sensor is lost, where they can be estimated
    notes : on these and on joints without any sensor
    """

    likely: LikelyAngles | None
    notes: tuple[Message, ...]


def _lost(
    model: Model,
    mounting: SensorMounting,
    fit: KinematicsFit,
    reported: Array,
    options: InverseKinematicsOptions,
) -> _Lost:
    """Find likely angles of joints whose sensor is lost.

    Parameters
    ----------
    reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors, NaN where unknown
    """
    known = np.asarray(np.isfinite(reported).all(axis=(2, 3)))
    tree = compile_tree(model)
    problem = pose_problem(tree, (), np.empty(0), options)
    seen = Seen(
        values=np.where(np.isfinite(fit.motion.values), fit.motion.values, tree.defaults),
        known=known,
        bodies=np.array([tree.body_number(body) for body in mounting.bodies], np.int64),
        joints=joint_angles(tree, problem.free),
    )
    likely = likely_angles(tree, problem, seen, fit.motion.time)
    notes = list[Message]()
    ever = np.asarray(known.any(axis=0))
    fullest = int(np.argmax(known.sum(axis=1)))
    blind = undetermined(tree, problem, seen, ever, fullest) & seen.joints
    if blind.any():
        names = [model.coordinate_names[j] for j in problem.free[blind]]
        notes.append(
            UNSEEN.message(f"no sensor determines {few(names)}: they stay near their defaults")
        )
    how = "filled from how they moved with the others before"
    if likely is None:
        how = "not determined there"
    for index, name in enumerate(mounting.sensors):
        lost = float(np.mean(~known[:, index]))
        if lost > MAX_LOST and ever[index]:
            notes.append(
                SENSORS.message(
                    f"sensor '{name}' is missing in {100 * lost:.0f} % of the frames: angles beside"
                    f" it are {how}",
                    share=lost,
                )
            )
    return _Lost(likely=likely, notes=tuple(notes))


def _of_joints(model: Model, likely: LikelyAngles, time: Array, marker_noise: float) -> _Bridges:
    """Pull joints whose sensor is lost to their likely angles.

    Parameters
    ----------
    time : (frames,) [s]
    marker_noise : against which the pulls are weighed [m]
    """
    names = [model.coordinate_names[j] for j in likely.columns]
    weights = (marker_noise / likely.spread) ** 2
    tasks = tuple(
        CoordinateTask(name, weight) for name, weight in zip(names, weights.tolist(), strict=True)
    )
    return _Bridges(
        tasks=tasks,
        places=Motion(time, tuple(names), likely.values),
        spreads=FrozenMap(dict(zip(names, likely.spread.tolist(), strict=True))),
    )


def _of_root(model: Model, marked: KinematicsFit | None) -> _Bridges:
    """Pull the root's position towards where markers show it before and after a gap."""
    if marked is None or marked.seen.all():
        return _Bridges()
    seen = marked.seen
    motion = marked.motion
    names = [
        name
        for name in floating_coordinates(model)
        if model.coordinate(name).motion == "translational"
    ]
    if not names:
        return _Bridges(places=motion)
    columns = [np.interp(motion.time, motion.time[seen], motion[name][seen]) for name in names]
    return _Bridges(
        tasks=tuple(CoordinateTask(name, BRIDGE) for name in names),
        places=Motion(motion.time, tuple(names), np.column_stack(columns)),
    )
