"""Coordinates across gaps of their markers: bridged from before to after, without jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

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


def eased_offsets(time: Array, jumps: Array, whole: np.ndarray, lost: np.ndarray) -> Array:
    """Find offsets that take jumps off a motion, and ease back to 0.

    Offsets o_k undo the jumps J_k between two frames where o_k - o_(k-1) = J_k. Summed up over a
    long time they would lead away, as each is known to its error only. With d_k what is left of a
    jump, d_k = o_k - o_(k-1) - J_k, they minimize

        sum_k (d_(k+1) - d_k)^2 + (h / EASE)^4 sum_k o_k^2

    h being the time between frames: within a gap that is short beside `EASE` a jump is undone, in a
    longer one what is left of it changes slowly. They are 0 where all markers are seen.

    Parameters
    ----------
    time : (frames,) [s]
    jumps : (frames, columns) before each frame
    whole : (frames,) in which all markers are seen
    lost : (frames,) in which no pose is known

    Returns
    -------
    (frames, columns), 0 in frames that are whole or lost
    """
    result = np.zeros_like(jumps)
    if not jumps.any():
        return result
    pull = (float(np.median(np.diff(time))) / EASE) ** 4
    for start, stop in runs(~whole & ~lost):
        before = start > 0 and bool(whole[start - 1])
        after = stop < len(time) and bool(whole[stop])
        inner = np.zeros((stop - start + 1, jumps.shape[1]))
        inner[: len(jumps) - start] = jumps[start : stop + 1]
        result[start:stop] = _eased_run(inner, before, after, pull)
    return result


def _eased_run(jumps: Array, before: bool, after: bool, pull: float) -> Array:
    """Find the offsets of a run of frames as `eased_offsets` does.

    Parameters
    ----------
    jumps : (frames + 1, columns) before each frame, and after the last
    before, after : whether offsets are 0 in the frames beside the run
    pull : weight of an offset's square

    Returns
    -------
    (frames, columns)
    """
    count = len(jumps) - 1
    steps = np.diff(jumps, axis=0)
    right = np.zeros((count, jumps.shape[1]))
    # Rows of the symmetric band matrix: its diagonal, and those one and two beside it.
    band = np.zeros((3, count))
    band[0] = pull
    for center in range(-1 if before else 1, count + (1 if after else -1)):
        # d_(c+1) - d_c = o_(c-1) - 2 o_c + o_(c+1) - (J_(c+1) - J_c)
        places = [(center - 1, 1.0), (center, -2.0), (center + 1, 1.0)]
        inside = [(place, factor) for place, factor in places if 0 <= place < count]
        wanted = _step_of_jumps(jumps, steps, center)
        for place, factor in inside:
            right[place] += factor * wanted
            for other, weight in inside:
                if other >= place:
                    band[other - place, place] += factor * weight
    return np.asarray(scipy.linalg.solveh_banded(band, right, lower=True))


def _step_of_jumps(jumps: Array, steps: Array, center: int) -> Array:
    """J_(c+1) - J_c (columns,) of a run, whose jumps are 0 in the frames beside it."""
    if center < 0:
        return np.asarray(jumps[0])
    return np.asarray(steps[center] if center < len(steps) else -jumps[-1])
