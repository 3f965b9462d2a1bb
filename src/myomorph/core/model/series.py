"""Time series as values: time first, names travel with the arrays, a hidden value is NaN."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.drawings import curves_drawing
from myomorph.core.model.errors import BadData, counted
from myomorph.core.model.findings import Finding
from myomorph.core.model.frames import Variable
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import AXES, Labelled
from myomorph.core.model.messages import Message
from myomorph.core.model.model import index_of
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.segment_poses import SegmentPoses
from myomorph.core.model.series_quantities import (
    COORDINATE_ACCELERATION,
    COORDINATE_VALUE,
    COORDINATE_VELOCITY,
    EMG,
    MARKER_POSITION,
    WRENCHES,
)
from myomorph.core.model.units import MotionKind

MAX_UNEVENNESS = 1.6  # Largest step of a clock by its median, where no frame is missing
Z_UP_TO_Y_UP: Array = frozen_array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns a laboratory whose z points up into OpenSim's y up, x kept: (x, y, z) -> (x, z, -y)."""

Turned = TypeVar("Turned")


def _turned(value: Turned, rotation: Array, *names: str) -> Turned:
    """Express arrays of a value in another frame.

    Parameters
    ----------
    rotation : (3, 3) whose rows are the axes of the frame
    names : fields of arrays (..., 3)
    """
    changes = {name: getattr(value, name) @ np.asarray(rotation).T for name in names}
    return replace(value, **changes)  # type: ignore[type-var]


class OverTime(Labelled):
    """A dataclass with `time` (frames,) and `names`, one a column."""

    noun: ClassVar[str] = "column"
    """What a name is that of."""

    time: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def headline(self) -> str:
        """What the series holds, in one line."""
        count = f"{counted(len(self.names), self.noun)}, {counted(len(self), 'frame')}"
        if len(self) < 2:
            return count
        start = self.time[0]
        stop = self.time[-1]
        rate = (len(self) - 1) / (stop - start)
        return f"{count} from {start:.4g} to {stop:.4g} s at {rate:.4g} Hz"

    def frames(self, which: Any) -> Self:
        """Take some of the frames, by a slice, numbers or truth values (frames,)."""
        return self._of_arrays(which)

    def _of_arrays(self, which: Any, **changes: Any) -> Self:
        """Take parts of the arrays.

        Parameters
        ----------
        which : of their frames or, as a tuple, of frames and columns
        changes : of other fields
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
        """Label each dimension: times [s], names, axes.

        Returns
        -------
        by dimension
        """
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
    motion_kinds : how coordinates move that have these names, where it is known
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    quantity: Quantity | None = field(default=None, kw_only=True)
    motion_kinds: Mapping[str, MotionKind] | None = field(default=None, kw_only=True)

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
        """Take some of the columns, by their numbers."""
        return self._of_arrays(
            (slice(None), list(which)), names=tuple(self.names[column] for column in which)
        )

    def __getitem__(self, name: str) -> Array:
        """Find the column of a name, (frames,) or (frames, 3); raises `UnknownName`."""
        return self.values[:, index_of("column", name, self.names, "the series")]

    def variables(self) -> dict[str, Variable]:
        """Name the values, and of vectors each axis, by their quantity."""
        if self.known is None:
            return {"values": Variable(("time", "name", "axis")[: self.values.ndim], self.values)}
        return dict(super().variables())

    @property
    def held(self) -> tuple[Quantity, ...]:
        """Quantity of the values, where it is known."""
        return () if self.known is None else (self.known,)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], names, axes, as the quantity names them.

        Returns
        -------
        by dimension
        """
        clock, names = ("time", "name") if self.known is None else self.known.dims[:2]
        return {clock: self.time, names: self.names, "axis": AXES}

    @property
    def known(self) -> Quantity | None:
        """Quantity of the values: the series' own, else that of its class."""
        return self.quantity or self.usual_quantity

    @property
    def unit(self) -> str:
        """Unit of the values, "" where it is not known."""
        return "" if self.known is None else self.known.unit

    def drawing(self) -> str:
        """Draw the first columns over time, as SVG for notebooks; "" for positions."""
        return curves_drawing(self.time, self.values, self.names)

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
        return float(1.0 / (median if steps.max() > MAX_UNEVENNESS * median else steps.mean()))


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
    warnings: tuple[Message, ...] = ()
    source: str = ""


@read_only
class Markers(Series):
    """Marker positions: values (frames, markers, 3) in ground [m], NaN where unseen."""

    noun = "marker"
    usual_quantity = MARKER_POSITION

    def rotated(self, rotation: Array) -> Markers:
        """Express the markers in another frame.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes of the frame

        Returns
        -------
        markers at the same times
        """
        return Markers(self.time, self.names, self.values @ np.asarray(rotation).T)


@read_only
class Motion(Series):
    """Coordinates over time: values (frames, coordinates) [rad or m].

    `velocities` and `accelerations`, where known, have the same shape [per s, per s^2]; `findings`
    say why it may be that of a mirrored or fallen body, so that no forces are to be judged by it,
    and in which frames it is not (with times).
    """

    velocities: Array | None = None
    accelerations: Array | None = None
    findings: tuple[Finding, ...] = field(default=(), kw_only=True)
    noun = "coordinate"
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
    noun = "wrench"

    time: Array
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    forces: Array
    points: Array
    torques: Array
    notes: tuple[Message, ...] = field(default=(), kw_only=True)
    findings: tuple[Finding, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names), 3)
        freeze(self, time=(-1,), forces=shape, points=shape, torques=shape)

    def columns(self, which: Sequence[int]) -> Self:
        """Take some of the forces, by their numbers."""
        names = tuple(self.names[column] for column in which)
        bodies = tuple(self.bodies[column] for column in which)
        return self._of_arrays((slice(None), list(which)), names=names, bodies=bodies)

    def rotated(self, rotation: Array) -> Wrenches:
        """Express the forces in another frame.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes of the frame

        Returns
        -------
        forces at the same times
        """
        return _turned(self, rotation, "forces", "points", "torques")

    def and_others(self, others: Wrenches) -> Wrenches:
        """Append the forces of others at the same times."""
        parts: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(others, name)], axis=1)
            for name in ("forces", "points", "torques")
        }
        return replace(
            self, names=(*self.names, *others.names), bodies=(*self.bodies, *others.bodies), **parts
        )

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], names of the forces, axes.

        Returns
        -------
        by dimension
        """
        return {"time": self.time, "external_force": self.names, "axis": AXES}


@read_only
class Analog(Series):
    """Analog channels: values (frames, channels) in `units` (one per channel)."""

    units: tuple[str, ...] = ()
    noun = "channel"

    def columns(self, which: Sequence[int]) -> Self:
        """Take some of the channels, by their numbers."""
        return replace(
            super().columns(which),
            units=tuple(self.units[column] for column in which if self.units),
        )


@read_only
class Emg(Series):
    """Muscle excitations: values (frames, channels), envelopes normalised to about 0..1."""

    noun = "channel"
    usual_quantity = EMG


@dataclass(frozen=True)
class Event:
    """A named instant of a recording.

    Attributes
    ----------
    time : [s]
    label : as "Foot Strike"
    side : "Left", "Right" or ""
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
        """Express the plate in another frame.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes of the frame

        Returns
        -------
        the plate with its forces
        """
        return _turned(self, rotation, "corners", "forces", "points", "torques")


@read_only
class PlateRecording:
    """Signals of one force plate in a file, before they become forces in the ground frame.

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
    segments : poses of segments, of programs that need no markers
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
    segments: SegmentPoses | None = None
    facts: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    warnings: tuple[Message, ...] = ()
    source: str = ""

    def rotated(self, rotation: Array) -> Trial:
        """Express the trial in another frame.

        `other_points` stay as the file has them: angles and moments are not vectors of the
        laboratory.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes of the frame in the laboratory

        Returns
        -------
        the trial

        Raises
        ------
        BadData : the matrix is no rotation
        """
        matrix = np.asarray(rotation, dtype=np.float64)
        if not _is_rotation(matrix):
            raise BadData(
                f"expected a rotation matrix (3, 3) with determinant 1, but got {matrix.tolist()}"
            )
        recordings = [_turned(plate, matrix, "corners") for plate in self.plate_recordings]
        return replace(
            self,
            markers=self.markers.rotated(matrix) if self.markers is not None else None,
            plates=tuple(plate.rotated(matrix) for plate in self.plates),
            plate_recordings=tuple(recordings),
            segments=self.segments.rotated(matrix) if self.segments is not None else None,
        )


def _is_rotation(matrix: Array) -> bool:
    """Whether a matrix is (3, 3), orthogonal and of determinant 1."""
    if matrix.shape != (3, 3) or not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6):
        return False
    return bool(np.linalg.det(matrix) >= 0)


@read_only
class Sound:
    """Channels of one recording, all on one clock.

    Attributes
    ----------
    rate : samples per second [Hz]
    names : one per channel
    samples : (samples, channels) in shares of full scale, -1 to 1; single precision
    start : time of the first sample on the motion's clock [s]
    warnings : what looks wrong, one line each
    source : path of the file, "" for a sound made in memory
    """

    rate: float
    names: tuple[str, ...]
    samples: np.ndarray
    start: float = 0.0
    warnings: tuple[Message, ...] = ()
    source: str = ""

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
        """Find the channel of a name, (samples,); raises `UnknownName`."""
        return self.samples[:, index_of("sound channel", name, self.names, "the recording")]

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return len(self.samples) / self.rate

    @property
    def time(self) -> Array:
        """(samples,) [s]."""
        return self.start + np.arange(len(self.samples)) / self.rate
