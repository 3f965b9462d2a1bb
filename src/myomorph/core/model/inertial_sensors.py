"""Inertial sensors on bodies as a value: what each measured, or how it was oriented."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frames import Variable
from myomorph.core.model.labelled import AXES
from myomorph.core.model.messages import Message
from myomorph.core.model.model import index_of
from myomorph.core.model.series import OverTime

SIGNALS = {
    "angular_velocities": "rad/s",
    "accelerations": "m/s^2",
    "magnetic_fields": "1",
    "orientations": "1",
}
"""Signals of sensors with their units: fields of `InertialSensors`."""
MAX_GAP = 0.1
"""A signal is interpolated between samples that are no further apart than this [s], or than
`MAX_STEPS` steps where they are rare: what is longer is missing.
"""
MAX_STEPS = 1.5


@read_only
class InertialSensors(OverTime):
    """Inertial sensors on one clock; what was not recorded is None, what is missing NaN.

    Attributes
    ----------
    time : (frames,) ascending [s]
    names : one per sensor
    orientations : (frames, sensors, 4) quaternions w, x, y, z from the sensor to the earth, whose z
        points up
    angular_velocities : (frames, sensors, 3) in the sensor [rad/s]
    accelerations : (frames, sensors, 3) in the sensor, gravity included: upwards at rest [m/s^2]
    magnetic_fields : (frames, sensors, 3) in the sensor, in any unit
    warnings : what looks wrong, one line each
    source : path of the file, "" for sensors made in memory
    """

    time: Array
    names: tuple[str, ...]
    orientations: Array | None = None
    angular_velocities: Array | None = None
    accelerations: Array | None = None
    magnetic_fields: Array | None = None
    warnings: tuple[Message, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        freeze(self, time=(-1,))
        object.__setattr__(self, "names", tuple(self.names))
        if len(self.time) > 1 and not np.all(np.diff(self.time) > 0):
            raise BadData("time does not increase from frame to frame")
        twice = next((name for name in self.names if self.names.count(name) > 1), "")
        if twice:
            raise BadData(f"two sensors are called '{twice}': give each a name of its own")
        for name in self.signals:
            components = 4 if name == "orientations" else 3
            freeze(self, **{name: (len(self.time), len(self.names), components)})

    @property
    def signals(self) -> dict[str, Any]:
        """Recorded arrays by the names of `SIGNALS`."""
        return {name: values for name in SIGNALS if (values := getattr(self, name)) is not None}

    @property
    def has_raw_signals(self) -> bool:
        """Whether turns can be integrated: angular velocities and accelerations are there."""
        return self.angular_velocities is not None and self.accelerations is not None

    @property
    def rate(self) -> float:
        """Median of frames per second [Hz], nan with fewer than two frames."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")

    def variables(self) -> Mapping[str, Variable]:
        """Name what was recorded."""
        return {
            name: Variable(
                ("time", "name", "part" if name == "orientations" else "axis"),
                values,
                SIGNALS[name],
            )
            for name, values in self.signals.items()
        }

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], names of the sensors, axes.

        Returns
        -------
        by dimension
        """
        return {"time": self.time, "name": self.names, "axis": AXES, "part": ("w", *AXES)}

    def only(self, names: Sequence[str]) -> InertialSensors:
        """Take some of the sensors, in the order of the names; raises `UnknownName`."""
        columns = [index_of("sensor", name, self.names, "the recording") for name in names]
        return replace(
            self,
            names=tuple(names),
            **{what: part[:, columns] for what, part in self.signals.items()},
        )

    def between(self, start: float, end: float) -> InertialSensors:
        """Take the frames from `start` to `end` [s]; raises `BadData` where there are none."""
        inside = (self.time >= start - 1e-9) & (self.time <= end + 1e-9)
        if not inside.any():
            raise BadData(
                f"{self.source or 'sensors'}: no frame from {start:g} to {end:g} s; the recording"
                f" runs from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        return self.frames(inside)


def beside(parts: Sequence[InertialSensors]) -> InertialSensors:
    """Put sensors of several files on the clock of the first, as far as all reach.

    Files of one sensor each are usual.

    Raises
    ------
    BadData : the files have no time or no signal in common
    """
    if len(parts) == 1:
        return parts[0]
    start = max(part.time[0] for part in parts)
    end = min(part.time[-1] for part in parts)
    clock = parts[0].time
    clock = clock[(clock >= start - 1e-9) & (clock <= end + 1e-9)]
    sources = ", ".join(part.source for part in parts)
    if not len(clock):
        raise BadData(f"{sources}: no time in common: give files of one recording")
    result = InertialSensors(
        time=clock,
        names=tuple(chain.from_iterable(part.names for part in parts)),
        warnings=tuple(chain.from_iterable(part.warnings for part in parts)),
        source=parts[0].source,
        orientations=_merged(parts, "orientations", clock),
        angular_velocities=_merged(parts, "angular_velocities", clock),
        accelerations=_merged(parts, "accelerations", clock),
        magnetic_fields=_merged(parts, "magnetic_fields", clock),
    )
    if not result.signals:
        raise BadData(f"{sources}: no signal that all of them have")
    return result


def _merged(parts: Sequence[InertialSensors], what: str, clock: Array) -> Array | None:
    """Signal of all sensors at other times (frames, sensors, 3 or 4); None if a part lacks it."""
    if not all(what in part.signals for part in parts):
        return None
    return np.concatenate([_at(part, what, clock) for part in parts], axis=1)


def _at(part: InertialSensors, what: str, clock: Array) -> Array:
    """Interpolate a signal, linearly between frames; quaternions by the shorter way.

    Parameters
    ----------
    what : name of the signal
    clock : (frames,) other times [s]

    Returns
    -------
    (frames, sensors, 3 or 4)
    """
    values = np.array(part.signals[what])
    if len(clock) == len(part.time) and np.allclose(clock, part.time, rtol=0.0, atol=1e-9):
        return values
    return interpolated(part.time, values, clock)


def max_gap(time: Array) -> float:
    """Return the longest time between samples that may be bridged.

    Parameters
    ----------
    time : (frames,) [s]

    Returns
    -------
    [s]
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    return max(MAX_GAP, MAX_STEPS * step)


def interpolated(time: Array, values: Array, at: Array) -> Array:
    """Interpolate signals between the samples that there are; what lies in a gap is missing.

    Parameters
    ----------
    time : (frames,) ascending [s]
    values : (frames, sensors, 3 or 4), NaN where missing; 4 are quaternions, which go the shorter
        way
    at : (times,) [s]

    Returns
    -------
    (times, sensors, 3 or 4), NaN outside the recording and in gaps longer than `max_gap`
    """
    limit = max_gap(time)
    result = np.full((len(at), *values.shape[1:]), np.nan)
    for index in range(values.shape[1]):
        known = np.isfinite(values[:, index]).all(axis=1)
        if not known.any():
            continue
        samples = values[known, index]
        if values.shape[2] == 4:
            samples = steady(samples)
        of_sensor = [np.interp(at, time[known], part, np.nan, np.nan) for part in samples.T]
        result[:, index] = np.column_stack(of_sensor)
        result[_in_gap(time[known], at, limit), index] = np.nan
    return result


def _in_gap(time: Array, at: Array, limit: float) -> np.ndarray:
    """Find times between samples that are further apart than a limit.

    Parameters
    ----------
    time : (samples,) ascending [s]
    at : (times,) [s]
    limit : longest time between samples [s]

    Returns
    -------
    (times,)
    """
    after = np.clip(np.searchsorted(time, at), 1, max(len(time) - 1, 1))
    if len(time) < 2:
        return np.zeros(len(at), dtype=bool)
    long = time[after] - time[after - 1] > limit * (1.0 + 1e-9)
    return np.asarray(long & (at > time[after - 1]) & (at < time[after]))


def steady(quaternions: Array) -> Array:
    """Give quaternions signs that do not jump from frame to frame: q and -q are one orientation.

    Parameters
    ----------
    quaternions : (frames, ..., 4)

    Returns
    -------
    (frames, ..., 4)
    """
    known = np.where(np.isfinite(quaternions), quaternions, 0.0)
    signs = np.ones((*known.shape[:-1], 1))
    signs[1:][np.sum(known[1:] * known[:-1], axis=-1, keepdims=True) < 0.0] = -1.0
    return np.asarray(quaternions * signs.cumprod(axis=0))
