"""Feet whose load is not determined: they share a plate, or stand off all plates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.force_inspection import (
    CARRIED,
    FOOT,
    LOADED,
    MOVES,
    PAUSE,
    ground_velocity,
    sole_distances,
)
from myomorph.core.contact.spells import steady
from myomorph.core.fit.trends import running_mean
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.causes import FEET_BESIDE
from myomorph.core.model.findings import Finding, spans_of, times_text
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Wrenches

Flags = NDArray[np.bool_]

UNDETERMINED = "load not determined"  # Kind of a finding, whose place is the body of the foot
MAX_OFFSET = 0.75  # Of a foot's own center of pressure from its middle line, over its length
MAX_NEARNESS = 0.6  # Of that offset to the distance from another foot that stands
MAX_STEP = 0.25  # Height of a standing foot above feet on plates, over its length
STILL = 0.25
"""Of the speed of a standing foot, at which a foot that is higher stands still."""
RESTS = 0.2
"""Duration for which a higher foot of a person is still at least on a step [s]."""
MISSING = 0.2
"""Share of the weight that plates must lack meanwhile, on the mean: else the foot is held up."""


@read_only
class Feet:
    """Heels and balls of all feet over time.

    Attributes
    ----------
    names : bodies of the feet
    time : (frames,) [s]
    heels, balls : (frames, feet, 3) in ground, NaN where unseen [m]
    up : (3,) unit vector against gravity
    """

    names: tuple[str, ...]
    time: Array
    heels: Array
    balls: Array
    up: Array

    @cached_property
    def heights(self) -> Array:
        """(frames, feet) of the lower end of each foot [m]."""
        return np.minimum(self.heels @ self.up, self.balls @ self.up)

    @cached_property
    def lengths(self) -> Array:
        """(feet,) from heel to ball [m]."""
        return np.nanmedian(np.linalg.norm(self.balls - self.heels, axis=2), axis=0)

    @property
    def time_scale(self) -> float:
        """Times and speeds over those of a human foot, by Froude: the root of lengths."""
        return float(np.sqrt(self.lengths.mean() / FOOT))

    @property
    def min_duration(self) -> float:
        """Duration below which a change of state is noise [s]."""
        return PAUSE * self.time_scale

    def standing(self, carried: Flags) -> Flags:
        """Frames in which each foot rests on the ground, or on the belt of a treadmill.

        Parameters
        ----------
        carried : (frames, feet) whether a plate carries the foot

        Returns
        -------
        (frames, feet)
        """
        ends = np.stack([self.heels, self.balls], axis=2)
        velocities = np.gradient(ends, self.time, axis=0)
        seen = carried.any(axis=1) & np.isfinite(velocities).all(axis=(1, 2, 3))
        belt = ground_velocity(velocities.reshape(len(self.time), -1, 3), seen)
        speeds = np.linalg.norm(velocities - belt, axis=3).min(axis=2)
        max_heights = np.nanmedian(self.heights[carried]) + MAX_STEP * self.lengths
        return (speeds < MOVES * self.time_scale) & (self.heights < max_heights)

    def on_steps(self, wrenches: Wrenches, weight: float, standing: Flags) -> Flags:
        """Frames in which a foot rests on something above the plates: a step, a stool, a rail.

        It is still there, heel and ball, while the plates carry less than the body weighs. A foot
        that is held up is still as well, but then the plates carry the whole body.

        Parameters
        ----------
        wrenches : of all plates
        weight : of the body [N]
        standing : (frames, feet) as of `standing`

        Returns
        -------
        (frames, feet)
        """
        vertical = np.nan_to_num(wrenches.forces @ self.up).sum(axis=1)
        ends = np.stack([self.heels, self.balls], axis=2)
        speeds = np.linalg.norm(np.gradient(ends, self.time, axis=0), axis=3).max(axis=2)
        still = (speeds < STILL * MOVES * self.time_scale) & ~standing
        result = np.zeros(still.shape, bool)
        for foot in range(len(self.names)):
            for start, stop in runs(still[:, foot]):
                lasts = self.time[stop - 1] - self.time[start]
                lacks = vertical[start:stop].mean() < (1.0 - MISSING) * weight
                if lasts >= RESTS * self.time_scale and lacks:
                    result[start:stop, foot] = True
        return result


def undetermined_loads(
    wrenches: Wrenches, places: Mapping[str, Array], weight: float, up: Array
) -> tuple[Finding, ...]:
    """Find the times at which the measured forces do not determine the load on a foot.

    A load belongs to a foot while the center of pressure lies under it, and clearly nearer to it
    than to another foot that stands. A foot that swings has no load.

    Parameters
    ----------
    wrenches : on the feet, (frames, forces, 3)
    places : foot -> its heel and ball at the same times (frames, 2, 3), NaN where unseen [m]
    weight : of the body [N]
    up : (3,) unit vector against gravity

    Returns
    -------
    a finding for each foot that has such times
    """
    feet = Feet(
        names=tuple(places),
        time=wrenches.time,
        heels=np.stack([place[:, 0] for place in places.values()], axis=1),
        balls=np.stack([place[:, 1] for place in places.values()], axis=1),
        up=up,
    )
    loaded = np.nan_to_num(np.linalg.norm(wrenches.forces, axis=2)) > LOADED * weight
    owned = np.equal.outer(np.array(feet.names, object), np.array(wrenches.bodies, object))
    carried = (loaded[:, None] & owned).any(axis=2)
    if len(feet.time) < 3 or not np.isfinite(feet.heights[carried]).any():
        return ()

    stands = feet.standing(carried)
    stands |= feet.on_steps(wrenches, weight, stands | carried)
    outside, shared = _shared_loads(feet, wrenches, loaded, owned, stands)
    # A foot that stands while another's load is shared may carry a part of it.
    shared |= stands & ~carried & shared.any(axis=1, keepdims=True)

    findings = []
    for number, foot in enumerate(feet.names):
        off_plates = _stances_off_plates(
            feet, stands[:, number] | carried[:, number], carried[:, number]
        )
        unknown = steady(shared[:, number] | off_plates, feet.time, feet.min_duration)
        spans = [
            (start, stop)
            for start, stop in spans_of(feet.time, unknown)
            if stop - start > feet.min_duration
        ]
        if not spans:
            continue
        reasons = []
        if (shared[:, number] & unknown).any():
            beside = ", at times beside all feet" if (outside[:, number] & unknown).any() else ""
            reasons.append(f"the center of pressure is not under it alone{beside}")
        if (off_plates & unknown).any():
            reasons.append("it stands where no plate carries it")
        share = float(unknown.sum() / np.isfinite(feet.heights[:, number]).sum())
        text = _message(foot, share, spans, reasons)
        findings.append(Finding(kind=UNDETERMINED, place=foot, text=text, times=tuple(spans)))
    return tuple(findings)


def _message(
    foot: str, share: float, spans: Sequence[tuple[float, float]], reasons: Sequence[str]
) -> Message:
    """Say that the load on a foot is not determined, when and why."""
    return FEET_BESIDE.message(
        f"the load on '{foot}' is not determined in {100.0 * share:.0f} % of the time"
        f" ({times_text(spans)}): {', or '.join(reasons)}: torques of its joints are wrong there",
        size=100.0 * share,
        share=share,
    )


def _shared_loads(
    feet: Feet, wrenches: Wrenches, loaded: Flags, owned: Flags, stands: Flags
) -> tuple[Flags, Flags]:
    """Frames in which a foot's load lies beside all feet, and in which it is not its alone.

    Parameters
    ----------
    loaded : (frames, forces) whether a force counts as a load
    owned : (feet, forces) whether a force is assigned to a foot
    stands : (frames, feet)

    Returns
    -------
    (frames, feet) each; the second holds the first
    """
    centers = centers_of_pressure(wrenches, feet.min_duration)
    distances = sole_distances(centers, feet.heels, feet.balls, feet.up)  # (frames, forces, feet)
    # On axes (frames, forces, foot, other foot): only other feet that stand compete for a load.
    competes = stands[:, None, None] & ~np.eye(len(feet.names), dtype=bool)
    to_others = np.where(competes, distances[:, :, None], np.inf).min(axis=3)
    limits = np.minimum(MAX_OFFSET * feet.lengths, MAX_NEARNESS * to_others)
    has_load = loaded[..., None] & owned.T
    beside = (distances > MAX_OFFSET * feet.lengths).all(axis=2, keepdims=True)
    outside = np.asarray((has_load & beside).any(axis=1))
    return outside, np.asarray((has_load & (distances > limits)).any(axis=1))


def centers_of_pressure(wrenches: Wrenches, duration: float) -> Array:
    """Centers of pressure, averaged over a duration with the forces as weights.

    Noise of plates moves the center of pressure of a light body far from frame to frame.

    Parameters
    ----------
    wrenches : of plates
    duration : of the moving average [s]

    Returns
    -------
    (frames, forces, 3) in ground [m]
    """
    window = max(1, round(duration / float(np.median(np.diff(wrenches.time)))))
    weights = np.linalg.norm(np.nan_to_num(wrenches.forces), axis=2, keepdims=True)
    weighted_points = weights * np.nan_to_num(wrenches.points)
    mean_points = running_mean(weighted_points, window)
    mean_weights = running_mean(weights, window)
    return mean_points / np.maximum(mean_weights, 1e-12)


def _stances_off_plates(feet: Feet, on_ground: Flags, carried: Flags) -> Flags:
    """Frames of one foot's stances that no plate carries; all arrays (frames,)."""
    result = np.zeros(len(feet.time), bool)
    for start, stop in runs(steady(on_ground, feet.time, feet.min_duration)):
        result[start:stop] = carried[start:stop].mean() <= CARRIED
    return result
