"""Stretches in which a sensor repeats its last sample, or a program drew a line: missing data.

Real sensors have noise, so that no two samples are the same, and no turn goes on at exactly the
same speed. A sensor that does so while others of the body move has lost its connection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import SENSORS
from myomorph.core.model.inertial_sensors import InertialSensors, max_gap
from myomorph.core.model.messages import Message, Span
from myomorph.core.model.spatial import rotation_from_quaternion, vector_from_rotation

MIN_TIME = 0.5  # A stretch that is shorter is none [s]
MIN_FRAMES = 10
SAME_STEP = 2e-6
"""Rotations from frame to frame that differ by less are the same, and about the same axis: noise of
gyroscopes alone makes ten times as much [rad].
"""
SAME_SHARE = 5e-3
"""A line between quaternions does not turn evenly: about one axis, steps may differ by this share.
"""
OTHERS_TURN = 0.35  # Another sensor rotates so far in the stretch, so that the body moves [rad]
OTHERS_SPEED = 0.5  # Of raw signals: another sensor rotates so fast in it [rad/s]


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Frames in which a sensor shows nothing new.

    Attributes
    ----------
    first, last : frames
    """

    first: int
    last: int


def without_dropouts(sensors: InertialSensors) -> InertialSensors:
    """Take samples that a sensor repeats, or that lie on a line drawn over a gap, as missing.

    Parameters
    ----------
    sensors : with orientations, or raw signals

    Returns
    -------
    the same with NaN there, in all signals, and a message for each such sensor
    """
    if len(sensors) < MIN_FRAMES:
        return sensors
    same = _same_steps(sensors)
    missing = np.zeros((len(sensors), len(sensors.names)), dtype=bool)
    notes = list[Message]()
    for index, name in enumerate(sensors.names):
        stretches = [
            stretch
            for stretch in _stretches(sensors.time, same[:, index])
            if _others_move(sensors, index, stretch)
        ]
        for stretch in stretches:
            missing[stretch.first : stretch.last + 1, index] = True
        if stretches:
            spans = [
                (float(sensors.time[one.first]), float(sensors.time[one.last])) for one in stretches
            ]
            notes.append(_message(name, spans, float(missing[:, index].mean())))
    if not notes:
        return sensors
    changed: dict[str, Any] = {
        what: np.where(missing[..., None], np.nan, values)
        for what, values in sensors.signals.items()
    }
    return replace(sensors, warnings=(*sensors.warnings, *notes), **changed)


def _message(name: str, spans: list[Span], share: float) -> Message:
    """Say that a sensor stood still while the body moved."""
    longest = max(end - start for start, end in spans)
    return SENSORS.message(
        f"sensor '{name}' repeats itself, or follows a line, for {longest:.1f} s while others"
        f" move ({100.0 * share:.0f} % of the recording): taken as missing there",
        place=name,
        times=spans,
        share=share,
        severity="changes results",
    )


def _same_steps(sensors: InertialSensors) -> np.ndarray:
    """Find frames whose step is the one before.

    Returns
    -------
    (frames, sensors)
    """
    if sensors.orientations is not None:
        rotations = rotation_from_quaternion(np.asarray(sensors.orientations))
        between = rotations[1:] @ np.swapaxes(rotations[:-1], 2, 3)
        turns = np.zeros((len(sensors), len(sensors.names), 3))
        turns[1:] = vector_from_rotation(between)
        changes = np.diff(turns, axis=0, prepend=turns[:1])
        sizes = np.linalg.norm(turns, axis=2)
        axes = turns / np.maximum(sizes, 1e-12)[..., None]
        along = np.einsum("fsi,fsi->fs", changes, axes)
        across = np.linalg.norm(changes - along[..., None] * axes, axis=2)
        with np.errstate(invalid="ignore"):
            even = np.abs(along) < np.maximum(SAME_STEP, SAME_SHARE * sizes)
            return np.asarray(even & (across < SAME_STEP))
    parts = np.concatenate(list(sensors.signals.values()), axis=2)
    with np.errstate(invalid="ignore"):
        return np.asarray((np.diff(parts, axis=0, prepend=np.nan) == 0.0).all(axis=2))


def _stretches(time: Array, same: np.ndarray) -> list[Stretch]:
    """Find runs of frames with the same step that are long enough.

    Parameters
    ----------
    time : (frames,) [s]
    same : (frames,)
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    runs = [Stretch(first=int(start), last=int(end) - 1) for start, end in edges.reshape(-1, 2)]
    return [
        run
        for run in runs
        if run.last - run.first >= MIN_FRAMES and time[run.last] - time[run.first] >= MIN_TIME
    ]


def _others_move(sensors: InertialSensors, index: int, stretch: Stretch) -> bool:
    """Whether another sensor rotates in a stretch.

    Parameters
    ----------
    index : of the sensor that does not
    """
    frames = slice(stretch.first, stretch.last + 1)
    others = [other for other in range(len(sensors.names)) if other != index]
    if sensors.orientations is None:
        if sensors.angular_velocities is None:
            return False
        speeds = np.linalg.norm(sensors.angular_velocities[frames, others], axis=2)
        return bool((np.nan_to_num(speeds) > OTHERS_SPEED).any())
    rotations = rotation_from_quaternion(np.asarray(sensors.orientations)[frames][:, others])
    away = vector_from_rotation(rotations @ np.swapaxes(rotations[:1], 2, 3))
    return bool((np.nan_to_num(np.linalg.norm(away, axis=2)) > OTHERS_TURN).any())


def gaps_filled(time: Array) -> Array:
    """Add the frames that a clock lacks, so that no time is passed over in silence.

    Parameters
    ----------
    time : (frames,) ascending [s]

    Returns
    -------
    (more frames,) [s]
    """
    if len(time) < 2:
        return time
    step = float(np.median(np.diff(time)))
    parts = [time[:1]]
    limit = max_gap(time) * (1.0 + 1e-9)
    for start, end in pairwise(time):
        if end - start > limit:
            count = round((end - start) / step) - 1
            parts.append(start + (end - start) * np.arange(1, count + 1) / (count + 1))
        parts.append(np.array([end]))
    return np.concatenate(parts)
