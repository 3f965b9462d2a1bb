"""Checks of external forces against the center of mass and the standing feet.

They concern directions, mass and clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.force_inspection import (
    GAIN,
    TURNED_PLATE,
    Change,
    FootPoses,
    ForceSamples,
    Inspection,
    belt_velocity,
    changed_wrenches,
    supported,
)
from myomorph.core.contact.force_placement import FITS, MARKED, NEAR, shared_frames
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import CLOCKS, PLATES, WEIGHT
from myomorph.core.model.findings import Finding, Repair
from myomorph.core.model.severity import FORCE_ERROR, severity_of
from myomorph.core.motion.filters import lowpass

CUTOFF = 6.0
"""Low-pass filter of the compared forces, of a human body [Hz]."""
MASS = 0.09
"""Part by which plates and model may differ in weight."""
LIGHTEST = 0.4
HEAVIEST = 2.5
"""Plates that carry a share of the model's weight beyond these carry something else than a body, or
another unit.
"""
SPREAD = 0.35
"""How far that part may differ from frame to frame, where all of the weight is measured."""


RISES = 0.15
"""Way of the center of mass of a body that rises from a seat, of a human foot [m]."""
CARRIED = 0.55
"""Share of the weight that walkers put on plates whenever all standing feet are on them."""
SHARP_FEET = 0.4
"""Part of the gliding of standing feet at no lag that may be left at another lag."""
STEPS = 4
"""Number of steps from which standing feet alone are believed about the clock."""
CLOCK = 0.012
SLACK = 0.1
"""Lag beyond its own uncertainty from which it is named, twice the largest of clean recordings (6
ms); and the largest that is looked for [s].
"""
LAGS = np.arange(-SLACK, SLACK + 1e-9, 0.005)
"""Lags that are tried [s]."""
CLOCK_OF_FEET = 0.033
"""Lag by standing feet that is named [s]."""
SHORTEST = 0.3
"""Time that the center of mass must be compared for [s]."""
EXPLAINED = 0.5
"""Share of the variance of the forces that the motion has to explain: 0.74 to 0.99 in clean
recordings, and 0.1 where a chair carries a part.
"""


class Turn(NamedTuple):
    """A horizontal turn or reflection of the axes of forces.

    Attributes
    ----------
    kind, text : of a finding
    matrix : (3, 3)
    """

    kind: str
    text: str
    matrix: Array


class BalancedForces(NamedTuple):
    """Force that plates measure and that the center of mass needs, (frames, 3) each [N]."""

    measured: Array
    needed: Array


def balance(inspection: Inspection) -> BalancedForces | None:
    """Filter measured and needed force alike; None where the motion is too short or has gaps.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (frames, 3) both [N]
    """
    feet = inspection.feet
    steps = np.diff(feet.time)
    if len(feet.time) < 20 or steps.max() > 1.5 * steps.min() or not np.isfinite(feet.needed).all():
        return None
    if float(np.mean(steps)) > 0.03 or len(feet.feet) > 2:
        return None
    rate = 1.0 / float(np.mean(steps))
    cutoff = cutoff_of(inspection)
    if rate < 2.5 * cutoff:
        return None
    return BalancedForces(
        measured=np.asarray(lowpass(inspection.samples.forces.sum(axis=1), rate, cutoff)),
        needed=np.asarray(lowpass(feet.needed, rate, cutoff)),
    )


def cutoff_of(inspection: Inspection) -> float:
    """Low-pass filter of the compared forces, of a body of this size [Hz]."""
    return float(CUTOFF / np.sqrt(inspection.feet.unit))


def covered(inspection: Inspection, measured: Array, needed: Array) -> NDArray[np.bool_]:
    """Find frames in which the plates carry about what the center of mass needs.

    Parameters
    ----------
    inspection : forces with the motion
    measured, needed : (frames, 3) [N]

    Returns
    -------
    (frames,)
    """
    up = inspection.feet.up
    weight = inspection.feet.model.weight
    carried = measured @ up
    wanted = needed @ up
    inside = np.zeros(len(carried), bool)
    margin = max(2, len(carried) // 25)
    inside[margin:-margin] = True
    return np.asarray(inside & (np.abs(carried - wanted) < 0.25 * weight) & (wanted > 0.4 * weight))


def turns(up: Array) -> list[Turn]:
    """Make turns about the vertical by right angles, and reflections of horizontal axes.

    The one that does nothing comes first.

    Parameters
    ----------
    up : (3,)

    Returns
    -------
    eight turns
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
    """Find axes of forces and points that are turned or mirrored against the motion's."""
    if any(finding.kind == TURNED_PLATE for finding in inspection.findings):
        return
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
    if points and not forces and _mirrored_on_belt(inspection, choices[points]):
        return
    what = "forces" if points == 0 else "points"
    if forces == points:
        what = "forces and points"
    turn = choices[forces or points]
    numbers = inspection.numbers
    change = _changed(choices[forces].matrix, choices[points].matrix)
    repair = Repair(
        lambda wrenches: reduce(
            lambda turned, number: changed_wrenches(turned, number, change), numbers, wrenches
        ),
        "they were corrected",
        "give them in the axes of the motion",
    )
    names = ", ".join(map(inspection.name, numbers))
    yield Finding(
        turn.kind,
        names,
        PLATES.message(f"{what} of the plates are {turn.text} against the motion"),
        repair=repair,
    )


def _mirrored_on_belt(inspection: Inspection, turn: Turn) -> bool:
    """Return whether points of a belt are mirrored.

    Its plates are mirrored about their own middle, not about the origin: `check_mirrors` names
    them.
    """
    return bool(np.linalg.det(turn.matrix) < 0.0 and np.any(belt_velocity(inspection)))


def _changed(forces: Array, points: Array) -> Change:
    """Make the change that turns forces and their moments, and points, by (3, 3) matrices."""
    sign = float(np.sign(np.linalg.det(forces)))
    return lambda f, p, t: (f @ forces.T, p @ points.T, sign * t @ forces.T)


def _turn_errors(inspection: Inspection, choices: list[Turn]) -> Array | None:
    """Mean square of what horizontal forces leave, turned each way, and without them last.

    Returns
    -------
    (turns + 1,) [N^2]; None where too little acts
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
    """Find the turn by which forces accelerate the center of mass as it moves; 0 for none.

    Parameters
    ----------
    errors : (turns + 1,) of `_turn_errors`
    """
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
    """Find the turn that brings the centers of pressure under the feet; 0 for none."""
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
    """Mean distance [m] of all centers of pressure to their feet, forces and points turned."""
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
    """Mean distance [m] of a center of pressure to the foot it is put on, or to the nearest."""
    feet = inspection.feet
    owner = feet.owners.get(inspection.wrenches.bodies[number])
    distances = np.nan_to_num(feet.distances(samples.centers(feet.up)[:, [number]])[:, 0])
    chosen = distances.min(axis=1) if owner is None else distances[:, owner]
    return float(np.average(chosen, weights=inspection.weights(number)))


class WeightRatio(NamedTuple):
    """What plates carry over what the center of mass needs, over some frames.

    Attributes
    ----------
    mean : of the sums over time
    median : over the frames
    spread : range that holds eight of ten frames
    """

    mean: float
    median: float
    spread: float

    @property
    def is_even(self) -> bool:
        """Whether it is about the same in all frames.

        A part of the weight that another contact carries changes; a wrong mass does not.
        """
        return self.spread <= SPREAD * self.median and abs(self.mean - self.median) <= 0.05


def check_mass(inspection: Inspection) -> Iterator[Finding]:
    """Compare the weight on plates with the model's, where all standing feet are on plates."""
    result = balance(inspection)
    if result is None or any(finding.kind == GAIN for finding in inspection.findings):
        return
    ratio = _weight_ratio(inspection, result)
    if ratio is None or not LIGHTEST < ratio < HEAVIEST or abs(ratio - 1.0) < MASS:
        return
    mass = inspection.feet.model.mass
    difference = 100.0 * (1.0 / ratio - 1.0)
    text = WEIGHT.message(
        f"the plates carry {ratio * mass:.1f} kg where all standing feet are on them, the"
        f" model weighs {mass:.1f} kg ({difference:+.0f} %): scale the model"
        " to the subject's mass, or check the calibration of the plates",
        size=difference,
        severity=severity_of(difference, 100.0 * FORCE_ERROR),
    )
    yield Finding("mass", ", ".join(map(inspection.name, inspection.numbers)), text)


def _weight_ratio(inspection: Inspection, forces: BalancedForces) -> float | None:
    """Divide what plates carry by what the body needs; None where that changes over time."""
    up = inspection.feet.up
    weight = inspection.feet.model.weight
    time = inspection.feet.time
    carried = forces.measured @ up
    wanted = forces.needed @ up
    steady = (wanted > 0.5 * weight) & (carried > 0.0)
    margin = max(2, len(time) // 25)
    steady[:margin] = False
    steady[-margin:] = False
    step = float(np.median(np.diff(time)))
    for frames in _weighing_frames(inspection):
        used = frames & steady
        if used.sum() < 15 or used.sum() * step < 0.3:
            continue
        ratios = carried[used] / wanted[used]
        low, middle, high = np.percentile(ratios, [10, 50, 90])
        mean = float(carried[used].sum() / wanted[used].sum())
        ratio = WeightRatio(mean=mean, median=float(middle), spread=float(high - low))
        if ratio.is_even:
            return ratio.mean
    return None


def _weighing_frames(inspection: Inspection) -> Iterator[NDArray[np.bool_]]:
    """Choose frames (frames,) in which plates may carry all of the body, the surest first.

    They are those in which all feet that stand are on plates; of a body that rises from a seat
    those in which it is up; and those in which two feet share a plate.
    """
    feet = inspection.feet
    stands = supported(inspection)
    yield stands
    height = feet.center @ feet.up
    low = float(height.min())
    high = float(height.max())
    if high - low > RISES * feet.unit:
        yield stands & (height > 0.5 * (low + high))
    yield shared_frames(inspection)


class Lag(NamedTuple):
    """A lag of forces behind a motion.

    Attributes
    ----------
    lag, sd : of the least disagreement, and its standard deviation [s]
    explained : share of the measured forces' variance that the center of mass explains then
    """

    lag: float
    sd: float
    explained: float


def check_clock(inspection: Inspection) -> Iterator[Finding]:
    """Find plates that are late or early, by the center of mass, else by feet that glide."""
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
    """Name forces that are late (early where the lag is negative) [s]."""
    word = "late" if lag > 0 else "early"
    text = CLOCKS.message(
        f"the forces seem {1000.0 * abs(lag):.0f} ms {word}{sure} against the motion, by {how}:"
        f" shift them by {-1000.0 * lag:.0f} ms (--force-shift {-lag:.3f}), or synchronize the"
        " recordings",
        size=1000.0 * abs(lag),
    )
    return Finding("clock", ", ".join(map(inspection.name, inspection.numbers)), text)


def lag_of_mass(inspection: Inspection) -> Lag | None:
    """Find the lag at which the plates' forces accelerate the center of mass best.

        minimize  sum |F(t + lag) - m (a - g)|^2,    offsets taken off

    over frames in which the plates carry all that the body stands on. Its standard deviation is
    that of a time by least squares, with as many independent samples as the low-pass filter leaves.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    the lag with its standard deviation [s]; None where it explains little
    """
    result = balance(inspection)
    if result is None:
        return None
    core = core_frames(inspection)
    # On treadmills and in flight all frames count, though stances of fast runners hardly show in
    # the feet's motion.
    parts = (supported(inspection) & core, between_steps(inspection, result[0]), core)
    lags = (_lag(inspection, *result, frames) for frames in parts)
    known = [lag for lag in lags if lag is not None and lag.explained > EXPLAINED]
    return min(known, key=lambda value: value.sd, default=None)


def _lag(
    inspection: Inspection, measured: Array, needed: Array, frames: NDArray[np.bool_]
) -> Lag | None:
    """Lag by some frames (frames,); None where they are too few.

    Parameters
    ----------
    measured, needed : (frames, 3) [N]
    """
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
    """Lag of the least value, by a parabola, and that value over the one at no lag.

    Parameters
    ----------
    lags, values : (lags,) [s], and of the disagreement
    """
    index = int(np.argmin(values))
    lag = float(lags[index])
    if 0 < index < len(lags) - 1:
        a, b, c = values[index - 1 : index + 2]
        lag += 0.5 * float(lags[1] - lags[0]) * float((a - c) / max(a - 2.0 * b + c, 1e-300))
    return lag, float(values[index] / max(values[len(lags) // 2], 1e-300))


def core_frames(inspection: Inspection) -> NDArray[np.bool_]:
    """Find frames that no lag moves out of the recording.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (frames,)
    """
    time = inspection.feet.time
    return np.asarray((time > time[0] + SLACK) & (time < time[-1] - SLACK))


def between_steps(inspection: Inspection, measured: Array) -> NDArray[np.bool_]:
    """Find frames in which the plates carry most of the weight at every lag: from step to step.

    Parameters
    ----------
    inspection : forces with the motion
    measured : (frames, 3) [N]

    Returns
    -------
    (frames,)
    """
    time = inspection.feet.time
    weight = inspection.feet.model.weight
    carries = measured @ inspection.feet.up > CARRIED * weight
    result = np.zeros(len(time), bool)
    for start, stop in runs(carries):
        result[start:stop] = (time[start:stop] > time[start] + SLACK) & (
            time[start:stop] < time[stop - 1] - SLACK
        )
    return result & core_frames(inspection)


def _gliding(inspection: Inspection, lags: Array) -> Array | None:
    """Mean square speed of the feet at the centers of pressure at each lag, weighted by force.

    A foot that stands does not glide: the material point at the center of pressure is at rest.

    Parameters
    ----------
    lags : (lags,) [s]

    Returns
    -------
    (lags,) [m^2/s^2]
    """
    feet = inspection.feet
    time = feet.time
    centers = inspection.samples.centers(feet.up)
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
        frames = np.flatnonzero((weights > 0.0) & core_frames(inspection))
        if not len(frames):
            continue
        velocities = np.stack(
            [
                _at_centers(
                    time, lag, frames, nearest[frames, index], centers[frames, index], fields
                )
                for lag in lags
            ]
        )
        firm = weights[frames] > 0.5 * feet.model.weight
        belt = np.zeros(3)
        if firm.sum() > 5:
            belt = np.median(velocities[len(lags) // 2, firm, :, 0], axis=0)
        if not np.linalg.norm(belt) > 0.3:
            belt = np.zeros(3)
        glide = np.linalg.norm(velocities - belt[None, None, :, None], axis=2).min(axis=2)
        total += (weights[frames] * np.minimum(glide, 1.5) ** 2).sum(axis=1)
        count += float(weights[frames].sum())
    return total / count if count else None


def _at_centers(
    time: Array,
    lag: float,
    frames: NDArray[np.int64],
    nearest: NDArray[np.int64],
    centers: Array,
    fields: list[list[Field]],
) -> Array:
    """Velocities of the feet's material points at centers of pressure, a lag earlier.

    Parameters
    ----------
    time : (all frames,) [s]
    lag : [s]
    frames : (frames,) numbers
    nearest : (frames,) number of the nearest foot
    centers : (frames, 3) [m]
    fields : of each foot, those of its heel and of its toes, which may be one body

    Returns
    -------
    (frames, 3, 2) as a part of the heel, and of the toes [m/s]
    """
    at = np.clip(np.searchsorted(time, time[frames] - lag), 0, len(time) - 1)
    velocities = np.empty((len(frames), 3, 2))
    for number, of_foot in enumerate(fields):
        on_foot = nearest == number
        here = at[on_foot]
        for part in range(2):
            field = of_foot[min(part, len(of_foot) - 1)]
            arm = centers[on_foot] - field.origin[here]
            turning = np.einsum("fij,fj->fi", field.spin[here], arm)
            velocities[on_foot, :, part] = field.velocity[here] + turning
    return velocities


class Field(NamedTuple):
    """Velocity field of a body over time.

    Attributes
    ----------
    origin, velocity : (frames, 3) of its origin [m], [m/s]
    spin : (frames, 3, 3) angular velocity as a matrix [rad/s]
    """

    origin: Array
    velocity: Array
    spin: Array


def _field(feet: FootPoses, body: str) -> Field:
    """Find the velocity field of a body in all frames."""
    rotations, origins = feet.pose_of(body)
    rates = np.gradient(rotations, feet.time, axis=0)
    return Field(
        origin=origins,
        velocity=np.gradient(origins, feet.time, axis=0),
        spin=np.einsum("fij,fkj->fik", rates, rotations),
    )
