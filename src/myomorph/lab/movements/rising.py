"""Rising from a seat: times, lean of the trunk, forces and moments of each rise.

With the height h of the hips' centers and the angle q of the trunk with the vertical:

- a rise is where h goes from its lower to its upper quarter, over 15 cm at least;
- the seat is left where h last is within 5 % of the rise above its seated height, and the rise ends
  where h first is within 5 % below its standing height;
- it begins where the trunk begins to lean: q last is within 5 % of its way from its least value on
  the seat to its largest before the seat is left;
- the momentum phase is from the beginning until the seat is left, the extension phase from there
  until standing (phases I, and II with III, of Schenkman et al. 1990);
- peak vertical force: the largest force under both feet, as measured, over body weight; its share
  of the right foot while legs extend.

Moments are the largest ones from the beginning to standing, per body mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.body_curves import BodyCurves, right_load
from myomorph.lab.movements.part import UNKNOWN, Part, known_numbers, phases_between
from myomorph.lab.movements.support_force import SupportForce

MIN_RISE = 0.15
"""Hips go up by so much at least [m]."""
NEAR = 0.05
"""Sitting ends, and standing begins, within this share of the rise."""
MIN_SEEN = 0.9
"""Share of the frames of a rise in which the hips must be seen."""


@dataclass(frozen=True, kw_only=True)
class Rise:
    """Instants of a rise [s].

    Attributes
    ----------
    sat : the body sits from here on: sitting down has ended, or the recording begins
    off : the seat is left
    stop : the body stands
    """

    sat: float
    off: float
    stop: float


def rising(curves: BodyCurves, force: SupportForce | None) -> tuple[Part, ...]:
    """Find the numbers of each rise, see the module.

    Parameters
    ----------
    curves : of the body
    force : under the feet, as measured; None without plates
    """
    return tuple(_part(curves, force, rise) for rise in rises(curves.time, curves.hips))


def _part(curves: BodyCurves, force: SupportForce | None, rise: Rise) -> Part:
    """Numbers of one rise."""
    begun = _leaning(curves, rise)
    first = begun if np.isfinite(begun) else rise.off
    numbers = {
        of.RISE_TIME: rise.stop - begun,
        of.MOMENTUM_TIME: rise.off - begun,
        of.EXTENSION_TIME: rise.stop - rise.off,
        of.TRUNK_LEAN: _largest_lean(curves, first, rise.stop),
        of.PEAK_VERTICAL_FORCE: _peak(force, first, rise.stop),
        of.RIGHT_SHARE: right_load(force, rise.off, rise.stop, carried=False),
    }
    moments = known_numbers(dict(curves.peaks(first, rise.stop)))
    return Part(
        start=first,
        stop=rise.stop,
        numbers=FrozenMap({**known_numbers(numbers), **moments}),
        phases=phases_between(("momentum", "extension"), (first, rise.off, rise.stop)),
    )


def rises(time: Array, hips: Array) -> tuple[Rise, ...]:
    """Find rises in the height of the hips.

    Parameters
    ----------
    time, hips : (frames,) [s], [m]; frames that are NaN are passed over

    Returns
    -------
    in order of time; none where hips hardly move, or were seldom seen
    """
    seen = np.isfinite(hips)
    if seen.sum() < 3 or seen.mean() < MIN_SEEN:
        return ()
    clock = time[seen]
    height = hips[seen]
    low = float(height.min())
    span = float(height.max()) - low
    if span < MIN_RISE:
        return ()
    seated = runs(height < low + 0.25 * span)
    found = []
    for index, (first, last) in enumerate(seated):
        following = seated[index + 1][0] if index + 1 < len(seated) else len(height)
        after = height[last:following]
        if not len(after) or after.max() < low + 0.75 * span:
            continue
        found.append(_rise(clock, height, (first, last, following)))
    return tuple(found)


def _rise(clock: Array, height: Array, frames: tuple[int, int, int]) -> Rise:
    """Return the instants of a rise.

    Parameters
    ----------
    clock, height : (frames,) [s], [m]
    frames : sitting begins, it ends, and the body sits down again
    """
    first, last, following = frames
    seat = float(np.median(height[first:last]))
    # Only the way up: standing ends with the largest height.
    top = last + int(np.argmax(height[last:following]))
    way = float(height[top]) - seat
    on_seat = np.flatnonzero(height[first : top + 1] <= seat + NEAR * way) + first
    off = int(on_seat[-1])
    standing = off + int(np.argmax(height[off : top + 1] >= height[top] - NEAR * way))
    return Rise(sat=float(clock[on_seat[0]]), off=float(clock[off]), stop=float(clock[standing]))


def _leaning(curves: BodyCurves, rise: Rise) -> float:
    """Return when the trunk begins to lean [s], NaN where that was not seen."""
    if curves.lean is None:
        return UNKNOWN
    on_seat = (curves.time >= rise.sat) & (curves.time <= rise.off)
    lean = curves.lean[on_seat]
    if len(lean) < 3 or not np.isfinite(lean).all():
        return UNKNOWN
    top = int(np.argmax(lean))
    lowest = float(lean[: top + 1].min())
    upright = np.flatnonzero(lean[: top + 1] <= lowest + NEAR * (lean[top] - lowest))
    return float(curves.time[on_seat][upright[-1]])


def _largest_lean(curves: BodyCurves, start: float, stop: float) -> float:
    """Return the largest angle of the trunk with the vertical in a span of time [degrees]."""
    if curves.lean is None:
        return UNKNOWN
    inside = (curves.time >= start) & (curves.time <= stop)
    lean = curves.lean[inside]
    return float(lean.max()) if len(lean) and np.isfinite(lean).all() else UNKNOWN


def _peak(force: SupportForce | None, start: float, stop: float) -> float:
    """Return the largest force under the feet in a span of time, over body weight."""
    if force is None:
        return UNKNOWN
    part = force.inside(start, stop)
    if part.stop <= part.start:
        return UNKNOWN
    return float(force.total[part].max()) / force.weight
