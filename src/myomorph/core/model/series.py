"""Time series as values: time first, names travel with the arrays, a hidden value is NaN."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import AXES, Labelled, Variable
from myomorph.core.model.model import index_of
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series_quantities import (
    COORDINATE_ACCELERATION,
    COORDINATE_VALUE,
    COORDINATE_VELOCITY,
    EMG,
    MARKER_POSITION,
    WRENCHES,
)

Z_UP_TO_Y_UP: Array = frozen_array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns a laboratory whose z points up into OpenSim's y up, x kept: (x, y, z) -> (x, z, -y)."""

Turned = TypeVar("Turned")


def _turned(value: Turned, rotation: Array, *names: str) -> Turned:
    """The value with arrays (..., 3) seen in a frame whose axes are the rows of `rotation`."""
    return replace(value, **{name: getattr(value, name) @ np.asarray(rotation).T for name in names})  # type: ignore[type-var]


class OverTime(Labelled):
    """A dataclass with `time` (frames,) and `names`, one a column."""

    time: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    def frames(self, which: Any) -> Self:
        """Some of the frames, by a slice, numbers or truth values (frames,)."""
        return self._of_arrays(which)

    def _of_arrays(self, which: Any, **changes: Any) -> Self:
        """The value with parts of its arrays: `which` of their frames or, as a tuple, of frames and
        columns.
        """
        value: Any = self
        arrays = {part.name: getattr(self, part.name) for part in fields(value)}
        least = len(which) if isinstance(which, tuple) else 1
        chosen = {
            name: array[which]
            for name, array in arrays.items()
            if isinstance(array, np.ndarray) and array.ndim >= least
        }
        return replace(value, **chosen, **changes)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Times [s], names, axes."""
        return {"time": self.time, "name": self.names, "axis": AXES}


@read_only
class Series(OverTime):
    """Named columns over time.

    Attributes
    ----------
    time : (frames,) ascending [s]
    names : one per column
    values : (frames, names) or (frames, names, 3)
    quantity : what the values are, where it is known
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    quantity: Quantity | None = field(default=None, kw_only=True)

    usual_quantity: ClassVar[Quantity | None] = None
    """What the values of a class are that are always the same."""

    def __post_init__(self) -> None:
        freeze(self, time=(-1,), values=None)
        object.__setattr__(self, "names", tuple(self.names))
        if self.values.shape[:2] != (len(self.time), len(self.names)):
            raise BadData(
                f"expected values ({len(self.time)}, {len(self.names)}, ...), but got"
                f" {self.values.shape}"
            )
        if len(self.time) > 1 and not np.all(np.diff(self.time) > 0):
            raise BadData("time does not increase from frame to frame")

    def columns(self, which: Sequence[int]) -> Self:
        """Some of the columns, by their numbers."""
        return self._of_arrays(
            (slice(None), list(which)), names=tuple(self.names[column] for column in which)
        )

    def __getitem__(self, name: str) -> Array:
        """Column of that name, (frames,) or (frames, 3); raises `UnknownName`."""
        return self.values[:, index_of("column", name, self.names, "the series")]

    def variables(self) -> dict[str, Variable]:
        """The values, and of vectors each axis, under the name of their quantity."""
        if self.known is None:
            return {"values": Variable(("time", "name", "axis")[: self.values.ndim], self.values)}
        return dict(super().variables())

    @property
    def held(self) -> tuple[Quantity, ...]:
        """What the values are, where it is known."""
        return () if self.known is None else (self.known,)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Times [s], names, axes, by the names of the quantity's axes."""
        clock, names = ("time", "name") if self.known is None else self.known.dims[:2]
        return {clock: self.time, names: self.names, "axis": AXES}

    @property
    def known(self) -> Quantity | None:
        """What the values are: the series' own quantity, else that of its class."""
        return self.quantity or self.usual_quantity

    @property
    def unit(self) -> str:
        """Unit of the values, "" where it is not known."""
        return "" if self.known is None else self.known.unit

    @property
    def rate(self) -> float:
        """Frames per second, nan with fewer than two frames [Hz].

        The mean where no frame is missing (times are often rounded to a millisecond), else the
        median.
        """
        steps = np.diff(self.time)
        if not len(steps):
            return float("nan")
        median = np.median(steps)
        return float(1.0 / (median if steps.max() > 1.6 * median else steps.mean()))


@read_only
class Table(Series):
    """Columns as a file holds them: values (rows, columns) in the file's own units.

    Attributes
    ----------
    in_degrees : angles are in degrees, as the file's header says
    facts : the header's lines, key to text
    warnings : what looks wrong, one line each
    source : path of the file, "" for a table made in memory
    """

    in_degrees: bool = False
    facts: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    warnings: tuple[str, ...] = ()
    source: str = ""


@read_only
class Markers(Series):
    """Marker positions: values (frames, markers, 3) in ground [m], NaN where unseen."""

    usual_quantity = MARKER_POSITION

    def rotated(self, rotation: Array) -> Markers:
        """The same markers seen in a frame whose axes are the rows of `rotation` (3, 3)."""
        return Markers(self.time, self.names, self.values @ np.asarray(rotation).T)


@read_only
class Motion(Series):
    """Coordinates over time: values (frames, coordinates) [rad or m].

    `velocities` and `accelerations`, where known, have the same shape [per s, per s^2].
    """

    velocities: Array | None = None
    accelerations: Array | None = None
    usual_quantity = COORDINATE_VALUE

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze(self, velocities=self.values.shape, accelerations=self.values.shape)

    @property
    def held(self) -> tuple[Quantity, ...]:
        """Values, and velocities and accelerations where they are known."""
        return (*super().held, COORDINATE_VELOCITY, COORDINATE_ACCELERATION)


# One frame that leaves every coordinate at its default.
DEFAULT_POSE = Motion(np.zeros(1), (), np.zeros((1, 0)))


@read_only
class Wrenches(OverTime):
    """External forces on bodies, in ground.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the wrenches, e.g. the plates or the entries of an external loads file
    bodies : name of the body each acts on, "" where not known yet
    forces, points, torques : (frames, wrenches, 3): force [N], its point of application [m] and the
        free torque about that point [N m]
    notes : what they leave open or assume, one line each
    findings : what looks wrong with them, or was put right
    """

    quantities = WRENCHES

    time: Array
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    forces: Array
    points: Array
    torques: Array
    notes: tuple[str, ...] = field(default=(), kw_only=True)
    findings: tuple[Finding, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names), 3)
        freeze(self, time=(-1,), forces=shape, points=shape, torques=shape)

    def columns(self, which: Sequence[int]) -> Self:
        """Some of the forces, by their numbers."""
        names = tuple(self.names[column] for column in which)
        bodies = tuple(self.bodies[column] for column in which)
        return self._of_arrays((slice(None), list(which)), names=names, bodies=bodies)

    def rotated(self, rotation: Array) -> Wrenches:
        """The same forces seen in a frame whose axes are the rows of `rotation` (3, 3)."""
        return _turned(self, rotation, "forces", "points", "torques")

    def and_others(self, others: Wrenches) -> Wrenches:
        """The forces and those of others at the same times."""
        parts: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(others, name)], axis=1)
            for name in ("forces", "points", "torques")
        }
        return replace(
            self, names=(*self.names, *others.names), bodies=(*self.bodies, *others.bodies), **parts
        )

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Times [s], names of the forces, axes."""
        return {"time": self.time, "external_force": self.names, "axis": AXES}


@read_only
class Analog(Series):
    """Analog channels: values (frames, channels) in `units` (one per channel)."""

    units: tuple[str, ...] = ()

    def columns(self, which: Sequence[int]) -> Self:
        """Some of the channels, by their numbers."""
        return replace(
            super().columns(which),
            units=tuple(self.units[column] for column in which if self.units),
        )


@read_only
class Emg(Series):
    """Muscle excitations: values (frames, channels), envelopes normalised to about 0..1."""

    usual_quantity = EMG


@dataclass(frozen=True)
class Event:
    """Something that happened: a label ("Foot Strike"), a side ("Left", "Right", "") and a time
    [s].
    """

    time: float
    label: str
    side: str = ""


@read_only
class ForcePlate:
    """One force plate and what it measured, in the ground frame.

    Attributes
    ----------
    name : of the plate
    kind : type of the C3D standard, 1 to 5
    corners : (4, 3) [m]
    forces, points, torques : (frames, 3): force on the subject [N], center of pressure [m] (NaN
        where unloaded) and free torque about it [N m]
    """

    name: str
    kind: int
    corners: Array
    forces: Array
    points: Array
    torques: Array

    def __post_init__(self) -> None:
        freeze(self, corners=(4, 3), forces=(-1, 3), points=(-1, 3), torques=(-1, 3))

    def rotated(self, rotation: Array) -> ForcePlate:
        """The same plate in a frame whose axes are the rows of `rotation` (3, 3)."""
        return _turned(self, rotation, "corners", "forces", "points", "torques")


@read_only
class PlateRecording:
    """What a file stores of one force plate, before it becomes forces in the ground frame.

    Attributes
    ----------
    name : of the plate
    kind : the C3D type: 1 force, center of pressure and free moment; 2 force and moment;
        3 eight sensor forces (Kistler); 4 as 2, but raw signals that `calibration` maps to 2
    corners : (4, 3) in the laboratory, in the plate's quadrants ++, -+, --, +- [m]
    origin : (3,) as the file writes it; from the sensors' origin to the center of the top surface
        in the plate's axes (kinds 2 and 4), half distances of the sensors and depth (kind 3) [m]
    channels : (samples, 6 or 8) [N, N m, m], for kind 4 in the file's units
    channel_names : labels of the channels
    calibration : (6, 6) from the channels of a kind 4 plate to [N, N m], or None
    center_polynomial : (2, 6) Kistler's correction of the center of pressure (lengths in mm), or
        None
    """

    name: str
    kind: int
    corners: Array
    origin: Array
    channels: Array
    channel_names: tuple[str, ...] = ()
    calibration: Array | None = None
    center_polynomial: Array | None = None

    def __post_init__(self) -> None:
        freeze(
            self,
            corners=(4, 3),
            origin=(3,),
            channels=(-1, -1),
            calibration=(6, 6),
            center_polynomial=(2, 6),
        )


@read_only
class Trial:
    """Everything one recording holds.

    Attributes
    ----------
    markers : real, labelled markers
    plates : force plates as forces in ground, once `contact` has made them from `plate_recordings`
    plate_recordings : force plates as the file stores them
    plate_time : (samples,) clock of the plates and analog channels [s]
    analog : further channels that the file holds, in its units
    emg : raw EMG or envelopes
    events : named instants [s]
    other_points : points a program computed that are no places (angles, moments, powers), in the
        file's units
    facts : what the file says of itself: subject, maker, units, rates
    warnings : what looks wrong, one line each
    source : path of the file, "" for a recording made in memory
    """

    markers: Markers | None = None
    plates: tuple[ForcePlate, ...] = ()
    plate_recordings: tuple[PlateRecording, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    analog: Analog | None = None
    emg: Emg | None = None
    events: tuple[Event, ...] = ()
    other_points: Series | None = None
    facts: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    warnings: tuple[str, ...] = ()
    source: str = ""

    def rotated(self, rotation: Array) -> Trial:
        """The same trial in a frame whose axes, in the laboratory, are the rows of `rotation` (3,
        3).

        `other_points` stay as the file has them: angles and moments are not vectors of the
        laboratory.
        """
        turn = np.asarray(rotation, dtype=np.float64)
        if (
            turn.shape != (3, 3)
            or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
            or np.linalg.det(turn) < 0
        ):
            raise BadData(
                f"expected a rotation matrix (3, 3) with determinant 1, but got {turn.tolist()}"
            )
        return replace(
            self,
            markers=self.markers.rotated(turn) if self.markers is not None else None,
            plates=tuple(plate.rotated(turn) for plate in self.plates),
            plate_recordings=tuple(
                _turned(plate, turn, "corners") for plate in self.plate_recordings
            ),
        )


@read_only
class Sound:
    """Channels of one recording, all on one clock."""

    rate: float  # samples per second [Hz]
    names: tuple[str, ...]  # one per channel
    samples: np.ndarray  # (samples, channels) in shares of full scale, -1 to 1; single precision
    start: float = 0.0  # time of the first sample on the motion's clock [s]
    warnings: tuple[str, ...] = ()  # what looks wrong, one line each
    source: str = ""  # path of the file, "" for a sound made in memory

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        samples = np.array(self.samples, dtype=np.float32)
        object.__setattr__(self, "samples", samples)
        if samples.ndim != 2 or samples.shape[1] != len(self.names):
            raise BadData(
                f"expected samples of shape (..., {len(self.names)}), but got {samples.shape}"
            )
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise BadData(f"a sound of {self.rate:g} samples per second: expected a rate above 0")

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel of that name, (samples,); raises `UnknownName`."""
        return self.samples[:, index_of("sound channel", name, self.names, "the recording")]

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.samples) / self.rate

    @property
    def time(self) -> Array:
        """(samples,) [s]."""
        return self.start + np.arange(len(self.samples)) / self.rate
