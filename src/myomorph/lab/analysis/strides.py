"""Strides of any number of legs: when each foot strikes and lifts, how long and how fast the
strides are.

Seen from the body a foot goes forward in swing and backward in stance, on a treadmill as over
ground: it strikes where it is farthest ahead and lifts where it is farthest behind (Zeni et al.
2008). Neither forces nor the height of the floor are needed; where plates tell, they go before.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Event, Series, Wrenches
from myomorph.core.model.shown import shown
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis import foot_events
from myomorph.lab.analysis.foot_events import FootTrack, StrideOptions
from myomorph.lab.causes import STRIDES


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
    direction : (3,) of travel
    ground_speed : of the ground, along `direction` [m/s]; negative on a treadmill, 0 over ground
    notes : what is missing, one line each
    """

    strides: tuple[Stride, ...]
    strikes: Mapping[str, Array]
    lifts: Mapping[str, Array]
    phases: Mapping[str, Array]
    direction: Array
    ground_speed: float
    notes: tuple[Message, ...] = ()

    def of(self, limb: str) -> tuple[Stride, ...]:
        """Strides of one limb; raises `UnknownName`."""
        index_of("limb", limb, tuple(self.strikes), "the strides")
        return tuple(stride for stride in self.strides if stride.limb == limb)


def find_strides(
    points: Series,
    limbs: Sequence[foot_events.Limb],
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
    """Strides of each limb: from plates where there are, else from a recording's events, else from
    points on the feet.

    Source: Zeni, Richards and Higginson 2008.

    Parameters
    ----------
    points : values (frames, points, 3) in ground [m], NaN where unseen
    limbs : legs, each with the points that tell strikes and lifts; see `analysis.foot_events.Limb`
    body : points of the trunk whose mean the feet are seen from
    up : (3,) unit vector against gravity
    direction : (3,) of travel; by default the way of the trunk, or, where it stays in place as on a
        treadmill, the way on which feet are faster in one direction than back (a guess, said in
        `notes`)
    ground_speed : of a belt [m/s], against the travel; by default 0 where the trunk travels, else
        what standing feet do
    wrenches : on the limbs' bodies; strikes and lifts that they show replace those of the points
    weight : of the body [N], needed with wrenches
    events : foot strikes and foot offs that the recording names ("Foot Strike", "Foot Off", with a
        side)
    running : the same of a run, from its flights; they replace those of the points, and events
        replace them
    facing : (3,) where the feet point on the whole; it decides where feet in place swing forward as
        fast as backward
    options : how strikes are told; see `StrideOptions`

    Returns
    -------
    strides with their times [s], lengths [m] and speeds [m/s], strikes and lifts of each limb [s],
    notes

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
        raise BadData(
            "plates tell contact by the share of body weight on them: the weight is missing"
        )
    trunk = _trunk(points, limbs, body)
    feet = {limb.name: _mean(points, limb.points) for limb in limbs}
    notes: list[Message] = []
    up = np.asarray(up, dtype=np.float64)
    along, travels = foot_events.direction_of(
        points.time, trunk, list(feet.values()), up, direction, notes, facing
    )
    tracks: dict[str, FootTrack] = {}
    sides = [split_side(limb.name)[1] for limb in limbs]
    # An event names a side: on a body with two feet of one side it is that of neither.
    alone = len(set(sides)) == len(sides)
    if events and not alone:
        notes.append(
            STRIDES.message(
                "events of the recording are not used: they name a side, on which there are several"
                " feet"
            )
        )
    for limb in limbs:
        foot = feet[limb.name]
        lifting = _mean(points, limb.lifting) if limb.lifting else foot
        track = foot_events.foot_track(points.time, foot, lifting, trunk, along, options)
        if alone:
            track = foot_events.on_events(
                foot_events.on_events(track, limb, running, "running"), limb, events
            )
        if wrenches is not None and weight is not None:
            span = float(points.time[0]), float(points.time[-1])
            track = foot_events.on_plates(
                track, limb, wrenches, up, weight * options.threshold, span, options
            )
        if len(track.strikes):
            tracks[limb.name] = track
        else:
            notes.append(
                STRIDES.message(f"{limb.name}: the foot is not seen to go forward and back")
            )
    ground = -abs(ground_speed) if ground_speed is not None else 0.0
    if ground_speed is None and not travels:
        ground = foot_events.ground_speed_of(points.time, tracks, trunk, along, options)
        if ground:
            advice = "as standing feet do; give the belt's speed if it is known"
            notes.append(STRIDES.message(f"the ground moves at {ground:.3g} m/s {advice}"))
    ways = along, np.cross(up, along)
    strides = [
        stride
        for name in tracks
        for stride in _strides(points.time, name, tracks, *ways, ground, options)
    ]
    strikes = {
        limb.name: tracks[limb.name].strikes if limb.name in tracks else np.zeros(0)
        for limb in limbs
    }
    lifts = {
        limb.name: tracks[limb.name].lifts if limb.name in tracks else np.zeros(0) for limb in limbs
    }
    phases = {
        name: _phases(strikes[limbs[0].name], track.strikes) for name, track in tracks.items()
    }
    strides.sort(key=lambda stride: stride.start)
    return Strides(
        strides=tuple(strides),
        strikes=FrozenMap(strikes),
        lifts=FrozenMap(lifts),
        phases=FrozenMap(phases),
        direction=frozen_array(along),
        ground_speed=ground,
        notes=tuple(notes),
    )


def _trunk(points: Series, limbs: Sequence[foot_events.Limb], body: Sequence[str]) -> Array:
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


def _strides(
    time: Array,
    name: str,
    tracks: Mapping[str, FootTrack],
    along: Array,
    across: Array,
    ground: float,
    options: StrideOptions,
) -> list[Stride]:
    track = tracks[name]
    usual = float(np.median(np.diff(track.strikes))) if len(track.strikes) > 1 else np.inf
    base, side = split_side(name)
    other = next(
        (
            foot
            for key, foot in tracks.items()
            if side and split_side(key)[0] == base and key != name
        ),
        None,
    )
    result = []
    for start, stop in itertools.pairwise(track.strikes):
        inside = (time >= start) & (time <= stop)
        seen = float(track.seen[inside].mean()) if inside.any() else 0.0
        lifts = track.lifts[(track.lifts > start) & (track.lifts < stop)]
        # Two strides in one: a strike between was not seen.
        if stop - start > 1.6 * usual or seen < options.seen or len(lifts) > 1:
            continue
        way = (_at(time, track.place, stop) - _at(time, track.place, start)) @ along - ground * (
            stop - start
        )
        width = np.nan
        step = np.nan
        between = (
            np.zeros(0)
            if other is None
            else other.strikes[(other.strikes > start) & (other.strikes < stop)]
        )
        if other is not None and len(between):
            struck = float(between[0])
            last = float(between[-1])
            # Distance of the other foot's strike from the line between two of this one.
            share = (struck - start) / (stop - start)
            place = (1.0 - share) * _at(time, track.place, start) + share * _at(
                time, track.place, stop
            )
            width = abs(float((_at(time, other.place, struck) - place) @ across))
            step = float(
                (_at(time, track.place, stop) - _at(time, other.place, last)) @ along
                - ground * (stop - last)
            )
        lift = float(lifts[0]) if len(lifts) else np.nan
        result.append(
            Stride(
                limb=name,
                start=float(start),
                lift=lift,
                stop=float(stop),
                length=float(way),
                width=width,
                seen=seen,
                source=track.source,
                step=step,
            )
        )
    return result


def _at(time: Array, place: Array, at: float) -> Array:
    known = np.isfinite(place[:, 0])
    return np.array([np.interp(at, time[known], place[known, i]) for i in range(3)])


def _phases(first: Array, strikes: Array) -> Array:
    """Share of each stride of the first limb at which the other strikes, NaN where it does not."""
    result = np.full(max(len(first) - 1, 0), np.nan)
    for index, (start, stop) in enumerate(itertools.pairwise(first)):
        inside = strikes[(strikes >= start) & (strikes < stop)]
        if len(inside):
            result[index] = (inside[0] - start) / (stop - start)
    return result
