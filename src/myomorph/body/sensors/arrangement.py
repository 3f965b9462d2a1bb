"""How a recording of sensors is read: which sensor is where, and what its quaternions mean.

A file does not say whether its quaternions begin with the scalar, turn from the sensor to the earth
or back, and which axis of the earth points up, and labels are exchanged when sensors are strapped
on. Each of these is a whole solution: it is solved to its end, and that with the least residual is
taken where it is decisive.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from myomorph.core.rigid.tree import Tree


@dataclass(frozen=True, kw_only=True)
class Convention:
    """What the four numbers of an orientation mean.

    Attributes
    ----------
    scalar_last : x, y, z, w in the place of w, x, y, z
    to_sensor : from the earth to the sensor in the place of the other way
    y_up : y of the earth points up in the place of z
    """

    scalar_last: bool = False
    to_sensor: bool = False
    y_up: bool = False

    @property
    def words(self) -> str:
        """The convention as a text."""
        parts = (
            ("x, y, z, w", self.scalar_last),
            ("from the earth to the sensor", self.to_sensor),
            ("in an earth whose y points up", self.y_up),
        )
        return ", ".join(words for words, applies in parts if applies)

    def read(self, quaternions: Array) -> Array:
        """Bring quaternions to w, x, y, z from the sensor to an earth whose z points up.

        Parameters
        ----------
        quaternions : (..., 4) as recorded

        Returns
        -------
        (..., 4)
        """
        result = np.array(quaternions)
        if self.scalar_last:
            result = np.roll(result, 1, axis=-1)
        if self.to_sensor:
            result = result * np.array([1.0, -1.0, -1.0, -1.0])
        if self.y_up:
            upright = axis_rotation((1.0, 0.0, 0.0), 0.5 * np.pi)
            result = quaternion_from_rotation(upright @ rotation_from_quaternion(result))
        return result


AS_WRITTEN = Convention()
CONVENTIONS = tuple(
    Convention(scalar_last=scalar_last, to_sensor=to_sensor, y_up=y_up)
    for scalar_last in (False, True)
    for to_sensor in (False, True)
    for y_up in (False, True)
)
"""All that files have, as written first."""


@dataclass(frozen=True, kw_only=True)
class Arrangement:
    """One way to read a recording.

    Attributes
    ----------
    convention : of its quaternions
    exchanged : two sensors whose data are each other's; empty for none
    left_out : sensors that take no part
    turned : a sensor whose earth is turned about the vertical against the others'; "" for none
    angle : by which it is [rad]
    stepped : a sensor that turned on its body in the recording; "" for none
    step_time : when it did [s]
    step : rotation vector by which it is turned back from then on, in its own axes [rad]
    """

    convention: Convention = AS_WRITTEN
    exchanged: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    turned: str = ""
    angle: float = 0.0
    stepped: str = ""
    step_time: float = 0.0
    step: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def words(self) -> str:
        """What is different from the recording as it is labelled."""
        parts = []
        if self.convention != AS_WRITTEN:
            parts.append(f"quaternions read as {self.convention.words}")
        if self.exchanged:
            parts.append(f"sensors {' and '.join(self.exchanged)} exchanged")
        if self.left_out:
            names = " and ".join(self.left_out)
            parts.append(f"sensor {names} left out")
        if self.turned:
            wrapped = (np.degrees(self.angle) + 180.0) % 360.0 - 180.0
            parts.append(f"the heading of sensor {self.turned} turned by {abs(wrapped):.0f}°")
        if self.stepped:
            angle = np.degrees(np.linalg.norm(self.step))
            moment = f"at {self.step_time:.1f} s"
            parts.append(f"sensor {self.stepped} turned by {angle:.0f}° on its body {moment}")
        return ", ".join(parts) or "what it is labelled"

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors that it says something of."""
        named = (*self.exchanged, *self.left_out, self.turned, self.stepped)
        return tuple(name for name in named if name)

    def read(self, recording: SensorRecording) -> SensorRecording:
        """Read a recording and its calibration pose this way.

        Parameters
        ----------
        recording : with orientations
        """
        pose = recording.pose
        return replace(
            recording,
            sensors=self._turned_back(self._read_sensors(recording.sensors)),
            pose=None if pose is None else self._read_sensors(pose),
        )

    def _read_sensors(self, sensors: InertialSensors) -> InertialSensors:
        """Read sensors this way; names stay in their order."""
        kept = tuple(name for name in sensors.names if name not in self.left_out)
        others = dict(zip(self.exchanged, reversed(self.exchanged), strict=True))
        taken = sensors.only([others.get(name, name) for name in kept])
        result = replace(taken, names=kept)
        if result.orientations is None or not (self.turned or self.convention != AS_WRITTEN):
            return result
        quaternions = self.convention.read(np.asarray(result.orientations))
        if self.turned:
            index = kept.index(self.turned)
            turn = axis_rotation((0.0, 0.0, 1.0), self.angle)
            rotations = turn @ rotation_from_quaternion(quaternions[:, index])
            quaternions[:, index] = quaternion_from_rotation(rotations)
        return replace(result, orientations=quaternions)

    def _turned_back(self, sensors: InertialSensors) -> InertialSensors:
        """Turn the sensor that turned on its body back, from then on."""
        if not self.stepped or sensors.orientations is None:
            return sensors
        index = sensors.names.index(self.stepped)
        later = sensors.time >= self.step_time
        quaternions = np.array(sensors.orientations)
        rotations = rotation_from_quaternion(quaternions[later, index])
        back = rotation_from_vector(np.array(self.step))
        quaternions[later, index] = quaternion_from_rotation(rotations @ back)
        return replace(sensors, orientations=quaternions)


def other_conventions() -> list[Arrangement]:
    """List the readings with other conventions."""
    return [Arrangement(convention=one) for one in CONVENTIONS if one != AS_WRITTEN]


def exchanges(tree: Tree, names: tuple[str, ...], bodies: tuple[str, ...]) -> list[Arrangement]:
    """List the readings in which two sensors are exchanged that people do exchange.

    They are those of one segment on both sides, and those that are next to each other.

    Parameters
    ----------
    tree : of the model
    names : of the sensors
    bodies : that each is on
    """
    on = dict(zip(bodies, names, strict=True))
    pairs = list[tuple[str, str]]()
    for body, name in on.items():
        word, side = split_side(body)
        for other in on:
            other_word, other_side = split_side(other)
            if word == other_word and side and other_side and side < other_side:
                pairs.append((name, on[other]))
        above = next((one for one in _ancestors(tree, body) if one in on), None)
        if above is not None:
            pairs.append((on[above], name))
    return [Arrangement(exchanged=pair) for pair in pairs]


def _ancestors(tree: Tree, body: str) -> list[str]:
    """List the bodies between a body and ground, the nearest first."""
    joints = {joint.child: joint.parent for joint in tree.model.joints}
    result = []
    while body in joints:
        body = joints[body]
        result.append(body)
    return result


def removals(names: tuple[str, ...]) -> list[Arrangement]:
    """List the readings without one of the sensors.

    Parameters
    ----------
    names : of the sensors
    """
    return [Arrangement(left_out=(name,)) for name in names]
