"""Reading of a plate while nobody is on it: its zero, and whether that drifts.

A foot presses: what a plate reads lies on its zero or beyond. So the zero is the line below which
no flat reading lies, and on which most of them do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import PLATE_ZERO
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Wrenches
from myomorph.core.model.severity import FORCE_ERROR, severity_of

ZERO = "plate zero"  # Kind of a finding: what a plate reads with nobody on it.
LOW = 0.2  # Share of the largest force below which a plate may be unloaded.
MIN_TIME = 0.15  # That it stays so [s].
MIN_SAMPLES = 8
EDGE = 0.03  # A foot comes and goes at both ends [s].
FLAT = 0.01  # Standard deviation of a reading that is none of a foot, as a share of the largest.
STEADY = 0.004  # The same within a stretch in which a foot comes or goes.
MAX_IDLE = 0.01  # Reading of an unloaded plate, as a share of the largest.
ON_LINE = 0.005  # Distance of a reading from a zero that drifts evenly, as a share of the largest.
MIN_ON_LINE = 3  # Readings that show such a drift.
LOADED = 0.05  # Share of the weight from which a plate counts as loaded.
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
    first_sample, last_sample : numbers of the samples that these are of
    weight : of the body, 0 where it is not known [N]
    """

    first: float
    last: float
    largest: float
    first_sample: float = 0.0
    last_sample: float = 1.0
    weight: float = 0.0

    def readings(self, count: int) -> Array:
        """Interpolate the readings of all samples.

        Parameters
        ----------
        count : of samples

        Returns
        -------
        (count,) [N]
        """
        known = (self.first_sample, self.last_sample)
        return np.asarray(np.interp(np.arange(count), known, (self.first, self.last)))

    @property
    def worst(self) -> float:
        """The larger reading [N]."""
        return max(abs(self.first), abs(self.last))

    @property
    def drifts(self) -> bool:
        """Whether it changes by more than a plate's noise."""
        return abs(self.last - self.first) > MAX_IDLE * self.largest

    @property
    def matters(self) -> bool:
        """Whether it is beyond a plate's noise."""
        return self.worst > MAX_IDLE * self.largest

    def message(self, name: str) -> Message | None:
        """Say that a plate was not set to zero, or drifts; None where it is near zero."""
        if not self.matters:
            return None
        text = f"{name} reads {self.worst:.3g} N with nobody on it: was it set to zero?"
        if self.drifts:
            text = (
                f"{name} reads {self.first:.3g} N with nobody on it at first and"
                f" {self.last:.3g} N at last: its zero drifts"
            )
        severity = severity_of(self.worst, LEVER * FORCE_ERROR * self.largest)
        # An empty plate that counts as loaded is taken for a foot.
        if 0.0 < LOADED * self.weight < self.worst:
            severity = "changes results"
        return PLATE_ZERO.message(text, place=name, size=self.worst, severity=severity)


class _Level(NamedTuple):
    """What a plate reads in a flat stretch: number of its middle sample, and reading [N]."""

    sample: float
    reading: float


class _Line(NamedTuple):
    """A reading that drifts evenly: at sample 0 [N], and its change per sample [N]."""

    start: float
    slope: float

    def at(self, sample: float) -> float:
        """Read it at a sample [N]."""
        return self.start + self.slope * sample


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
    whole: list[_Level] = []
    within: list[_Level] = []
    for part in _small_parts(pressing, rate, largest):
        values = pressing[part]
        if _unevenness(values) <= FLAT * largest:
            whole += _both_ends(values, part.start)
        else:
            within += _flattest(values, part.start, rate, largest)
    levels = sorted([*whole, *within])
    if not levels:
        return None
    first = levels[0]
    last = levels[-1]
    if within:
        line = _lowest_line(levels, largest, _side(pressing))
        end = len(pressing) - 1
        first = _Level(sample=0.0, reading=line.at(0.0))
        last = _Level(sample=end, reading=line.at(end))
    return Zero(
        first=first.reading,
        last=last.reading,
        largest=largest,
        first_sample=first.sample,
        last_sample=last.sample,
    )


def _small_parts(pressing: Array, rate: float, largest: float) -> Iterator[slice]:
    """Find stretches of small readings (samples,) that last, without the edges of steps."""
    small = np.abs(np.nan_to_num(pressing, nan=np.inf)) < LOW * largest
    edge = max(1, round(EDGE * rate))
    for start, stop in runs(small):
        # The ends of the recording are no steps.
        first = start if start == 0 else start + edge
        last = stop if stop == len(small) else stop - edge
        if last - first >= _min_count(rate):
            yield slice(first, last)


def _min_count(rate: float) -> int:
    """Count the samples of the shortest stretch that is looked at."""
    return int(np.ceil(max(MIN_SAMPLES, MIN_TIME * rate)))


def _unevenness(values: Array) -> float:
    """Measure how far readings (samples,) leave a line, which a drift is [N]."""
    number = np.arange(len(values))
    slope = np.polyfit(number, values, 1)
    return float((values - np.polyval(slope, number)).std())


def _both_ends(values: Array, start: int) -> list[_Level]:
    """Levels of the first and the last third of a stretch (samples,)."""
    third = max(3, len(values) // 3)
    return [
        _Level(start + 0.5 * third, float(np.median(values[:third]))),
        _Level(start + len(values) - 0.5 * third, float(np.median(values[-third:]))),
    ]


def _flattest(values: Array, start: int, rate: float, largest: float) -> Iterator[_Level]:
    """Find levels of the flattest windows of a stretch (samples,), one in each half that has one.

    Feet come and go slowly in it, as a heel that is raised or a leg of somebody who sits.
    """
    count = _min_count(rate)
    parts = 2 if len(values) >= 2 * count else 1
    for part in np.array_split(np.arange(len(values)), parts):
        starts = range(int(part[0]), int(part[-1]) + 2 - count, max(1, count // 4))
        rest = [_unevenness(values[first : first + count]) for first in starts]
        best = int(np.argmin(rest))
        if rest[best] <= STEADY * largest:
            window = values[starts[best] : starts[best] + count]
            yield _Level(start + starts[best] + 0.5 * count, float(np.median(window)))


def _side(pressing: Array) -> float:
    """Sign of the largest reading (samples,), to which feet press."""
    known = np.nan_to_num(pressing)
    return float(np.sign(known[np.argmax(np.abs(known))]))


def _lowest_line(levels: list[_Level], largest: float, side: float) -> _Line:
    """Find the line on which most levels lie and below which none does.

    Where fewer than `MIN_ON_LINE` lie on one, the lowest level is the zero.
    """
    samples = np.array([level.sample for level in levels])
    readings = np.array([level.reading for level in levels])
    lowest = _Line(start=float(side * (side * readings).min()), slope=0.0)
    near = np.abs(readings - lowest.start) <= ON_LINE * largest
    best = lowest
    most = max(MIN_ON_LINE - 1, int(near.sum()))
    for one, other in combinations(levels, 2):
        slope = (other.reading - one.reading) / (other.sample - one.sample)
        line = _Line(start=one.reading - slope * one.sample, slope=slope)
        above = side * (readings - line.at(0) - slope * samples)
        count = int((above <= ON_LINE * largest).sum())
        if above.min() >= -ON_LINE * largest and count > most:
            best = line
            most = count
    return best


def zeros_of(wrenches: Wrenches, up: Array, weight: float = 0.0) -> tuple[Zero | None, ...]:
    """Find the zero of each force of a table.

    Parameters
    ----------
    wrenches : in ground, at their own times
    up : (3,)
    weight : of the body, 0 where it is not known [N]

    Returns
    -------
    of each force; None where it is never seen without a load
    """
    if len(wrenches) < 2 or not wrenches.names:
        return (None,) * len(wrenches.names)
    rate = 1.0 / float(np.median(np.diff(wrenches.time)))
    lifts = wrenches.forces @ up
    largest = float(np.nanmax(np.abs(lifts), initial=0.0))
    zeros = (zero_of(lift, rate, largest) for lift in lifts.T)
    return tuple(None if zero is None else replace(zero, weight=weight) for zero in zeros)


def without_zeros(wrenches: Wrenches, up: Array) -> Wrenches:
    """Take the readings of unloaded plates off the vertical forces, where they are beyond noise.

    A force that is never large is left: it may be a load in the hands.

    Parameters
    ----------
    wrenches : in ground, at their own times
    up : (3,)

    Returns
    -------
    the same wrenches where all plates are at zero
    """
    peaks = np.nanmax(np.abs(wrenches.forces @ up), axis=0, initial=0.0)
    zeros = {
        number: zero
        for number, zero in enumerate(zeros_of(wrenches, up))
        if zero is not None and zero.matters and peaks[number] > LOW * zero.largest
    }
    if not zeros:
        return wrenches
    forces = np.array(wrenches.forces)
    for number, zero in zeros.items():
        forces[:, number] -= np.outer(zero.readings(len(wrenches)), up)
    return replace(wrenches, forces=forces)


def zero_messages(wrenches: Wrenches, up: Array, weight: float = 0.0) -> tuple[Message, ...]:
    """Say which forces of a table do not vanish while no foot is on their plate.

    Parameters
    ----------
    wrenches : in ground, at their own times
    up : (3,)
    weight : of the body, 0 where it is not known [N]

    Returns
    -------
    a message for each such force
    """
    zeros = zeros_of(wrenches, up, weight)
    messages = (
        None if zero is None else zero.message(name)
        for name, zero in zip(wrenches.names, zeros, strict=True)
    )
    return tuple(message for message in messages if message is not None)
