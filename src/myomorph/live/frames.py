"""Results of a recording frame by frame, as they come while it is played."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from dataclasses import dataclass, field

from threadpoolctl import threadpool_limits

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.series import Markers, Wrenches
from myomorph.live.chain import ChainFrame, ChainOptions, LiveChain
from myomorph.live.loop import STATES
from myomorph.live.sources import Replay

LOOK = 0.02  # So often the source is looked at [s].


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveFrame:
    """Results of one frame, by name.

    Torques and activations are those of `time` less `delay`, which the causal filter takes.

    Attributes
    ----------
    model : that moves
    result : of the frame
    delay : of the filter [s]
    seconds : that the computation of the frame took [s]
    """

    model: Model
    result: ChainFrame = field(repr=False)
    delay: float
    seconds: float

    @property
    def time(self) -> float:
        """Of the frame [s]."""
        return self.result.time

    @property
    def state(self) -> str:
        """What is known: "solved", or "settling", "markers lost", "no force", "no solution"."""
        return STATES[self.result.state]

    def angle(self, name: str) -> float:
        """Return a filtered coordinate [rad or m]; raises `UnknownName`."""
        return float(self.result.coordinates[self._coordinate(name)])

    def torque(self, name: str) -> float:
        """Return the generalized force of a coordinate [N m or N]; raises `UnknownName`."""
        return float(self.result.torques[self._coordinate(name)])

    def activation(self, muscle: str) -> float:
        """Return the activation of a muscle; raises `UnknownName`."""
        return float(self.result.tension.activations[self._muscle(muscle)])

    def muscle_force(self, muscle: str) -> float:
        """Return the force of a muscle along its tendon [N]; raises `UnknownName`."""
        return float(self.result.tension.forces[self._muscle(muscle)])

    def _coordinate(self, name: str) -> int:
        return index_of("coordinate", name, self.model.coordinate_names)

    def _muscle(self, name: str) -> int:
        return index_of("muscle", name, self.model.muscle_names)


def live_frames(
    model: Model,
    markers: Markers,
    wrenches: Wrenches | None = None,
    *,
    speed: float = 1.0,
    options: ChainOptions | None = None,
) -> Iterator[LiveFrame]:
    """Play a recording and give each frame's results as it comes, from that and earlier frames.

    Parameters
    ----------
    model : with the markers
    markers : that are played
    wrenches : external forces on bodies, None for none
    speed : times real time; 0 as fast as it goes
    options : cutoff [Hz] and further settings; see `ChainOptions`

    Yields
    ------
    angles, torques, activations and forces of each frame, by name; NaN while the filter settles

    Returns
    -------
    an iterator of them

    Raises
    ------
    BadData : the recording is too short, or forces and motion have no time in common

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> markers = mm.read_recording("reach.trc").markers
    >>> frames = list(mm.live_frames(model, markers, speed=0.0))
    >>> len(frames), frames[0].state, frames[-1].state
    (61, 'settling', 'solved')
    """
    check_argument("model", model, Model)
    check_argument("markers", markers, Markers)
    source = Replay(markers, wrenches, speed)
    chain = LiveChain(model, source, options)
    return _played(chain, source)


def _played(chain: LiveChain, source: Replay) -> Iterator[LiveFrame]:
    # One frame's matrices are small: waking further threads for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        chain.warm_up()
        while not source.done:
            arrived = source.take()
            chain.push_forces(arrived.force_time, arrived.forces)
            for time, row in zip(arrived.motion_time.tolist(), arrived.motion, strict=True):
                began = clock.perf_counter()
                result = chain.frame(time, row)
                seconds = clock.perf_counter() - began
                yield LiveFrame(
                    model=chain.model, result=result, delay=chain.filter_delay, seconds=seconds
                )
            source.wait(LOOK)
