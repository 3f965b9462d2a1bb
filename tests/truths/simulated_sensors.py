"""Inertial sensors on a body whose motion is known.

Orientations and raw signals, with the errors that sensors have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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


def simulated_sensors(
    model: Model,
    motion: Motion,
    bodies: Sequence[str],
    errors: SensorErrors | None = None,
    seed: int = 0,
    mounted: Array | None = None,
    accelerometers: bool = False,
) -> SimulatedSensors:
    """Return sensors named BODY_imu on bodies that move.

    `mounted`: (sensors, 3, 3) from sensors to bodies, by default any; `accelerometers`: they
    measure acceleration too, at a position on the body that nobody knows.
    """
    errors = errors or SensorErrors()
    rng = np.random.default_rng(seed)
    off: dict[str, float] = {name: 0.0 for group in GROUPS.values() for name in group}
    sources = replace(Sources(), **{**off, "joint_axis": errors.axes})
    person = drawn_model(model, Draw(0, sources, Normals(1, seed)))
    tree = compile_tree(person)
    count = len(bodies)
    frames = len(motion)
    columns = [tree.body_number(body) for body in bodies]
    values = tree.coordinates_of(motion)
    floating = floating_coordinates(model)
    joints = [j for j in free_coordinates(tree) if model.coordinates[j].name not in floating]
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    anyhow = rotation_from_vector(rng.uniform(-np.pi, np.pi, (count, 3)) / np.sqrt(3.0))
    mounted = anyhow if mounted is None else mounted
    common = rng.uniform(-np.pi, np.pi)

    moving = values[:, joints] - values[:, joints].mean(axis=0)
    gains = rng.normal(size=(len(joints), 3 * count))
    following = (moving @ gains).reshape(frames, count, 3)
    following /= np.maximum(following.std(axis=0), 1e-9)
    skin = (
        np.sqrt(0.5)
        * errors.skin
        * (following + _process(rng, frames, count, errors.skin_time * rate))
    )
    filtered = errors.noise * _process(rng, frames, count, errors.noise_time * rate)
    walk = rng.normal(size=(frames, count)).cumsum(axis=0) * errors.drift / np.sqrt(60.0 * rate)
    headings = common + errors.heading * rng.normal(size=count) + walk

    def earth(coordinates: Array, moved: Array, turned: Array) -> Array:
        own = forward_kinematics(tree, coordinates).rotations[:, columns]
        seen = own @ rotation_from_vector(moved) @ mounted
        away = rotation_from_vector(-turned[..., None] * np.asarray(model.up))
        return np.asarray(earth_to_ground(model).T @ away @ seen)

    names = tuple(f"{body}_imu" for body in bodies)
    measured = earth(values, skin + filtered, headings)
    stance = np.tile(tree.defaults, (int(rate), 1))
    stance[:, joints] += errors.pose * rng.normal(size=len(joints))
    for j in joints:
        coordinate = model.coordinates[j]
        if coordinate.clamped:
            stance[:, j] = np.clip(stance[:, j], *coordinate.range)
    still = earth(
        tree.coordinates_of(Motion(np.arange(len(stance)) / rate, model.coordinate_names, stance)),
        np.zeros((len(stance), count, 3)),
        np.tile(headings[0], (len(stance), 1)),
    )
    felt = None
    if accelerometers:
        felt = _accelerations(rng, tree, values, motion.time, columns) - np.asarray(model.gravity)
        turned = (
            forward_kinematics(tree, values).rotations[:, columns]
            @ rotation_from_vector(skin)
            @ mounted
        )
        felt = np.einsum("fsji,fsj->fsi", turned, felt) + ACCELEROMETER * rng.normal(
            size=felt.shape
        )
    return SimulatedSensors(
        sensors=InertialSensors(
            motion.time, names, quaternion_from_rotation(measured), accelerations=felt
        ),
        pose=InertialSensors(np.arange(len(stance)) / rate, names, quaternion_from_rotation(still)),
        rotations=mounted,
        headings=headings,
        person=person,
    )


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
