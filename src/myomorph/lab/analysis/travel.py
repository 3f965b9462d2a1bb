"""Direction of travel of a body from frame to frame, and where it stops or turns.

Over ground a body goes where its trunk gets to within a stride, so that neither sway nor the way of
a whole recording counts: who walks out and back goes two ways. In place, as on a belt or where
inertial sensors show angles alone, feet show the axis, and the faster way of their swing the
direction.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message, Span
from myomorph.lab.analysis.stride_period import mean_rate, stride_period
from myomorph.lab.causes import STRIDES

CLEAR = 0.4  # Skewness of the speeds of feet from which on their swing shows the direction
TRAVELS = 0.3  # A body goes over ground that is faster than this share of its feet's usual speed
STOPS = 0.5  # A body stops that is slower than this share of its own usual speed
STRAIGHT = np.radians(15.0)  # A way is straight within this angle of its direction as a whole
TURNS = np.radians(45.0)  # A body in place turns that faces ways so far apart
MAX_TURN = np.radians(30.0)  # Change of direction within a stride of straight gait
STANDS = 0.5  # Feet on the ground are slower than this share of the trunk's speed, ...
STANDING_SHARE = 20.0  # ... in this percentage of all frames at least
SHORT = 0.1  # Share of a stride over which a foot's speed is taken


class Course(NamedTuple):
    """How a body goes in a stretch of time.

    Attributes
    ----------
    direction : (3,) mean direction of travel, a unit vector
    is_straight : whether it neither stops nor turns by more than `MAX_TURN`
    """

    direction: Array
    is_straight: bool


@read_only
class Travel:
    """Which way a body goes in every frame.

    Attributes
    ----------
    time : (frames,) [s]
    along : (frames, 3) unit vectors across the vertical
    goes : (frames,) whether the body goes on rather than stopping or turning on the spot
    over_ground : whether it goes over the ground rather than in place
    period : usual duration of a stride [s], NaN where it was not seen
    notes : what was guessed
    """

    time: Array
    along: Array
    goes: np.ndarray
    over_ground: bool
    period: float = float("nan")
    notes: tuple[Message, ...] = ()

    @cached_property
    def is_one_way(self) -> bool:
        """Whether the direction is the same in all frames."""
        return bool((self.along == self.along[0]).all())

    @property
    def direction(self) -> Array:
        """Direction (3,) of most frames in which the body goes."""
        if self.is_one_way:
            return self.along[0]
        ways = self.along[self.goes] if self.goes.any() else self.along
        near = [(ways @ way > np.cos(STRAIGHT)).sum() for way in ways[:: max(len(ways) // 50, 1)]]
        best = ways[:: max(len(ways) // 50, 1)][int(np.argmax(near))]
        return _unit(ways[ways @ best > np.cos(STRAIGHT)].mean(axis=0))

    @property
    def stops(self) -> tuple[Span, ...]:
        """Stretches in which the body stops or turns on the spot, and goes on afterwards [s]."""
        last = len(self.goes) - 1
        inner = [(start, stop) for start, stop in runs(~self.goes) if start > 0 and stop <= last]
        return tuple((float(self.time[start]), float(self.time[stop])) for start, stop in inner)

    def along_at(self, time: Array) -> Array:
        """Return the direction of the nearest frame.

        Parameters
        ----------
        time : (times,) [s]

        Returns
        -------
        (times, 3) unit vectors
        """
        return self.along[self._nearest(time)]

    def course(self, start: float, stop: float) -> Course:
        """Return how the body goes from one time to another [s]."""
        first, last = self._nearest(np.array([start, stop]))
        ways = self.along[first : last + 1]
        mean = ways.mean(axis=0)
        if not np.linalg.norm(mean) > 0.0:
            return Course(direction=ways[0], is_straight=False)
        direction = ways[0] if self.is_one_way else _unit(mean)
        # From one extreme to the other, within half a turn
        sides = np.cross(direction, ways)
        away = np.arctan2(np.linalg.norm(sides, axis=1), ways @ direction)
        signs = np.sign(sides @ _dominant(sides))
        straight = float(np.ptp(away * signs)) <= MAX_TURN
        return Course(
            direction=direction,
            is_straight=bool(self.goes[first : last + 1].all() and straight),
        )

    def _nearest(self, time: Array) -> np.ndarray:
        """Index of the frame nearest to each time (times,)."""
        middles = 0.5 * (self.time[1:] + self.time[:-1])
        return np.searchsorted(middles, time)


@read_only
class FootPaths:
    """Paths of trunk and feet.

    Attributes
    ----------
    time : (frames,) [s]
    trunk : (frames, 3) [m], NaN where unseen
    feet : of each foot (frames, 3) [m], NaN where unseen
    up : (3,) unit vector against gravity
    """

    time: Array
    trunk: Array
    feet: tuple[Array, ...]
    up: Array

    @property
    def level(self) -> Array:
        """Projection (3, 3) onto the ground."""
        return np.eye(3) - np.outer(self.up, self.up)

    @cached_property
    def relative(self) -> tuple[Array, ...]:
        """Of each foot its path (frames, 3) over the ground as the trunk sees it [m]."""
        return tuple((foot - self.trunk) @ self.level for foot in self.feet)

    @cached_property
    def foot_velocities(self) -> Array:
        """Velocities (samples, 3) of all feet as the trunk sees them, where they are seen [m/s]."""
        rates = np.concatenate([np.gradient(foot, self.time, axis=0) for foot in self.relative])
        return np.asarray(rates[np.isfinite(rates[:, 0])])

    @cached_property
    def foot_speed(self) -> float:
        """Usual speed of a foot as the trunk sees it [m/s]."""
        return float(np.median(np.linalg.norm(self.foot_velocities, axis=1)))

    @cached_property
    def period(self) -> float:
        """Usual duration of a stride [s], NaN where none repeats."""
        return stride_period(self.time, self.relative)

    @cached_property
    def overall(self) -> Array:
        """Mean velocity (3,) of the trunk over the ground, by a line through its path [m/s]."""
        seen = np.isfinite(self.trunk[:, 0])
        span = self.time[seen] - self.time[seen].mean()
        path = self.trunk[seen] @ self.level
        return np.asarray(span @ path / max(float(span @ span), 1e-12))

    @cached_property
    def velocities(self) -> Array:
        """Velocities (frames, 3) of the trunk over the ground, each over a stride [m/s]."""
        return mean_rate(self.time, self.trunk @ self.level, self.period)

    def one_way(self, direction: Array, over_ground: bool, *notes: Message) -> Travel:
        """Go in one direction in all frames.

        Parameters
        ----------
        direction : (3,) unit vector
        over_ground : whether the body goes over the ground
        notes : what was guessed

        Returns
        -------
        the travel
        """
        return Travel(
            time=self.time,
            along=np.tile(direction, (len(self.time), 1)),
            goes=np.ones(len(self.time), np.bool_),
            over_ground=over_ground,
            period=self.period,
            notes=notes,
        )


def travel_of(
    paths: FootPaths, direction: Array | None = None, facing: Array | None = None
) -> Travel:
    """Find which way a body goes.

    Parameters
    ----------
    paths : of trunk and feet
    direction : (3,) of travel in all frames, None to find it
    facing : (3,) or (frames, 3) where the feet point, or None. It decides where feet in place swing
        forward as fast as backward, and shows turns of a body in place

    Returns
    -------
    the travel

    Raises
    ------
    BadData : no foot is seen beside the trunk, or the given direction is vertical
    """
    if not len(paths.foot_velocities):
        raise BadData(
            "no foot is seen in frames in which the trunk is: there is no direction of travel"
        )
    # Over ground the trunk is as fast as feet that stand are seen from it; on a belt it only
    # drifts.
    gets_away = bool(np.linalg.norm(paths.overall) > TRAVELS * paths.foot_speed)
    if direction is not None:
        stated = np.asarray(direction, dtype=np.float64) @ paths.level
        if not np.linalg.norm(stated) > 0.0:
            raise BadData("the direction of travel is vertical, or no direction at all")
        return paths.one_way(_unit(stated), gets_away)
    if not np.isfinite(paths.period):
        return (
            paths.one_way(_unit(paths.overall), over_ground=True)
            if gets_away
            else _in_place(paths, facing)
        )
    if gets_away or _goes_to_and_fro(paths):
        return _over_ground(paths, gets_away)
    return _in_place(paths, facing)


def _goes_to_and_fro(paths: FootPaths) -> bool:
    """Whether a body that ends where it began was elsewhere, on feet that stand.

    On a belt feet that stand are as fast as the belt, and the trunk only drifts.
    """
    speeds = np.linalg.norm(paths.velocities, axis=1)
    usual = float(np.percentile(speeds, 75.0))
    if not usual > TRAVELS * paths.foot_speed:
        return False
    rates = [
        np.linalg.norm(mean_rate(paths.time, foot @ paths.level, SHORT * paths.period), axis=1)
        for foot in paths.feet
        if np.isfinite(foot[:, 0]).sum() > 1
    ]
    return bool(np.percentile(np.concatenate(rates), STANDING_SHARE) < STANDS * usual)


def _over_ground(paths: FootPaths, gets_away: bool) -> Travel:
    """Travel by the trunk's velocity over a stride: one way where it is straight."""
    velocities = paths.velocities
    speeds = np.linalg.norm(velocities, axis=1)
    fast = speeds > TRAVELS * paths.foot_speed
    if not fast.any():
        return paths.one_way(_unit(paths.overall), over_ground=True)
    goes = speeds > STOPS * float(np.median(speeds[fast]))
    ways = velocities[goes] / speeds[goes, None]
    overall = _unit(paths.overall) if gets_away else np.zeros(3)
    if (ways @ overall).min() >= np.cos(STRAIGHT):
        along = np.tile(overall, (len(paths.time), 1))
    else:
        # Who stops keeps the direction of the frame nearest in which he went.
        nearest = np.searchsorted(
            0.5 * (np.flatnonzero(goes)[1:] + np.flatnonzero(goes)[:-1]), np.arange(len(goes))
        )
        along = ways[nearest]
    return Travel(
        time=paths.time,
        along=along,
        goes=goes,
        over_ground=True,
        period=paths.period,
    )


def _in_place(paths: FootPaths, facing: Array | None) -> Travel:
    """Travel of a body whose trunk stays: along the axis of its feet, where their swing is fast."""
    faced = None if facing is None else np.atleast_2d(facing) @ paths.level
    turning = _turning(paths, faced)
    if turning is not None:
        return turning
    seen_feet = [foot[np.isfinite(foot[:, 0])] for foot in paths.relative]
    swept = np.concatenate([foot - np.median(foot, axis=0) for foot in seen_feet if len(foot)])
    # A marker that was taken for another one for a while does not turn the way.
    far = np.linalg.norm(swept, axis=1)
    swept = swept[far <= np.percentile(far, 95.0)]
    axis = np.linalg.svd(swept, full_matrices=False)[2][0]
    skew = _skewness(paths.foot_velocities @ axis)
    reason = "feet swing fastest"
    if faced is not None and abs(skew) < CLEAR:
        skew = float(np.nanmean(faced, axis=0) @ axis)
        reason = "feet point"
    axis = axis if skew > 0.0 else -axis
    text = f"direction of travel {np.round(axis, 2).tolist()} is where {reason}"
    note = STRIDES.message(f"{text}; give it if it is not")
    return paths.one_way(frozen_array(axis), False, note)


def _turning(paths: FootPaths, faced: Array | None) -> Travel | None:
    """Travel of a body that turns in place, as inertial sensors show it; None where it does not.

    Parameters
    ----------
    faced : (frames, 3) or (1, 3) where the feet point, or None
    """
    if faced is None or len(faced) != len(paths.time) or not np.isfinite(paths.period):
        return None
    known = np.isfinite(faced[:, 0])
    if known.sum() < 2:
        return None
    # The running integral of what was seen: its rate over a stride is the mean.
    filled = np.stack([np.interp(paths.time, paths.time[known], way[known]) for way in faced.T], 1)
    steps = 0.5 * (filled[1:] + filled[:-1]) * np.diff(paths.time)[:, None]
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    means = mean_rate(paths.time, sums, paths.period)
    lengths = np.linalg.norm(means, axis=1)
    if not (lengths > 0.0).all():
        return None
    along = means / lengths[:, None]
    if float((along @ along.T[:, :: max(len(along) // 50, 1)]).min()) > np.cos(TURNS):
        return None
    forward = np.concatenate(
        [(np.gradient(foot, paths.time, axis=0) * along).sum(axis=1) for foot in paths.relative]
    )
    skew = _skewness(forward[np.isfinite(forward)])
    backward = skew < -CLEAR
    return Travel(
        time=paths.time,
        along=-along if backward else along,
        goes=np.ones(len(along), np.bool_),
        over_ground=False,
        period=paths.period,
    )


def _skewness(values: Array) -> float:
    """Skewness of values (samples,)."""
    away = values - values.mean()
    return float(np.mean(away**3)) / max(float(np.mean(away**2)) ** 1.5, 1e-12)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def _dominant(vectors: Array) -> Array:
    """Return the longest (3,) of vectors (n, 3)."""
    longest: Array = vectors[int(np.argmax((vectors**2).sum(axis=1)))]
    return longest
