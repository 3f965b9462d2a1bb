"""Inertial sensors on bodies as a value: what each measured, or how it was oriented, over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.labelled import AXES, Variable
from myomorph.core.model.model import index_of
from myomorph.core.model.series import OverTime

SIGNALS = {
    "angular_velocities": "rad/s",
    "accelerations": "m/s^2",
    "magnetic_fields": "1",
    "orientations": "1",
}
"""What a sensor may give, with its unit: fields of `InertialSensors`."""


@read_only
class InertialSensors(OverTime):
    """Inertial sensors on one clock; what was not recorded is None, what is missing NaN."""

    time: Array  # (frames,) ascending [s]
    names: tuple[str, ...]  # one per sensor
    # (frames, sensors, 4) quaternions w, x, y, z from the sensor to the earth, whose z points up
    orientations: Array | None = None
    angular_velocities: Array | None = None  # (frames, sensors, 3) in the sensor [rad/s]
    # (frames, sensors, 3) in the sensor, gravity included: upwards at rest [m/s^2]
    accelerations: Array | None = None
    magnetic_fields: Array | None = None  # (frames, sensors, 3) in the sensor, in any unit
    warnings: tuple[str, ...] = ()  # what looks wrong, one line each
    source: str = ""  # path of the file, "" for sensors made in memory

    def __post_init__(self) -> None:
        freeze(self, time=(-1,))
        object.__setattr__(self, "names", tuple(self.names))
        if len(self.time) > 1 and not np.all(np.diff(self.time) > 0):
            raise BadData("time does not increase from frame to frame")
        twice = next((name for name in self.names if self.names.count(name) > 1), "")
        if twice:
            raise BadData(f"two sensors are called '{twice}': give each a name of its own")
        for name in self.signals:
            freeze(
                self,
                **{name: (len(self.time), len(self.names), 4 if name == "orientations" else 3)},
            )

    @property
    def signals(self) -> dict[str, Any]:
        """What was recorded, by the names of `SIGNALS`."""
        return {name: values for name in SIGNALS if (values := getattr(self, name)) is not None}

    @property
    def rate(self) -> float:
        """Median of frames per second [Hz], nan with fewer than two frames."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")

    def variables(self) -> Mapping[str, Variable]:
        """What was recorded."""
        return {
            name: Variable(
                ("time", "name", "part" if name == "orientations" else "axis"),
                values,
                SIGNALS[name],
            )
            for name, values in self.signals.items()
        }

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Times [s], names of the sensors, axes."""
        return {"time": self.time, "name": self.names, "axis": AXES, "part": ("w", *AXES)}

    def only(self, names: Sequence[str]) -> InertialSensors:
        """Some of the sensors, in the order that is given; raises `UnknownName`."""
        columns = [index_of("sensor", name, self.names, "the recording") for name in names]
        return replace(
            self,
            names=tuple(names),
            **{what: part[:, columns] for what, part in self.signals.items()},
        )

    def between(self, start: float, end: float) -> InertialSensors:
        """Frames from `start` to `end` [s]."""
        some = (self.time >= start - 1e-9) & (self.time <= end + 1e-9)
        if not some.any():
            raise BadData(
                f"{self.source or 'sensors'}: no frame from {start:g} to {end:g} s; the recording"
                f" runs from {self.time[0]:g} to {self.time[-1]:g} s"
            )
        return self.frames(some)


def beside(parts: Sequence[InertialSensors]) -> InertialSensors:
    """Sensors of several files on the clock of the first, as far as all reach; files of one sensor
    each are usual.
    """
    if len(parts) == 1:
        return parts[0]
    start = max(part.time[0] for part in parts)
    end = min(part.time[-1] for part in parts)
    clock = parts[0].time
    clock = clock[(clock >= start - 1e-9) & (clock <= end + 1e-9)]
    if not len(clock):
        raise BadData(
            f"{', '.join(part.source for part in parts)}: no time in common: give files of one"
            " recording"
        )
    common = [what for what in SIGNALS if all(what in part.signals for part in parts)]
    if not common:
        raise BadData(
            f"{', '.join(part.source for part in parts)}: no signal that all of them have"
        )
    merged = {
        what: np.concatenate([_at(part, what, clock) for part in parts], axis=1) for what in common
    }
    return InertialSensors(
        clock,
        tuple(name for part in parts for name in part.names),
        warnings=tuple(text for part in parts for text in part.warnings),
        source=parts[0].source,
        **merged,
    )


def _at(part: InertialSensors, what: str, clock: Array) -> Array:
    """A signal at other times, linear between frames; quaternions by the shorter way."""
    values = np.array(part.signals[what])
    if len(clock) == len(part.time) and np.allclose(clock, part.time, rtol=0.0, atol=1e-9):
        return values
    if what == "orientations":
        values = steady(values)
    flat = values.reshape(len(values), -1)
    result = np.column_stack(
        [np.interp(clock, part.time, column, np.nan, np.nan) for column in flat.T]
    )
    return result.reshape(len(clock), *values.shape[1:])


def steady(quaternions: Array) -> Array:
    """Quaternions (frames, ..., 4) whose sign does not jump from frame to frame: q and -q are one
    orientation.
    """
    known = np.where(np.isfinite(quaternions), quaternions, 0.0)
    signs = np.ones((*known.shape[:-1], 1))
    signs[1:][np.sum(known[1:] * known[:-1], axis=-1, keepdims=True) < 0.0] = -1.0
    return np.asarray(quaternions * signs.cumprod(axis=0))
