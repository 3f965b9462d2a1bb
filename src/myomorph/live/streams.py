"""Streams of the Lab Streaming Layer: what comes in, and results that go out.

What the channels mean stands here too.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, MyomorphError, UnknownName
from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.online_identification import total_wrench
from myomorph.live.sources import Arrived, Source

_AXIS = re.compile(r"^(.*?)[ _.:-]?([wxyz])$", re.IGNORECASE)
_FORCE = re.compile(r"^(.*?)[ _.:-]?([fptm])[ _.:-]?([xyz])$", re.IGNORECASE)
_UNITS: Mapping[str, float] = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "": 1.0,
    "mm": 1e-3,
    "millimeter": 1e-3,
    "millimeters": 1e-3,
    "millimetre": 1e-3,
    "millimetres": 1e-3,
    "cm": 1e-2,
    "centimeter": 1e-2,
    "centimeters": 1e-2,
}


def marker_channels(
    labels: Sequence[str], units: Sequence[str], axes: str = "xyz"
) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Find the channels of markers, or of sensors with axes "wxyz".

    Parameters
    ----------
    labels : of the channels
    units : of the channels
    axes : "xyz" of markers, "wxyz" of sensors

    Returns
    -------
    Names, (markers, 3) or (sensors, 4) channels, and the factor to metres, 1 of sensors

    Raises
    ------
    BadData : channels without the axes, or in no unit of length
    """
    kind = "markers" if axes == "xyz" else "sensors"
    channels: dict[str, dict[str, int]] = {}
    for i, label in enumerate(labels):
        match = _AXIS.match(label)
        if match and match[1]:
            channels.setdefault(match[1], {})[match[2].lower()] = i
    if not channels:
        expected = ", ".join(f"NAME_{axis}" for axis in axes)
        has = _first_labels(labels)
        raise BadData(f"the {kind}' stream has channels {has}: expected {expected} for each")
    for name, axis_channels in channels.items():
        if set(axis_channels) != set(axes):
            has = ", ".join(sorted(axis_channels))
            raise BadData(
                f"'{name}' of the {kind}' stream has only {has}: expected {', '.join(axes)}"
            )
    columns = np.array([[of_axis[axis] for axis in axes] for of_axis in channels.values()])
    scale = 1.0 if kind == "sensors" else _scale([units[i] for i in columns.ravel()])
    return tuple(channels), columns, scale


def _first_labels(labels: Sequence[str]) -> str:
    return ", ".join(labels[:6]) or "without labels"


def _scale(units: Iterable[str]) -> float:
    """Find the factor to metres of markers' channels, which have one unit."""
    used = {unit.strip().lower() for unit in units}
    if len(used) != 1 or not used <= set(_UNITS):
        raise BadData(
            f"the markers' stream is in '{', '.join(sorted(used))}': expected one of m, mm, cm"
        )
    return _UNITS[used.pop()]


def force_channels(
    labels: Sequence[str], units: Sequence[str]
) -> tuple[tuple[str, ...], Callable[[Array], Array]]:
    """Find the channels of plates.

    Parameters
    ----------
    labels : of the channels
    units : of the channels

    Returns
    -------
    Names of plates, and a function from samples (samples, channels) to their wrenches (samples,
        plates, 6): moments about the ground's origin [N m] and forces [N]

    Raises
    ------
    BadData : no plate, a plate without some of its channels, or points in no unit of length
    """
    plate_channels: dict[str, dict[str, int]] = {}
    for i, label in enumerate(labels):
        match = _FORCE.match(label)
        if match:
            plate_channels.setdefault(match[1], {})[match[2].lower() + match[3].lower()] = i
    plates = [_layout(name, channels, units) for name, channels in plate_channels.items()]
    if not plates:
        has = _first_labels(labels)
        raise BadData(f"the forces' stream has channels {has}: expected NAME_Fx ... NAME_Tz")

    def each(samples: Array) -> Array:
        return np.stack([plate.wrenches(samples) for plate in plates], axis=1)

    return tuple(plate_channels), each


@read_only
class _Layout:
    """Channels of one plate."""

    kind: str  # "fpt": force, point, torque about it; "fm": force and moment about the origin
    columns: np.ndarray  # (kinds, 3) of force, and of point and torque or of moment
    scale: float  # factor of the point to metres

    def wrenches(self, samples: Array) -> Array:
        """Moments about the ground's origin and forces (samples, 6) of (samples, channels)."""
        parts = samples[:, self.columns]
        if self.kind == "fm":
            return np.concatenate([parts[:, 1], parts[:, 0]], axis=1)
        return total_wrench(parts[:, None, 0], self.scale * parts[:, None, 1], parts[:, None, 2])


def _layout(name: str, channels: Mapping[str, int], units: Sequence[str]) -> _Layout:
    """Find which channels of a plate are which, and in which unit its points are."""
    wanted = {kind: {a + b for a in kind for b in "xyz"} for kind in ("fpt", "fm")}
    kind = next((kind for kind, needed in wanted.items() if needed <= set(channels)), "")
    if not kind:
        has = ", ".join(sorted(channels))
        expected = "Fx..Fz, Px..Pz, Tx..Tz, or Fx..Fz, Mx..Mz"
        raise BadData(f"plate '{name}' of the forces' stream has {has}: expected {expected}")
    unit = units[channels["px"]].strip().lower() if kind == "fpt" else ""
    if unit not in _UNITS:
        raise BadData(f"the points of plate '{name}' are in '{unit}': expected m, mm or cm")
    columns = np.array([[channels[a + b] for b in "xyz"] for a in kind])
    return _Layout(kind=kind, columns=columns, scale=_UNITS[unit])


WAIT = 10.0  # How long a stream is waited for [s].
SILENCE = 5.0  # A stream that sends nothing for so long has ended [s].
RATE_ERROR = 0.2  # Share by which a stream's samples may come faster or slower than it says.


class LabStreams:
    """Markers and forces that other programs send over the Lab Streaming Layer.

    The markers' stream has three channels a marker, labelled NAME_x, NAME_y, NAME_z (any of `_ . :
        -` or a space before
    the axis), in the unit that the channels name (m where none), NaN while hidden. The forces'
    stream has either nine channels a plate, NAME_Fx Fy Fz (force on the subject [N]), NAME_Px Py Pz
    (point of application [m]), NAME_Tx Ty Tz (free torque about it [N m]), or six, NAME_Fx Fy Fz
    and NAME_Mx My Mz (moment about the laboratory's origin [N m]). Both are in the model's ground
    axes. `turn`: (3, 3) rows are the ground's axes in the laboratory; `library`: `pylsl`, or
    something that behaves like it; `orientations`: the stream is of inertial sensors, four channels
    each, NAME_w, NAME_x, NAME_y, NAME_z, quaternions to an earth whose z axis points up.
    """

    duration: float | None = None
    speed = 0.0

    def __init__(
        self,
        markers: str,
        forces: str,
        wait: float = WAIT,
        turn: Array | None = None,
        library: Any = None,
        orientations: bool = False,
    ):
        self.markers = not orientations
        self._lsl = lsl = library or streaming_library()
        self._turn = None if turn is None else np.asarray(turn, dtype=np.float64)
        self._markers = _Stream(lsl, markers, "sensors" if orientations else "markers", wait)
        (labels, units) = self._markers.channels
        axes = "wxyz" if orientations else "xyz"
        self.names, self._columns, self._scale = marker_channels(labels, units, axes)
        self.rate = self._markers.rate
        self._forces: _Stream | None = None
        self.plates: tuple[str, ...] = ()
        self.force_rate = 0.0
        if forces:
            self._forces = _Stream(lsl, forces, "forces", wait)
            self.force_rate = self._forces.rate
            self.plates, self._layout = force_channels(*self._forces.channels)
        self.bodies: tuple[str, ...] = ("",) * len(self.plates)
        self._last: float | None = None

    @property
    def done(self) -> bool:
        """Whether nothing has come for a while since the first look."""
        return self._last is not None and clock.monotonic() - self._last > SILENCE

    def take(self) -> Arrived:
        """Everything that came since the last call."""
        force_time = np.zeros(0)
        wrenches = np.zeros((0, len(self.plates), 6))
        if self._forces is not None:
            force_time, samples = self._forces.pulled()
            if len(samples):
                wrenches = self._layout(samples)
        time, rows = self._markers.pulled()
        if len(time) or self._last is None:
            self._last = clock.monotonic()
        positions = (
            rows[:, self._columns] * self._scale
            if len(rows)
            else np.zeros((0, *self._columns.shape))
        )
        if self._turn is not None:
            positions = positions @ self._turn.T
            wrenches = np.concatenate(
                [wrenches[..., :3] @ self._turn.T, wrenches[..., 3:] @ self._turn.T], axis=-1
            )
        return Arrived(motion_time=time, motion=positions, force_time=force_time, forces=wrenches)

    def wait(self, most: float) -> None:
        """Sleep until the markers' stream sends."""
        self._markers.wait(most)

    def age(self, time: float) -> float:
        """How long ago the sender gave a frame its time, on this machine's clock."""
        return float(self._lsl.local_clock() - time)


def streaming_library() -> Any:
    """Return the package `pylsl`; raises `MyomorphError` where it is not installed."""
    try:
        # Brings pylsl: loaded only where it is needed.
        import pylsl
    except (ImportError, RuntimeError) as error:
        text = f"need the package 'pylsl' ({error}): pip install 'myomorph[live]'"
        raise MyomorphError(f"streams of the Lab Streaming Layer {text}") from None
    return pylsl


class _Stream:
    """One stream: its channels, its rate, and what it sends."""

    def __init__(self, lsl: Any, name: str, what: str, wait: float):
        streams = lsl.resolve_byprop("name", name, timeout=wait)
        if not streams:
            others = tuple(dict.fromkeys(stream.name() for stream in lsl.resolve_streams(1.0)))
            raise UnknownName(f"stream of {what}", name, existing=others, where="the network")
        flags = lsl.proc_clocksync | lsl.proc_dejitter | lsl.proc_monotonize
        try:
            self._inlet = lsl.StreamInlet(streams[0], processing_flags=flags)
            info = self._inlet.info(wait)
            # What the first sample would wait for: the connection, and a first look at the sender's
            # clock.
            self._inlet.open_stream(wait)
            self._inlet.time_correction(wait)
        except RuntimeError as error:
            cause = str(error) or type(error).__name__
            raise BadData(
                f"stream '{name}' is announced but does not respond ({cause}): restart its sender"
            ) from None
        self.name = name
        self.rate = float(info.nominal_srate())
        if self.rate <= 0.0:
            raise BadData(
                f"stream '{name}' has no rate: its sender must name one (samples per second)"
            )
        labels = list[str]()
        units = list[str]()
        channel = info.desc().child("channels").child("channel")
        for _ in range(info.channel_count()):
            labels.append(channel.child_value("label"))
            units.append(channel.child_value("unit"))
            channel = channel.next_sibling("channel")
        self.channels = labels, units
        self._first = float("nan")
        self._count = 0
        self._early: tuple[list[float], float] | None = None

    def wait(self, most: float) -> None:
        """Sleep until a sample comes, at most so long [s]; the next `pulled` gives it."""
        if self._early is None:
            sample, time = self._inlet.pull_sample(timeout=most)
            if sample is not None:
                self._early = (sample, time)

    def pulled(self) -> tuple[Array, Array]:
        """Return times (samples,) [s] and samples (samples, channels) since the last call."""
        samples, times = self._inlet.pull_chunk(timeout=0.0, max_samples=4096)
        if self._early is not None:
            samples = [self._early[0], *samples]
            times = [self._early[1], *times]
            self._early = None
        if self._count == 0 and times:
            self._first = times[0]
        self._count += len(times)
        span = times[-1] - self._first if times else 0.0
        if span > 1.0 and abs((self._count - 1) / span / self.rate - 1.0) > RATE_ERROR:
            rates = f"{self.rate:g} samples a second, but sends {(self._count - 1) / span:.4g}"
            raise BadData(
                f"stream '{self.name}' states {rates}: correct the rate that its sender names"
            )
        return frozen_array(np.array(times, dtype=np.float64)), np.array(samples, dtype=np.float64)


class LabOutlet:
    """One stream of three groups of channels: coordinates, torques, activations.

    A row is of one instant, which its time stamp names: the frame's own less the filter's delay.
    Channels are labelled by the names of coordinates, the same with `_moment` or `_force`, and the
    names of muscles, and have units. What is unknown is NaN. Of a stream, time stamps are those of
    its sender on this machine's clock; of a recording that is played, those at which its frames
    were due. With limits, all channels come twice more, as `..._low` and `..._high`.
    """

    def __init__(self, name: str, chain: LiveChain, source: Source, library: Any = None):
        self._lsl = lsl = library or streaming_library()
        self._delay = chain.filter.delay
        model = chain.model
        turns = {
            coordinate.name: coordinate.motion == "rotational" for coordinate in model.coordinates
        }
        channels = [(label, "rad" if turn else "m", "Angle") for label, turn in turns.items()]
        torques = {True: ("moment", "N m"), False: ("force", "N")}
        channels += [
            (f"{label}_{torques[turn][0]}", torques[turn][1], "Torque")
            for label, turn in turns.items()
        ]
        channels += [(muscle, "1", "Activation") for muscle in chain.tension.muscles]
        self._results = len(channels)
        self._limited = chain.limits is not None
        if self._limited:
            results = tuple(channels)
            channels += [
                (f"{name}_{end}", unit, kind)
                for end in ("low", "high")
                for name, unit, kind in results
            ]
        try:
            info = lsl.StreamInfo(
                name, "Biomechanics", len(channels), source.rate, "double64", f"myomorph-{name}"
            )
            described = info.desc().append_child("channels")
            for label, unit, kind in channels:
                channel = described.append_child("channel")
                for key, text in (("label", label), ("unit", unit), ("type", kind)):
                    channel.append_child_value(key, text)
            info.desc().append_child_value("filter_delay", f"{self._delay:.6f}")
            self._outlet = lsl.StreamOutlet(info)
        except RuntimeError as error:
            raise MyomorphError(f"stream '{name}' cannot be sent: {error}") from None
        self._source = source
        self._row = np.empty(len(channels))

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """Send one frame.

        Parameters
        ----------
        frame : the result
        markers : (markers, 3) as recorded [m], which are not sent
        """
        results = frame.coordinates, frame.torques, frame.tension.activations
        self._row[: self._results] = np.concatenate(results)
        if self._limited:
            self._row[self._results :] = np.nan
        if (limits := frame.limits) is not None:
            ends = np.hstack([limits.coordinates[:2], limits.torques[:2], limits.activations[:2]])
            self._row[self._results :] = ends.ravel()
        # A stream's frames have its clock already; those of a recording were due some time ago.
        stamp = frame.time
        if self._source.duration is not None:
            age = self._source.age(frame.time)
            stamp = self._lsl.local_clock() - (age if np.isfinite(age) else 0.0)
        self._outlet.push_sample(self._row, stamp - self._delay)

    def close(self) -> None:
        """End the stream."""
        del self._outlet
