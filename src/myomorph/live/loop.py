"""The loop of everything that works while frames arrive, and how late its results are.

A loop takes frames from a source, lets steps compute each of them, and gives the results to
outputs. `live` and `identify --live` are two kinds of steps.
"""

from __future__ import annotations

import gc
import threading
import time as clock
from array import array
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.live.interruption import asked_to_end
from myomorph.live.session_clock import SessionClock, Stamp
from myomorph.live.sources import Arrived, Source

WAIT = 0.02  # Longest sleep without a look at the source [s].
GAP = 0.1  # Time without a sample of force after which forces are unknown [s].
FORCE_WAIT = 0.01  # How long a frame waits for the forces of its time [s].
PAUSE = 0.0005  # Pause while a frame waits for its forces [s].
SOLVED, HELD, NO_FORCE, SETTLING, UNSOLVED, BAD_TIME = range(6)
STATES = ("solved", "markers lost", "no force", "settling", "no solution", "bad time")
"""What a frame's torques and activations are: known, or unknown because of what."""


class Frame(Protocol):
    """What the steps make of one frame."""

    @property
    def time(self) -> float:
        """Of the frame [s]."""

    @property
    def state(self) -> int:
        """Index into `STATES`."""


F = TypeVar("F", bound=Frame)
FrameOut = TypeVar("FrameOut", bound=Frame, covariant=True)
FrameIn = TypeVar("FrameIn", bound=Frame, contravariant=True)


class Steps(Protocol[FrameOut]):
    """What is computed of each frame."""

    @property
    def max_age(self) -> float:
        """Frames older than that are dropped, the oldest first; inf to drop none [s]."""

    @property
    def newest_force(self) -> float:
        """Time of the newest force sample, which a frame waits for; inf if it needs none [s]."""

    @property
    def filter_delay(self) -> float:
        """How much older the results are than their frame [s]."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is assumed, and what has been missing so far, one line each."""

    def warm_up(self) -> None:
        """Compute once without effect, so that nothing is compiled when the first frame comes."""

    def push_forces(self, time: Array, wrenches: Array) -> None:
        """Add samples of the plates.

        Parameters
        ----------
        time : (samples,) [s]
        wrenches : (samples, plates, 6) moment about the ground's origin [N m] and force [N]
        """

    def restart(self) -> None:
        """Begin anew with the next frame: the clock of the frames was set."""

    def frame(self, time: float, row: Array) -> FrameOut:
        """Compute one frame.

        Parameters
        ----------
        time : of the frame [s]
        row : markers (markers, 3) [m], or coordinates (coordinates,) of the source's names
            [rad or m]

        Returns
        -------
        The result of the frame
        """

    def idle(self) -> bool:
        """Do a little of what may wait until no frame does; whether any of it is left."""


class Output(Protocol[FrameIn]):
    """Something that takes results as they come."""

    def put(self, frame: FrameIn, markers: Array) -> None:
        """Put out one frame, with what was recorded; return at once.

        Parameters
        ----------
        frame : the result
        markers : (markers, 3) as recorded [m], or coordinates (coordinates,) [rad or m]
        """


@dataclass(frozen=True)
class Spread:
    """Median, 99th percentile and worst of some times [s]; nan where there are none."""

    median: float
    late: float
    worst: float

    @staticmethod
    def of(values: Array) -> Spread:
        """Describe the values that are finite.

        Parameters
        ----------
        values : (n,)

        Returns
        -------
        Median, 99th percentile and maximum, NaN where no value is finite
        """
        known = values[np.isfinite(values)]
        if not len(known):
            return Spread(float("nan"), float("nan"), float("nan"))
        return Spread(
            float(np.median(known)), float(np.percentile(known, 99.0)), float(known.max())
        )

    def summary(self) -> str:
        """In milliseconds."""
        return (
            f"median {1e3 * self.median:.2f} ms, 99 % {1e3 * self.late:.2f} ms, worst"
            f" {1e3 * self.worst:.1f} ms"
        )


class Delays:
    """Times of every frame, 40 bytes each.

    `dropped` counts frames that came and were left out because newer ones waited.
    """

    WIDTH = 5  # Numbers of a row.

    def __init__(self) -> None:
        self._rows = array("d")
        self.dropped = 0

    @classmethod
    def of_table(cls, table: Array, dropped: int) -> Delays:
        """Make them of stored rows.

        Parameters
        ----------
        table : (frames, 5) time, taken, age, busy [s] and state, as of `add`
        dropped : frames that were left out

        Returns
        -------
        The delays of all rows
        """
        delays = cls()
        delays.dropped = dropped
        delays._rows.extend(np.asarray(table, np.float64).ravel().tolist())
        return delays

    def row(self, index: int) -> list[float]:
        """Time, taken, age, busy and state of a frame."""
        return self._rows[self.WIDTH * index : self.WIDTH * (index + 1)].tolist()

    def add(self, time: float, taken: float, age: float, busy: float, state: int) -> None:
        """Add one frame.

        Parameters
        ----------
        time : of the frame [s]
        taken, age : how long after it was there it was taken, and its result given out [s]; nan
            where nobody knows
        busy : what its computation took [s]
        state : index into `STATES`
        """
        self._rows.extend((time, taken, age, busy, state))

    def __len__(self) -> int:
        return len(self._rows) // 5

    @property
    def table(self) -> Array:
        """(frames, 5) time, taken, age, busy, state."""
        return np.array(self._rows).reshape(-1, 5)

    @property
    def end_to_end(self) -> Spread:
        """From a frame's being there to its result being given out, the filter's delay apart."""
        return Spread.of(self.table[:, 2])

    @property
    def busy(self) -> Spread:
        """Computation of a frame."""
        return Spread.of(self.table[:, 3])

    def recent(self, frames: int) -> Spread:
        """Return `end_to_end` of the newest frames.

        It is the computation alone where nobody knows when they were there.
        """
        newest = np.array(self._rows[-5 * frames :]).reshape(-1, 5)
        return Spread.of(newest[:, 2] if np.isfinite(newest[:, 2]).any() else newest[:, 3])

    def states(self) -> dict[int, int]:
        """Frames by state."""
        codes, counts = np.unique(self.table[:, 4].astype(np.int64), return_counts=True)
        return dict(zip(codes.tolist(), counts.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class LiveSession:
    """How a session went."""

    delays: Delays  # of all frames
    filter_delay: float  # which comes on top of them [s]
    seconds: float  # how long it took [s]
    notes: tuple[str, ...] = ()  # what was assumed or missing, one line each
    interrupted: bool = False  # whether it was ended by Ctrl-C

    def summary(self) -> tuple[str, ...]:
        """Write a few lines for the end."""
        delays = self.delays
        counts = {STATES[state]: count for state, count in delays.states().items()}
        solved = counts.pop("solved", 0)
        left = "".join(f", {count} {name}" for name, count in counts.items())
        lines = [
            f"{len(delays)} frames in {self.seconds:.1f} s, {delays.dropped} dropped: {solved}"
            f" solved{left}"
        ]
        known = delays.end_to_end
        if np.isfinite(known.median):
            filtered = f"the filter's delay of {self.filter_delay:.4f} s apart"
            lines.append(f"from frame to result: {known.summary()}; {filtered}")
        lines.append(f"computation of a frame: {delays.busy.summary()}")
        return tuple(lines)


def follow(
    steps: Steps[F],
    source: Source,
    outputs: Sequence[Output[F]] = (),
    late: Sequence[Output[F]] = (),
    delays: Delays | None = None,
) -> LiveSession:
    """Take frames from a source until it is done, or Ctrl-C is pressed.

    Parameters
    ----------
    steps : what is computed of each frame
    source : of the frames
    outputs : what a result must have reached before it counts as given out
    late : what it reaches after that
    delays : to be filled, where another looks at them
    """
    delays = Delays() if delays is None else delays
    # One frame's matrices are small: waking further threads for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        steps.warm_up()
        with uncollected_past(), asked_to_end() as ended:
            began = clock.perf_counter()
            try:
                _Following(steps, source, outputs, late, delays).run(ended)
            except KeyboardInterrupt:
                # Asked for again, or raised where signals are none of ours.
                ended.set()
            seconds = clock.perf_counter() - began
            # Streams end when the user says so.
            interrupted = ended.is_set()
    if interrupted and not len(delays):
        raise KeyboardInterrupt
    if not len(delays):
        raise BadData("no frame arrived")
    return LiveSession(
        delays=delays,
        filter_delay=steps.filter_delay,
        seconds=seconds,
        notes=steps.notes,
        interrupted=interrupted,
    )


@contextmanager
def uncollected_past() -> Iterator[None]:
    """Declare that what is alive now is no garbage.

    Collections that look through it all take as long as several frames.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@read_only
@dataclass(frozen=True, eq=False)
class _Waiting:
    """A frame that is to be computed. `taken`: how long after it was there it was taken [s]."""

    sent: float  # its time by the sender's clock [s]
    stamp: Stamp
    row: Array
    taken: float

    def age(self, source: Source) -> float:
        """How long ago it was there [s]."""
        return source.age(self.sent) - self.stamp.late

    def after(self, dropped: _Waiting) -> _Waiting:
        """Return the frame as it is where the one before it was dropped."""
        if not dropped.stamp.restarts:
            return self
        return replace(self, stamp=replace(self.stamp, restarts=True))


def _stamped(
    arrived: Arrived, stamps: SessionClock, source: Source, delays: Delays
) -> Iterator[_Waiting]:
    """Yield frames with rising times; those without are only counted."""
    for time, row in zip(arrived.motion_time.tolist(), arrived.motion, strict=True):
        stamp = stamps.of_frame(time, source.age(time))
        if stamp.is_bad:
            delays.add(time, float("nan"), float("nan"), 0.0, BAD_TIME)
        else:
            yield _Waiting(time, stamp, row, source.age(time) - stamp.late)


class _Following(Generic[F]):
    """The loop of a session."""

    def __init__(
        self,
        steps: Steps[F],
        source: Source,
        outputs: Sequence[Output[F]],
        late: Sequence[Output[F]],
        delays: Delays,
    ):
        self._steps = steps
        self._source = source
        self._outputs = outputs
        self._late = late
        self._delays = delays
        self._waiting: deque[_Waiting] = deque()
        self._stamps = SessionClock()
        self._clocked = source.speed != 0.0 or source.duration is None
        self._force_step = 1.5 / source.force_rate if source.force_rate else 0.0
        self._pushing = 0.0

    def run(self, ended: threading.Event) -> None:
        """Compute frames until the source is done and none waits, or the session is ended."""
        while (self._waiting or not self._source.done) and not ended.is_set():
            if not self._waiting and not self._steps.idle():
                self._source.wait(WAIT)
            # A recording as fast as it goes gives more whenever it is asked.
            if self._clocked or not self._waiting:
                self._receive()
            self._drop_old()
            if not self._waiting:
                continue
            if self._awaits_force(self._waiting[0]):
                clock.sleep(PAUSE)
                continue
            self._compute(self._waiting.popleft())
            # As fast as it goes, no frame is ever awaited: what is left is done now.
            while not self._clocked and self._steps.idle():
                pass

    def _receive(self) -> None:
        arrived = self._source.take()
        start = clock.perf_counter()
        force_time, kept = self._stamps.of_forces(arrived.force_time)
        self._steps.push_forces(force_time, arrived.forces[kept])
        self._pushing += clock.perf_counter() - start
        self._waiting.extend(_stamped(arrived, self._stamps, self._source, self._delays))

    def _drop_old(self) -> None:
        """Drop frames that are too old while newer ones wait."""
        waiting = self._waiting
        max_age = self._steps.max_age
        while self._clocked and len(waiting) > 1 and waiting[0].age(self._source) > max_age:
            dropped = waiting.popleft()
            waiting[0] = waiting[0].after(dropped)
            self._delays.dropped += 1

    def _awaits_force(self, oldest: _Waiting) -> bool:
        """Check whether the forces of a frame's time may still come."""
        if not (self._clocked and self._force_step):
            return False
        behind = oldest.stamp.time - self._steps.newest_force
        return self._force_step < behind < GAP and oldest.age(self._source) < FORCE_WAIT

    def _compute(self, oldest: _Waiting) -> None:
        start = clock.perf_counter()
        if oldest.stamp.restarts:
            self._steps.restart()
        time = oldest.stamp.time
        frame = self._steps.frame(time, oldest.row)
        for output in self._outputs:
            output.put(frame, oldest.row)
        age = oldest.age(self._source) if self._clocked else float("nan")
        busy = self._pushing + clock.perf_counter() - start
        self._delays.add(time, oldest.taken, age, busy, frame.state)
        self._pushing = 0.0
        for output in self._late:
            output.put(frame, oldest.row)
