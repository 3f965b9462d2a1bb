"""Time series as values: time first, names travel with the arrays, a hidden value is NaN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.model.spatial import Array, frozen_array


@dataclass(frozen=True, eq=False)
class Series:
    """Named columns over time.

    Attributes
    ----------
    time : (frames,) ascending [s]
    names : one per column
    values : (frames, names) or (frames, names, 3)
    """

    time: Array
    names: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", frozen_array(self.time, (-1,)))
        object.__setattr__(self, "values", frozen_array(self.values))
        object.__setattr__(self, "names", tuple(self.names))
        if self.values.shape[:2] != (len(self.time), len(self.names)):
            raise BadData(
                f"expected values of shape ({len(self.time)}, {len(self.names)}, ...), but got {self.values.shape}"
            )
        if len(self.time) > 1 and not np.all(np.diff(self.time) > 0):
            raise BadData("time does not increase from frame to frame")

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> Array:
        """Column of that name, (frames,) or (frames, 3); raises `UnknownName`."""
        column: Array = self.values[:, index_of("column", name, self.names, "the series")]
        return column

    @property
    def rate(self) -> float:
        """Frames per second (median), nan with fewer than two frames [Hz]."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self.time) > 1 else float("nan")


@dataclass(frozen=True, eq=False)
class Markers(Series):
    """Marker positions: values (frames, markers, 3) in ground [m], NaN where unseen."""


@dataclass(frozen=True, eq=False)
class Motion(Series):
    """Coordinates over time: values (frames, coordinates) [rad or m].

    `velocities` and `accelerations`, where known, have the same shape [per s, per s^2].
    """

    velocities: Array | None = None
    accelerations: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("velocities", "accelerations"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, frozen_array(given, self.values.shape))


@dataclass(frozen=True, eq=False)
class Wrenches:
    """External forces on bodies, in ground.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the wrenches, e.g. the plates or the entries of an external loads file
    bodies : name of the body each acts on, "" where not known yet
    forces, points, torques : (frames, wrenches, 3): force [N], its point of application [m] and the
        free torque about that point [N m]
    """

    time: Array
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    forces: Array
    points: Array
    torques: Array

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names), 3)
        object.__setattr__(self, "time", frozen_array(self.time, (-1,)))
        for name in ("forces", "points", "torques"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape))

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, eq=False)
class Analog(Series):
    """Analog channels: values (frames, channels) in `units` (one per channel)."""

    units: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Emg(Series):
    """Muscle excitations: values (frames, channels), envelopes normalised to about 0..1."""


@dataclass(frozen=True)
class Event:
    """Something that happened: a label ("Foot Strike"), a side ("Left", "Right", "") and a time [s]."""

    time: float
    label: str
    side: str = ""


@dataclass(frozen=True, eq=False)
class ForcePlate:
    """One force plate and what it measured, in the ground frame.

    Attributes
    ----------
    corners : (4, 3) [m]
    forces, points, torques : (frames, 3): force on the subject [N], center of pressure [m] (NaN where
        unloaded) and free torque about it [N m]
    """

    name: str
    kind: int
    corners: Array
    forces: Array
    points: Array
    torques: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """Everything one recording holds.

    Attributes
    ----------
    markers : real, labelled markers
    plate_time : (samples,) clock of the plates and analog channels [s]
    other_points : points a program computed (angles, moments, joint centers), in the file's own units
    facts : what the file says of itself: subject, maker, units, rates
    warnings : what looks wrong, one line each
    """

    markers: Markers | None = None
    plates: tuple[ForcePlate, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    analog: Analog | None = None
    emg: Emg | None = None
    events: tuple[Event, ...] = ()
    other_points: Series | None = None
    facts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    warnings: tuple[str, ...] = ()
    source: str = ""
