"""Squats: depth, tempo, moments and shares of each repetition.

A repetition is a peak of the mean flexion q of the knees that stands out from both sides by half of
the largest range, and by 20 degrees. With q_0 and q_1, the least flexion before and after it, and
the depth d = max q - q_0 (of the way up max q - q_1):

- it begins where q leaves q_0 + 0.05 d, and ends where it is back at q_1 + 0.05 d;
- the way down ends, and the way up begins, where q passes 95 % of the depth: the tempo is
  down, bottom, up (descent and ascent of Wretenberg et al. 1993);
- depth of the center of mass: its height where it begins, less the least one;
- moments: the largest ones from beginning to end, per body mass; share of the right foot: its part
  of the mean force under both feet (Newton et al. 2006).

Where a recording begins or ends within a repetition, the times that this takes away are not known.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.motion.peaks import prominent_peaks
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.body_curves import BodyCurves, right_load
from myomorph.lab.movements.part import UNKNOWN, Part, known_numbers, phases_between
from myomorph.lab.movements.support_force import SupportForce

MIN_DEPTH = 20.0
"""A repetition bends the knees by so much at least [degrees]."""
PROMINENT = 0.5
"""Its bend stands out by this share of the range of the recording."""
NEAR = 0.05
"""Standing ends, and the bottom begins, within this share of the depth."""
STILL = 10.0
"""Knees that bend faster where a recording begins or ends are within a repetition [degrees/s]."""
REST = 0.1
"""Over so long [s]."""


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """Instants of a repetition [s], NaN where the recording does not show them.

    Attributes
    ----------
    start, stop : standing ends, and begins again
    low, up : the bottom is reached, and left
    deepest : knees bent most
    """

    start: float
    low: float
    deepest: float
    up: float
    stop: float


def squats(curves: BodyCurves, force: SupportForce | None) -> tuple[Part, ...]:
    """Find the numbers of each repetition, see the module.

    Parameters
    ----------
    curves : of the body
    force : under the feet, as measured; None without plates
    """
    return tuple(
        _squat(curves, force, repetition) for repetition in repetitions(curves.time, curves.bend)
    )


def _squat(curves: BodyCurves, force: SupportForce | None, repetition: Repetition) -> Part:
    """Numbers of one repetition."""
    start = repetition.start
    stop = repetition.stop
    first = start if np.isfinite(start) else float(curves.time[0])
    last = stop if np.isfinite(stop) else float(curves.time[-1])
    inside = (curves.time >= first) & (curves.time <= last)
    center = curves.center[inside]
    whole = np.isfinite(start) and np.isfinite(stop)
    numbers = {
        of.KNEE_DEPTH: float(np.nanmax(curves.bend[inside])),
        of.CENTER_DROP: float(center[0] - center.min())
        if np.isfinite(start) and np.isfinite(center).all()
        else UNKNOWN,
        of.DOWN_TIME: repetition.low - start,
        of.BOTTOM_TIME: repetition.up - repetition.low,
        of.UP_TIME: stop - repetition.up,
        of.RIGHT_SHARE: right_load(force, first, last, carried=True) if whole else UNKNOWN,
    }
    return Part(
        start=first,
        stop=last,
        numbers=FrozenMap(
            {**known_numbers(numbers), **known_numbers(dict(curves.peaks(first, last)))}
        ),
        phases=phases_between(
            ("down", "bottom", "up"), (first, repetition.low, repetition.up, last)
        ),
    )


def repetitions(time: Array, bend: Array) -> tuple[Repetition, ...]:
    """Find repetitions in the flexion of the knees.

    Parameters
    ----------
    time, bend : (frames,) [s], [degrees]; frames that are NaN are passed over

    Returns
    -------
    in order of time
    """
    seen = np.isfinite(bend)
    if seen.sum() < 3:
        return ()
    clock = time[seen]
    angle = bend[seen]
    needed = max(MIN_DEPTH, PROMINENT * float(np.ptp(angle)))
    # A recording may end at the bottom: its ends count as upright.
    ended = np.concatenate([[angle.min()], angle, [angle.min()]])
    peaks = prominent_peaks(ended, needed) - 1
    edges = [0, *(_lowest(angle, *pair) for pair in itertools.pairwise(peaks))]
    edges.append(len(angle) - 1)
    return tuple(
        _repetition(clock, angle, (first, int(peak), last))
        for first, peak, last in zip(edges, peaks, edges[1:], strict=False)
    )


def _lowest(angle: Array, first: int, last: int) -> int:
    """Return the frame of the least flexion between two peaks."""
    return int(first + np.argmin(angle[first : last + 1]))


def _repetition(clock: Array, angle: Array, frames: tuple[int, int, int]) -> Repetition:
    """Return the instants of a repetition.

    Parameters
    ----------
    clock, angle : (frames,) [s], [degrees]
    frames : that it lies between, and of its peak
    """
    first, peak, last = frames
    low = _reached(clock[first : peak + 1], angle[first : peak + 1], first == 0)
    back = slice(peak, last + 1)
    up = _reached(-clock[back][::-1], angle[back][::-1], last == len(clock) - 1)
    return Repetition(
        start=low.start,
        low=low.stop,
        deepest=float(clock[peak]),
        up=-up.stop,
        stop=-up.start,
    )


@dataclass(frozen=True, kw_only=True)
class _Way:
    """From standing to the bottom [s], NaN where it was not seen."""

    start: float
    stop: float


def _reached(clock: Array, angle: Array, cut: bool) -> _Way:
    """Return when standing ends, and the bottom is reached, on a way to a peak at its end.

    Parameters
    ----------
    clock, angle : (frames,) [s], [degrees]
    cut : whether the recording begins with it
    """
    lowest = int(np.argmin(angle))
    depth = float(angle[-1] - angle[lowest])
    if depth < MIN_DEPTH:
        return _Way(start=UNKNOWN, stop=UNKNOWN)
    upright = np.flatnonzero(angle <= angle[lowest] + NEAR * depth)
    start = int(upright[-1])
    bottom = start + int(np.argmax(angle[start:] >= angle[-1] - NEAR * depth))
    # At an end of the recording, standing is seen only where the knees are at rest.
    moved = abs(float(np.interp(clock[0] + REST, clock, angle)) - angle[0])
    within = cut and clock[start] - clock[0] < REST and moved > STILL * REST
    return _Way(start=UNKNOWN if within else float(clock[start]), stop=float(clock[bottom]))
