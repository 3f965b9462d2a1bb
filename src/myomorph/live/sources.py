"""Where live frames come from: a recording played again, or streams of the Lab Streaming Layer."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from myomorph.identify.online import total_wrench
from myomorph.live.channels import force_channels, marker_channels
from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData, MyomorphError, UnknownName
from myomorph.model.model import GROUND
from myomorph.model.series import Markers, Motion, Series, Wrenches

CHUNK = 0.05
"""Time that a recording played as fast as it goes gives at once [s]."""

WAIT = 10.0
"""How long a stream is waited for [s]."""

SILENCE = 5.0
"""A stream that sends nothing for so long has ended [s]."""

RATE_ERROR = 0.2
"""Share by which a stream's samples may come faster or slower than it says."""


@dataclass(frozen=True, eq=False)
class Arrived:
    """What came since the last look.

    Attributes
    ----------
    motion_time, motion : (frames,) [s] and (frames, coordinates) or (frames, markers, 3) [m]
    force_time, forces : (samples,) [s] and (samples, plates, 6) moment about the ground's origin and force of each
        plate [N m], [N]
    """

    motion_time: Array
    motion: Array
    force_time: Array
    forces: Array


class Source(Protocol):
    """Frames of markers or coordinates, and forces.

    Attributes
    ----------
    names : of markers or coordinates
    markers : whether they are markers
    plates, bodies : names of the plates, and of the bodies that they act on, "" where not known
    rate, force_rate : [Hz]; no forces come at 0
    duration : of the whole, None where nobody knows [s]
    speed : times real time at which it is played; 0 where that says nothing
    """

    names: tuple[str, ...]
    markers: bool
    plates: tuple[str, ...]
    bodies: tuple[str, ...]
    rate: float
    force_rate: float
    duration: float | None
    speed: float

    def take(self) -> Arrived:
        """Everything that came since the last call."""

    def wait(self, most: float) -> None:
        """Sleep until the next frame comes, at most so long [s]."""

    def age(self, time: float) -> float:
        """How long ago the frame of a time was there to be taken, nan where nobody knows [s]."""

    @property
    def done(self) -> bool:
        """Whether nothing more will come."""


class Replay:
    """A recording at the speed at which it was made, or another.

    Parameters
    ----------
    motion : markers, or coordinates
    wrenches : all external forces, in ground, on any clock; None for none
    speed : times real time; 0 as fast as it goes
    now : a clock [s]

    Raises
    ------
    BadData : a negative speed, a recording without a rate, or no common time
    """

    def __init__(
        self,
        motion: Markers | Motion,
        wrenches: Wrenches | None,
        speed: float = 1.0,
        now: Callable[[], float] = clock.perf_counter,
    ):
        if not (speed >= 0.0 and np.isfinite(speed)):
            raise BadData(f"speed {speed:g}: expected 1 for real time, more for faster, 0 for as fast as it goes")
        if len(motion) < 2 or (wrenches is not None and len(wrenches) < 2):
            samples = "" if wrenches is None else f" and {len(wrenches)} samples of force"
            raise BadData(f"{len(motion)} frames{samples} cannot be played: two are needed")
        self.names, self.markers = motion.names, isinstance(motion, Markers)
        self.rate = motion.rate
        self.played, self._motion, self._time = motion, motion.values, motion.time
        first, last = float(motion.time[0]), float(motion.time[-1])
        self._take_forces(wrenches, first, last)
        self.duration: float | None = last - first
        self.speed, self._now = speed, now
        self._began: float | None = None
        self._frame = 0
        # Forces begin a little earlier, so that their filter is filled when the motion's is.
        self._sample = int(np.searchsorted(self._force_time, first - 1.0))

    def _take_forces(self, wrenches: Wrenches | None, first: float, last: float) -> None:
        self.plates: tuple[str, ...] = ()
        self.bodies: tuple[str, ...] = ()
        self.force_rate, self._force_time, self._forces = 0.0, np.zeros(0), np.zeros((0, 0, 6))
        if wrenches is None:
            return
        if wrenches.time[0] > last or wrenches.time[-1] < first:
            raise BadData(
                f"motion ({first:g} to {last:g} s) and forces ({wrenches.time[0]:g} to {wrenches.time[-1]:g} s) have "
                "no time in common"
            )
        outside = [i for i, body in enumerate(wrenches.bodies) if body != GROUND]
        self.plates = tuple(wrenches.names[i] for i in outside)
        self.bodies = tuple(wrenches.bodies[i] for i in outside)
        self.force_rate = Series(wrenches.time, (), np.zeros((len(wrenches), 0))).rate
        self._force_time = wrenches.time
        parts = (one[:, outside, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
        self._forces = total_wrench(*parts)

    @property
    def done(self) -> bool:
        """Whether all frames have been taken."""
        return self._frame >= len(self._time)

    def take(self) -> Arrived:
        """Everything whose time has come."""
        if self.speed == 0.0:
            until = float(self._time[min(self._frame, len(self._time) - 1)]) + CHUNK
        else:
            if self._began is None:
                self._began = self._now()
            until = float(self._time[0]) + self.speed * (self._now() - self._began)
        frames = slice(self._frame, int(np.searchsorted(self._time, until, side="right")))
        samples = slice(self._sample, int(np.searchsorted(self._force_time, until, side="right")))
        self._frame, self._sample = max(frames.stop, self._frame), max(samples.stop, self._sample)
        if self.done:
            samples = slice(samples.start, len(self._force_time))
        return Arrived(self._time[frames], self._motion[frames], self._force_time[samples], self._forces[samples])

    def wait(self, most: float) -> None:
        """Sleep until the time of the next frame."""
        if self.speed > 0.0 and not self.done:
            clock.sleep(min(max(-self.age(float(self._time[self._frame])), 0.0), most))

    def age(self, time: float) -> float:
        """How long ago a frame's time was."""
        if self.speed == 0.0 or self._began is None:
            return float("nan") if self.speed == 0.0 else 0.0
        return self._now() - self._began - (time - float(self._time[0])) / self.speed


class LabStreams:
    """Markers and forces that other programs send over the Lab Streaming Layer.

    The markers' stream has three channels a marker, labelled NAME_x, NAME_y, NAME_z (any of `_ . : -` or a
    space before the axis), in the unit that the channels name (m where none), NaN while hidden. The forces'
    stream has either nine channels a plate, NAME_Fx Fy Fz (force on the subject [N]), NAME_Px Py Pz (point of
    application [m]), NAME_Tx Ty Tz (free torque about it [N m]), or six, NAME_Fx Fy Fz and NAME_Mx My Mz
    (moment about the laboratory's origin [N m]). Both are in the model's ground axes.

    Parameters
    ----------
    markers, forces : names of the streams; "" for no forces
    wait : for the streams to appear [s]
    turn : (3, 3) rows are the ground's axes in the laboratory; None where they are the same
    library : `pylsl`, or something that behaves like it

    Raises
    ------
    MyomorphError : `pylsl` is not installed
    BadData : no such stream, or channels that cannot be told apart
    """

    markers = True
    duration: float | None = None
    speed = 0.0

    def __init__(self, markers: str, forces: str, wait: float = WAIT, turn: Array | None = None, library: Any = None):
        self._lsl = lsl = library or streaming_library()
        self._turn = None if turn is None else np.asarray(turn, dtype=np.float64)
        self._markers = _Stream(lsl, markers, "markers", wait)
        self.names, self._columns, self._scale = marker_channels(*self._markers.channels)
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
        force_time, wrenches = np.zeros(0), np.zeros((0, len(self.plates), 6))
        if self._forces is not None:
            force_time, samples = self._forces.pulled()
            if len(samples):
                wrenches = self._layout(samples)
        time, rows = self._markers.pulled()
        if len(time) or self._last is None:
            self._last = clock.monotonic()
        positions = rows[:, self._columns] * self._scale if len(rows) else np.zeros((0, len(self.names), 3))
        if self._turn is not None:
            positions = positions @ self._turn.T
            wrenches = np.concatenate([wrenches[..., :3] @ self._turn.T, wrenches[..., 3:] @ self._turn.T], axis=-1)
        return Arrived(time, positions, force_time, wrenches)

    def wait(self, most: float) -> None:
        """Sleep until the markers' stream sends."""
        self._markers.wait(most)

    def age(self, time: float) -> float:
        """How long ago the sender gave a frame its time, on this machine's clock."""
        return float(self._lsl.local_clock() - time)


def streaming_library() -> Any:
    """The package `pylsl`; raises `MyomorphError` where it is not installed."""
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:
        raise MyomorphError(
            f"streams of the Lab Streaming Layer need the package 'pylsl' ({error}): pip install 'myomorph[live]'"
        ) from None
    return pylsl


class _Stream:
    """One stream: its channels, its rate, and what it sends."""

    def __init__(self, lsl: Any, name: str, what: str, wait: float):
        found = lsl.resolve_byprop("name", name, timeout=wait)
        if not found:
            others = tuple(dict.fromkeys(one.name() for one in lsl.resolve_streams(1.0)))
            raise UnknownName(f"stream of {what}", name, others, "the network")
        flags = lsl.proc_clocksync | lsl.proc_dejitter | lsl.proc_monotonize
        try:
            self._inlet = lsl.StreamInlet(found[0], processing_flags=flags)
            info = self._inlet.info(wait)
            # What the first sample would wait for: the connection, and a first look at the sender's clock.
            self._inlet.open_stream(wait)
            self._inlet.time_correction(wait)
        except RuntimeError as error:
            told = str(error) or type(error).__name__
            raise BadData(f"stream '{name}' is announced but does not answer ({told}): start its sender anew") from None
        self.name, self.rate = name, float(info.nominal_srate())
        if self.rate <= 0.0:
            raise BadData(f"stream '{name}' has no rate: its sender must name one (samples per second)")
        self.channels = _channels(info)
        self._first, self._count = float("nan"), 0
        self._early: tuple[list[float], float] | None = None

    def wait(self, most: float) -> None:
        """Sleep until a sample comes, at most so long [s]; the next `pulled` gives it."""
        if self._early is None:
            sample, time = self._inlet.pull_sample(timeout=most)
            if sample is not None:
                self._early = (sample, time)

    def pulled(self) -> tuple[Array, Array]:
        """Times (samples,) [s] and samples (samples, channels) since the last call.

        Raises
        ------
        BadData : after a second, where they come at another rate than the stream says
        """
        samples, times = self._inlet.pull_chunk(timeout=0.0, max_samples=4096)
        if self._early is not None:
            samples, times = [self._early[0], *samples], [self._early[1], *times]
            self._early = None
        if self._count == 0 and times:
            self._first = times[0]
        self._count += len(times)
        span = times[-1] - self._first if times else 0.0
        if span > 1.0 and abs((self._count - 1) / span / self.rate - 1.0) > RATE_ERROR:
            raise BadData(
                f"stream '{self.name}' says {self.rate:g} samples a second, but sends {(self._count - 1) / span:.4g}: "
                "correct the rate that its sender names"
            )
        return frozen_array(np.array(times, dtype=np.float64)), np.array(samples, dtype=np.float64)


def _channels(info: Any) -> tuple[list[str], list[str]]:
    """Labels and units of a stream's channels, as its description holds them."""
    labels, units = [], []
    channel = info.desc().child("channels").child("channel")
    for _ in range(info.channel_count()):
        labels.append(channel.child_value("label"))
        units.append(channel.child_value("unit"))
        channel = channel.next_sibling("channel")
    return labels, units
