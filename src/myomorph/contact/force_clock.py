"""Check of the clock of external forces: lags by the acceleration of the center of mass, and by the feet that stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.foot_poses import FootPoses
from myomorph.contact.force_balance import balance
from myomorph.contact.force_inspection import Inspection
from myomorph.model.arrays import Array, runs

CARRIED = 0.55
"""Share of the weight that walkers put on plates whenever all standing feet are on them."""

SHARP_MASS, SHARP_FEET = 0.7, 0.4
"""Part of the disagreement at no lag that may be left at the lag found: of the center of mass, and of standing feet."""

STEPS = 4
"""Steps from which standing feet alone are believed about the clock."""

CLOCK, SLACK = 0.022, 0.1
"""Lag of the plates that is named, and the largest that is looked for [s]."""


def check_clock(inspection: Inspection) -> None:
    """Plates that are late or early: by the feet that glide under load, and by what the center of mass needs."""
    lags = np.arange(-SLACK, SLACK + 1e-9, 0.005)
    found, lag, how = balance(inspection), 0.0, ""
    if found is not None:
        for frames in (_core(inspection), _between_steps(inspection, found[0])):
            by_mass, left = _least(lags, _unbalanced(inspection, *found, lags, frames))
            if left < SHARP_MASS and abs(by_mass) > CLOCK and not how:
                lag, how = by_mass, "by the acceleration of the center of mass"
    if not how:
        gliding = _gliding(inspection, lags)
        if gliding is None:
            return
        by_feet, left = _least(lags, gliding)
        if left < SHARP_FEET and abs(by_feet) > 1.5 * CLOCK:
            lag, how = by_feet, "by the feet that stand"
    if not how:
        return
    word = "late" if lag > 0 else "early"
    inspection.found(
        "clock",
        ", ".join(inspection.name(int(k)) for k in inspection.numbers),
        f"the forces seem {1000.0 * abs(lag):.0f} ms {word} against the motion, {how}",
        advice=f"shift them by {-1000.0 * lag:.0f} ms (--force-shift {-lag:.3f}), or synchronize the recordings",
    )


def _least(lags: Array, values: Array) -> tuple[float, float]:
    """The lag of the least value, by a parabola, and that value over the one at no lag."""
    k = int(np.argmin(values))
    lag = float(lags[k])
    if 0 < k < len(lags) - 1:
        a, b, c = values[k - 1 : k + 2]
        lag += 0.5 * float(lags[1] - lags[0]) * float((a - c) / max(a - 2.0 * b + c, 1e-300))
    return lag, float(values[k] / max(values[len(lags) // 2], 1e-300))


def _core(inspection: Inspection) -> NDArray[np.bool_]:
    """Frames (frames,) that no lag moves out of the recording."""
    time = inspection.feet.time
    return np.asarray((time > time[0] + SLACK) & (time < time[-1] - SLACK))


def _between_steps(inspection: Inspection, measured: Array) -> NDArray[np.bool_]:
    """Those among them (frames,) in which the plates carry most of the weight at every lag: from step to step."""
    time, weight = inspection.feet.time, inspection.feet.model.weight
    carries = measured @ inspection.feet.up > CARRIED * weight
    found = np.zeros(len(time), bool)
    for start, stop in runs(carries):
        found[start:stop] = (time[start:stop] > time[start] + SLACK) & (time[start:stop] < time[stop - 1] - SLACK)
    return found & _core(inspection)


def _unbalanced(
    inspection: Inspection, measured: Array, needed: Array, lags: Array, frames: NDArray[np.bool_]
) -> Array:
    """What the center of mass lacks in some frames at each lag (lags,), offsets taken off [N]."""
    time = inspection.feet.time
    if frames.sum() < 10 or frames.sum() * np.median(np.diff(time)) < 2.0 * SLACK:
        return np.ones(len(lags))
    found = []
    for lag in lags:
        late = np.column_stack([np.interp(time + lag, time, column) for column in measured.T])
        apart = (late - needed)[frames]
        found.append(float(np.sqrt(np.mean((apart - apart.mean(axis=0)) ** 2))))
    return np.array(found)


def _gliding(inspection: Inspection, lags: Array) -> Array | None:
    """Mean square speed of the feet at the centers of pressure at each lag, weighted by force (lags,) [m^2/s^2].

    A foot that stands does not glide: the material point at the center of pressure is at rest.
    """
    feet, samples = inspection.feet, inspection.samples
    time = feet.time
    centers = samples.centers(feet.up)
    used = [int(k) for k in inspection.numbers if len(inspection.episodes(int(k)))]
    steps = sum(len(inspection.episodes(k)) for k in used)
    if steps < STEPS or time[-1] - time[0] < 4.0 * SLACK or len(time) < 20:
        return None
    nearest = np.argmin(np.nan_to_num(feet.distances(centers), nan=9.0), axis=2)
    fields = [[_field(feet, body) for body in dict.fromkeys((foot.heel, foot.toes))] for foot in feet.feet]
    total, count = np.zeros(len(lags)), 0.0
    for k in used:
        weights = inspection.weights(k)
        frames = np.flatnonzero((weights > 0.0) & (time > time[0] + SLACK) & (time < time[-1] - SLACK))
        if not len(frames):
            continue
        speeds = np.empty((len(lags), len(frames), 3, 2))
        for row, lag in enumerate(lags):
            at = np.clip(np.searchsorted(time, time[frames] - lag), 0, len(time) - 1)
            for number in range(len(feet.feet)):
                mine = nearest[frames, k] == number
                for part in range(2):
                    origin, drift, spin = fields[number][min(part, len(fields[number]) - 1)]
                    here, now = at[mine], centers[frames[mine], k]
                    reach = np.einsum("fij,fj->fi", spin[here], now - origin[here])
                    speeds[row, mine, :, part] = drift[here] + reach
        firm = weights[frames] > 0.5 * inspection.feet.model.weight
        belt = np.median(speeds[len(lags) // 2, firm, :, 0], axis=0) if firm.sum() > 5 else np.zeros(3)
        belt = belt if np.linalg.norm(belt) > 0.3 else np.zeros(3)
        glide = np.linalg.norm(speeds - belt[None, None, :, None], axis=2).min(axis=2)
        total += (weights[frames] * np.minimum(glide, 1.5) ** 2).sum(axis=1)
        count += float(weights[frames].sum())
    return total / count if count else None


def _field(feet: FootPoses, body: str) -> tuple[Array, Array, Array]:
    """Origin, velocity of the origin and angular velocity (as a matrix) of a body in all frames."""
    rotations, origins = feet.pose_of(body)
    rates = np.gradient(rotations, feet.time, axis=0)
    return origins, np.gradient(origins, feet.time, axis=0), np.einsum("fij,fkj->fik", rates, rotations)
