"""Inertial sensors on a body whose motion is known.

Orientations and raw signals, with the errors that sensors have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sensors.mounting import earth_to_ground
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.lab.uncertainty.bodies import Draw, drawn_model
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources

FIELD = (0.0, 0.4, -0.9)  # Magnetic field in the earth: east along x, north along y, z up.
GRAVITY = 9.80665
SMOOTH = 15.0
# Low-pass of recorded motion before it is differentiated [Hz], and noise [m/s^2].
ACCELEROMETER = 0.1


@dataclass(frozen=True)
class SensorErrors:
    """Standard deviations of what is wrong with simulated sensors; 0 leaves one out."""

    # of the rotation of a sensor against its bone about each axis, half of its variance follows the
    # joint angles, half is a process of its own [rad]
    skin: float = 0.035
    skin_time: float = 0.15  # that correlates it [s]
    noise: float = 0.01  # of the filter, the same way [rad]
    noise_time: float = 1.0  # that correlates it [s]
    pose: float = 0.05  # of each joint angle in the calibration pose against the model's [rad]
    heading: float = 0.03  # of each sensor's heading against the others' [rad]
    drift: float = 0.0  # of each sensor's heading after a minute, a random walk [rad]
    axes: float = 0.035  # of the orientation of joint axes, the body's against the model's [rad]


NO_ERRORS = SensorErrors(skin=0.0, noise=0.0, pose=0.0, heading=0.0, drift=0.0, axes=0.0)


@read_only
class SimulatedSensors:
    """Sensors, and the truth about them."""

    sensors: InertialSensors  # orientations over the motion
    pose: InertialSensors  # in the calibration pose, one second
    rotations: Array  # (sensors, 3, 3) from sensors to bodies
    # (frames, sensors) by which each earth is turned about the vertical against the body's ground
    # [rad]
    headings: Array
    person: Model  # the body, whose joint axes differ from those of the model


@dataclass(frozen=True, kw_only=True, eq=False)
class Mounting:
    """Which sensors are on a body.

    Attributes
    ----------
    bodies : one for each sensor
    rotations : (sensors, 3, 3) from sensors to bodies, by default any
    accelerometers : whether they measure acceleration too, at a position on the body that nobody
        knows
    """

    bodies: Sequence[str]
    rotations: Array | None = None
    accelerometers: bool = False


def simulated_sensors(
    model: Model,
    motion: Motion,
    bodies: Sequence[str],
    errors: SensorErrors | None = None,
    seed: int = 0,
) -> SimulatedSensors:
    """Return sensors named BODY_imu on bodies that move, mounted anyhow."""
    return mounted_sensors(model, motion, Mounting(bodies=bodies), errors, seed)


def mounted_sensors(
    model: Model,
    motion: Motion,
    mounting: Mounting,
    errors: SensorErrors | None = None,
    seed: int = 0,
) -> SimulatedSensors:
    """Return sensors named BODY_imu on bodies that move."""
    errors = errors or SensorErrors()
    rng = np.random.default_rng(seed)
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    sensed = _sensed_body(model, mounting, errors, rng, seed)
    values = sensed.tree.coordinates_of(motion)
    common = rng.uniform(-np.pi, np.pi)

    shifts = _shifts(sensed, values, errors, rng, rate)
    headings = _headings(common, shifts.skin.shape[:2], errors, rng, rate)
    measured = sensed.orientations(values, shifts.skin + shifts.filtered, headings)
    pose = _calibration_pose(sensed, headings[0], errors, rng, rate)
    felt = _felt(sensed, values, motion.time, shifts.skin, rng) if mounting.accelerometers else None
    names = tuple(f"{body}_imu" for body in mounting.bodies)
    return SimulatedSensors(
        sensors=InertialSensors(
            motion.time, names, quaternion_from_rotation(measured), accelerations=felt
        ),
        pose=InertialSensors(np.arange(len(pose)) / rate, names, quaternion_from_rotation(pose)),
        rotations=sensed.mounted,
        headings=headings,
        person=sensed.tree.model,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _SensedBody:
    """A person and the sensors on it.

    Attributes
    ----------
    model : the generic one, for the vertical
    tree : of the person
    columns : body number of each sensor
    joints : coordinates that move freely, without those of the root
    mounted : (sensors, 3, 3) from sensors to bodies
    """

    model: Model
    tree: Tree
    columns: list[int]
    joints: list[int]
    mounted: Array

    def orientations(self, coordinates: Array, moved: Array, turned: Array) -> Array:
        """Return rotations (frames, sensors, 3, 3) from sensors to the earth of each.

        Parameters
        ----------
        coordinates : (frames, coordinates)
        moved : (frames, sensors, 3) rotation vectors of sensors against bones [rad]
        turned : (frames, sensors) or (sensors,) headings [rad]
        """
        own = forward_kinematics(self.tree, coordinates).rotations[:, self.columns]
        seen = own @ rotation_from_vector(moved) @ self.mounted
        away = rotation_from_vector(-turned[..., None] * np.asarray(self.model.up))
        return np.asarray(earth_to_ground(self.model).T @ away @ seen)


def _sensed_body(
    model: Model, mounting: Mounting, errors: SensorErrors, rng: np.random.Generator, seed: int
) -> _SensedBody:
    """Draw a person's joint axes and how sensors are mounted, where that is not specified."""
    off: dict[str, float] = {name: 0.0 for group in GROUPS.values() for name in group}
    sources = replace(Sources(), **{**off, "joint_axis": errors.axes})
    tree = compile_tree(drawn_model(model, Draw(0, sources, Normals(1, seed))))
    floating = floating_coordinates(model)
    joints = [j for j in free_coordinates(tree) if model.coordinates[j].name not in floating]
    count = len(mounting.bodies)
    anyhow = rotation_from_vector(rng.uniform(-np.pi, np.pi, (count, 3)) / np.sqrt(3.0))
    return _SensedBody(
        model=model,
        tree=tree,
        columns=[tree.body_number(body) for body in mounting.bodies],
        joints=joints,
        mounted=anyhow if mounting.rotations is None else mounting.rotations,
    )


class _Shifts(NamedTuple):
    """Rotation vectors (frames, sensors, 3) of sensors against bones [rad]."""

    skin: Array
    filtered: Array


def _shifts(
    sensed: _SensedBody,
    values: Array,
    errors: SensorErrors,
    rng: np.random.Generator,
    rate: float,
) -> _Shifts:
    """Draw how skin moves and how the filter errs."""
    frames = len(values)
    count = len(sensed.columns)
    moving = values[:, sensed.joints] - values[:, sensed.joints].mean(axis=0)
    gains = rng.normal(size=(len(sensed.joints), 3 * count))
    following = (moving @ gains).reshape(frames, count, 3)
    following /= np.maximum(following.std(axis=0), 1e-9)
    own = _process(rng, frames, count, errors.skin_time * rate)
    return _Shifts(
        skin=np.sqrt(0.5) * errors.skin * (following + own),
        filtered=errors.noise * _process(rng, frames, count, errors.noise_time * rate),
    )


def _headings(
    common: float,
    shape: tuple[int, ...],
    errors: SensorErrors,
    rng: np.random.Generator,
    rate: float,
) -> Array:
    """Draw headings of a shape (frames, sensors) around a common one, with their drift [rad]."""
    walk = rng.normal(size=shape).cumsum(axis=0) * errors.drift / np.sqrt(60.0 * rate)
    return np.asarray(common + errors.heading * rng.normal(size=shape[1]) + walk)


def _calibration_pose(
    sensed: _SensedBody,
    headings: Array,
    errors: SensorErrors,
    rng: np.random.Generator,
    rate: float,
) -> Array:
    """Return orientations (frames, sensors, 3, 3) over a second of the calibration pose."""
    tree = sensed.tree
    stance = np.tile(tree.defaults, (int(rate), 1))
    stance[:, sensed.joints] += errors.pose * rng.normal(size=len(sensed.joints))
    for j in sensed.joints:
        coordinate = sensed.model.coordinates[j]
        if coordinate.clamped:
            stance[:, j] = np.clip(stance[:, j], *coordinate.range)
    names = sensed.model.coordinate_names
    return sensed.orientations(
        tree.coordinates_of(Motion(np.arange(len(stance)) / rate, names, stance)),
        np.zeros((len(stance), len(sensed.columns), 3)),
        np.tile(headings, (len(stance), 1)),
    )


def _felt(
    sensed: _SensedBody, values: Array, time: Array, skin: Array, rng: np.random.Generator
) -> Array:
    """Return what accelerometers measure, (frames, sensors, 3) in their axes [m/s^2]."""
    felt = _accelerations(rng, sensed.tree, values, time, sensed.columns)
    felt = felt - np.asarray(sensed.model.gravity)
    own = forward_kinematics(sensed.tree, values).rotations[:, sensed.columns]
    turned = own @ rotation_from_vector(skin) @ sensed.mounted
    noise = ACCELEROMETER * rng.normal(size=felt.shape)
    return np.asarray(np.einsum("fsji,fsj->fsi", turned, felt) + noise)


def _accelerations(
    rng: np.random.Generator, tree: Tree, values: Array, time: Array, columns: list[int]
) -> Array:
    """Return accelerations (frames, sensors, 3) of points on bodies, in ground [m/s^2].

    The points are some centimeters from the bodies' origins.
    """
    poses = forward_kinematics(tree, values)
    places = poses.points(np.array(columns), 0.05 * rng.normal(size=(len(columns), 3)))
    names = tuple(map(str, range(3 * len(columns))))
    moving = differentiate(Motion(time, names, places.reshape(len(time), -1)), SMOOTH)
    assert moving.accelerations is not None
    return np.array(moving.accelerations).reshape(places.shape)


def raw_signals(
    sensors: InertialSensors, rate: float, noise: float = 0.01, bias: float = 0.005, seed: int = 0
) -> InertialSensors:
    """Return the signals of gyroscope, accelerometer and magnetometer.

    The sensors rotate in place. `noise`: of angular velocities [rad/s]; ten times as much of
    accelerations [m/s^2]; `bias`: standard deviation of gyroscopes [rad/s].
    """
    assert sensors.orientations is not None
    rng = np.random.default_rng(seed)
    time = np.arange(sensors.time[0], sensors.time[-1], 1.0 / rate)
    flat = natural_spline(
        sensors.time, np.array(sensors.orientations).reshape(len(sensors), -1), degree=3
    )
    step = 0.5 / rate
    before = _rotations(flat(time + (-step)), sensors)
    now = _rotations(flat(time + 0.0), sensors)
    after = _rotations(flat(time + step), sensors)
    speeds = vector_from_rotation(np.swapaxes(before, 2, 3) @ after) * rate
    shape = speeds.shape
    inverse = np.swapaxes(now, 2, 3)
    return InertialSensors(
        time,
        sensors.names,
        angular_velocities=speeds
        + bias * rng.normal(size=shape[1:])
        + noise * rng.normal(size=shape),
        accelerations=inverse @ [0.0, 0.0, GRAVITY] + 10.0 * noise * rng.normal(size=shape),
        magnetic_fields=inverse @ FIELD + noise * rng.normal(size=shape),
    )


def _rotations(flat: Array, sensors: InertialSensors) -> Array:
    return rotation_from_quaternion(flat.reshape(len(flat), len(sensors.names), 4))


def _process(rng: np.random.Generator, frames: int, count: int, width: float) -> Array:
    """(frames, count, 3) numbers of variance 1 that a Gaussian of `width` frames correlates."""
    before = int(np.ceil(4.0 * width))
    white = rng.normal(size=(frames + 2 * before, 3 * count))
    weights = np.exp(-0.5 * (np.arange(-before, before + 1) / max(width, 1e-9)) ** 2)
    weights /= np.linalg.norm(weights)
    smooth = [np.convolve(column, weights, "valid") for column in white.T]
    return np.array(smooth).T.reshape(frames, count, 3)
