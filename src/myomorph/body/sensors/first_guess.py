"""Where a search for the mounting of sensors begins.

The calibration pose, or the motion of the markers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only, unit_vector
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import Model
from myomorph.core.model.spatial import axis_rotation, rotation_from_vector, vector_from_rotation
from myomorph.core.motion.sensors.mounting import rotations_at
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

AXES = {
    "x": np.array([1.0, 0.0, 0.0]),
    "-x": np.array([-1.0, -0.0, -0.0]),
    "y": np.array([0.0, 1.0, 0.0]),
    "-y": np.array([-0.0, -1.0, -0.0]),
    "z": np.array([0.0, 0.0, 1.0]),
    "-z": np.array([-0.0, -0.0, -1.0]),
}
"""Axes of a sensor by the names that a user writes."""
TRIED = 24  # Headings that are tried round the circle
NEAR = 6.0  # Of the least cost: lowest points of the circle up to here are solved to their end
SOLVED = 2  # So many at most
FLOOR = 0.2  # Added to costs that are compared, in squares of the noise: both may be perfect
REFINED = 5  # Times that the step between them is halved about the best
RATE = 100.0  # At which speeds of rotation are compared [Hz]
CLEAR = 0.85  # Share of a sensor's level turning about one axis, from which on it turns about this
# Sensors have their own headings where these leave less than this share of the squares of one
# heading
OWN = 0.25
STEADY = 0.05  # Added to errors that are compared, as the noise of a sensor against its bone [rad]
MIN_KNOWN = 20  # Numbers of which a correlation is taken
MIN_LIKENESS = 0.5  # Correlation of speeds of rotation below which two clocks are not compared


@read_only
class CalibrationPose:
    """Sensors while the body stands in a known pose.

    Attributes
    ----------
    rotations : (sensors, 3, 3) to the model's ground, headings as recorded
    coordinates : (coordinates,) of the body [rad or m]
    time : on the recording's clock, or that of its first frame where the pose was recorded apart
        [s]
    """

    rotations: Array
    coordinates: Array
    time: float


class Guess(NamedTuple):
    """Where the search begins.

    Attributes
    ----------
    rotations : (sensors, 3, 3) to bodies
    headings : (sensors,) by which each sensor's earth is rotated [rad]
    """

    rotations: Array
    headings: Array


class TriedHeading(NamedTuple):
    """A heading that was tried; headings are ordered by their costs.

    Attributes
    ----------
    cost : in squares of the noise
    angle : [rad]
    """

    cost: float
    angle: float


def mean_rotation(rotations: Array) -> Array:
    """Compute mean rotations by the polar decomposition of their sum.

    Parameters
    ----------
    rotations : (frames, ..., 3, 3); NaN are left out

    Returns
    -------
    (..., 3, 3)
    """
    U, _, V = np.linalg.svd(np.nansum(rotations, axis=0))
    sign = np.linalg.det(U @ V)
    U[..., :, 2] *= sign[..., None]
    return np.asarray(U @ V)


def calibration_pose(
    model: Model, sensors: InertialSensors, coordinates: Array, start: float
) -> CalibrationPose:
    """Average a recording of the calibration pose, of which all frames count.

    Parameters
    ----------
    model : whose ground it is
    sensors : recording with orientations
    coordinates : (coordinates,) of the body in the pose [rad or m]
    start : time of the pose on the recording's clock [s]

    Returns
    -------
    mean rotations of the sensors

    Raises
    ------
    BadData : a sensor recorded nothing
    """
    rotations = rotations_at(sensors, sensors.time, model)
    seen = np.asarray(np.isfinite(rotations).all((2, 3)))
    silent = [name for index, name in enumerate(sensors.names) if not seen[:, index].any()]
    if silent:
        raise BadData(
            f"{sensors.source or 'calibration pose'}: sensors {', '.join(silent)} recorded nothing"
            " there"
        )
    return CalibrationPose(rotations=mean_rotation(rotations), coordinates=coordinates, time=start)


def from_pose(tree: Tree, bodies: tuple[str, ...], pose: CalibrationPose, headings: Array) -> Guess:
    """Find mountings with which the sensors report the pose.

        R_mounting = R_body^T R_up(heading) R_sensor

    Parameters
    ----------
    tree : of the model
    bodies : that each sensor is on
    pose : calibration pose
    headings : (sensors,) by which each earth is rotated [rad]

    Returns
    -------
    mountings and headings
    """
    poses = forward_kinematics(tree, pose.coordinates[None])
    turned = rotation_from_vector(headings[:, None] * tree.model.up) @ pose.rotations
    of_bodies = poses.rotations[0, [tree.body_number(body) for body in bodies]]
    return Guess(rotations=np.swapaxes(of_bodies, 1, 2) @ turned, headings=headings)


def named_headings(
    model: Model, names: tuple[str, ...], pose: CalibrationPose, axes: Mapping[str, str]
) -> Array | None:
    """Find headings by which the named axis of a sensor points along the model's x in the pose.

    One axis gives the heading of all sensors, several each that of its own.

    Parameters
    ----------
    model : says what is up
    names : of the sensors
    pose : calibration pose
    axes : sensor to its axis that points forward, as "x" or "-z"

    Returns
    -------
    (sensors,) [rad]; None where no axis is named

    Raises
    ------
    UnknownName : a sensor or an axis is unknown
    BadData : an axis stands upright in the pose, or several but not all sensors have one
    """
    if not axes:
        return None
    up = np.asarray(model.up)
    found = dict[str, float]()
    forward = unit_vector(np.eye(3)[0] - up[0] * up, "forward", model.name)
    for name, axis in axes.items():
        if name not in names:
            raise UnknownName("sensor", name, existing=names, where="the recording")
        if axis.casefold() not in AXES:
            where = f"the heading of sensor '{name}'"
            raise UnknownName("axis", axis, existing=tuple(AXES), where=where)
        pointing = pose.rotations[names.index(name)] @ AXES[axis.casefold()]
        level = pointing - (pointing @ up) * up
        if np.linalg.norm(level) < 0.5:
            raise BadData(
                f"axis {axis} of sensor '{name}' stands upright in the calibration pose: name a"
                " level one"
            )
        found[name] = float(np.arctan2(np.cross(level, forward) @ up, level @ forward))
    if len(found) == 1:
        return np.full(len(names), next(iter(found.values())))
    if lost := [name for name in names if name not in found]:
        raise BadData(
            f"sensors {', '.join(lost)}: name the axis that points forward of one sensor, or of"
            " every one"
        )
    return np.array([found[name] for name in names])


def by_trying(
    tree: Tree, bodies: tuple[str, ...], pose: CalibrationPose, cost: Callable[[Guess], float]
) -> tuple[Guess, ...]:
    """Find headings, each the same of all sensors, about which the cost is least.

    A pose alone says nothing of it. Each is a guess from which the whole problem is solved: what is
    left at its end decides, and not the cost here.

    Parameters
    ----------
    tree : of the model
    bodies : that each sensor is on
    pose : calibration pose
    cost : of a guess, in squares of the noise

    Returns
    -------
    guesses, the best first
    """

    def at(angle: float) -> TriedHeading:
        guess = from_pose(tree, bodies, pose, np.full(len(bodies), angle))
        return TriedHeading(cost=cost(guess), angle=angle)

    def refined(tried: TriedHeading) -> TriedHeading:
        step = 2.0 * np.pi / TRIED
        for _ in range(REFINED):
            step *= 0.5
            tried = min(tried, at(tried.angle - step), at(tried.angle + step))
        return tried

    round_circle = [at(2.0 * np.pi * index / TRIED) for index in range(TRIED)]
    lowest = sorted(
        tried
        for index, tried in enumerate(round_circle)
        if tried <= min(round_circle[index - 1], round_circle[(index + 1) % TRIED])
    )
    near = [tried for tried in lowest if tried.cost + FLOOR < NEAR * (lowest[0].cost + FLOOR)]
    found = sorted(refined(tried) for tried in near[:SOLVED])
    return tuple(
        from_pose(tree, bodies, pose, np.full(len(bodies), tried.angle)) for tried in found
    )


def turned_from_others(time: Array, earth: Array, up: Array) -> Array:
    """Compute how far each sensor's level axis of rotation is from that of all.

    It is the level axis about which it rotates most. Legs that swing rotate about the body's
    lateral axis.

    Parameters
    ----------
    time : (frames,) [s]
    earth : (frames, sensors, 3, 3) rotations to ground, NaN where unknown
    up : (3,) unit vector

    Returns
    -------
    (sensors,) angle [rad], 0 where a sensor rotates about no one axis
    """
    velocities = _angular_velocities(time, earth)
    level = np.nan_to_num(velocities - (velocities @ up)[..., None] * up)
    squares, directions = np.linalg.eigh(np.einsum("fsi,fsj->sij", level, level))
    axes = directions[..., -1]
    clear = squares[:, -1] > CLEAR * squares.sum(axis=1)
    if not clear.any():
        return np.zeros(len(axes))
    # An axis has no sign.
    _, common_axes = np.linalg.eigh(np.einsum("si,sj->ij", axes[clear], axes[clear]))
    cosine = np.abs(axes @ common_axes[:, -1])
    return np.where(clear, np.arccos(np.clip(cosine, 0.0, 1.0)), 0.0)


def from_motion(bodies: Array, earth: Array, up: Array, anywhere: bool) -> tuple[Guess, bool]:
    """Find mountings and headings with which sensors follow bodies whose motion is known.

    All have one heading, or each its own: where `anywhere`, or where they follow much better then,
    as sensors without magnetometer do.

    Parameters
    ----------
    bodies : (frames, sensors, 3, 3) rotations of the sensors' bodies to ground, NaN where unknown
    earth : (frames, sensors, 3, 3) rotations of the sensors to their ground, NaN where unknown
    up : (3,) unit vector
    anywhere : whether each sensor has a heading of its own

    Returns
    -------
    mountings and headings, and whether each has its own
    """
    known = np.asarray(np.isfinite(bodies).all((2, 3)) & np.isfinite(earth).all((2, 3)))
    followers = [
        _Follower(bodies=bodies[known[:, index], index], earth=earth[known[:, index], index], up=up)
        for index in range(bodies.shape[1])
    ]
    together = _best_heading(followers)
    apart = [_best_heading([follower]) for follower in followers]
    floor = STEADY**2 * int(known.sum())
    error_apart = sum(tried.cost for tried in apart) + floor
    anywhere = anywhere or error_apart < OWN * (together.cost + floor)
    angles = [tried.angle for tried in apart] if anywhere else [together.angle] * len(followers)
    rotations = [
        follower.mounted(angle).rotation for follower, angle in zip(followers, angles, strict=True)
    ]
    return Guess(rotations=np.array(rotations), headings=np.array(angles)), anywhere


class Mounted(NamedTuple):
    """A mounting by which a sensor follows its body best.

    Attributes
    ----------
    error : sum of squared angles that are left [rad^2]
    rotation : (3, 3) to the body
    """

    error: float
    rotation: Array


@read_only
class _Follower:
    """A sensor and its body, in frames in which both are known.

    Attributes
    ----------
    bodies : (frames, 3, 3) rotations of the body to ground
    earth : (frames, 3, 3) rotations of the sensor to its ground
    up : (3,) unit vector
    """

    bodies: Array
    earth: Array
    up: Array

    def mounted(self, heading: float) -> Mounted:
        """Find the mean mounting with a heading [rad]."""
        if not len(self.earth):
            return Mounted(error=0.0, rotation=np.eye(3))
        to_body = np.swapaxes(self.bodies, 1, 2)
        mountings = to_body @ axis_rotation(self.up, heading) @ self.earth
        mean = mean_rotation(mountings)
        error = float((vector_from_rotation(mountings @ mean.T) ** 2).sum())
        return Mounted(error=error, rotation=mean)


def _best_heading(followers: Sequence[_Follower]) -> TriedHeading:
    """Find the heading, the same of these sensors, with which they follow their bodies best."""

    def at(angle: float) -> TriedHeading:
        errors = [follower.mounted(angle).error for follower in followers]
        return TriedHeading(cost=sum(errors), angle=angle)

    step = 2.0 * np.pi / TRIED
    best = min(at(step * index) for index in range(TRIED))
    for _ in range(4 * REFINED):
        step *= 0.5
        best = min(best, at(best.angle - step), at(best.angle + step))
    wrapped = (best.angle + np.pi) % (2.0 * np.pi) - np.pi
    return best._replace(angle=wrapped)


def _angular_velocities(time: Array, rotations: Array) -> Array:
    """Difference rotations (frames, items, 3, 3) in time: (frames - 1, items, 3) [rad/s]."""
    between = rotations[1:] @ np.swapaxes(rotations[:-1], 2, 3)
    return np.asarray(vector_from_rotation(between) / np.diff(time)[:, None, None])


def speeds_of(time: Array, rotations: Array, at: Array) -> Array:
    """Compute speeds of rotation, which mountings and headings do not change.

    Parameters
    ----------
    time : (frames,) [s]
    rotations : (frames, items, 3, 3)
    at : (times,) [s]

    Returns
    -------
    (times, items) [rad/s], NaN outside the recording
    """
    middle = 0.5 * (time[1:] + time[:-1])
    speeds = np.linalg.norm(_angular_velocities(time, rotations), axis=2)
    columns = [np.interp(at, middle, column, np.nan, np.nan) for column in speeds.T]
    return np.column_stack(columns)


def clock_delay(
    bodies: Array, sensors: Callable[[Array], Array], at: Array, search: float
) -> tuple[float, float]:
    """Find the delay of the sensors' clock at which speeds of rotation are most alike.

    Parameters
    ----------
    bodies : (times, sensors) speeds of the bodies [rad/s]
    sensors : speeds (times, sensors) at any times [rad/s]
    at : (times,) even, at `RATE` [s]
    search : largest delay that is tried [s]

    Returns
    -------
    delay [s], and the correlation there
    """
    count = int(search * RATE)
    lags = np.arange(-count, count + 1) / RATE
    likeness = np.array([alike(bodies, sensors(at + lag)) for lag in lags])
    best = int(np.nanargmax(likeness)) if np.isfinite(likeness).any() else len(lags) // 2
    return float(lags[best]), float(likeness[best])


def alike(first: Array, second: Array) -> float:
    """Compute the correlation of two tables, all columns together.

    Parameters
    ----------
    first, second : (times, columns); NaN are left out

    Returns
    -------
    correlation; NaN with fewer than `MIN_KNOWN` numbers
    """
    known = np.isfinite(first) & np.isfinite(second)
    if known.sum() < MIN_KNOWN:
        return np.nan
    x = first[known] - first[known].mean()
    y = second[known] - second[known].mean()
    norms = np.sqrt((x @ x) * (y @ y))
    return float(x @ y / max(norms, 1e-300))
