"""Where inertial sensors are mounted on a model's bodies, and what their orientations count beside markers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData, listing, quoted
from myomorph.model.inertial_sensors import InertialSensors
from myomorph.model.model import Model, index_of
from myomorph.model.series import Markers
from myomorph.model.spatial import rotation_from_vector
from myomorph.motion.sensors.orientation import rotations_at
from myomorph.motion.tasks.orientations import OrientationTask

SUFFIXES = ("_imu", "_sensor", "_sensors")
"""What the name of a sensor may have behind that of its body."""


@dataclass(frozen=True)
class SensorOptions:
    """Options of inertial sensors.

    Attributes
    ----------
    imu_mounting : how each sensor's mounting on its body is found: "recording" from the calibration pose and the whole
        recording, "pose" from the calibration pose alone, "model" from the model's frames of the sensors' names
    imu_noise : standard deviation of a sensor's orientation against its bone, of filter and skin [rad]
    imu_marker_noise : of a marker against its bone, which weights markers against sensors [m]
    imu_pose_error : of each joint angle in the calibration pose [rad]
    imu_heading_error : of each sensor's heading at the start against the others' [rad]
    imu_heading_drift : of each sensor's heading, what it may have gained after a minute [rad]
    imu_magnetometer : use magnetic fields, where raw signals hold them
    """

    imu_mounting: Literal["recording", "pose", "model"] = "recording"
    imu_noise: float = 0.05
    imu_marker_noise: float = 0.01
    imu_pose_error: float = 0.07
    imu_heading_error: float = 0.05
    imu_heading_drift: float = 0.02
    imu_magnetometer: bool = True

    def __post_init__(self) -> None:
        for name in ("imu_noise", "imu_marker_noise", "imu_pose_error"):
            if not getattr(self, name) > 0.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected more than 0")
        for name in ("imu_heading_error", "imu_heading_drift"):
            if not getattr(self, name) >= 0.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected 0 or more")


@read_only
@dataclass(frozen=True, eq=False)
class SensorMounting:
    """Sensors on bodies, turned by `rotations` (sensors, 3, 3) to them; each sensor's earth is turned about the
    vertical (`up` of the ground) by `headings` (knots, sensors) [rad], linear between the `knots` [s].

    `delay` [s] is by how much the sensors' clock is behind the motion's; `factor` (3 sensors + knots sensors, numbers)
    of the covariance of what is left open: rotation vectors in the bodies, behind them the headings, knot by knot
    [rad].
    """

    sensors: tuple[str, ...]
    bodies: tuple[str, ...]
    rotations: Array
    knots: Array
    headings: Array
    delay: float
    factor: Array
    up: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotations", frozen_array(self.rotations, (len(self.sensors), 3, 3)))
        object.__setattr__(self, "headings", frozen_array(self.headings, (len(self.knots), len(self.sensors))))

    @property
    def deviations(self) -> Array:
        """(sensors,) standard deviation of the mounting, the mean over its three axes [rad]."""
        variances = (self.factor[: 3 * len(self.sensors)] ** 2).sum(axis=1).reshape(-1, 3)
        return np.asarray(np.sqrt(variances.mean(axis=1)))

    def moved(self, numbers: Array) -> SensorMounting:
        """The same with errors of what is left open, by independent numbers of variance 1."""
        count = len(self.sensors)
        errors = self.factor @ numbers
        turned = rotation_from_vector(errors[: 3 * count].reshape(-1, 3)) @ self.rotations
        headings = self.headings + errors[3 * count :].reshape(self.headings.shape)
        return replace(self, rotations=turned, headings=headings)

    def heading_at(self, time: Array) -> Array:
        """(times, sensors) headings [rad]."""
        return np.column_stack([np.interp(time, self.knots, column) for column in self.headings.T])

    def body_rotations(self, sensors: InertialSensors, time: Array, model: Model) -> Array:
        """(times, sensors, 3, 3) from bodies to ground, as the sensors report; NaN where they do not."""
        earth = rotations_at(sensors.only(self.sensors), time + self.delay, model)
        turned = rotation_from_vector(self.heading_at(time)[..., None] * self.up)
        return np.asarray(turned @ earth @ np.swapaxes(self.rotations, 1, 2))


def orientation_tasks(
    mounting: SensorMounting, rotations: Array, marker_weights: Array, options: SensorOptions
) -> tuple[OrientationTask, ...]:
    """Tasks of inverse kinematics whose weight beside the markers follows from both's noise. `marker_weights` (frames,)
    are the sums over the markers seen, by which each marker's is divided.
    """
    weight = (options.imu_marker_noise / options.imu_noise) ** 2 / np.maximum(marker_weights, 1.0)
    return tuple(
        OrientationTask(name, body, rotations[:, index], weight)
        for index, (name, body) in enumerate(zip(mounting.sensors, mounting.bodies, strict=True))
    )


def weights_seen(model: Model, markers: Markers, weights: Mapping[str, float], only_weighted: bool) -> Array:
    """(frames,) sum of the weights of the model's markers that a recording shows."""
    default, total = 0.0 if only_weighted else 1.0, np.zeros(len(markers))
    for index, name in enumerate(markers.names):
        if name in model.marker_names:
            total += weights.get(name, default) * np.isfinite(markers.values[:, index]).all(axis=1)
    return total


def bodies_of_sensors(model: Model, names: tuple[str, ...], chosen: Mapping[str, str]) -> dict[str, str]:
    """Body of each sensor by its name: a frame of the model, a body, or that with `_imu` behind it; `chosen` are the
    user's, "" leaves a sensor out.
    """
    bodies, result = {body.name.casefold(): body.name for body in model.bodies}, dict[str, str]()
    frames = {frame.name: frame.body for frame in model.frames}
    for name, body in chosen.items():
        index_of("sensor", name, names, "the recording")
        if body:
            index_of("body", body, model.body_names, "the model")
    lost = list[str]()
    for name in names:
        plain = name.casefold()
        for suffix in SUFFIXES:
            plain = plain.removesuffix(suffix)
        own = chosen[name] if name in chosen else frames.get(name) or bodies.get(plain)
        if own is None:
            lost.append(name)
        elif own:
            result[name] = own
    if lost:
        first = lost[0]
        raise BadData(
            f"sensors {quoted(lost)}: no frame or body of the model is called so; bodies are "
            f"{listing(first, bodies.values())}. "
            f"Name the body of each: --imu-bodies '{first}=BODY' (or '{first}=-' to leave it out)"
        )
    if not result:
        raise BadData("all sensors are left out: name a body for at least one")
    return result
