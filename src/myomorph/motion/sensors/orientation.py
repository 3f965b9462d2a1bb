"""Orientations of inertial sensors in a model's ground: from raw signals by a filter, and at the times of a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, from_extra
from myomorph.model.inertial_sensors import InertialSensors, steady
from myomorph.model.model import Model
from myomorph.model.spatial import rotation_from_quaternion

MIN_RATE = 20.0
"""Raw signals at a lower rate cannot be integrated [Hz]."""
STEADY_RATE = 0.02
"""Steps of a clock that differ by a larger share have gaps."""


def with_orientations(sensors: InertialSensors, magnetometer: bool = True) -> InertialSensors:
    """The sensors with the orientations that a filter finds in their raw signals; known orientations are kept.

    The filter is VQF (Laidig and Seel 2023), run forwards and backwards over the whole recording: gyroscopes are
    integrated, accelerations correct the inclination, magnetic fields the heading where they are undisturbed. Without
    magnetic fields every sensor's heading begins anywhere and drifts slowly.
    """
    if sensors.orientations is not None:
        return sensors
    gyroscopes, accelerations = sensors.angular_velocities, sensors.accelerations
    if gyroscopes is None or accelerations is None:
        raise BadData(
            f"{sensors.source or 'sensors'}: hold {', '.join(sensors.signals) or 'nothing'}: orientations, or angular "
            "velocities and accelerations are needed"
        )
    steps = np.diff(sensors.time)
    if len(steps) < 2 or not sensors.rate > MIN_RATE:
        raise BadData(f"{sensors.source or 'sensors'}: {sensors.rate:.3g} Hz is too slow for a filter of raw signals")
    clock = sensors.time[0] + np.arange(int((sensors.time[-1] - sensors.time[0]) * sensors.rate) + 1) / sensors.rate
    vqf = from_extra("sensors", "vqf")
    fields = sensors.magnetic_fields if magnetometer else None
    found = np.full((len(sensors), len(sensors.names), 4), np.nan)
    warnings = list(sensors.warnings)
    for index, name in enumerate(sensors.names):
        known = np.isfinite(np.hstack((gyroscopes[:, index], accelerations[:, index]))).all(axis=1)
        if known.sum() < 2:
            warnings.append(f"sensor '{name}' recorded nothing")
            continue
        parts = [gyroscopes[:, index], accelerations[:, index]]
        if fields is not None and np.isfinite(fields[:, index]).all(axis=1).any():
            parts.append(fields[:, index])
        even = [_filled(sensors.time, part, clock) for part in parts]
        result = vqf.offlineVQF(*even, *(() if len(even) == 3 else (None,)), 1.0 / sensors.rate)
        quaternions = steady(result["quat9D" if len(even) == 3 else "quat6D"])
        at = np.column_stack([np.interp(sensors.time, clock, column) for column in quaternions.T])
        at[~known] = np.nan
        found[:, index] = at
        gaps = int((steps > (1.5 + STEADY_RATE) / sensors.rate).sum())
        if gaps and index == 0:
            warnings.append(f"the clock of the sensors has {gaps} gaps: turns are interpolated there")
    return replace(sensors, orientations=found, warnings=tuple(warnings))


def _filled(time: Array, values: Array, clock: Array) -> Array:
    """A signal (frames, 3) on an even clock, gaps bridged by lines."""
    known = np.isfinite(values).all(axis=1)
    columns = [np.interp(clock, time[known], column) for column in values[known].T]
    return np.ascontiguousarray(np.array(columns).T)


def earth_to_ground(model: Model) -> Array:
    """Rotation (3, 3) from an earth whose z points up to the model's ground: about x where y points up there."""
    up = np.asarray(model.up)
    axis = np.cross([0.0, 0.0, 1.0], up)
    sine, cosine = float(np.linalg.norm(axis)), float(up[2])
    if sine < 1e-12:
        return np.diag([1.0, np.sign(cosine), np.sign(cosine)])
    x, y, z = axis / sine
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * K + (1.0 - cosine) * (K @ K))


def rotations_at(sensors: InertialSensors, time: Array, model: Model) -> Array:
    """Rotations (times, sensors, 3, 3) from sensors to the model's ground at other times; NaN outside, and in gaps.
    Half a frame beyond either end the sensors are as they were there.
    """
    assert sensors.orientations is not None
    slack = 0.5 / sensors.rate if len(sensors) > 1 else 0.0
    first, last = sensors.time[0], sensors.time[-1]
    time = np.where((time > first - slack) & (time < last + slack), np.clip(time, first, last), time)
    quaternions = steady(sensors.orientations)
    flat = quaternions.reshape(len(sensors), -1)
    at = np.column_stack([np.interp(time, sensors.time, column, np.nan, np.nan) for column in flat.T])
    return np.asarray(earth_to_ground(model) @ rotation_from_quaternion(at.reshape(len(time), -1, 4)))
