"""The clock of a session, which rises whatever the sender's clock does.

A sender that restarts may set its clock back. The session goes on after a pause: frames get times
that follow the newest one, and forces the same shift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array

SET_BACK = 0.5  # From which a clock that goes back was set [s]; less is a frame out of order.
PAUSE = 1.0  # Between the newest frame and the first one of a clock that was set [s].
TOGETHER = 5.0  # By which forces and frames of one clock may be apart [s].


@dataclass(frozen=True)
class Stamp:
    """The time of a frame in the session.

    Attributes
    ----------
    time : on the clock of the session [s]
    is_bad : whether it is no number, or not later than that of the frame before
    restarts : whether the sender's clock was set back before this frame
    late : age that the source states for a frame that has just come, since its clock was set [s]
    """

    time: float
    is_bad: bool = False
    restarts: bool = False
    late: float = 0.0


class SessionClock:
    """Gives frames and forces rising times."""

    def __init__(self) -> None:
        self._newest = -np.inf
        self._newest_force = -np.inf
        self._shift = 0.0
        self._late = 0.0

    def of_frame(self, time: float, age: float) -> Stamp:
        """Return the time of a frame.

        Parameters
        ----------
        time : by its sender [s]
        age : how long ago that was by the source, NaN where nobody knows [s]
        """
        if not np.isfinite(time):
            return Stamp(time, is_bad=True)
        back = self._newest - (time + self._shift)
        restarts = back >= SET_BACK
        if restarts:
            self._shift = self._newest + PAUSE - time
            self._late = age if np.isfinite(age) else 0.0
        elif back >= 0.0:
            return Stamp(time, is_bad=True)
        self._newest = time + self._shift
        return Stamp(self._newest, restarts=restarts, late=self._late)

    def of_forces(self, time: Array) -> tuple[Array, np.ndarray]:
        """Return the times of samples of force.

        Parameters
        ----------
        time : (samples,) by their sender [s]

        Returns
        -------
        (kept,) times on the clock of the session [s], and (samples,) whether each is kept: those of
        another clock than the frames', or not later than one before, are not
        """
        if not self._shift:
            shifted = np.asarray(time, np.float64)
        else:
            moved = time + self._shift
            near = np.abs(moved - self._newest) < TOGETHER
            # Forces whose clock was not set, or not yet, cannot be aligned.
            shifted = np.where(near, moved, np.nan)
        highest = np.fmax.accumulate(np.concatenate([[self._newest_force], shifted]))
        with np.errstate(invalid="ignore"):
            kept = np.isfinite(shifted) & (shifted > highest[:-1])
        self._newest_force = float(highest[-1])
        return shifted[kept], kept
