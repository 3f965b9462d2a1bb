"""Poses of frames that keep coming, in which markers are lost and found again without a jump.

Markers never fit a model exactly, so that the pose jumps when one of them is lost or comes back. The jump is what
the same frame gives with the markers before and after: it is taken off at once, and given back along the path of a
critically damped spring. What no marker shows any more keeps its last value; without any marker the whole body does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.motion.ik import InverseKinematicsOptions
from myomorph.motion.online import LOST, OnlineKinematics
from myomorph.motion.turns import floating_coordinates
from myomorph.rigid.tree import compile_tree

BLEND = 0.05
"""Time constant with which a jump is given back: 9 % of it are left after four of them [s]."""

SEARCH = 0.5
"""Least time between two searches from several headings [s]."""


@dataclass(frozen=True, eq=False)
class SteadyFrame:
    """One pose, NaN before any marker was seen, and its root mean square error [m]; `held` is the last one, where no
    marker is seen. `owed` is the root mean square, over coordinates in radians and metres, of the jump still to be
    given back.
    """

    coordinates: Array
    error: float
    seen: int
    held: bool
    owed: float


class SteadyKinematics:
    """Inverse kinematics frame by frame, continuous where markers come and go: jumps are given back in `blend` [s]."""

    def __init__(
        self, model: Model, names: Sequence[str], options: InverseKinematicsOptions | None = None, blend: float = BLEND
    ):
        if not blend > 0.0:
            raise BadData(f"jumps are given back in {blend:g} s: expected above 0")
        self._inverse = OnlineKinematics(model, names, options)
        self.marker_names = self._inverse.marker_names
        self._blend = blend
        self._defaults = compile_tree(model).defaults.copy()
        count = len(self._defaults)
        columns = [list(names).index(marker_name) for marker_name in self.marker_names]
        self._tracked = np.zeros(len(names), np.bool_)
        self._tracked[columns] = True
        floating = floating_coordinates(model)
        self._turning = np.array(
            [
                coordinate.motion == "rotational" and (not coordinate.clamped or coordinate.name in floating)
                for coordinate in model.coordinates
            ]
        )
        self._positions = np.full((len(names), 3), np.nan)
        self._seen = np.zeros(len(names), np.bool_)
        self._ever = np.zeros(len(names), np.bool_)
        # What the markers give, now and one frame before, and what is shown less that, with its rate.
        self._found: Array | None = None
        self._before: Array | None = None
        self._time = self._time_before = self._searched = -np.inf
        self._offset, self._rate = np.zeros(count), np.zeros(count)
        self._shown = np.full(count, np.nan)
        self._usual = 0.0

    def solve(self, time: float, positions: Array) -> SteadyFrame:
        """The pose of one frame of markers (markers, 3) [m], NaN where unseen."""
        positions = np.asarray(positions, dtype=np.float64)
        seen = np.isfinite(positions).all(axis=1) & self._tracked
        if not seen.any():
            return self._hold(time)
        if self._found is None:
            values, error = self._inverse.from_anywhere(time, positions, self._defaults)
        else:
            self._give_back(time - self._time)
            common = seen & self._seen
            if not np.array_equal(seen, self._seen):
                self._take_off_lost(common)
            posture = self._posture(seen)
            start = self._ahead(time)
            values, error = self._inverse.from_start(time, positions, start, posture)
            values, error = self._searched_again(time, positions, values, error)
            if not np.array_equal(seen, common):
                self._take_off_found(time, positions, common, start, values)
        self._usual = error if self._usual == 0.0 else 0.95 * self._usual + 0.05 * error
        self._before, self._time_before = (self._found, self._time) if self._seen.any() else (None, -np.inf)
        self._found, self._time = values, time
        self._positions, self._seen = positions.copy(), seen
        self._ever |= seen
        self._shown = values + self._offset
        left = float(np.sqrt(np.mean(self._offset**2)))
        return SteadyFrame(self._shown, error, int(seen.sum()), False, left)

    def _hold(self, time: float) -> SteadyFrame:
        """No marker is seen: everything stays where it was shown."""
        if self._found is not None:
            self._found, self._before = self._shown.copy(), None
            self._offset[:] = 0.0
            self._rate[:] = 0.0
            self._time = time
        self._seen = np.zeros_like(self._seen)
        return SteadyFrame(self._shown, float("nan"), 0, True, 0.0)

    def _posture(self, seen: np.ndarray) -> Array:
        """What coordinates that no marker shows are drawn to: the default, or while markers are lost the last pose."""
        if self._found is None or not (self._ever & ~seen).any():
            return self._defaults
        return self._found

    def _ahead(self, time: float) -> Array:
        """Straight on from the last two frames."""
        assert self._found is not None
        span = self._time - self._time_before
        if self._before is None or not 0.0 < time - self._time < 3.0 * span:
            return self._found.copy()
        return self._found + (time - self._time) / span * (self._found - self._before)

    def _give_back(self, step: float) -> None:
        """Move the offset towards 0 as a critically damped spring does."""
        x = max(step, 0.0) / self._blend
        pushed = self._rate * self._blend + self._offset
        decay = np.exp(-x)
        self._rate = decay * (self._rate - x * pushed / self._blend)
        self._offset = decay * (self._offset + x * pushed)

    def _take_off_lost(self, common: np.ndarray) -> None:
        """Of the frame before, what it gives without the markers that are lost now."""
        if not common.any() or np.array_equal(common, self._seen) or self._found is None:
            return
        left = np.where(common[:, None], self._positions, np.nan)
        values, _ = self._inverse.from_start(self._time, left, self._found.copy(), self._found)
        self._offset -= values - self._found
        # From here on the markers that are left determine where the body is.
        if self._before is not None:
            self._before = self._before + (values - self._found)
        self._found = values

    def _take_off_found(self, time: float, positions: Array, common: np.ndarray, start: Array, values: Array) -> None:
        """Of this frame, what the markers change that were found just now."""
        assert self._found is not None
        if common.any():
            left = np.where(common[:, None], positions, np.nan)
            without, _ = self._inverse.from_start(time, left, start, self._found)
        else:
            without = self._found
        self._offset -= self._turned(values - without)

    def _searched_again(self, time: float, positions: Array, values: Array, error: float) -> tuple[Array, float]:
        """Another heading where the markers fit badly and another one fits better, its jump taken off."""
        blind = not self._seen.any()
        if not blind and (error <= LOST * self._usual or time - self._searched < SEARCH):
            return values, error
        self._searched = time
        other, less = self._inverse.from_anywhere(time, positions, self._defaults)
        if not less < 0.99 * error:
            return values, error
        turned = self._turned(other - values)
        if not blind:
            self._offset -= turned
        return values + turned, less

    def _turned(self, change: Array) -> Array:
        """A change of coordinates with angles by the shorter way round."""
        round_ = 2.0 * np.pi * np.round(change / (2.0 * np.pi))
        return np.where(self._turning, change - round_, change)
