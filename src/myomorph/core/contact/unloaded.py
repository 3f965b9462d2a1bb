"""Reading of a plate while nobody is on it: its zero, and whether that drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import PLATE_ZERO
from myomorph.core.model.gravity import FORCE_ERROR, gravity_of
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Wrenches

LOW = 0.2  # Share of the largest force below which a plate may be unloaded.
MIN_TIME = 0.15  # That it stays so [s].
EDGE = 0.03  # A foot comes and goes at both ends [s].
FLAT = 0.01  # Standard deviation of a reading that is none of a foot, as a share of the largest.
MAX_IDLE = 0.01  # Reading of an unloaded plate, as a share of the largest.
LEVER = 0.4
"""A zero acts in the middle of a plate, some 0.25 m from the foot, where the largest force acts 0.1
m from a joint: so much less of it changes a torque by the error of a force.
"""


@dataclass(frozen=True, kw_only=True)
class Zero:
    """What a plate reads with nobody on it.

    Attributes
    ----------
    first, last : at the beginning and at the end of a recording [N]
    largest : force of the recording [N]
    """

    first: float
    last: float
    largest: float

    @property
    def worst(self) -> float:
        """The larger reading [N]."""
        return max(abs(self.first), abs(self.last))

    @property
    def drifts(self) -> bool:
        """Whether it changes by more than a plate's noise."""
        return abs(self.last - self.first) > MAX_IDLE * self.largest

    def message(self, name: str) -> Message | None:
        """Say that a plate was not set to zero, or drifts; None where it is near zero."""
        if self.worst <= MAX_IDLE * self.largest:
            return None
        text = f"{name} reads {self.worst:.3g} N with nobody on it: was it set to zero?"
        if self.drifts:
            text = (
                f"{name} reads {self.first:.3g} N with nobody on it at first and"
                f" {self.last:.3g} N at last: its zero drifts"
            )
        return PLATE_ZERO.message(
            text,
            place=name,
            size=self.worst,
            gravity=gravity_of(self.worst, LEVER * FORCE_ERROR * self.largest),
        )


def zero_of(pressing: Array, rate: float, largest: float) -> Zero | None:
    """Find the zero of a plate; None where it is never seen without a load.

    Parameters
    ----------
    pressing : (samples,) force along the plate's normal [N], NaN where unknown
    rate : [Hz]
    largest : force of all plates [N]

    Returns
    -------
    what it reads at first and at last
    """
    if not largest > 0.0:
        return None
    small = np.abs(np.nan_to_num(pressing, nan=np.inf)) < LOW * largest
    edge = max(1, round(EDGE * rate))
    levels: list[float] = []
    for start, stop in runs(small):
        # The ends of the recording are no steps.
        first = start if start == 0 else start + edge
        last = stop if stop == len(small) else stop - edge
        if last - first < max(8.0, MIN_TIME * rate):
            continue
        part = pressing[first:last]
        third = max(3, len(part) // 3)
        # A line through it: what drifts is no load.
        slope = np.polyfit(np.arange(len(part)), part, 1)
        rest = part - np.polyval(slope, np.arange(len(part)))
        if float(rest.std()) > FLAT * largest:
            continue
        levels += [float(np.median(part[:third])), float(np.median(part[-third:]))]
    if not levels:
        return None
    return Zero(first=levels[0], last=levels[-1], largest=largest)


def zero_messages(wrenches: Wrenches, up: Array) -> tuple[Message, ...]:
    """Say which forces of a table do not vanish while no foot is on their plate.

    Parameters
    ----------
    wrenches : in ground, at their own times
    up : (3,)

    Returns
    -------
    a message for each such force
    """
    if len(wrenches) < 2 or not wrenches.names:
        return ()
    rate = 1.0 / float(np.median(np.diff(wrenches.time)))
    lifts = wrenches.forces @ up
    largest = float(np.nanmax(np.abs(lifts), initial=0.0))
    zeros = (zero_of(lift, rate, largest) for lift in lifts.T)
    messages = (
        None if zero is None else zero.message(name)
        for name, zero in zip(wrenches.names, zeros, strict=True)
    )
    return tuple(message for message in messages if message is not None)
