"""Times at which no plate measures what acts on a foot: another body is on it too, or the foot stands beside all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy

from myomorph.contact.force_inspection import CARRIED, FOOT, LOADED, MOVES, PAUSE, ground_velocity, sole_distances
from myomorph.contact.states import steady
from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding, spans_of, times_text
from myomorph.model.series import Wrenches

UNDETERMINED = "load not determined"  # Kind of a finding, whose place is the body of the foot
BESIDE = 0.75  # A center of pressure farther from a foot's middle line, over its length, is not the foot's alone
CLOSER = 0.6  # Nor is one that is not nearer than this share of its distance to another foot that stands
LOW = 0.25  # A foot stands at most so high above feet on plates, over its length


def undetermined_loads(
    wrenches: Wrenches, places: Mapping[str, Array], weight: float, up: Array
) -> tuple[Finding, ...]:
    """Times at which the measured forces do not say what acts on a foot, a finding for each foot that has any.
    A load is a foot's while the center of pressure lies under it and nearer than to other feet that stand; a foot that
    swings has none. `wrenches`: on the feet; `places`: foot to its heel and ball (samples, 2, 3) at the same times, NaN
    where unseen [m]; `weight`: of the body [N]; `up` (3,) against gravity.
    """
    heels, balls = (np.stack([place[:, end] for place in places.values()], axis=1) for end in (0, 1))
    time, owned = wrenches.time, np.array([[body == foot for body in wrenches.bodies] for foot in places])
    loaded = np.nan_to_num(np.linalg.norm(wrenches.forces, axis=2)) > LOADED * weight
    carried = np.stack([(loaded & mine).any(axis=1) for mine in owned], axis=1)
    lowest = np.minimum(heels @ up, balls @ up)
    if len(time) < 3 or not np.isfinite(lowest[carried]).any():
        return ()
    lengths = np.nanmedian(np.linalg.norm(balls - heels, axis=2), axis=0)
    shortest, low = PAUSE * np.sqrt(lengths.mean() / FOOT), np.nanmedian(lowest[carried]) + LOW * lengths
    velocities = np.gradient(np.stack([heels, balls], axis=2), time, axis=0)
    seen = carried.any(axis=1) & np.isfinite(velocities).all(axis=(1, 2, 3))
    belt = ground_velocity(velocities.reshape(len(time), -1, 3), seen)
    speeds = np.linalg.norm(velocities - belt, axis=3).min(axis=2)
    stands = (speeds < MOVES * np.sqrt(lengths.mean() / FOOT)) & (lowest < low)
    # Noise of plates moves the center of pressure of a light body far from sample to sample.
    size = max(1, round(shortest / float(np.median(np.diff(time)))))
    lift = np.linalg.norm(np.nan_to_num(wrenches.forces), axis=2, keepdims=True)
    turning = scipy.ndimage.uniform_filter1d(lift * np.nan_to_num(wrenches.points), size, axis=0)
    points = turning / np.maximum(scipy.ndimage.uniform_filter1d(lift, size, axis=0), 1e-12)
    distances = sole_distances(points, heels, balls, up)
    others = np.where(stands[:, None, None] & ~np.eye(len(places), dtype=bool), distances[:, :, None], np.inf)
    limits = np.minimum(BESIDE * lengths, CLOSER * others.min(axis=3))
    shared = (loaded[..., None] & owned.T & (distances > limits)).any(axis=1)
    shared |= stands & ~carried & shared.any(axis=1, keepdims=True)
    findings = []
    for number, foot in enumerate(places):
        elsewhere = np.zeros(len(time), bool)
        for start, stop in runs(steady((stands | carried)[:, number], time, shortest)):
            elsewhere[start:stop] = carried[start:stop, number].mean() <= CARRIED
        unknown = steady(shared[:, number] | elsewhere, time, shortest)
        spans = [span for span in spans_of(time, unknown) if span[1] - span[0] > shortest]
        if spans:
            reasons = ["the center of pressure is not under it alone"] if (shared[:, number] & unknown).any() else []
            reasons += ["it stands where no plate carries it"] if (elsewhere & unknown).any() else []
            share = 100.0 * unknown.sum() / np.isfinite(lowest[:, number]).sum()
            when = f"in {share:.0f} % of the time ({times_text(spans)})"
            text = f"the load on '{foot}' is not determined {when}: {', or '.join(reasons)}"
            findings.append(Finding(UNDETERMINED, foot, f"{text}: torques of its joints are wrong there", tuple(spans)))
    return tuple(findings)
