"""`identify --live`: frames arrive, and the body takes color.

The subject is requested to move what would show most.
"""

from __future__ import annotations

import sys
import time as clock
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.identify.base_parameters import held_in
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.extension import MotionRequest
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.segments import Segment, segments_of
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.surface import Surface
from myomorph.core.motion.online import SteadyFrame
from myomorph.lab.store.settings import with_settings
from myomorph.lab.study.subject.identifying import (
    MotionFiles,
    SubjectMotion,
    _surfaces,
    open_motions,
)
from myomorph.live.chain import Poses
from myomorph.live.identification_page import Clock, Display, TerminalDisplay, WebDisplay
from myomorph.live.loop import SOLVED, Delays, follow
from myomorph.live.online_identification import OnlineIdentification, OnlineOptions, OnlineState
from myomorph.live.sources import LiveRecording, Replay, Source, open_recording
from myomorph.live.streams import LabStreams

INTERVAL = 0.2  # Time between two looks at the estimate [s].
SHARE = 0.25  # Part of the time that looking may take.


@dataclass(frozen=True)
class LiveOptions:
    """How a live session goes.

    Attributes
    ----------
    speed : playback speed of a recording relative to real time; 0 for as fast as possible
    web : port of a local web page that shows the body
    lsl_markers : name of the marker stream in the Lab Streaming Layer, instead of a recording
    lsl_forces : name of the force stream in the Lab Streaming Layer
    """

    speed: float = 1.0
    web: int | None = None
    lsl_markers: str = ""
    lsl_forces: str = ""


@dataclass(frozen=True, eq=False)
class LiveResult:
    """What a live session ends with."""

    identification: OnlineIdentification  # the estimate with everything that was folded in
    state: OnlineState  # of it at the end
    motion: Motion  # coordinates as they came, before the filter
    wrenches: Wrenches  # total external force as it came, on the base body, before the filter
    # frames, seconds: that came, and how long it took [s]
    frames: int
    seconds: float
    busy: float  # time spent on frames, without displays and waiting [s]
    # root mean square marker error of all frames, nan without markers [m]
    marker_rms: float = float("nan")

    @property
    def frames_per_second(self) -> float:
        """Frames that can be taken in a second, displays apart."""
        return self.frames / max(self.busy, 1e-9)

    def summary(self) -> str:
        """One line for the end."""
        fit = self.state.fit
        weakest = fit.least
        line = f"{self.frames} frames in {self.seconds:.1f} s, {fit.frames} used"
        line += "".join(
            f"; {count} left out: {reason}" for reason, count in self.state.left_out.items()
        )
        line += f"; markers {1000 * self.marker_rms:.1f} mm" if np.isfinite(self.marker_rms) else ""
        line += (
            f"; identified {100 * fit.progress:.0f} %, least '{weakest}'"
            f" {100 * fit.link_levels[weakest]:.0f} %"
        )
        return line + f"; kept up with {self.frames_per_second:.0f} frames a second"


@dataclass(frozen=True, eq=False)
class IdentificationFrame:
    """The pose of one frame, which the estimate has taken in."""

    time: float
    pose: SteadyFrame
    state: int = SOLVED


class LiveIdentification:
    """Steps of the loop that fold every frame into an estimate, and keep what came.

    No frame is dropped, and none waits (`max_age` and `newest_force` are infinite), since the
    estimate itself waits for forces.
    """

    max_age = newest_force = float("inf")
    notes: tuple[str, ...] = ()

    def __init__(
        self,
        model: Model,
        source: Source,
        mass: float | None = None,
        options: OnlineOptions | None = None,
    ):
        played = source.played if isinstance(source, Replay) else None
        held = held_in(model, [played]) if isinstance(played, Motion) else None
        self.model = model
        self.poses = Poses(model, source)
        self.estimate = OnlineIdentification(
            model=model,
            rate=source.rate,
            force_rate=source.force_rate,
            mass=mass,
            options=options,
            held=held,
        )
        self.filter_delay = self.estimate.delay
        self._frames: list[IdentificationFrame] = []
        self._forces: list[tuple[Array, Array]] = []
        self._waiting: deque[tuple[float, Array]] = deque()

    def idle(self) -> bool:
        """Nothing waits."""
        return False

    def warm_up(self) -> None:
        """Compute once without effect, so that nothing is compiled when the first frame comes."""
        self.estimate.warm_up()
        self.poses.warm_up()

    def push_forces(self, time: Array, wrenches: Array) -> None:
        """Add samples of the plates.

        Parameters
        ----------
        time : (samples,) [s]
        wrenches : (samples, plates, 6) moment about the ground's origin [N m] and force [N]
        """
        totals = wrenches.sum(axis=1)
        self._forces.append((time, totals))
        self._waiting.extend(zip(time.tolist(), totals, strict=True))

    def restart(self) -> None:
        """Begin anew with the next frame; what was identified stays."""
        self.estimate.restart()
        self._waiting.clear()

    def frame(self, time: float, row: Array) -> IdentificationFrame:
        """Fold one frame in.

        Parameters
        ----------
        time : of the frame [s]
        row : markers (markers, 3) [m], or coordinates (coordinates,) of the source's names
            [rad or m]

        Returns
        -------
        The pose of the frame
        """
        self._pass_on_forces(time)
        identification_frame = IdentificationFrame(time, self.poses.solve(time, row))
        self._frames.append(identification_frame)
        self.estimate.push_motion(time, identification_frame.pose.coordinates)
        return identification_frame

    def _pass_on_forces(self, until: float) -> None:
        """Give the estimate the forces up to a time, for it keeps no more than frames need [s]."""
        while self._waiting and self._waiting[0][0] <= until:
            self.estimate.push_force(*self._waiting.popleft())

    def finish(self) -> None:
        """Fold in what still waits for its forces."""
        self._pass_on_forces(float("inf"))
        self.estimate.finish()

    def result(self, seconds: float, busy: float) -> LiveResult:
        """Return what the session ends with; raises `BadData` where no frame could be used."""
        state = self.estimate.state()
        frames = self._frames
        if not state.fit.frames:
            left = ", ".join(f"{count} {reason}" for reason, count in state.left_out.items())
            raise BadData(
                f"none of the {len(frames)} frames that came can be used:"
                f" {left or 'too few for the filter'}"
            )
        errors = np.array([frame.pose.error for frame in frames])
        errors = errors[np.isfinite(errors)]
        rms = float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")
        times, poses = map(
            np.array, zip(*((f.time, f.pose.coordinates) for f in frames), strict=True)
        )
        motion = Motion(times, self.model.coordinate_names, poses)
        time, totals = map(np.concatenate, zip(*self._forces, strict=True))
        base = self.model.body_names[0]
        zero = np.zeros((len(time), 1, 3))
        wrenches = Wrenches(
            time=time,
            names=("all",),
            bodies=(base,),
            forces=totals[:, None, 3:],
            points=zero,
            torques=totals[:, None, :3],
        )
        return LiveResult(
            identification=self.estimate,
            state=state,
            motion=motion,
            wrenches=wrenches,
            frames=len(frames),
            seconds=seconds,
            busy=busy,
            marker_rms=rms,
        )


def identify_frames(
    model: Model,
    source: Source,
    *,
    mass: float | None = None,
    online: OnlineOptions | None = None,
    displays: Sequence[Display] = (),
) -> LiveResult:
    """Take frames from a source until it is done."""
    # As in the loop: the matrices are small, before it and after it too.
    with threadpool_limits(limits=1, user_api="blas"):
        steps = LiveIdentification(model=model, source=source, mass=mass, options=online)
        delays = Delays()
        looks = Looks(steps.estimate, source, displays)
        session = follow(steps, source, late=[looks] if displays else [], delays=delays)
        if session.interrupted and source.duration is not None:
            raise KeyboardInterrupt
        steps.finish()
        looks.show(float(delays.table[-1, 0]), 0.0)
        return steps.result(session.seconds, float(delays.table[:, 3].sum()))


class Looks:
    """Lets displays look at the estimate every now and then."""

    def __init__(self, estimate: OnlineIdentification, source: Source, displays: Sequence[Display]):
        self._estimate = estimate
        self._source = source
        self._displays = displays
        self._first = float("nan")
        self._looked = clock.monotonic()
        self._pause = INTERVAL

    def put(self, frame: IdentificationFrame, markers: Array) -> None:
        """Show a frame's pose, and the estimate where the last look is some time ago.

        Parameters
        ----------
        frame : that was folded in
        markers : (markers, 3) as recorded [m]
        """
        if np.isnan(self._first):
            self._first = frame.time
        if np.isfinite(frame.pose.coordinates).all():
            for display in self._displays:
                display.pose(frame.pose.coordinates, markers if self._source.markers else None)
        start = clock.monotonic()
        if start - self._looked >= self._pause:
            self.show(
                frame.time, max(self._source.age(frame.time), 0.0) if self._source.speed else 0.0
            )
            self._looked = clock.monotonic()
            # A look that takes long is taken less often, so that frames are never held up by it.
            self._pause = max(INTERVAL, (self._looked - start) / SHARE)

    def show(self, time: float, late: float) -> None:
        """Show the estimate at the time of a frame that came so late [s]."""
        if not self._displays:
            return
        state = self._estimate.state()
        at = Clock(time - self._first, self._source.duration, late)
        for display in self._displays:
            display.show(state, at)


@contextmanager
def open_displays(
    model: Model, live: LiveOptions, surfaces: Mapping[str, Surface] | None = None
) -> Iterator[list[Display]]:
    """Yield the displays of a session: a web page if requested, a terminal if there is one."""
    displays: list[Display] = []
    try:
        segments = segments_of(model)
    except BadData:
        # Not of a human: every body is its own part of the list.
        segments = FrozenMap({name: Segment(name) for name in model.body_names})
    try:
        if live.web is not None:
            displays.append(
                WebDisplay(model=model, segments=segments, surfaces=surfaces, port=live.web)
            )
        if sys.stderr.isatty():
            displays.append(TerminalDisplay(model, segments, surfaces))
        yield displays
    finally:
        for display in displays:
            display.close()


def source_of(recording: LiveRecording | None, live: LiveOptions) -> Source:
    """Open what the frames come from."""
    if live.lsl_markers and live.lsl_forces:
        return LabStreams(live.lsl_markers, live.lsl_forces)
    if live.lsl_markers or live.lsl_forces:
        raise BadData("streams need both --lsl-markers NAME and --lsl-forces NAME")
    if recording is None:
        raise BadData(
            "--live needs a recording (--motion and --loads) or streams (--lsl-markers and"
            " --lsl-forces)"
        )
    return Replay(recording.motion, recording.wrenches, live.speed)


def live_motions(model: Model, request: MotionRequest) -> list[SubjectMotion]:
    """Collect motions as they arrive, shown while they do.

    They come from recordings one after the other or from streams.
    """
    live = with_settings(LiveOptions(), request.settings)
    online = with_settings(OnlineOptions(), request.settings)
    surfaces = _surfaces(model)

    def run(recording: LiveRecording | None = None) -> LiveResult:
        source = source_of(recording, live)
        with open_displays(model, live, surfaces) as displays:
            return identify_frames(
                model, source, mass=request.mass, online=online, displays=displays
            )

    streams = live.lsl_markers or live.lsl_forces
    files = MotionFiles(motions=request.motions, loads=request.loads)
    opened = [] if streams else open_motions(model, files, request.time)
    if not opened:
        # Streams; where none are named either, this says so.
        result = run()
        sys.stderr.write(result.summary() + "\n")
        return [SubjectMotion("live", result.motion, result.wrenches)]
    for motion_path, loads_path in zip(request.motions, request.loads, strict=True):
        result = run(open_recording(model, motion_path, loads_path, request.time))
        sys.stderr.write(f"{motion_path.name}: {result.summary()}\n")
    return opened
