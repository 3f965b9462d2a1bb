"""`identify --live`: frames arrive, the body takes color, and the subject is told what to move next."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from types import MappingProxyType

import numpy as np

from myomorph.identify.base_parameters import held_in
from myomorph.identify.online import OnlineIdentification, OnlineOptions, OnlineState
from myomorph.io.formats import trial_format
from myomorph.live.displays import Display, TerminalDisplay, WebDisplay
from myomorph.live.sources import Arrived, LabStreams, Replay, Source
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model, index_of
from myomorph.model.segments import Segment, segments_of
from myomorph.model.series import Markers, Motion, Wrenches
from myomorph.model.surface import Surface
from myomorph.motion.measurements import default_markers
from myomorph.motion.online import OnlineKinematics
from myomorph.viewer.live_view import Clock

INTERVAL = 0.2
"""Time between two looks at the estimate [s]."""

SHARE = 0.25
"""Part of the time that looking may take."""

IDLE = 0.004
"""Pause where nothing has come [s]."""


@dataclass(frozen=True)
class LiveOptions:
    """How a live session goes.

    Attributes
    ----------
    speed : of a recording that is played, times real time; 0 as fast as it goes
    web : port of a web page on this machine that shows the body
    lsl_markers : stream of markers of the Lab Streaming Layer, instead of a recording
    lsl_forces : stream of forces
    """

    speed: float = 1.0
    web: int | None = None
    lsl_markers: str = ""
    lsl_forces: str = ""


@dataclass(frozen=True, eq=False)
class LiveResult:
    """What a live session ends with.

    Attributes
    ----------
    identification : the estimate with everything that was folded in
    state : of it at the end
    motion : coordinates as they came, before the filter
    wrenches : total external force as it came, on the base body, before the filter
    frames, seconds : that came, and how long it took [s]
    busy : time spent on frames, without displays and waiting [s]
    marker_rms : root mean square marker error of all frames, nan without markers [m]
    """

    identification: OnlineIdentification
    state: OnlineState
    motion: Motion
    wrenches: Wrenches
    frames: int
    seconds: float
    busy: float
    marker_rms: float = float("nan")

    @property
    def frames_per_second(self) -> float:
        """Frames that can be taken in a second, displays apart."""
        return self.frames / max(self.busy, 1e-9)

    def summary(self) -> str:
        """One line for the end."""
        fit = self.state.fit
        weakest = fit.least
        told = f"{self.frames} frames in {self.seconds:.1f} s, {fit.frames} used"
        told += "".join(f"; {count} left out: {reason}" for reason, count in self.state.left_out.items())
        told += f"; markers {1000 * self.marker_rms:.1f} mm" if np.isfinite(self.marker_rms) else ""
        told += f"; identified {100 * fit.progress:.0f} %, least '{weakest}' {100 * fit.link_levels[weakest]:.0f} %"
        return told + f"; kept up with {self.frames_per_second:.0f} frames a second"


@dataclass(frozen=True)
class LiveRecording:
    """What is played: markers or coordinates, and forces, see `run_live`."""

    motion: Markers | Motion
    wrenches: Wrenches


def run_live(
    model: Model,
    recording: LiveRecording | None = None,
    *,
    mass: float | None = None,
    live: LiveOptions | None = None,
    online: OnlineOptions | None = None,
    surfaces: Mapping[str, Surface] | None = None,
    terminal: bool = True,
) -> LiveResult:
    """Identify while frames arrive, and show it.

    Parameters
    ----------
    model : scaled to the subject
    recording : to play; None for streams
    mass : of the subject [kg]
    surfaces : meshes for the pictures
    terminal : draw on the terminal, where there is one

    Raises
    ------
    BadData : neither a recording nor streams, or nothing usable came
    MyomorphError : an optional package is missing
    """
    live = live or LiveOptions()
    source = source_of(recording, live)
    displays: list[Display] = []
    segments = _segments(model)
    try:
        if live.web is not None:
            displays.append(WebDisplay(model, segments, surfaces, live.web))
        if terminal and sys.stderr.isatty():
            displays.append(TerminalDisplay(model, segments, surfaces))
        return follow(model, source, mass=mass, online=online, displays=displays)
    finally:
        for display in displays:
            display.close()


def source_of(recording: LiveRecording | None, live: LiveOptions) -> Source:
    """What the frames come from.

    Raises
    ------
    BadData : neither a recording nor both streams are named
    """
    if live.lsl_markers and live.lsl_forces:
        return LabStreams(live.lsl_markers, live.lsl_forces)
    if live.lsl_markers or live.lsl_forces:
        raise BadData("streams need both --lsl-markers NAME and --lsl-forces NAME")
    if recording is None:
        raise BadData("--live needs a recording (--motion and --loads) or streams (--lsl-markers and --lsl-forces)")
    return Replay(recording.motion, recording.wrenches, live.speed)


@dataclass
class _Kept:
    """Everything that came, for the result."""

    time: list[float] = field(default_factory=list)
    coordinates: list[Array] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    force_time: list[Array] = field(default_factory=list)
    forces: list[Array] = field(default_factory=list)


def follow(
    model: Model,
    source: Source,
    *,
    mass: float | None = None,
    online: OnlineOptions | None = None,
    displays: Sequence[Display] = (),
    now: Callable[[], float] = clock.monotonic,
) -> LiveResult:
    """Take frames from a source until it is done.

    Raises
    ------
    BadData : no frame came, or none could be used
    """
    from threadpoolctl import threadpool_limits

    # One frame's matrices are small: waking further threads for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        return _follow(model, source, mass, online, displays, now)


def _follow(
    model: Model,
    source: Source,
    mass: float | None,
    online: OnlineOptions | None,
    displays: Sequence[Display],
    now: Callable[[], float],
) -> LiveResult:
    held = held_in(model, [source.played]) if isinstance(source, Replay) and isinstance(source.played, Motion) else None
    identification = OnlineIdentification(model, source.rate, source.force_rate, mass, online, held)
    kinematics = OnlineKinematics(model, source.names) if source.markers else None
    identification.rehearse()
    if kinematics is not None:
        _rehearse(model, source)
    columns = [] if kinematics else [index_of("coordinate", name, model.coordinate_names) for name in source.names]
    kept = _Kept()
    began = looked = now()
    busy, pause = 0.0, INTERVAL
    try:
        while not source.done:
            arrived = source.take()
            start = now()
            coordinates, seen = _take(identification, kinematics, columns, kept, arrived)
            busy += now() - start
            if coordinates is None:
                clock.sleep(IDLE)
                continue
            if np.isfinite(coordinates).all():
                for display in displays:
                    display.pose(coordinates, seen)
            if displays and now() - looked >= pause:
                start = now()
                at = _clock(source, kept, start - began)
                state = identification.state()
                for display in displays:
                    display.show(state, at)
                looked = now()
                # A look that takes long is taken less often, so that frames are never held up by it.
                pause = max(INTERVAL, (looked - start) / SHARE)
    except KeyboardInterrupt:
        # Streams end when the user says so.
        if source.duration is not None or not kept.time:
            raise
    if not kept.time:
        raise BadData("no frame came")
    identification.finish()
    state = identification.state()
    for display in displays:
        display.show(state, _clock(source, kept, 0.0))
    if not state.fit.frames:
        told = ", ".join(f"{count} {reason}" for reason, count in state.left_out.items())
        raise BadData(f"none of the {len(kept.time)} frames that came can be used: {told or 'too few for the filter'}")
    errors = np.array(kept.errors)
    errors = errors[np.isfinite(errors)]
    return LiveResult(
        identification=identification,
        state=state,
        motion=Motion(np.array(kept.time), model.coordinate_names, np.array(kept.coordinates)),
        wrenches=_on_base(model, np.concatenate(kept.force_time), np.concatenate(kept.forces)),
        frames=len(kept.time),
        seconds=now() - began,
        busy=busy,
        marker_rms=float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan"),
    )


def _take(
    identification: OnlineIdentification,
    kinematics: OnlineKinematics | None,
    columns: Sequence[int],
    kept: _Kept,
    arrived: Arrived,
) -> tuple[Array | None, Array | None]:
    """Push what arrived in the order of its times; the newest coordinates and markers, None where none came."""
    kept.force_time.append(arrived.force_time)
    totals = arrived.forces.sum(axis=1)
    kept.forces.append(totals)
    coordinates: Array | None = None
    seen: Array | None = None
    forces = zip(arrived.force_time, totals, strict=True)
    sample = 0
    before = np.searchsorted(arrived.force_time, arrived.motion_time, side="right")
    for stop, time, row in zip(before, arrived.motion_time, arrived.motion, strict=True):
        for moment, wrench in islice(forces, int(stop) - sample):
            identification.push_force(float(moment), wrench)
        sample = int(stop)
        if kinematics is not None:
            coordinates, error = kinematics.solve(float(time), row)
            kept.errors.append(error)
            seen = row
        else:
            coordinates = np.array([coordinate.default for coordinate in identification.model.coordinates])
            coordinates[columns] = row
        kept.time.append(float(time))
        kept.coordinates.append(coordinates)
        identification.push_motion(float(time), coordinates)
    for moment, wrench in forces:
        identification.push_force(float(moment), wrench)
    return coordinates, seen


def _rehearse(model: Model, source: Source) -> None:
    """Solve the default pose once, so that nothing is compiled when the first frame comes."""
    kinematics = OnlineKinematics(model, source.names)
    positions = np.full((len(source.names), 3), np.nan)
    places = default_markers(model, kinematics.marker_names)
    positions[[source.names.index(name) for name in kinematics.marker_names]] = places
    kinematics.solve(0.0, positions)


def _clock(source: Source, kept: _Kept, elapsed: float) -> Clock:
    at = kept.time[-1] - kept.time[0]
    return Clock(at, source.duration, max(elapsed - at / source.speed, 0.0) if source.speed else 0.0)


def _on_base(model: Model, time: Array, totals: Array) -> Wrenches:
    zero = np.zeros((len(time), 1, 3))
    base = model.body_names[0]
    return Wrenches(time, ("all",), (base,), totals[:, None, 3:], zero, totals[:, None, :3])


def _segments(model: Model) -> Mapping[str, Segment]:
    """Segments of a human model; of another, every body is its own part of the list."""
    try:
        return segments_of(model)
    except BadData:
        return MappingProxyType({name: Segment(name) for name in model.body_names})


def open_recording(model: Model, motion: Path, loads: Path, time: tuple[float, float] | None = None) -> LiveRecording:
    """Files to play: markers (.trc, .c3d) or coordinates (.mot, .sto), and an external loads file.

    Raises
    ------
    MyomorphError : a file cannot be read, or does not fit the model
    """
    from myomorph.motion.sync import cut
    from myomorph.study.trial import inputs

    if trial_format(motion) is not None:
        trial = inputs.fitted_to(model, inputs.open_trial(motion))
        assert trial.markers is not None
        series: Markers | Motion = trial.markers
        posed = Motion(series.time[:1], (), np.zeros((1, 0)))
        wrenches = inputs.open_loads(loads, model, posed)
    else:
        series = inputs.open_motion(motion, model)
        wrenches = inputs.open_loads(loads, model, series)
    span = inputs.cut_to(time, series, motion)
    return LiveRecording(series if span is None else cut(series, *span), wrenches)
