"""Strikes and lifts of one foot, seen from the trunk, and the speed of the ground under it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.model.stride_curves import STRIKES
from myomorph.core.motion.peaks import prominent_peaks
from myomorph.lab.analysis.phases import contacts
from myomorph.lab.analysis.travel import Travel

NEAREST = 0.4
"""An event that is known better replaces the nearest one within this share of a stride; a runner's
foot is farthest ahead a quarter of a stride before it strikes.
"""
MIN_SEPARATION = 0.6
"""Strikes of a foot, and its lifts, are apart by this share of a stride at least: a foot that drags
stops on its way ahead, and plates, events and points may differ by more than `NEAREST`.
"""
STILL = 0.02
"""A foot that goes forward and back by a smaller share of its distance from the trunk does not
step: it trembles, or its points are noisy.
"""
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
    period: float = float("nan")  # usual duration of a stride [s], NaN where it was not seen

    @property
    def usual(self) -> float:
        """Usual time from strike to strike [s], NaN where it was not seen."""
        if np.isfinite(self.period):
            return self.period
        return float(np.median(np.diff(self.strikes))) if len(self.strikes) > 1 else float("nan")


def foot_track(
    foot: Array, lifting: Array, trunk: Array, travel: Travel, options: StrideOptions
) -> FootTrack:
    """Strikes where the foot is farthest ahead of the trunk, lifts where it is farthest behind.

    Where the body stops or turns on the spot it has neither.

    Parameters
    ----------
    foot, lifting, trunk : paths (frames, 3) [m] of what shows strikes, lifts, and of the trunk, NaN
        where unseen
    travel : of the body, at the same times
    options : how far a foot must go, and be seen

    Returns
    -------
    the foot's path and events
    """
    time = travel.time
    ahead = _along(foot - trunk, travel)
    behind = _along(lifting - trunk, travel)
    least = STILL * float(np.nanmedian(np.linalg.norm(foot - trunk, axis=1)))
    strikes = _extremes(travel, ahead, options, least)
    lifts = _extremes(travel, -behind, options, least)
    both = np.concatenate([np.diff(strikes), np.diff(lifts)])
    usual = float(np.median(both)) if len(both) else np.inf
    return FootTrack(
        place=foot,
        strikes=_seen_events(time, ahead, strikes, options.gap * usual),
        lifts=_seen_events(time, behind, lifts, options.gap * usual),
        seen=np.isfinite(foot[:, 0] - trunk[:, 0]),
        period=travel.period,
    )


def _along(relative: Array, travel: Travel) -> Array:
    """Part (frames,) of a foot's path (frames, 3) along the travel [m], NaN where there is none."""
    along = np.einsum("fi,fi->f", relative, travel.along)
    return np.where(travel.goes, along, np.nan)


def _seen_events(time: Array, values: Array, events: Array, within: float) -> Array:
    """Select the events (events,) [s] about which values (frames,) were seen `within` [s]."""
    return np.array([at for at in events if _is_seen(time, values, at, within)])


def _extremes(travel: Travel, values: Array, options: StrideOptions, least: float) -> Array:
    """Find times of the maxima that stand out, between samples by the parabola around each.

    Parameters
    ----------
    travel : at the times of the values
    values : (frames,) NaN where unknown
    options : how far a maximum must stand out
    least : way of the values below which they have no maxima [m]

    Returns
    -------
    (maxima,) [s]
    """
    time = travel.time
    known = np.isfinite(values)
    if known.sum() < MIN_FRAMES:
        return np.zeros(0)
    filled = np.interp(time, time[known], values[known])
    way = float(np.ptp(np.percentile(values[known], (5.0, 95.0))))
    if not way > least:
        return np.zeros(0)
    step = float(np.median(np.diff(time)))
    apart = MIN_SEPARATION * travel.period / step if np.isfinite(travel.period) else 1.0
    # A foot that begins or ends at its extreme has not been seen to turn there.
    peaks = prominent_peaks(filled, options.prominence * way, max(apart, 1.0))
    if not len(peaks):
        return np.zeros(0)
    usual = float(np.median(np.diff(time[peaks]))) if len(peaks) > 1 else 0.2 * float(np.ptp(time))
    reach = max(1, round(0.02 * usual / step))
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


@read_only
class PlateLoads:
    """Forces of the ground that show contacts of feet.

    Attributes
    ----------
    wrenches : as measured [N]
    up : (3,) unit vector against gravity
    threshold : vertical force of a contact [N]
    span : time of the feet's points, first and last [s]; events outside it are left out
    """

    wrenches: Wrenches
    up: Array
    threshold: float
    span: tuple[float, float]


def on_plates(track: FootTrack, limb: Limb, loads: PlateLoads, options: StrideOptions) -> FootTrack:
    """Replace the events of the foot's points by the nearest ones that plates show.

    Parameters
    ----------
    track : events of a foot from its points
    limb : of the foot, whose bodies the forces act on
    loads : of all plates
    options : shortest duration of a contact, in usual stride times

    Returns
    -------
    FootTrack with the events of plates where there are any
    """
    wrenches = loads.wrenches
    span = loads.span
    columns = [index for index, body in enumerate(wrenches.bodies) if body in limb.bodies]
    if not columns:
        return track
    usual = track.usual if np.isfinite(track.usual) else float(np.ptp(wrenches.time))
    force = np.nan_to_num(wrenches.forces[:, columns] @ loads.up).sum(axis=1)
    touches = contacts(wrenches.time, force, loads.threshold, options.shortest * usual)
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
    usual = track.usual
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
    return FootTrack(
        place=track.place,
        strikes=_replaced(track.strikes, strikes, usual),
        lifts=_replaced(track.lifts, lifts, usual),
        seen=track.seen,
        source=source,
        period=track.period,
    )


def _replaced(events: Array, better: Sequence[float], usual: float) -> Array:
    """Put better events in the place of the nearest ones.

    The others are shifted by as much as those were off in the middle: a stride from an event of one
    kind to one of the other would be too long or too short by that.

    Parameters
    ----------
    events : (events,) [s]
    better : [s]
    usual : duration of a stride [s]

    Returns
    -------
    (events,) in order of time [s]
    """
    off = (
        [other - events[int(np.argmin(np.abs(events - other)))] for other in better]
        if len(events)
        else []
    )
    off = [difference for difference in off if abs(difference) <= NEAREST * usual]
    shift = float(np.median(off)) if off else 0.0
    shifted = [float(event) + shift for event in events]
    kept = [
        event
        for event in shifted
        if all(abs(event - other) > MIN_SEPARATION * usual for other in better)
    ]
    return np.array(sorted([*kept, *better]))


def ground_speed_of(
    tracks: Mapping[str, FootTrack], trunk: Array, travel: Travel, options: StrideOptions
) -> float:
    """How fast feet that stand move along the travel: the belt's speed, 0 over ground.

    Parameters
    ----------
    tracks : of the feet
    trunk : (frames, 3) its path [m], NaN where unseen
    travel : of the body
    options : from which share of the speed of travel on the ground moves

    Returns
    -------
    [m/s], negative on a belt
    """
    time = travel.time
    standing = []
    traveling = []
    trunk_speed = _speed(trunk, travel)
    for track in tracks.values():
        speed = _speed(track.place, travel)
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
    moves = abs(ground) > options.belt * abs(float(np.nanmedian(np.concatenate(traveling))))
    return ground if moves else 0.0


def _speed(path: Array, travel: Travel) -> Array:
    """Speed (frames,) of a path (frames, 3) along the travel [m/s]."""
    return np.asarray(np.einsum("fi,fi->f", np.gradient(path, travel.time, axis=0), travel.along))
