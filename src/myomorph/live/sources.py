"""Where live frames come from: what every source has, and recordings that are played."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Markers, Motion, Series, Wrenches
from myomorph.core.motion.sync import cut
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.external_forces import force_table, read_loads
from myomorph.lab.study.inputs.loads import TABLES
from myomorph.live.online_identification import total_wrench

CHUNK = 0.05  # Time that a recording played as fast as it goes gives at once [s].


@read_only
class Arrived:
    """What came since the last look."""

    # motion_time, motion: (frames,) [s] and (frames, coordinates), (frames, markers, 3) [m] or
    # (frames, sensors, 4)
    motion_time: Array
    motion: Array
    # force_time, forces: (samples,) [s] and (samples, plates, 6) moment about the ground's origin
    # and force of each plate [N m], [N]
    force_time: Array
    forces: Array


class Source(Protocol):
    """Frames of markers, coordinates or orientations of sensors, and forces."""

    names: tuple[str, ...]  # of markers, coordinates or sensors
    markers: bool  # whether they are markers
    # plates, bodies: names of the plates, and of the bodies that they act on, "" where not known
    plates: tuple[str, ...]
    bodies: tuple[str, ...]
    # rate, force_rate: [Hz]; no forces come at 0
    rate: float
    force_rate: float
    duration: float | None  # of the whole, None where nobody knows [s]
    speed: float  # times real time at which it is played; 0 where that says nothing

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
    """A recording and external forces in ground that are played.

    They are played at `speed` times real time, 0 as fast as it goes.
    """

    def __init__(
        self,
        motion: Markers | Motion | InertialSensors,
        wrenches: Wrenches | None,
        speed: float = 1.0,
        now: Callable[[], float] = clock.perf_counter,
    ):
        if not (speed >= 0.0 and np.isfinite(speed)):
            raise BadData(
                f"speed {speed:g}: expected 1 for real time, more for faster, 0 for as fast as it"
                " goes"
            )
        if len(motion) < 2 or (wrenches is not None and len(wrenches) < 2):
            samples = "" if wrenches is None else f" and {len(wrenches)} samples of force"
            raise BadData(f"{len(motion)} frames{samples} cannot be played: two are needed")
        self.names = motion.names
        self.markers = isinstance(motion, Markers)
        self.rate = motion.rate
        values = motion.orientations if isinstance(motion, InertialSensors) else motion.values
        assert values is not None
        self.played = motion
        self._time = motion.time
        self._motion = values
        first = float(motion.time[0])
        last = float(motion.time[-1])
        self._take_forces(wrenches, first, last)
        self.duration: float | None = last - first
        self.speed = speed
        self._now = now
        self._began: float | None = None
        self._frame = 0
        # Forces begin a little earlier, so that their filter is filled when the motion's is.
        self._sample = int(np.searchsorted(self._force_time, first - 1.0))

    def _take_forces(self, wrenches: Wrenches | None, first: float, last: float) -> None:
        self.plates: tuple[str, ...] = ()
        self.bodies: tuple[str, ...] = ()
        self.force_rate = 0.0
        self._force_time = np.zeros(0)
        self._forces = np.zeros((0, 0, 6))
        if wrenches is None:
            return
        if wrenches.time[0] > last or wrenches.time[-1] < first:
            forces = f"forces ({wrenches.time[0]:g} to {wrenches.time[-1]:g} s)"
            raise BadData(f"motion ({first:g} to {last:g} s) and {forces} have no time in common")
        outside = [i for i, body in enumerate(wrenches.bodies) if body != GROUND]
        self.plates = tuple(wrenches.names[i] for i in outside)
        self.bodies = tuple(wrenches.bodies[i] for i in outside)
        self.force_rate = Series(wrenches.time, (), np.zeros((len(wrenches), 0))).rate
        self._force_time = wrenches.time
        parts = (
            values[:, outside, None]
            for values in (wrenches.forces, wrenches.points, wrenches.torques)
        )
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
        return Arrived(
            motion_time=self._time[frames],
            motion=self._motion[frames],
            force_time=self._force_time[samples],
            forces=self._forces[samples],
        )

    def wait(self, most: float) -> None:
        """Sleep until the time of the next frame."""
        if self.speed > 0.0 and not self.done:
            clock.sleep(min(max(-self.age(float(self._time[self._frame])), 0.0), most))

    def age(self, time: float) -> float:
        """How long ago a frame's time was."""
        if self.speed == 0.0 or self._began is None:
            return float("nan") if self.speed == 0.0 else 0.0
        return self._now() - self._began - (time - float(self._time[0])) / self.speed


class LiveRecording(NamedTuple):
    """What is played: markers or coordinates, and all external forces, None for no forces."""

    motion: Markers | Motion
    wrenches: Wrenches | None


def open_recording(
    model: Model,
    motion: Path,
    loads: Path | None = None,
    time: tuple[float, float] | None = None,
    labels: Mapping[str, str] | None = None,
) -> LiveRecording:
    """Open files to play.

    Parameters
    ----------
    model : that the recording is of
    motion : markers (.trc, .c3d) or coordinates (.mot, .sto)
    loads : an external loads file, or a table of plates; None for the plates of a C3D file, or for
        no forces
    time : first and last time to play [s]
    labels : what the model calls markers that the recording calls otherwise, "" for those to leave
        out
    """
    series: Markers | Motion
    wrenches: Wrenches | None = None
    if motion.suffix.lower() in reading.TABLE_FILES:
        series = posed = reading.read_motion(motion, model)
    else:
        reading.check_labels(labels or {}, model)
        trial = reading.fitted_to(
            model, reading.with_labels(reading.read_recording(motion), labels or {})
        )
        assert trial.markers is not None
        series = trial.markers
        posed = Motion(series.time[:1], (), np.zeros((1, 0)))
        if loads is None and trial.plates:
            wrenches = wrenches_from_plates(trial.plates, trial.plate_time)
    if loads is not None:
        wrenches = read_forces_of(model, loads, posed)
    span = reading.cut_to(time, series, motion)
    return LiveRecording(series if span is None else cut(series, *span), wrenches)


def read_forces_of(model: Model, loads: Path, posed: Motion) -> Wrenches:
    """Read the forces of a table of plates or of external loads.

    `posed` moves bodies in whose frames these are.
    """
    return force_table(loads) if loads.suffix.lower() in TABLES else read_loads(loads, model, posed)
