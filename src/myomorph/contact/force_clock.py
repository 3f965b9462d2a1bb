"""Check of the clock of external forces: lags by the acceleration of the center of mass, and by the feet that stand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.force_balance import CUTOFF, balance
from myomorph.contact.force_inspection import FootPoses, Inspection, supported
from myomorph.model.arrays import Array, runs
from myomorph.model.findings import Finding

CARRIED = 0.55  # Share of the weight that walkers put on plates whenever all standing feet are on them
SHARP_FEET = 0.4  # Part of the gliding of standing feet at no lag that may be left at the lag found
STEPS = 4  # Steps from which standing feet alone are believed about the clock
CLOCK, SLACK = 0.012, 0.1
"""Lag beyond its own uncertainty from which it is named, twice the largest of clean recordings (6 ms); and the largest
that is looked for [s]."""

CLOCK_OF_FEET = 0.033  # Lag by standing feet that is named [s]
SHORTEST = 0.3  # Time that the center of mass must be compared for [s]
EXPLAINED = 0.5
"""Share of the variance of the forces that the motion has to explain: 0.74 to 0.99 in clean recordings, and 0.1 where a
chair carries a part."""


class Lag(NamedTuple):
    """A lag of forces behind a motion."""

    # lag, sd: of the least disagreement, and its standard deviation [s]
    lag: float
    sd: float
    explained: float  # share of the measured forces' variance that the center of mass explains then


def check_clock(inspection: Inspection) -> Iterator[Finding]:
    """Plates that are late or early: by what the center of mass needs, else by the feet that glide under load."""
    balanced = lag_of_mass(inspection)
    if balanced is not None:
        # The center of mass of a model is off in time, too, by what clean recordings show.
        if abs(balanced.lag) - 2.0 * balanced.sd > CLOCK:
            sure = f" (±{2000.0 * balanced.sd:.0f} ms)"
            yield _late(inspection, balanced.lag, sure, "the acceleration of the center of mass")
        return
    lags = np.arange(-SLACK, SLACK + 1e-9, 0.005)
    gliding = _gliding(inspection, lags)
    if gliding is None:
        return
    by_feet, left = _least(lags, gliding)
    if left < SHARP_FEET and abs(by_feet) > CLOCK_OF_FEET:
        yield _late(inspection, by_feet, "", "the feet that stand")


def _late(inspection: Inspection, lag: float, sure: str, how: str) -> Finding:
    """Forces that are late (early where the lag is negative) [s]."""
    word = "late" if lag > 0 else "early"
    text = (
        f"the forces seem {1000.0 * abs(lag):.0f} ms {word}{sure} against the motion, by {how}: shift them by "
        f"{-1000.0 * lag:.0f} ms (--force-shift {-lag:.3f}), or synchronize the recordings"
    )
    return Finding("clock", ", ".join(map(inspection.name, inspection.numbers)), text)


def lag_of_mass(inspection: Inspection) -> Lag | None:
    """The lag at which the plates' forces accelerate the center of mass as it moves; None where they hardly do.
    The least of the squares of F(t + lag) - m (a - g), offsets taken off, over frames in which the plates carry all
    that the body stands on. Its standard deviation is that of a time by least squares, with as many independent
    samples as the low-pass filter leaves.
    """
    result = balance(inspection)
    if result is None:
        return None
    core = _core(inspection)
    # On treadmills and in flight all frames count, though stances of fast runners hardly show in the feet's motion.
    parts = (supported(inspection) & core, _between_steps(inspection, result[0]), core)
    lags = (_lag(inspection, *result, frames) for frames in parts)
    known = [lag for lag in lags if lag is not None and lag.explained > EXPLAINED]
    return min(known, key=lambda value: value.sd, default=None)


def _lag(inspection: Inspection, measured: Array, needed: Array, frames: NDArray[np.bool_]) -> Lag | None:
    """The lag by some frames (frames,); None where they are too few."""
    time = inspection.feet.time
    lasts = float(frames.sum() * np.median(np.diff(time)))
    if frames.sum() < 10 or lasts < SHORTEST:
        return None
    lags = np.arange(-SLACK, SLACK + 1e-9, 0.005)

    def part(values: Array, lag: float) -> Array:
        late = np.column_stack([np.interp(time + lag, time, column) for column in values.T])[frames]
        return np.asarray(late - late.mean(axis=0))

    wanted = part(needed, 0.0)
    lag, _ = _least(lags, np.array([np.sum((part(measured, lag) - wanted) ** 2) for lag in lags]))
    best = part(measured, lag)
    left = float(np.mean((best - wanted) ** 2))
    slope = float(np.mean(part(np.gradient(measured, time, axis=0), lag) ** 2))
    independent = measured.shape[1] * max(1.0, 2.0 * lasts * CUTOFF / np.sqrt(inspection.feet.unit))
    sd = float(np.sqrt(left / max(slope, 1e-300) / independent))
    return Lag(lag, sd, 1.0 - left / max(float(np.mean(best**2)), 1e-300))


def _least(lags: Array, values: Array) -> tuple[float, float]:
    """The lag of the least value, by a parabola, and that value over the one at no lag."""
    index = int(np.argmin(values))
    lag = float(lags[index])
    if 0 < index < len(lags) - 1:
        a, b, c = values[index - 1 : index + 2]
        lag += 0.5 * float(lags[1] - lags[0]) * float((a - c) / max(a - 2.0 * b + c, 1e-300))
    return lag, float(values[index] / max(values[len(lags) // 2], 1e-300))


def _core(inspection: Inspection) -> NDArray[np.bool_]:
    """Frames (frames,) that no lag moves out of the recording."""
    time = inspection.feet.time
    return np.asarray((time > time[0] + SLACK) & (time < time[-1] - SLACK))


def _between_steps(inspection: Inspection, measured: Array) -> NDArray[np.bool_]:
    """Those among them (frames,) in which the plates carry most of the weight at every lag: from step to step."""
    time, weight = inspection.feet.time, inspection.feet.model.weight
    carries = measured @ inspection.feet.up > CARRIED * weight
    result = np.zeros(len(time), bool)
    for start, stop in runs(carries):
        result[start:stop] = (time[start:stop] > time[start] + SLACK) & (time[start:stop] < time[stop - 1] - SLACK)
    return result & _core(inspection)


def _gliding(inspection: Inspection, lags: Array) -> Array | None:
    """Mean square speed of the feet at the centers of pressure at each lag, weighted by force (lags,) [m^2/s^2].
    A foot that stands does not glide: the material point at the center of pressure is at rest.
    """
    feet, samples = inspection.feet, inspection.samples
    time = feet.time
    centers = samples.centers(feet.up)
    used = [number for number in inspection.numbers if len(inspection.episodes(number))]
    steps = sum(len(inspection.episodes(number)) for number in used)
    if steps < STEPS or time[-1] - time[0] < 4.0 * SLACK or len(time) < 20:
        return None
    nearest = np.argmin(np.nan_to_num(feet.distances(centers), nan=9.0), axis=2)
    fields = [[_field(feet, body) for body in dict.fromkeys((foot.heel, foot.toes))] for foot in feet.feet]
    total, count = np.zeros(len(lags)), 0.0
    for index in used:
        weights = inspection.weights(index)
        frames = np.flatnonzero((weights > 0.0) & (time > time[0] + SLACK) & (time < time[-1] - SLACK))
        if not len(frames):
            continue
        speeds = np.empty((len(lags), len(frames), 3, 2))
        for row, lag in enumerate(lags):
            at = np.clip(np.searchsorted(time, time[frames] - lag), 0, len(time) - 1)
            for number in range(len(feet.feet)):
                mine = nearest[frames, index] == number
                for part in range(2):
                    origin, drift, spin = fields[number][min(part, len(fields[number]) - 1)]
                    here, now = at[mine], centers[frames[mine], index]
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
