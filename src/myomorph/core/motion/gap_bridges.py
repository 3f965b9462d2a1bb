"""Coordinates across gaps of their markers: bridged from before to after, without jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only, runs

EASE = 0.3  # Time constant with which a coordinate goes to what is likely, at an open end [s]
LOOKED = 0.06  # Time before and after a gap from which its rates are taken [s]
CARRIED = 0.4  # Longest time over which a rate is carried on into a gap [s]


@dataclass(frozen=True, kw_only=True)
class _End:
    """How a coordinate leaves or enters a gap.

    Attributes
    ----------
    time : of the frame beside the gap [s]
    value, rate : there [rad or m, per s]
    """

    time: float
    value: float
    rate: float


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Bridge:
    """A coordinate with its gaps filled.

    Attributes
    ----------
    values : (frames,) [rad or m]
    sd : (frames,) standard deviation of what was filled in, 0 elsewhere [rad or m]
    """

    values: Array
    sd: Array


def bridged(time: Array, values: Array, known: np.ndarray, likely: Array, sd: Array) -> Bridge:
    """Fill the gaps of one coordinate.

    Between two known parts, with u from 0 to 1 over the gap, values a and b and rates v and w
    beside it (Hermite),

        x = a + (b - a) u^2 (3 - 2 u) + v t (1 - t / S)^2 - w r (1 - r / S)^2

    where t and r are the times since its beginning and until its end, and S the gap's duration, or
    `CARRIED` where that is shorter: then a rate is forgotten after it. At an open end the
    coordinate goes from a to what is likely, p, like a critically damped spring,

        x = p + (a - p + (v + (a - p) / EASE) t) exp(-t / EASE)

    A coordinate whose acceleration has the standard deviation s may by then be away by
    s t^2 r^2 / T^2 over a gap T, and s t^2 at an open end, but no further than what is known
    beforehand. That is twice what an acceleration alone makes of it, as rates beside a gap are not
    known exactly either.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames,) [rad or m], read where known
    known : (frames,) whether markers show it
    likely : (frames,) what it is without any marker [rad or m]
    sd : (frames,) standard deviation about that [rad or m]

    Returns
    -------
    values and their standard deviation
    """
    filled = np.where(known, values, likely)
    spread = np.where(known, 0.0, sd)
    if not known.any():
        return Bridge(values=filled, sd=spread)
    acceleration = usual_acceleration(time, values, known)
    for start, stop in runs(~known):
        inside = slice(start, stop)
        before = _end(time, values, known, start - 1, -1) if start > 0 else None
        after = _end(time, values, known, stop, 1) if stop < len(time) else None
        if before is not None and after is not None:
            filled[inside] = _between(time[inside], before, after)
            share = (time[inside] - before.time) * (after.time - time[inside])
            apart = acceleration * (share / (after.time - before.time)) ** 2
        else:
            end = before or after
            assert end is not None
            filled[inside] = _eased(time[inside], end, likely[inside])
            apart = acceleration * (time[inside] - end.time) ** 2
        spread[inside] = np.minimum(apart, sd[inside])
    return Bridge(values=filled, sd=spread)


def usual_acceleration(time: Array, values: Array, known: np.ndarray) -> float:
    """Root mean square of the second differences of known frames, over `LOOKED`.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames,) of a coordinate [rad or m]
    known : (frames,) which frames count

    Returns
    -------
    [per s^2], 0 without three known frames so far apart
    """
    if len(time) < 3:
        return 0.0
    step = max(1, round(LOOKED / float(np.median(np.diff(time)))))
    if len(time) <= 2 * step:
        return 0.0
    both = known[2 * step :] & known[step:-step] & known[: -2 * step]
    bent = values[2 * step :] - 2.0 * values[step:-step] + values[: -2 * step]
    span = float(np.median(time[step:] - time[:-step]))
    return float(np.sqrt(np.mean(bent[both] ** 2))) / span**2 if both.any() else 0.0


def _end(time: Array, values: Array, known: np.ndarray, frame: int, way: int) -> _End:
    """Value and rate beside a gap, of a line or parabola through the frames that lie beyond.

    Parameters
    ----------
    frame : beside the gap
    way : -1 where the known frames lie before it, 1 where after it
    """
    frames = [frame]
    while len(frames) < len(time):
        following = frames[-1] + way
        if not 0 <= following < len(time) or not known[following]:
            break
        if len(frames) > 2 and abs(time[following] - time[frame]) > LOOKED:
            break
        frames.append(following)
    rate = 0.0
    if len(frames) > 2:
        order = 2 if len(frames) > 4 else 1
        # The line through the frame itself: the bridge begins there.
        since = time[frames[1:]] - time[frame]
        powers = since[:, None] ** np.arange(1, order + 1)
        rate = float(np.linalg.lstsq(powers, values[frames[1:]] - values[frame], rcond=None)[0][0])
    return _End(time=float(time[frame]), value=float(values[frame]), rate=rate)


def _between(time: Array, before: _End, after: _End) -> Array:
    """Bridge times (frames,) between two ends."""
    duration = after.time - before.time
    since = time - before.time
    until = after.time - time
    share = since / duration
    carried = min(duration, CARRIED)
    away = since * np.maximum(1.0 - since / carried, 0.0) ** 2
    back = until * np.maximum(1.0 - until / carried, 0.0) ** 2
    blend = share**2 * (3.0 - 2.0 * share)
    return np.asarray(
        before.value + (after.value - before.value) * blend + before.rate * away - after.rate * back
    )


def _eased(time: Array, end: _End, likely: Array) -> Array:
    """Go from an end to what is likely (frames,), forwards or backwards in time."""
    since = np.abs(time - end.time)
    forwards = bool(time[0] >= end.time)
    rate = end.rate if forwards else -end.rate
    away = end.value - likely
    return np.asarray(likely + (away + (rate + away / EASE) * since) * np.exp(-since / EASE))


def without_drift(time: Array, offsets: Array, whole: np.ndarray) -> Array:
    """Let offsets that jumps add up to come back to 0 where all markers are seen.

    Between two whole parts what is left at the end is taken off smoothly, u^2 (3 - 2 u) of it; at
    the beginning of a recording all of it; at its end the offset stays, as the marker's does.

    Parameters
    ----------
    time : (frames,) [s]
    offsets : (frames, columns) sums of the jumps since the beginning
    whole : (frames,) in which offsets are 0

    Returns
    -------
    (frames, columns)
    """
    result = np.zeros_like(offsets)
    for start, stop in runs(~whole):
        inside = slice(start, stop)
        first = offsets[start - 1] if start > 0 else np.zeros(offsets.shape[1])
        part = offsets[inside] - first
        if stop < len(time):
            left = offsets[stop] - first
            begin = time[start - 1] if start > 0 else -np.inf
            share = (time[inside] - begin) / (time[stop] - begin) if start > 0 else 1.0
            blend = share**2 * (3.0 - 2.0 * share)
            part = part - np.multiply.outer(blend, left)
        result[inside] = part
    return result
