"""Strides of any number of legs: foot strikes, foot offs, durations, lengths and speeds.

Seen from the body a foot goes forward in swing and backward in stance, on a treadmill as over
ground: it strikes where it is farthest ahead and lifts where it is farthest behind (Zeni et al.
2008). Neither forces nor the height of the floor are needed; where plates tell, they go before.

Ahead is where the body goes at the time (`travel`). Strides in which it turns or stops are left
out, whatever showed their strikes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import times_text
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.message_groups import joined_spans
from myomorph.core.model.messages import Message, Span
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Event, Series, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis import foot_events
from myomorph.lab.analysis.foot_events import FootTrack, Limb, PlateLoads, StrideOptions
from myomorph.lab.analysis.phases import LONGEST
from myomorph.lab.analysis.travel import FootPaths, Travel, travel_of
from myomorph.lab.causes import STRIDES

FLYING = 0.5  # Share of the steps of a run that have a flight
RUN_STRIKE = "Foot Strike"


@shown
@dataclass(frozen=True)
class Stride:
    """From one strike of a foot to its next.

    Attributes
    ----------
    limb : name
    start, lift, stop : strike, lift and next strike [s]; the lift is nan where it was not seen
    length : way of the foot over the ground along the direction of travel [m]
    width : step width: distance to the other side's track, across the direction of travel [m]; nan
        without another side
    seen : share of the stride in which the foot was seen
    source : "markers", "running", "events" or "plates", what showed the strikes
    step : step length: way from the other foot's last strike to the one that ends the stride [m];
        nan without one
    """

    limb: str
    start: float
    lift: float
    stop: float
    length: float
    width: float
    seen: float
    source: str
    step: float = float("nan")

    @property
    def duration(self) -> float:
        """[s]."""
        return self.stop - self.start

    @property
    def duty(self) -> float:
        """Share of stance in the stride (duty factor)."""
        return (self.lift - self.start) / self.duration

    @property
    def speed(self) -> float:
        """Of travel [m/s]."""
        return self.length / self.duration


@read_only
class Strides:
    """All strides of a recording.

    Attributes
    ----------
    strides : of all limbs, in order of time
    strikes, lifts : by limb, (events,) [s]
    phases : of each limb against the first: its strike, as a share of the first limb's stride (0
        together, 0.5 in turn), one value for each of those strides; none where the first limb was
        not seen to strike
    direction : (3,) of travel; of a body that turns, its direction in most frames
    ground_speed : of the ground, along the travel [m/s]; negative on a treadmill, 0 over ground
    notes : what is missing, one line each
    travel : direction in every frame, None where it was not looked for
    left_out : of strides in which the body turns or stops, by limb [s]
    """

    strides: tuple[Stride, ...]
    strikes: Mapping[str, Array]
    lifts: Mapping[str, Array]
    phases: Mapping[str, Array]
    direction: Array
    ground_speed: float
    notes: tuple[Message, ...] = ()
    travel: Travel | None = None
    left_out: Mapping[str, tuple[Span, ...]] = field(default_factory=lambda: FrozenMap({}))

    def of(self, limb: str) -> tuple[Stride, ...]:
        """Strides of one limb; raises `UnknownName`."""
        index_of("limb", limb, tuple(self.strikes), "the strides")
        return tuple(stride for stride in self.strides if stride.limb == limb)


def find_strides(  # page: points and legs, and what is known of a recording, all of it optional
    points: Series,
    limbs: Sequence[Limb],
    body: Sequence[str],
    up: Array,
    *,
    direction: Array | None = None,
    ground_speed: float | None = None,
    wrenches: Wrenches | None = None,
    weight: float | None = None,
    events: Sequence[Event] = (),
    running: Sequence[Event] = (),
    facing: Array | None = None,
    options: StrideOptions | None = None,
) -> Strides:
    """Find the strides of each limb, from plates where there are any.

    Without plates they come from a recording's events, else from points on the feet.

    Source: Zeni, Richards and Higginson 2008.

    Parameters
    ----------
    points : values (frames, points, 3) in ground [m], NaN where unseen
    limbs : legs, each with the points that show foot strikes and foot offs; see
        `analysis.foot_events.Limb`
    body : points of the trunk whose mean the feet are seen from
    up : (3,) unit vector against gravity
    direction : (3,) of travel; by default the way of the trunk, that within a stride where the
        recording goes out and back or turns, or, where the trunk stays in place as on a treadmill,
        the way on which feet are faster in one direction than back (a guess, reported in `notes`)
    ground_speed : of a belt [m/s], against the travel; by default 0 where the trunk travels, else
        what standing feet do
    wrenches : on the limbs' bodies; foot strikes and foot offs that they show replace those of the
        points
    weight : of the body [N], needed with wrenches
    events : foot strikes and foot offs that the recording names ("Foot Strike", "Foot Off", with a
        side)
    running : the same of a run, from its flights; they replace those of the points, and events
        replace them. Where most steps have no flight they are not used
    facing : (3,) or (frames, 3) where the feet point; it decides where feet in place swing forward
        as fast as backward, and in every frame shows turns in place
    options : how foot strikes are found; see `StrideOptions`

    Returns
    -------
    strides with their times [s], lengths [m] and speeds [m/s], foot strikes and foot offs of each
        limb [s], notes

    Raises
    ------
    BadData : no limb, points without a third axis, wrenches without a weight, or a trunk that is
        never seen
    UnknownName : a point is not there

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> time = np.arange(0.0, 6.0, 0.01)
    >>> foot = time + np.sin(2.0 * np.pi * time) / 7.0
    >>> values = np.stack([np.stack([x, 0.0 * x, 0.0 * x], axis=1) for x in (foot, time)], axis=1)
    >>> points = mm.Series(time, ("heel", "trunk"), values)
    >>> leg = mm.Limb("leg", ("heel",))
    >>> found = mm.find_strides(points, [leg], ["trunk"], np.array([0.0, 1.0, 0.0]))
    >>> [round(one.length, 2) for one in found.of("leg")]
    [1.0, 1.0, 1.0, 1.0, 1.0]
    """
    options = options or StrideOptions()
    if wrenches is not None and not (weight is not None and weight > 0.0):
        raise BadData("contacts from plates need the body weight")
    trunk = _trunk(points, limbs, body)
    feet = {limb.name: _mean(points, limb.points) for limb in limbs}
    up = np.asarray(up, dtype=np.float64)
    paths = FootPaths(time=points.time, trunk=trunk, feet=tuple(feet.values()), up=up)
    travel = travel_of(paths, direction, facing)
    notes: list[Message] = list(travel.notes)

    tracks = {}
    for limb in limbs:
        lifting = _mean(points, limb.lifting) if limb.lifting else feet[limb.name]
        tracks[limb.name] = foot_events.foot_track(feet[limb.name], lifting, trunk, travel, options)
    if _sides_differ(limbs):
        tracks = _on_events(tracks, limbs, running, events)
    else:
        notes += _unused_events(events)
    if wrenches is not None and weight is not None:
        loads = PlateLoads(
            wrenches=wrenches,
            up=up,
            threshold=weight * options.threshold,
            span=(float(points.time[0]), float(points.time[-1])),
        )
        for limb in limbs:
            track = tracks[limb.name]
            tracks[limb.name] = foot_events.on_plates(track, limb, loads, options)

    notes += _without_strikes(tracks)
    stepping = {name: track for name, track in tracks.items() if len(track.strikes)}
    if ground_speed is not None:
        ground = -abs(ground_speed)
    elif travel.over_ground:
        ground = 0.0
    else:
        ground = foot_events.ground_speed_of(stepping, trunk, travel, options)
        notes += _belt_notes(ground)
    gait = _Gait(tracks=FrozenMap(stepping), travel=travel, up=up, ground=ground, options=options)
    return _result(gait, [limb.name for limb in limbs], notes)


def _unused_events(events: Sequence[Event]) -> list[Message]:
    """Report events that name a side, where several limbs are of that side."""
    if not events:
        return []
    text = "events of the recording are not used: they name a side, on which there are several feet"
    return [STRIDES.message(text)]


def _belt_notes(ground: float) -> list[Message]:
    """Report the speed of a belt [m/s] that standing feet show, where it moves."""
    if not ground:
        return []
    advice = "as standing feet do; give the belt's speed if it is known"
    return [STRIDES.message(f"the ground moves at {ground:.3g} m/s {advice}")]


def _sides_differ(limbs: Sequence[Limb]) -> bool:
    """Check that no two limbs are of one side.

    An event names a side: on a body with two feet of one side it is that of neither.
    """
    sides = [split_side(limb.name)[1] for limb in limbs]
    return len(set(sides)) == len(sides)


def _without_strikes(tracks: Mapping[str, FootTrack]) -> list[Message]:
    return [
        STRIDES.message(f"{name}: the foot does not move forward and back")
        for name, track in tracks.items()
        if not len(track.strikes)
    ]


def _on_events(
    tracks: Mapping[str, FootTrack],
    limbs: Sequence[Limb],
    running: Sequence[Event],
    events: Sequence[Event],
) -> dict[str, FootTrack]:
    """Put events of a run, then those of the recording, in the place of those of the points."""
    found = dict(tracks)
    # Noise of the points may look like a flight now and then; who runs flies with most steps.
    struck = sum(event.label == RUN_STRIKE for event in running)
    runs = struck >= FLYING * sum(len(track.strikes) for track in tracks.values())
    for limb in limbs:
        track = found[limb.name]
        if runs:
            track = foot_events.on_events(track, limb, running, "running")
        found[limb.name] = foot_events.on_events(track, limb, events)
    return found


@read_only
class _Gait:
    """Feet that step, and the ground that they step on.

    Attributes
    ----------
    tracks : by limb, those that were seen to step
    travel : of the body
    up : (3,) unit vector against gravity
    ground : its speed along the travel [m/s]
    options : what counts as a stride
    """

    tracks: Mapping[str, FootTrack]
    travel: Travel
    up: Array
    ground: float
    options: StrideOptions

    def other(self, name: str) -> FootTrack | None:
        """Return the track of the same foot of the other side."""
        base, side = split_side(name)
        return next(
            (
                track
                for key, track in self.tracks.items()
                if side and split_side(key)[0] == base and key != name
            ),
            None,
        )


def _result(gait: _Gait, limbs: Sequence[str], notes: Sequence[Message]) -> Strides:
    """Strides of all limbs, in order of time, and what was left out."""
    whole = [
        stride for name in gait.tracks for stride in _strides(gait, name) if stride is not None
    ]
    whole.sort(key=lambda stride: stride.start)
    chosen = _straight(gait, whole)
    strikes = {
        name: gait.tracks[name].strikes if name in gait.tracks else np.zeros(0) for name in limbs
    }
    lifts = {
        name: gait.tracks[name].lifts if name in gait.tracks else np.zeros(0) for name in limbs
    }
    phases = {
        name: _phases(gait, strikes[limbs[0]], track.strikes) for name, track in gait.tracks.items()
    }
    return Strides(
        strides=chosen.strides,
        strikes=FrozenMap(strikes),
        lifts=FrozenMap(lifts),
        phases=FrozenMap(phases),
        direction=frozen_array(gait.travel.direction),
        ground_speed=gait.ground,
        notes=(*notes, *chosen.notes),
        travel=gait.travel,
        left_out=chosen.left_out,
    )


class _Chosen(NamedTuple):
    """Strides that count, those that were left out by limb [s], and a note on them."""

    strides: tuple[Stride, ...]
    left_out: Mapping[str, tuple[Span, ...]]
    notes: tuple[Message, ...]


def _straight(gait: _Gait, whole: Sequence[Stride]) -> _Chosen:
    """Leave out strides in which the body turns or stops, unless it does so in all of them."""
    goes = [gait.travel.course(one.start, one.stop).is_straight for one in whole]
    kept = tuple(one for one, straight in zip(whole, goes, strict=True) if straight)
    curved = [one for one, straight in zip(whole, goes, strict=True) if not straight]
    if curved and not kept:
        spans = joined_spans((one.start, one.stop) for one in curved)
        text = "the body turns or stops in every stride: lengths and speeds are along its mean way"
        return _Chosen(tuple(curved), FrozenMap({}), (STRIDES.message(text, times=spans),))
    left_out = {
        name: tuple((one.start, one.stop) for one in curved if one.limb == name)
        for name in gait.tracks
    }
    spans = joined_spans([*gait.travel.stops, *((one.start, one.stop) for one in curved)])
    if not spans:
        return _Chosen(kept, FrozenMap(left_out), ())
    text = f"strides in which the body turns or stops are left out: {times_text(spans)}"
    note = STRIDES.message(text, times=spans, severity="good to know")
    return _Chosen(kept, FrozenMap(left_out), (note,))


def _trunk(points: Series, limbs: Sequence[Limb], body: Sequence[str]) -> Array:
    """(frames, 3) of the trunk; raises `BadData` where strides cannot be found from the points."""
    if not limbs:
        raise BadData("no limb is named: strides need at least one")
    if points.values.ndim != 3:
        raise BadData(
            f"points of feet have shape {points.values.shape}: expected (frames, points, 3)"
        )
    trunk = _mean(points, body)
    if np.isfinite(trunk[:, 0]).sum() < foot_events.MIN_FRAMES:
        raise BadData(
            f"the points of the trunk, {', '.join(body)}, are seen in under"
            f" {foot_events.MIN_FRAMES} frames"
        )
    return trunk


def _mean(points: Series, names: Sequence[str]) -> Array:
    """(frames, 3) mean of points, NaN where one of them is unseen."""
    columns = [index_of("point", name, points.names, "the recording") for name in names]
    return points.values[:, columns].mean(axis=1)


def _strides(gait: _Gait, name: str) -> list[Stride | None]:
    """Return strides of a limb from each strike to the next, None where one is not whole."""
    track = gait.tracks[name]
    usual = float(np.median(np.diff(track.strikes))) if len(track.strikes) > 1 else np.inf
    return [
        _stride(gait, name, float(start), float(stop), usual)
        for start, stop in itertools.pairwise(track.strikes)
    ]


def _stride(gait: _Gait, name: str, start: float, stop: float, usual: float) -> Stride | None:
    """Return the stride from one strike to another; None where it is two, or was not seen.

    Parameters
    ----------
    usual : duration of the limb's strides [s]
    """
    track = gait.tracks[name]
    time = gait.travel.time
    inside = (time >= start) & (time <= stop)
    seen = float(track.seen[inside].mean()) if inside.any() else 0.0
    lifts = track.lifts[(track.lifts > start) & (track.lifts < stop)]
    # Two strides in one: a strike between was not seen.
    if stop - start > LONGEST * usual or seen < gait.options.seen or len(lifts) > 1:
        return None
    along = gait.travel.course(start, stop).direction
    first = _at(time, track.place, start)
    last = _at(time, track.place, stop)
    step = _step_over(gait, name, start, stop)
    return Stride(
        limb=name,
        start=start,
        lift=float(lifts[0]) if len(lifts) else np.nan,
        stop=stop,
        length=float((last - first) @ along - gait.ground * (stop - start)),
        width=step.width,
        seen=seen,
        source=track.source,
        step=step.length,
    )


class _Step(NamedTuple):
    """Step width and length [m], NaN where the other foot was not seen to strike."""

    width: float
    length: float


def _step_over(gait: _Gait, name: str, start: float, stop: float) -> _Step:
    """Return width and length of the step that ends a stride, past the other foot."""
    track = gait.tracks[name]
    other = gait.other(name)
    if other is None:
        return _Step(width=np.nan, length=np.nan)
    between = other.strikes[(other.strikes > start) & (other.strikes < stop)]
    if not len(between):
        return _Step(width=np.nan, length=np.nan)
    time = gait.travel.time
    along = gait.travel.course(start, stop).direction
    across = np.cross(gait.up, along)
    struck = float(between[0])
    last = float(between[-1])
    # Distance of the other foot's strike from the line between two of this one
    share = (struck - start) / (stop - start)
    begin = _at(time, track.place, start)
    end = _at(time, track.place, stop)
    place = (1.0 - share) * begin + share * end
    ahead = (end - _at(time, other.place, last)) @ along
    return _Step(
        width=abs(float((_at(time, other.place, struck) - place) @ across)),
        length=float(ahead - gait.ground * (stop - last)),
    )


def _at(time: Array, place: Array, at: float) -> Array:
    known = np.isfinite(place[:, 0])
    return np.array([np.interp(at, time[known], place[known, i]) for i in range(3)])


def _phases(gait: _Gait, first: Array, strikes: Array) -> Array:
    """Phase of a limb in each stride of the first limb.

    Parameters
    ----------
    gait : in which the body may turn or stop
    first : (strikes,) of the first limb [s]
    strikes : (strikes,) of the limb [s]

    Returns
    -------
    (strides,) share of each stride of the first limb at which the other strikes, NaN where it does
    not, and where the body turns or stops
    """
    result = np.full(max(len(first) - 1, 0), np.nan)
    for index, (start, stop) in enumerate(itertools.pairwise(first)):
        inside = strikes[(strikes >= start) & (strikes < stop)]
        if len(inside) and gait.travel.course(float(start), float(stop)).is_straight:
            result[index] = (inside[0] - start) / (stop - start)
    return result
