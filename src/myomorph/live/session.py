"""`live`: the loop that takes frames, computes and gives results out."""

from __future__ import annotations

import gc
import time as clock
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from myomorph.live.chain import GAP, STATES, ChainFrame, LiveChain
from myomorph.live.delays import Delays
from myomorph.live.sources import Source
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData

WAIT = 0.02
"""Longest sleep without a look at the source [s]."""

FORCE_WAIT = 0.01
"""How long a frame waits for the forces of its time [s]."""

PAUSE = 0.0005
"""Pause while a frame waits for its forces [s]."""


class Output(Protocol):
    """Something that takes results as they come."""

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """One frame, with what was recorded; returns at once."""

    def close(self) -> None:
        """Nothing more comes."""


@dataclass(frozen=True, eq=False)
class LiveSession:
    """How a session went.

    Attributes
    ----------
    delays : of all frames
    filter_delay : which comes on top of them [s]
    seconds : how long it took [s]
    notes : what was assumed or missing, one line each
    """

    delays: Delays
    filter_delay: float
    seconds: float
    notes: tuple[str, ...] = ()

    def summary(self) -> tuple[str, ...]:
        """A few lines for the end."""
        delays = self.delays
        counts = {STATES[state]: count for state, count in delays.states().items()}
        solved = counts.pop("solved", 0)
        left = "".join(f", {count} {name}" for name, count in counts.items())
        lines = [f"{len(delays)} frames in {self.seconds:.1f} s, {delays.dropped} dropped: {solved} solved{left}"]
        known = delays.end_to_end
        if known.median == known.median:
            lines.append(f"from frame to result: {known.told()}; the filter's delay of {self.filter_delay:.4f} s apart")
        lines.append(f"computation of a frame: {delays.busy.told()}")
        return tuple(lines)


def follow_chain(
    chain: LiveChain,
    source: Source,
    outputs: Sequence[Output] = (),
    late: Sequence[Output] = (),
    delays: Delays | None = None,
    now: Callable[[], float] = clock.perf_counter,
) -> LiveSession:
    """Take frames from a source until it is done, or Ctrl-C is pressed.

    Parameters
    ----------
    outputs : what a result must have reached before it counts as given out
    late : what it reaches after that
    delays : to be filled, where another looks at them meanwhile

    Raises
    ------
    BadData : no frame came
    """
    from threadpoolctl import threadpool_limits

    delays = Delays() if delays is None else delays
    chain.rehearse()
    # One frame's matrices are small: waking further threads for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"), uncollected_past():
        began = now()
        try:
            _follow(chain, source, outputs, late, delays, now)
        except KeyboardInterrupt:
            # Streams end when the user says so.
            if not len(delays):
                raise
        seconds = now() - began
    if not len(delays):
        raise BadData("no frame came")
    return LiveSession(delays, chain.filter.delay, seconds, (*chain.notes, *_missing(chain, source)))


@contextmanager
def uncollected_past() -> Iterator[None]:
    """What is alive now is no garbage: collections that look through it all take as long as several frames."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _follow(
    chain: LiveChain,
    source: Source,
    outputs: Sequence[Output],
    late: Sequence[Output],
    delays: Delays,
    now: Callable[[], float],
) -> None:
    waiting: deque[tuple[float, Array, float]] = deque()
    clocked, limit = source.speed != 0.0 or source.duration is None, chain.options.late
    step = 1.5 / source.force_rate if source.force_rate else 0.0
    while waiting or not source.done:
        if not waiting:
            source.wait(WAIT)
        # A recording as fast as it goes gives more whenever it is asked.
        if clocked or not waiting:
            arrived = source.take()
            chain.push_forces(arrived.force_time, arrived.forces)
            for time, row in zip(arrived.motion_time.tolist(), arrived.motion, strict=True):
                waiting.append((time, row, source.age(time)))
        while clocked and waiting and source.age(waiting[0][0]) > limit and len(waiting) > 1:
            waiting.popleft()
            delays.dropped += 1
        if not waiting:
            continue
        time, row, taken = waiting[0]
        behind = time - chain.newest_force
        if clocked and step and step < behind < GAP and source.age(time) < FORCE_WAIT:
            clock.sleep(PAUSE)
            continue
        waiting.popleft()
        start = now()
        frame = chain.frame(time, row)
        for output in outputs:
            output.put(frame, row)
        delays.add(time, taken, source.age(time) if clocked else float("nan"), now() - start, frame.state)
        for output in late:
            output.put(frame, row)


def _missing(chain: LiveChain, source: Source) -> tuple[str, ...]:
    """What the end shows to have been missing."""
    return tuple(
        f"plate '{name}' was loaded for {count / source.force_rate:.2f} s near no foot: that force was left out"
        for name, count in zip(chain.feet.plates, chain.feet.nobody.tolist(), strict=True)
        if count > 0.02 * source.force_rate
    )
