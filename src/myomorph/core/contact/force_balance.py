"""Checks of external forces against the center of mass and the standing feet: directions, mass and
clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.force_inspection import (
    Change,
    FootPoses,
    ForceSamples,
    Inspection,
    belt_velocity,
    changed_wrenches,
    supported,
)
from myomorph.core.contact.force_placement import FITS, MARKED, NEAR
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.findings import Finding, Repair
from myomorph.core.motion.filters import lowpass

CUTOFF = 6.0  # Low-pass filter of the compared forces, of a human body [Hz]
MASS = 0.09  # Part by which plates and model may differ in weight
LIGHTEST = 0.4
HEAVIEST = 2.5
"""Plates that carry a share of the model's weight beyond these carry something else than a body, or
another unit.
"""
# How far that part may differ from frame to frame, where all of the weight is measured
SPREAD = 0.35


class Turn(NamedTuple):
    """A horizontal turn or reflection of the axes of forces."""

    kind: str
    text: str
    matrix: Array


def balance(inspection: Inspection) -> tuple[Array, Array] | None:
    """Measured and needed force (frames, 3), filtered alike [N]; None where the motion is too short
    or has gaps.
    """
    feet = inspection.feet
    steps = np.diff(feet.time)
    if len(feet.time) < 20 or steps.max() > 1.5 * steps.min() or not np.isfinite(feet.needed).all():
        return None
    if float(np.mean(steps)) > 0.03 or len(feet.feet) > 2:
        return None
    rate = 1.0 / float(np.mean(steps))
    cutoff = CUTOFF / np.sqrt(feet.unit)
    if rate < 2.5 * cutoff:
        return None
    measured = inspection.samples.forces.sum(axis=1)
    return np.asarray(lowpass(measured, rate, cutoff)), np.asarray(
        lowpass(feet.needed, rate, cutoff)
    )


def covered(inspection: Inspection, measured: Array, needed: Array) -> NDArray[np.bool_]:
    """Frames (frames,) in which the plates carry about what the center of mass needs."""
    up = inspection.feet.up
    weight = inspection.feet.model.weight
    carried = measured @ up
    wanted = needed @ up
    inside = np.zeros(len(carried), bool)
    margin = max(2, len(carried) // 25)
    inside[margin:-margin] = True
    return np.asarray(inside & (np.abs(carried - wanted) < 0.25 * weight) & (wanted > 0.4 * weight))


def turns(up: Array) -> list[Turn]:
    """Turns about the vertical by right angles and reflections of horizontal axes, the one that
    does nothing first.
    """
    across = np.eye(3)[np.argsort(np.abs(up))[:2]]
    a, b = across
    both = np.outer(up, up)
    names = ["xyz"[int(np.argmax(np.abs(values)))] for values in (a, b)]

    def made(x: Array, y: Array) -> Array:
        return np.asarray(np.outer(x, a) + np.outer(y, b) + both)

    return [
        Turn("", "", np.eye(3)),
        Turn("walking direction", "turned by 180 degrees", made(-a, -b)),
        Turn("walking direction", "turned by 90 degrees", made(b, -a)),
        Turn("walking direction", "turned by -90 degrees", made(-b, a)),
        Turn("mirrored axis", f"mirrored along {names[0]}", made(-a, b)),
        Turn("mirrored axis", f"mirrored along {names[1]}", made(a, -b)),
        Turn("mirrored axis", f"{names[0]} and {names[1]} exchanged", made(b, a)),
        Turn("mirrored axis", f"{names[0]} and {names[1]} exchanged and reversed", made(-b, -a)),
    ]


def check_directions(inspection: Inspection) -> Iterator[Finding]:
    """Horizontal axes of forces and points that are turned or mirrored against those of the motion."""
    choices = turns(inspection.feet.up)
    errors = _turn_errors(inspection, choices)
    forces = _turn_of_forces(inspection, choices, errors)
    points = _turn_of_points(inspection, choices, forces)
    # Points that are turned come with forces that are, unless the center of mass shows that these
    # are right.
    if points and not forces and (errors is None or errors[points] < 1.3 * errors[0]):
        forces = points
    if forces == points == 0:
        return
    if (
        points
        and not forces
        and np.linalg.det(choices[points].matrix) < 0.0
        and np.any(belt_velocity(inspection))
    ):
        # Plates of a belt that are mirrored about their own middle, not about the origin:
        # `check_mirrors` names them.
        return
    what = "forces and points" if forces == points else "forces" if points == 0 else "points"
    turn = choices[forces or points]
    numbers = inspection.numbers
    change = _changed(choices[forces].matrix, choices[points].matrix)
    repair = Repair(
        lambda wrenches: reduce(
            lambda turned, number: changed_wrenches(turned, number, change), numbers, wrenches
        ),
        "they were put right",
        "give them in the axes of the motion",
    )
    names = ", ".join(map(inspection.name, numbers))
    yield Finding(
        turn.kind, names, f"{what} of the plates are {turn.text} against the motion", repair=repair
    )


def _changed(forces: Array, points: Array) -> Change:
    """The change that turns forces and their moments, and points."""
    sign = float(np.sign(np.linalg.det(forces)))
    return lambda f, p, t: (f @ forces.T, p @ points.T, sign * t @ forces.T)


def _turn_errors(inspection: Inspection, choices: list[Turn]) -> Array | None:
    """What horizontal forces leave, turned each way, without them last [N^2]; None where too little
    acts.
    """
    result = balance(inspection)
    if result is None:
        return None
    measured, needed = result
    here = covered(inspection, measured, needed)
    time = inspection.feet.time
    if here.sum() < 15 or here.sum() * np.median(np.diff(time)) < 0.25:
        return None
    level = np.eye(3) - np.outer(inspection.feet.up, inspection.feet.up)
    measured = measured[here] @ level
    needed = needed[here] @ level
    if np.sqrt(np.mean(np.sum(measured**2, axis=1))) < 0.03 * inspection.feet.model.weight:
        return None
    turned = [measured @ choice.matrix.T for choice in choices]
    return np.array(
        [
            float(np.mean(np.sum((values - needed) ** 2, axis=1)))
            for values in (*turned, 0.0 * needed)
        ]
    )


def _turn_of_forces(inspection: Inspection, choices: list[Turn], errors: Array | None) -> int:
    """Which turn makes the horizontal forces accelerate the center of mass as it moves; 0 for none."""
    if errors is None:
        return 0
    best = int(np.argmin(errors[:-1]))
    if best:
        # Forces to one side only may not distinguish a turn from a reflection: the points do.
        alike = [index for index in range(1, len(choices)) if errors[index] < 1.5 * errors[best]]
        best = min(alike, key=lambda index: _turned_misfit(inspection, choices, index, index))
    # No turn makes sense of forces that the center of mass does not feel.
    return best if best and errors[best] < min(0.35 * errors[0], 0.5 * errors[-1]) else 0


def _turn_of_points(inspection: Inspection, choices: list[Turn], forces: int) -> int:
    """Which turn brings the centers of pressure under the feet; 0 for none."""
    unit = inspection.feet.unit
    used = [number for number in inspection.numbers if inspection.weights(number).any()]
    if not used:
        return 0

    def misfit(points: int) -> float:
        return _turned_misfit(inspection, choices, forces, points)

    before = misfit(0)
    if forces:
        # The same turn as the forces', unless the points are better as they are.
        return forces if misfit(forces) < max(before, NEAR * unit) else 0
    if before < NEAR * unit or any(inspection.misfit(number) < NEAR * unit for number in used):
        return 0
    left = [misfit(index) for index in range(len(choices))]
    best, second = np.argsort(left)[:2]
    clear = left[best] < min(FITS * unit, MARKED * before) and left[second] > 1.5 * left[best]
    return int(best) if clear else 0


def _turned_misfit(inspection: Inspection, choices: list[Turn], forces: int, points: int) -> float:
    """Mean distance of all centers of pressure to their feet with forces and points turned [m]."""
    used = [number for number in inspection.numbers if inspection.weights(number).any()]
    samples = inspection.samples
    for index in used:
        samples = changed_wrenches(
            samples, index, _changed(choices[forces].matrix, choices[points].matrix)
        )
    return (
        float(np.mean([_own_misfit(inspection, number, samples) for number in used]))
        if used
        else 0.0
    )


def _own_misfit(inspection: Inspection, number: int, samples: ForceSamples) -> float:
    """Mean distance of the center of pressure to the foot that the force is put on, or to the
    nearest [m].
    """
    feet = inspection.feet
    owner = feet.owners.get(inspection.wrenches.bodies[number])
    distances = np.nan_to_num(feet.distances(samples.centers(feet.up)[:, [number]])[:, 0])
    chosen = distances.min(axis=1) if owner is None else distances[:, owner]
    return float(np.average(chosen, weights=inspection.weights(number)))


def check_mass(inspection: Inspection) -> Iterator[Finding]:
    """The weight that the plates carry against that of the model, where all standing feet are on
    plates.
    """
    result = balance(inspection)
    if result is None:
        return
    up = inspection.feet.up
    model = inspection.feet.model
    time = inspection.feet.time
    carried = result[0] @ up
    wanted = result[1] @ up
    steady = supported(inspection) & (wanted > 0.5 * model.weight) & (carried > 0.0)
    margin = max(2, len(time) // 25)
    steady[:margin] = steady[-margin:] = False
    if steady.sum() < 15 or steady.sum() * np.median(np.diff(time)) < 0.3:
        return
    ratios = carried[steady] / wanted[steady]
    low, middle, high = np.percentile(ratios, [10, 50, 90])
    ratio = float(carried[steady].sum() / wanted[steady].sum())
    # A part of the weight that another contact carries changes; a wrong mass is the same in all
    # frames.
    if (
        high - low > SPREAD * middle
        or abs(ratio - middle) > 0.05
        or not LIGHTEST < ratio < HEAVIEST
        or abs(ratio - 1.0) < MASS
    ):
        return
    text = (
        f"the plates carry {ratio * model.mass:.1f} kg where all standing feet are on them, the"
        f" model weighs {model.mass:.1f} kg ({100.0 * (1.0 / ratio - 1.0):+.0f} %): scale the model"
        " to the subject's mass, or check the calibration of the plates"
    )
    yield Finding("mass", model.name, text)


# Share of the weight that walkers put on plates whenever all standing feet are on them
CARRIED = 0.55
SHARP_FEET = 0.4  # Part of the gliding of standing feet at no lag that may be left at the lag found
STEPS = 4  # Steps from which standing feet alone are believed about the clock
CLOCK = 0.012
SLACK = 0.1
"""Lag beyond its own uncertainty from which it is named, twice the largest of clean recordings (6
ms); and the largest that is looked for [s].
"""
LAGS = np.arange(-SLACK, SLACK + 1e-9, 0.005)  # That are tried [s]
CLOCK_OF_FEET = 0.033  # Lag by standing feet that is named [s]
SHORTEST = 0.3  # Time that the center of mass must be compared for [s]
EXPLAINED = 0.5
"""Share of the variance of the forces that the motion has to explain: 0.74 to 0.99 in clean
recordings, and 0.1 where a chair carries a part.
"""


class Lag(NamedTuple):
    """A lag of forces behind a motion."""

    # lag, sd: of the least disagreement, and its standard deviation [s]
    lag: float
    sd: float
    explained: float  # share of the measured forces' variance that the center of mass explains then


def check_clock(inspection: Inspection) -> Iterator[Finding]:
    """Plates that are late or early: by what the center of mass needs, else by the feet that glide
    under load.
    """
    balanced = lag_of_mass(inspection)
    if balanced is not None:
        # The center of mass of a model is off in time, too, by what clean recordings show.
        if abs(balanced.lag) - 2.0 * balanced.sd > CLOCK:
            sure = f" (±{2000.0 * balanced.sd:.0f} ms)"
            yield _late(inspection, balanced.lag, sure, "the acceleration of the center of mass")
        return
    gliding = _gliding(inspection, LAGS)
    if gliding is None:
        return
    by_feet, left = _least(LAGS, gliding)
    if left < SHARP_FEET and abs(by_feet) > CLOCK_OF_FEET:
        yield _late(inspection, by_feet, "", "the feet that stand")


def _late(inspection: Inspection, lag: float, sure: str, how: str) -> Finding:
    """Forces that are late (early where the lag is negative) [s]."""
    word = "late" if lag > 0 else "early"
    text = (
        f"the forces seem {1000.0 * abs(lag):.0f} ms {word}{sure} against the motion, by {how}:"
        f" shift them by {-1000.0 * lag:.0f} ms (--force-shift {-lag:.3f}), or synchronize the"
        " recordings"
    )
    return Finding("clock", ", ".join(map(inspection.name, inspection.numbers)), text)


def lag_of_mass(inspection: Inspection) -> Lag | None:
    """The lag at which the plates' forces accelerate the center of mass as it moves; None where
    they hardly do. The least of the squares of F(t + lag) - m (a - g), offsets taken off, over
    frames in which the plates carry all that the body stands on. Its standard deviation is that of
    a time by least squares, with as many independent samples as the low-pass filter leaves.
    """
    result = balance(inspection)
    if result is None:
        return None
    core = _core(inspection)
    # On treadmills and in flight all frames count, though stances of fast runners hardly show in
    # the feet's motion.
    parts = (supported(inspection) & core, _between_steps(inspection, result[0]), core)
    lags = (_lag(inspection, *result, frames) for frames in parts)
    known = [lag for lag in lags if lag is not None and lag.explained > EXPLAINED]
    return min(known, key=lambda value: value.sd, default=None)


def _lag(
    inspection: Inspection, measured: Array, needed: Array, frames: NDArray[np.bool_]
) -> Lag | None:
    """The lag by some frames (frames,); None where they are too few."""
    time = inspection.feet.time
    lasts = float(frames.sum() * np.median(np.diff(time)))
    if frames.sum() < 10 or lasts < SHORTEST:
        return None

    def part(values: Array, lag: float) -> Array:
        late = np.column_stack([np.interp(time + lag, time, column) for column in values.T])[frames]
        return np.asarray(late - late.mean(axis=0))

    wanted = part(needed, 0.0)
    lag, _ = _least(LAGS, np.array([np.sum((part(measured, lag) - wanted) ** 2) for lag in LAGS]))
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
    """Those among them (frames,) in which the plates carry most of the weight at every lag: from
    step to step.
    """
    time = inspection.feet.time
    weight = inspection.feet.model.weight
    carries = measured @ inspection.feet.up > CARRIED * weight
    result = np.zeros(len(time), bool)
    for start, stop in runs(carries):
        result[start:stop] = (time[start:stop] > time[start] + SLACK) & (
            time[start:stop] < time[stop - 1] - SLACK
        )
    return result & _core(inspection)


def _gliding(inspection: Inspection, lags: Array) -> Array | None:
    """Mean square speed of the feet at the centers of pressure at each lag, weighted by force
    (lags,) [m^2/s^2]. A foot that stands does not glide: the material point at the center of
    pressure is at rest.
    """
    feet = inspection.feet
    samples = inspection.samples
    time = feet.time
    centers = samples.centers(feet.up)
    used = [number for number in inspection.numbers if len(inspection.episodes(number))]
    steps = sum(len(inspection.episodes(number)) for number in used)
    if steps < STEPS or time[-1] - time[0] < 4.0 * SLACK or len(time) < 20:
        return None
    nearest = np.argmin(np.nan_to_num(feet.distances(centers), nan=9.0), axis=2)
    fields = [
        [_field(feet, body) for body in dict.fromkeys((foot.heel, foot.toes))] for foot in feet.feet
    ]
    total = np.zeros(len(lags))
    count = 0.0
    for index in used:
        weights = inspection.weights(index)
        frames = np.flatnonzero(
            (weights > 0.0) & (time > time[0] + SLACK) & (time < time[-1] - SLACK)
        )
        if not len(frames):
            continue
        speeds = np.empty((len(lags), len(frames), 3, 2))
        for row, lag in enumerate(lags):
            at = np.clip(np.searchsorted(time, time[frames] - lag), 0, len(time) - 1)
            for number in range(len(feet.feet)):
                mine = nearest[frames, index] == number
                for part in range(2):
                    origin, drift, spin = fields[number][min(part, len(fields[number]) - 1)]
                    here = at[mine]
                    now = centers[frames[mine], index]
                    reach = np.einsum("fij,fj->fi", spin[here], now - origin[here])
                    speeds[row, mine, :, part] = drift[here] + reach
        firm = weights[frames] > 0.5 * inspection.feet.model.weight
        belt = (
            np.median(speeds[len(lags) // 2, firm, :, 0], axis=0) if firm.sum() > 5 else np.zeros(3)
        )
        belt = belt if np.linalg.norm(belt) > 0.3 else np.zeros(3)
        glide = np.linalg.norm(speeds - belt[None, None, :, None], axis=2).min(axis=2)
        total += (weights[frames] * np.minimum(glide, 1.5) ** 2).sum(axis=1)
        count += float(weights[frames].sum())
    return total / count if count else None


def _field(feet: FootPoses, body: str) -> tuple[Array, Array, Array]:
    """Origin, velocity of the origin and angular velocity (as a matrix) of a body in all frames."""
    rotations, origins = feet.pose_of(body)
    rates = np.gradient(rotations, feet.time, axis=0)
    return (
        origins,
        np.gradient(origins, feet.time, axis=0),
        np.einsum("fij,fkj->fik", rates, rotations),
    )
