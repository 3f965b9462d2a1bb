"""Results of a live session as a stream of the Lab Streaming Layer."""

from __future__ import annotations

from typing import Any

import numpy as np

from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.sources import Source, streaming_library
from myomorph.model.arrays import Array
from myomorph.model.errors import MyomorphError


class LabOutlet:
    """One stream of three groups of channels: coordinates, torques, activations.

    A row is of one instant, which its time stamp names: the frame's own less the filter's delay. Channels are labelled
    by the names of coordinates, the same with `_moment` or `_force`, and the names of muscles, and have units. What is
    unknown is NaN. Of a stream, time stamps are those of its sender on this machine's clock; of a recording that is
    played, those at which its frames were due.

    Parameters
    ----------
    source : of the frames
    library : `pylsl`, or something that behaves like it

    Raises
    ------
    MyomorphError : `pylsl` is not installed, or cannot send
    """

    def __init__(self, name: str, chain: LiveChain, source: Source, library: Any = None):
        self._lsl = lsl = library or streaming_library()
        self._delay = chain.filter.delay
        model = chain.model
        turns = {one.name: one.motion == "rotational" for one in model.coordinates}
        channels = [(one, "rad" if turns[one] else "m", "Angle") for one in model.coordinate_names]
        channels += [
            (f"{one}_{'moment' if turns[one] else 'force'}", "N m" if turns[one] else "N", "Torque")
            for one in model.coordinate_names
        ]
        channels += [(one, "1", "Activation") for one in chain.tension.muscles]
        try:
            info = lsl.StreamInfo(name, "Biomechanics", len(channels), source.rate, "double64", f"myomorph-{name}")
            described = info.desc().append_child("channels")
            for label, unit, kind in channels:
                one = described.append_child("channel")
                for key, text in (("label", label), ("unit", unit), ("type", kind)):
                    one.append_child_value(key, text)
            info.desc().append_child_value("filter_delay", f"{self._delay:.6f}")
            self._outlet = lsl.StreamOutlet(info)
        except RuntimeError as error:
            raise MyomorphError(f"stream '{name}' cannot be sent: {error}") from None
        self._source, self._row = source, np.empty(len(channels))

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """Send one frame."""
        n = len(frame.coordinates)
        self._row[:n], self._row[n : 2 * n], self._row[2 * n :] = (
            frame.coordinates, frame.torques, frame.tension.activations
        )  # fmt: skip
        # A stream's frames have its clock already; those of a recording were due some time ago.
        stamp = frame.time
        if self._source.duration is not None:
            age = self._source.age(frame.time)
            stamp = self._lsl.local_clock() - (age if np.isfinite(age) else 0.0)
        self._outlet.push_sample(self._row, stamp - self._delay)

    def close(self) -> None:
        """End the stream."""
        del self._outlet
