"""How late a live session's results are: measured frame by frame, told at the end."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array


@dataclass(frozen=True)
class Spread:
    """Median, 99th percentile and worst of some times [s]; nan where there are none."""

    median: float
    late: float
    worst: float

    @staticmethod
    def of(values: Array) -> Spread:
        """Of those values that are finite."""
        known = values[np.isfinite(values)]
        if not len(known):
            return Spread(float("nan"), float("nan"), float("nan"))
        return Spread(float(np.median(known)), float(np.percentile(known, 99.0)), float(known.max()))

    def told(self) -> str:
        """In milliseconds."""
        return f"median {1e3 * self.median:.2f} ms, 99 % {1e3 * self.late:.2f} ms, worst {1e3 * self.worst:.1f} ms"


class Delays:
    """Times of every frame, 33 bytes each.

    Attributes
    ----------
    dropped : frames that came and were left out because newer ones waited
    """

    def __init__(self) -> None:
        self._time, self._age, self._busy, self._taken = array("d"), array("d"), array("d"), array("d")
        self._state = array("b")
        self.dropped = 0

    def add(self, time: float, taken: float, age: float, busy: float, state: int) -> None:
        """One frame.

        Parameters
        ----------
        time : of the frame [s]
        taken, age : how long after it was there it was taken, and its result given out; nan where nobody knows [s]
        busy : what its computation took [s]
        state : index into `STATES`
        """
        self._time.append(time)
        self._taken.append(taken)
        self._age.append(age)
        self._busy.append(busy)
        self._state.append(state)

    def __len__(self) -> int:
        return len(self._time)

    @property
    def table(self) -> Array:
        """(frames, 5) time, taken, age, busy, state."""
        return np.stack([np.array(one, dtype=np.float64) for one in self._columns], axis=1).reshape(-1, 5)

    @property
    def _columns(self) -> tuple[array[float], ...]:
        return self._time, self._taken, self._age, self._busy, self._state  # type: ignore[return-value]

    @property
    def end_to_end(self) -> Spread:
        """From a frame's being there to its result being given out, the filter's delay apart."""
        return Spread.of(np.array(self._age))

    @property
    def busy(self) -> Spread:
        """Computation of a frame."""
        return Spread.of(np.array(self._busy))

    def recent(self, frames: int) -> Spread:
        """`end_to_end` of the newest frames, or the computation alone where nobody knows when they were there."""
        ages = np.array(self._age[-frames:])
        return Spread.of(ages if np.isfinite(ages).any() else np.array(self._busy[-frames:]))

    def states(self) -> dict[int, int]:
        """Frames by state."""
        found, counts = np.unique(np.array(self._state, dtype=np.int64), return_counts=True)
        return dict(zip(found.tolist(), counts.tolist(), strict=True))
