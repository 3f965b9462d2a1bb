"""Strikes and lifts of one foot, seen from the trunk, and which way and over what the body goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Event, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.model.stride_curves import STRIKES
from myomorph.lab.analysis.phases import contacts
from myomorph.lab.causes import STRIDES

NEAREST = 0.4
"""An event that is known better replaces the nearest one within this share of a stride; a runner's
foot is farthest ahead a quarter of a stride before it strikes.
"""
CLEAR = 0.4  # Skewness of the speeds of feet from which on their swing shows the direction
MIN_FRAMES = 8  # Frames in which trunk and foot must be seen


@dataclass(frozen=True)
class Limb:
    """A leg and what of it is watched.

    Attributes
    ----------
    name : as results call it, with its side ("hind_r")
    points : whose mean tells when the foot strikes (the heel, or the paw)
    lifting : whose mean tells when it lifts (the toes); those of `points` where empty
    bodies : of wrenches that act on this foot
    """

    name: str
    points: tuple[str, ...]
    lifting: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class StrideOptions:
    """What counts as a stride.

    Attributes
    ----------
    prominence : how far a foot must go forward and back, as a share of its usual way
    gap : an event is only told where the foot was seen so shortly before and after, as a share of
        the stride
    seen : and a stride where the foot was seen for at least this share of it
    belt : the ground moves where feet on it move faster than this share of the speed of travel
    threshold : force that is contact, as a share of body weight
    shortest : contacts and gaps on plates shorter than this share of a stride are noise
    """

    prominence: float = 0.4
    gap: float = 0.06
    seen: float = 0.5
    belt: float = 0.2
    threshold: float = 0.03
    shortest: float = 0.04


@read_only
class FootTrack:
    """A foot and its events."""

    place: Array  # (frames, 3) of what tells strikes [m], NaN where unseen
    # strikes, lifts: (events,) [s]
    strikes: Array
    lifts: Array
    seen: np.ndarray  # (frames,)
    source: str = "markers"  # "markers", "running", "events" or "plates"


def direction_of(
    time: Array,
    trunk: Array,
    feet: Sequence[Array],
    up: Array,
    direction: Array | None,
    notes: list[Message],
    facing: Array | None = None,
) -> tuple[Array, bool]:
    """Direction of travel, and whether the body goes over the ground rather than in place on a
    belt. `facing` (3,) where the feet point, for a body in place whose feet are as fast backward as
    forward, as a sprinter's.
    """
    flat = np.eye(3) - np.outer(up, up)
    seen = np.isfinite(trunk[:, 0])
    span = time[seen] - time[seen].mean()
    slope = span @ (trunk[seen] @ flat) / max(float(span @ span), 1e-12)
    relative = [(foot - trunk) @ flat for foot in feet]
    speeds = np.concatenate([np.gradient(track, time, axis=0) for track in relative])
    speeds = speeds[np.isfinite(speeds[:, 0])]
    if not len(speeds):
        raise BadData(
            "no foot is seen in frames in which the trunk is: there is no direction of travel"
        )
    # Over ground the trunk is as fast as feet that stand are seen from it; on a belt it only
    # drifts.
    travels = bool(np.linalg.norm(slope) > 0.3 * np.median(np.linalg.norm(speeds, axis=1)))
    if direction is not None:
        slope = direction @ flat
        if not np.linalg.norm(slope) > 0.0:
            raise BadData("the direction of travel is vertical, or no direction at all")
    if travels or direction is not None:
        return slope / np.linalg.norm(slope), travels
    seen_feet = [track[np.isfinite(track[:, 0])] for track in relative]
    swept = np.concatenate([track - np.median(track, axis=0) for track in seen_feet if len(track)])
    # A marker that was taken for another one for a while does not turn the way.
    swept = swept[
        np.linalg.norm(swept, axis=1) <= np.percentile(np.linalg.norm(swept, axis=1), 95.0)
    ]
    axis = np.linalg.svd(swept, full_matrices=False)[2][0]
    # In place: swing is faster than stance.
    forward = speeds @ axis
    away = forward - forward.mean()
    skew = float(np.mean(away**3)) / max(float(np.mean(away**2)) ** 1.5, 1e-12)
    reason = "feet swing fastest"
    if facing is not None and abs(skew) < CLEAR:
        skew = float(facing @ axis)
        reason = "feet point"
    axis = axis if skew > 0.0 else -axis
    notes.append(
        STRIDES.message(
            f"direction of travel {np.round(axis, 2).tolist()} is where {reason}; give it if it is"
            " not"
        )
    )
    return axis, False


def foot_track(
    time: Array, foot: Array, lifting: Array, trunk: Array, along: Array, options: StrideOptions
) -> FootTrack:
    """Strikes where the foot is farthest ahead of the trunk, lifts where it is farthest behind."""
    ahead = (foot - trunk) @ along
    behind = (lifting - trunk) @ along
    strikes = _extremes(time, ahead, options)
    lifts = _extremes(time, -behind, options)
    both = np.concatenate([np.diff(strikes), np.diff(lifts)])
    usual = float(np.median(both)) if len(both) else np.inf
    strikes = (
        strikes[[_is_seen(time, ahead, at, options.gap * usual) for at in strikes]]
        if len(strikes)
        else strikes
    )
    lifts = (
        lifts[[_is_seen(time, behind, at, options.gap * usual) for at in lifts]]
        if len(lifts)
        else lifts
    )
    return FootTrack(place=foot, strikes=strikes, lifts=lifts, seen=np.isfinite(ahead))


def _extremes(time: Array, values: Array, options: StrideOptions) -> Array:
    """Times of the maxima that stand out, between samples by the parabola around each."""
    known = np.isfinite(values)
    if known.sum() < MIN_FRAMES:
        return np.zeros(0)
    filled = np.interp(time, time[known], values[known])
    way = float(np.ptp(np.percentile(values[known], (5.0, 95.0))))
    if not way > 0.0:
        return np.zeros(0)
    # A foot that begins or ends at its extreme has not been seen to turn there.
    peaks, _ = scipy.signal.find_peaks(filled, prominence=options.prominence * way, plateau_size=1)
    if not len(peaks):
        return np.zeros(0)
    usual = float(np.median(np.diff(time[peaks]))) if len(peaks) > 1 else 0.2 * float(np.ptp(time))
    reach = max(1, round(0.02 * usual / float(np.median(np.diff(time)))))
    return np.array([_vertex(time, filled, int(peak), reach) for peak in peaks])


def _vertex(time: Array, values: Array, at: int, reach: int) -> float:
    window = slice(max(at - reach, 0), at + reach + 1)
    t = time[window] - time[at]
    x = values[window]
    if len(t) < 3:
        return float(time[at])
    _, slope, bend = np.polynomial.polynomial.polyfit(t, x, 2)
    return (
        float(time[at] + np.clip(-0.5 * slope / bend, t[0], t[-1]))
        if bend < 0.0
        else float(time[at])
    )


def _is_seen(time: Array, values: Array, at: float, within: float) -> bool:
    seen = time[np.isfinite(values)]
    after = int(np.searchsorted(seen, at))
    step = 1.01 * float(np.median(np.diff(time)))
    reach = max(within, step)
    return 0 < after < len(seen) and seen[after] - at <= reach and at - seen[after - 1] <= reach


def on_plates(
    track: FootTrack,
    limb: Limb,
    wrenches: Wrenches,
    up: Array,
    threshold: float,
    span: tuple[float, float],
    options: StrideOptions,
) -> FootTrack:
    """Events that plates show in place of the nearest ones of the points, those within the points'
    span of time [s].
    """
    columns = [index for index, body in enumerate(wrenches.bodies) if body in limb.bodies]
    if not columns:
        return track
    usual = (
        float(np.median(np.diff(track.strikes)))
        if len(track.strikes) > 1
        else float(np.ptp(wrenches.time))
    )
    force = np.nan_to_num(wrenches.forces[:, columns] @ up).sum(axis=1)
    touches = contacts(wrenches.time, force, threshold, options.shortest * usual)
    inner = len(wrenches) - 1
    strikes = [
        at
        for start, _ in touches
        if start > 0 and span[0] <= (at := wrenches.time[start]) <= span[1]
    ]
    lifts = [
        at
        for _, stop in touches
        if stop < inner and span[0] <= (at := wrenches.time[stop]) <= span[1]
    ]
    return _with_events(track, strikes, lifts, usual, "plates" if len(strikes) > 1 else "markers")


LIFTS = ("foot off", "toe off", "foot lift")
"""What laboratories call it when a foot leaves the ground, as `STRIKES` when it meets it."""


def on_events(
    track: FootTrack, limb: Limb, events: Sequence[Event], source: str = "events"
) -> FootTrack:
    """Events of a recording in place of the nearest ones of the points on the limb's side."""
    side = split_side(limb.name)[1]
    sided = [event for event in events if side and event.side.lower() == side]
    strikes = [
        event.time for event in sided if event.label.lower().replace("_", " ").strip() in STRIKES
    ]
    lifts = [
        event.time for event in sided if event.label.lower().replace("_", " ").strip() in LIFTS
    ]
    if not strikes and not lifts:
        return track
    usual = float(np.median(np.diff(track.strikes))) if len(track.strikes) > 1 else np.inf
    if not np.isfinite(usual):
        usual = (
            float(np.median(np.diff(sorted(strikes))))
            if len(strikes) > 1
            else float(np.ptp([*strikes, *lifts]))
        )
    return _with_events(track, strikes, lifts, usual, source if strikes else track.source)


def _with_events(
    track: FootTrack, strikes: Sequence[float], lifts: Sequence[float], usual: float, source: str
) -> FootTrack:
    near = NEAREST * usual
    return FootTrack(
        place=track.place,
        strikes=_replaced(track.strikes, strikes, near),
        lifts=_replaced(track.lifts, lifts, near),
        seen=track.seen,
        source=source,
    )


def _replaced(events: Array, better: Sequence[float], near: float) -> Array:
    """Better events in place of the nearest ones; the others are shifted by as much as those were
    off in the middle. A stride from an event of one kind to one of the other would be too long or
    too short by that.
    """
    kept = [event for event in events if all(abs(event - other) > near for other in better)]
    off = (
        [other - events[int(np.argmin(np.abs(events - other)))] for other in better]
        if len(events)
        else []
    )
    off = [difference for difference in off if abs(difference) <= near]
    shift = float(np.median(off)) if off else 0.0
    return np.array(sorted([*(time + shift for time in kept), *better]))


def ground_speed_of(
    time: Array, tracks: Mapping[str, FootTrack], trunk: Array, along: Array, options: StrideOptions
) -> float:
    """How fast feet that stand move along the travel: the belt's speed, 0 over ground."""
    standing = []
    traveling = []
    trunk_speed = np.gradient(trunk @ along, time)
    for track in tracks.values():
        speed = np.gradient(track.place @ along, time)
        for strike in track.strikes:
            lift = next((time for time in track.lifts if time > strike), np.nan)
            middle = (time > strike + 0.25 * (lift - strike)) & (
                time < strike + 0.75 * (lift - strike)
            )
            standing.append(speed[middle])
            traveling.append((trunk_speed - speed)[middle])
    stood = np.concatenate(standing) if standing else np.zeros(0)
    if not np.isfinite(stood).any():
        return 0.0
    ground = float(np.nanmedian(stood))
    return (
        ground
        if abs(ground) > options.belt * abs(float(np.nanmedian(np.concatenate(traveling))))
        else 0.0
    )
