"""Mounting of inertial sensors on a model's bodies: position, orientation and weight."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.causes import SENSORS
from myomorph.core.model.errors import BadData, from_extra, listing, quoted
from myomorph.core.model.inertial_sensors import (
    InertialSensors,
    interpolated,
    max_gap,
    steady,
)
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.segments import Segment, segments_if_human, segments_of
from myomorph.core.model.series import Markers
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import rotation_from_quaternion, rotation_from_vector
from myomorph.core.motion.tasks.orientations import OrientationTask

# What the name of a sensor may have behind that of its body
SUFFIXES = ("_imu", "_sensor", "_sensors")
WORDS = {
    "lower_trunk": ("pelvis", "sacrum", "lumbar", "waist", "hips"),
    "upper_trunk": ("t8", "sternum", "chest", "torso", "trunk", "thorax"),
    "thigh": ("upperleg", "upleg", "thigh", "femur"),
    "shank": ("lowerleg", "shank", "tibia"),
    "foot": ("foot", "calcn"),
    "upper_arm": ("upperarm", "humerus"),
    "lower_arm": ("forearm", "lowerarm", "ulna", "radius"),
    "hand": ("hand",),
    "head": ("head",),
}
"""Labels of Xsens MVN and APDM, and anatomists', by segment: small letters, without side, spaces
and number.
"""
NUMBER = re.compile(r"[ _]\d+$")
HUMPS = re.compile(r"(?<=[a-z])(?=[A-Z])| ")
SEGMENT_OF = {word: segment for segment, words in WORDS.items() for word in words}


def named_bodies(model: Model, names: tuple[str, ...]) -> dict[str, str]:
    """Find the body of each sensor whose name shows it.

    A name is that of a body or a frame, else a maker's word for a segment; of several sensors that
    name one segment, the first counts.

    Parameters
    ----------
    model : with the bodies
    names : of the sensors

    Returns
    -------
    body by sensor, where known
    """
    bodies = {body.name.casefold(): body.name for body in model.bodies}
    frames = {frame.name: frame.body for frame in model.frames}
    result = dict[str, str]()
    for name in names:
        body = frames.get(name) or bodies.get(_plain(name).casefold())
        if body is not None:
            result[name] = body
    parts = _main_bodies(model)
    for name in names:
        word, side = split_side(HUMPS.sub("_", NUMBER.sub("", _plain(name))))
        segment = SEGMENT_OF.get(word.casefold().replace("_", ""))
        body = parts.get(Segment(segment, side)) if segment else None
        if body is not None and name not in result and body not in result.values():
            result[name] = body
    return result


def bodies_of_sensors(
    model: Model, names: tuple[str, ...], chosen: Mapping[str, str]
) -> dict[str, str]:
    """Find the body of each sensor, as chosen, else by its name (`named_bodies`).

    Parameters
    ----------
    model : with the bodies
    names : of the sensors
    chosen : body by sensor, "" to leave it out

    Returns
    -------
    body by sensor, without those left out

    Raises
    ------
    BadData : the body of a sensor is not known, or all are left out
    UnknownName : a chosen sensor or body does not exist
    """
    for name, body in chosen.items():
        index_of("sensor", name, names, "the recording")
        if body:
            index_of("body", body, model.body_names, "the model")
    known = named_bodies(model, names) | dict(chosen)
    if lost := [name for name in names if name not in known]:
        first = lost[0]
        raise BadData(
            f"sensors {quoted(lost)}: no frame or body of the model is called so; bodies are "
            f"{listing(first, model.body_names)}. "
            f"Name the body of each: --imu-bodies '{first}=BODY' (or '{first}=-' to leave it out)"
        )
    result = {name: known[name] for name in names if known[name]}
    if not result:
        raise BadData("all sensors are left out: name a body for at least one")
    return result


def _plain(name: str) -> str:
    """Strip a sensor's name of what stands for 'sensor' at its end."""
    for suffix in SUFFIXES:
        if name.casefold().endswith(suffix):
            return name[: -len(suffix)]
    return name


def _main_bodies(model: Model) -> dict[Segment, str]:
    """Find the heaviest body of each segment; none of a model without human segments."""
    masses = {body.name: body.mass for body in model.bodies}
    segments = sorted(segments_if_human(model).items(), key=lambda part: masses[part[0]])
    return {segment: body for body, segment in segments}


@dataclass(frozen=True)
class SensorOptions:
    """Options of inertial sensors.

    Attributes
    ----------
    imu_mounting : source of the orientation of each sensor on its body; "recording": the
        calibration pose and the whole recording; "pose": the calibration pose alone; "model": the
        model's frames with the sensors' names
    imu_noise : standard deviation of a sensor's orientation relative to the bone, from the sensor's
        filter and the skin [rad]
    imu_marker_noise : standard deviation of a marker's position relative to the bone, which weights
        markers against sensors [m]
    imu_pose_error : standard deviation of each joint angle in the calibration pose [rad]
    imu_heading_error : standard deviation of each sensor's heading relative to the others at the
        start [rad]
    imu_heading_drift : standard deviation of the drift of each sensor's heading after one minute
        [rad]
    imu_magnetometer : use magnetic fields, if the raw signals contain them
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
class SensorMounting:
    """Orientation of sensors on bodies.

    Each sensor's earth is rotated about the vertical by its heading, linear between knots.

    Attributes
    ----------
    sensors : names
    bodies : of each sensor
    rotations : (sensors, 3, 3) from sensors to their bodies
    knots : (knots,) [s]
    headings : (knots, sensors) [rad]
    delay : of the sensors' clock behind the motion's [s]
    factor : (3 sensors + knots sensors, numbers) of the covariance of what is not determined:
        rotation vectors in the bodies, then the headings, knot by knot [rad]
    up : (3,) unit vector, vertical of the ground
    notes : what looks wrong, one line each
    """

    sensors: tuple[str, ...]
    bodies: tuple[str, ...]
    rotations: Array
    knots: Array
    headings: Array
    delay: float
    factor: Array
    up: Array
    notes: tuple[Message, ...] = ()

    def __post_init__(self) -> None:
        freeze(
            self, rotations=(len(self.sensors), 3, 3), headings=(len(self.knots), len(self.sensors))
        )

    def moved(self, numbers: Array) -> SensorMounting:
        """Draw a mounting with errors of what is not determined.

        Parameters
        ----------
        numbers : (numbers,) independent, of variance 1

        Returns
        -------
        the same sensors with other rotations and headings
        """
        count = len(self.sensors)
        errors = self.factor @ numbers
        turned = rotation_from_vector(errors[: 3 * count].reshape(-1, 3)) @ self.rotations
        headings = self.headings + errors[3 * count :].reshape(self.headings.shape)
        return replace(self, rotations=turned, headings=headings)

    def heading_at(self, time: Array) -> Array:
        """Interpolate the headings.

        Parameters
        ----------
        time : (times,) [s]

        Returns
        -------
        (times, sensors) [rad]
        """
        return np.column_stack([np.interp(time, self.knots, column) for column in self.headings.T])

    def body_rotations(self, sensors: InertialSensors, time: Array, model: Model) -> Array:
        """Compute the rotations of bodies as the sensors report them.

            R_body = R_heading R_earth-to-ground R_sensor R_mounting^T

        Parameters
        ----------
        sensors : with orientations
        time : (times,) on the motion's clock [s]
        model : with the vertical

        Returns
        -------
        (times, sensors, 3, 3) from bodies to ground, NaN where the sensors have none
        """
        return self.bodies_turned(
            rotations_at(sensors.only(self.sensors), time + self.delay, model), time
        )

    def bodies_turned(self, earth: Array, time: Array) -> Array:
        """Compute the rotations of bodies from those of their sensors; see `body_rotations`.

        Parameters
        ----------
        earth : (times, sensors, 3, 3) from sensors to the model's ground, headings as recorded
        time : (times,) on the motion's clock [s]

        Returns
        -------
        (times, sensors, 3, 3) from bodies to ground
        """
        turned = rotation_from_vector(self.heading_at(time)[..., None] * self.up)
        return np.asarray(turned @ earth @ np.swapaxes(self.rotations, 1, 2))


def trunk_acceleration(
    model: Model, mounting: SensorMounting, sensors: InertialSensors, time: Array
) -> Array | None:
    """Compute the acceleration of the sensor on the pelvis in the model's ground, without gravity.

        a = R_sensor f + g

    with the measured specific force f. Where on the pelvis it is nobody knows, so its rotation
    about other points is not taken off.

    Parameters
    ----------
    model : with segments and gravity
    mounting : of the sensors
    sensors : with orientations, and accelerations (frames, sensors, 3) [m/s^2]
    time : (times,) on the motion's clock [s]

    Returns
    -------
    (times, 3) [m/s^2], NaN where unknown; None without such a sensor
    """
    segments = segments_of(model)
    of_trunk = [
        index for index, body in enumerate(mounting.bodies) if segments[body].name == "lower_trunk"
    ]
    measured = sensors.only(mounting.sensors).accelerations
    if measured is None or not of_trunk:
        return None
    index = of_trunk[0]
    rotations = mounting.body_rotations(sensors, time, model)[:, index] @ mounting.rotations[index]
    at = np.column_stack(
        [np.interp(time + mounting.delay, sensors.time, part) for part in measured[:, index].T]
    )
    return np.asarray(np.einsum("fij,fj->fi", rotations, at) + model.gravity)


def orientation_tasks(
    mounting: SensorMounting, rotations: Array, marker_weights: Array, options: SensorOptions
) -> tuple[OrientationTask, ...]:
    """Build tasks of inverse kinematics whose weight against the markers follows from both's noise.

        weight = (marker noise / sensor noise)^2 / max(sum of marker weights, 1)

    Parameters
    ----------
    mounting : sensors and their bodies
    rotations : (frames, sensors, 3, 3) from bodies to ground, NaN where unknown
    marker_weights : (frames,) sum over the markers seen, by which each marker's is divided
    options : noise of sensors [rad] and markers [m]

    Returns
    -------
    a task for each sensor
    """
    weight = (options.imu_marker_noise / options.imu_noise) ** 2 / np.maximum(marker_weights, 1.0)
    return tuple(
        OrientationTask(sensor=name, body=body, rotations=rotations[:, index], weight=weight)
        for index, (name, body) in enumerate(zip(mounting.sensors, mounting.bodies, strict=True))
    )


def weights_seen(
    model: Model, markers: Markers, weights: Mapping[str, float], only_weighted: bool
) -> Array:
    """Sum the weights of the model's markers that a recording shows.

    Parameters
    ----------
    model : with markers
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    weights : by name of a marker
    only_weighted : markers without a weight have 0; else 1

    Returns
    -------
    (frames,)
    """
    default = 0.0 if only_weighted else 1.0
    total = np.zeros(len(markers))
    for index, name in enumerate(markers.names):
        if name in model.marker_names:
            total += weights.get(name, default) * np.isfinite(markers.values[:, index]).all(axis=1)
    return total


MIN_RATE = 20.0  # Raw signals at a lower rate cannot be integrated [Hz]
STEADY_RATE = 0.02  # Steps of a clock that differ by a larger share have gaps


def with_orientations(
    sensors: InertialSensors, magnetometer: bool = True, causal: bool = False
) -> InertialSensors:
    """Find the orientations of sensors from their raw signals; known orientations are kept.

    Not where magnetic fields may not be used and raw signals are there: known orientations have the
    fields in them.

    The filter is VQF, run forwards and backwards over the whole recording, or forwards alone:
    gyroscopes are integrated, accelerations correct the inclination, magnetic fields the heading
    where they are undisturbed. Without magnetic fields every sensor's heading begins anywhere and
    drifts slowly.

    Source: Laidig and Seel 2023.

    Parameters
    ----------
    sensors : with angular velocities [rad/s] and accelerations [m/s^2], each (frames, sensors, 3)
    magnetometer : use magnetic fields, if the raw signals contain them
    causal : run forwards alone

    Returns
    -------
    with orientations, quaternions (frames, sensors, 4), NaN where a signal is missing

    Raises
    ------
    BadData : neither orientations nor raw signals, or a rate too low to integrate
    """
    if sensors.orientations is not None and magnetometer:
        return sensors
    if sensors.orientations is not None and not sensors.has_raw_signals:
        kept = SENSORS.message(
            "magnetic fields are in the orientations of the file, which holds no raw signals: these"
            " orientations are used, each sensor with a heading of its own"
        )
        return replace(sensors, warnings=(*sensors.warnings, kept))
    gyroscopes, accelerations = _raw_signals(sensors)
    vqf = from_extra("sensors", "vqf")
    fields = sensors.magnetic_fields if magnetometer else None
    clock = _even_clock(sensors)
    orientations = np.full((len(sensors), len(sensors.names), 4), np.nan)
    warnings = list(sensors.warnings)
    for index, name in enumerate(sensors.names):
        parts = [gyroscopes[:, index], accelerations[:, index]]
        known = np.isfinite(np.hstack(parts)).all(axis=1)
        if known.sum() < 2:
            warnings.append(SENSORS.message(f"sensor '{name}' recorded nothing"))
            continue
        if fields is not None and np.isfinite(fields[:, index]).all(axis=1).any():
            parts.append(fields[:, index])
        even = [_filled(sensors.time, part, clock) for part in parts]
        quaternions = steady(_filtered(vqf, even, 1.0 / sensors.rate, causal))
        at = np.column_stack([np.interp(sensors.time, clock, column) for column in quaternions.T])
        at[~known] = np.nan
        orientations[:, index] = at
        steps = np.diff(sensors.time)
        gaps = int((steps > (1.5 + STEADY_RATE) / sensors.rate).sum())
        if gaps and index == 0:
            warnings.append(_of_gaps(steps, gaps, max_gap(sensors.time)))
    return replace(sensors, orientations=orientations, warnings=tuple(warnings))


def _of_gaps(steps: Array, gaps: int, limit: float) -> Message:
    """Say what gaps of the clock do to integrated turns.

    Parameters
    ----------
    steps : (frames - 1,) between samples [s]
    gaps : how many are longer than usual
    limit : of what is interpolated [s]
    """
    text = f"the clock of the sensors has {gaps} gaps: rotations are interpolated there"
    longest = float(steps.max())
    if longest > limit:
        text = (
            f"the clock of the sensors has {gaps} gaps of up to {longest:.1f} s: no angles there,"
            " and headings after them are less certain"
        )
    return SENSORS.message(text)


def _raw_signals(sensors: InertialSensors) -> tuple[Array, Array]:
    """Return angular velocities and accelerations, each (frames, sensors, 3).

    Raises
    ------
    BadData : there are none, or their rate is too low to integrate
    """
    gyroscopes = sensors.angular_velocities
    accelerations = sensors.accelerations
    if gyroscopes is None or accelerations is None:
        raise BadData(
            f"{sensors.source or 'sensors'}: hold {', '.join(sensors.signals) or 'nothing'}:"
            " orientations, or angular velocities and accelerations are needed"
        )
    if len(sensors) < 3 or not sensors.rate > MIN_RATE:
        raise BadData(
            f"{sensors.source or 'sensors'}: {sensors.rate:.3g} Hz is too slow for a filter of raw"
            " signals"
        )
    return gyroscopes, accelerations


def _even_clock(sensors: InertialSensors) -> Array:
    """Divide the recording into even steps: (samples,) [s]."""
    length = sensors.time[-1] - sensors.time[0]
    steps: Array = np.arange(int(length * sensors.rate) + 1) / sensors.rate
    return sensors.time[0] + steps


def _filtered(vqf: Any, signals: Sequence[Array], step: float, causal: bool) -> Array:
    """Filter the signals of one sensor for its orientation.

    Parameters
    ----------
    vqf : the package of the filter
    signals : angular velocities [rad/s], accelerations [m/s^2] and, where there is one, the
        magnetic field, each (samples, 3)
    step : of their times [s]
    causal : run forwards alone

    Returns
    -------
    (samples, 4) quaternions
    """
    magnetic = len(signals) == 3
    if causal:
        result = vqf.VQF(step).updateBatch(*signals)
    else:
        result = vqf.offlineVQF(*signals, *(() if magnetic else (None,)), step)
    quaternions: Array = result["quat9D" if magnetic else "quat6D"]
    return quaternions


def _filled(time: Array, values: Array, clock: Array) -> Array:
    """Resample a signal on an even clock, gaps bridged by lines.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, 3), NaN in gaps
    clock : (samples,) [s]

    Returns
    -------
    (samples, 3)
    """
    known = np.isfinite(values).all(axis=1)
    columns = [np.interp(clock, time[known], column) for column in values[known].T]
    return np.ascontiguousarray(np.array(columns).T)


def earth_to_ground(model: Model) -> Array:
    """Rotate an earth whose z points up to the model's ground: about x where y points up there.

    With the unit axis a = z x up / |z x up|, K = [a]_x and the angle t between z and up
    (Rodrigues),

        R = 1 + sin t K + (1 - cos t) K K

    Parameters
    ----------
    model : with the vertical

    Returns
    -------
    (3, 3) from earth to ground
    """
    up = np.asarray(model.up)
    axis = np.cross([0.0, 0.0, 1.0], up)
    sine = float(np.linalg.norm(axis))
    cosine = float(up[2])
    if sine < 1e-12:
        return np.diag([1.0, np.sign(cosine), np.sign(cosine)])
    x, y, z = axis / sine
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * K + (1.0 - cosine) * (K @ K))


def rotations_at(sensors: InertialSensors, time: Array, model: Model) -> Array:
    """Interpolate the sensors' rotations to the model's ground at other times.

    Half a frame beyond either end the sensors are as they were there. What lies in a gap longer
    than `max_gap` is missing.

    Parameters
    ----------
    sensors : with orientations
    time : (times,) on the sensors' clock [s]
    model : with the vertical

    Returns
    -------
    (times, sensors, 3, 3) from sensors to ground, NaN outside and in gaps
    """
    assert sensors.orientations is not None
    slack = 0.5 / sensors.rate if len(sensors) > 1 else 0.0
    first = sensors.time[0]
    last = sensors.time[-1]
    time = np.where(
        (time > first - slack) & (time < last + slack), np.clip(time, first, last), time
    )
    quaternions = interpolated(sensors.time, np.asarray(sensors.orientations), time)
    return np.asarray(earth_to_ground(model) @ rotation_from_quaternion(quaternions))
