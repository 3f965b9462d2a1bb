"""Checks of external forces against the center of mass and the standing feet: directions and mass."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.force_inspection import (
    Change,
    ForceSamples,
    Inspection,
    belt_velocity,
    changed_wrenches,
    supported,
)
from myomorph.contact.force_placement import FITS, MARKED, NEAR
from myomorph.model.arrays import Array
from myomorph.model.findings import Finding, Repair
from myomorph.motion.filters import lowpass

CUTOFF = 6.0  # Low-pass filter of the compared forces, of a human body [Hz]
MASS = 0.09  # Part by which plates and model may differ in weight
LIGHTEST, HEAVIEST = 0.4, 2.5
"""Plates that carry a share of the model's weight beyond these carry something else than a body, or another unit."""
SPREAD = 0.35  # How far that part may differ from frame to frame, where all of the weight is measured


class Turn(NamedTuple):
    """A horizontal turn or reflection of the axes of forces."""

    kind: str
    text: str
    matrix: Array


def balance(inspection: Inspection) -> tuple[Array, Array] | None:
    """Measured and needed force (frames, 3), filtered alike [N]; None where the motion is too short or has gaps."""
    feet = inspection.feet
    steps = np.diff(feet.time)
    if len(feet.time) < 20 or steps.max() > 1.5 * steps.min() or not np.isfinite(feet.needed).all():
        return None
    if float(np.mean(steps)) > 0.03 or len(feet.feet) > 2:
        return None
    rate, cutoff = 1.0 / float(np.mean(steps)), CUTOFF / np.sqrt(feet.unit)
    if rate < 2.5 * cutoff:
        return None
    measured = inspection.samples.forces.sum(axis=1)
    return np.asarray(lowpass(measured, rate, cutoff)), np.asarray(lowpass(feet.needed, rate, cutoff))


def covered(inspection: Inspection, measured: Array, needed: Array) -> NDArray[np.bool_]:
    """Frames (frames,) in which the plates carry about what the center of mass needs."""
    up, weight = inspection.feet.up, inspection.feet.model.weight
    carried, wanted = measured @ up, needed @ up
    inside = np.zeros(len(carried), bool)
    margin = max(2, len(carried) // 25)
    inside[margin:-margin] = True
    return np.asarray(inside & (np.abs(carried - wanted) < 0.25 * weight) & (wanted > 0.4 * weight))


def turns(up: Array) -> list[Turn]:
    """Turns about the vertical by right angles and reflections of horizontal axes, the one that does nothing first."""
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
    # Points that are turned come with forces that are, unless the center of mass shows that these are right.
    if points and not forces and (errors is None or errors[points] < 1.3 * errors[0]):
        forces = points
    if forces == points == 0:
        return
    if points and not forces and np.linalg.det(choices[points].matrix) < 0.0 and np.any(belt_velocity(inspection)):
        # Plates of a belt that are mirrored about their own middle, not about the origin: `check_mirrors` names them.
        return
    what = "forces and points" if forces == points else "forces" if points == 0 else "points"
    turn = choices[forces or points]
    numbers, change = inspection.numbers, _changed(choices[forces].matrix, choices[points].matrix)
    repair = Repair(
        lambda wrenches: reduce(lambda turned, number: changed_wrenches(turned, number, change), numbers, wrenches),
        "they were put right",
        "give them in the axes of the motion",
    )
    names = ", ".join(map(inspection.name, numbers))
    yield Finding(turn.kind, names, f"{what} of the plates are {turn.text} against the motion", repair=repair)


def _changed(forces: Array, points: Array) -> Change:
    """The change that turns forces and their moments, and points."""
    sign = float(np.sign(np.linalg.det(forces)))
    return lambda f, p, t: (f @ forces.T, p @ points.T, sign * t @ forces.T)


def _turn_errors(inspection: Inspection, choices: list[Turn]) -> Array | None:
    """What horizontal forces leave of what the center of mass needs, turned each way [N^2]; None where too little acts.
    The last entry is that of no force at all.
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
    measured, needed = measured[here] @ level, needed[here] @ level
    if np.sqrt(np.mean(np.sum(measured**2, axis=1))) < 0.03 * inspection.feet.model.weight:
        return None
    turned = [measured @ choice.matrix.T for choice in choices]
    return np.array([float(np.mean(np.sum((values - needed) ** 2, axis=1))) for values in (*turned, 0.0 * needed)])


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
        samples = samples.changed(index, _changed(choices[forces].matrix, choices[points].matrix))
    return float(np.mean([_own_misfit(inspection, number, samples) for number in used])) if used else 0.0


def _own_misfit(inspection: Inspection, number: int, samples: ForceSamples) -> float:
    """Mean distance of the center of pressure to the foot that the force is put on, or to the nearest [m]."""
    feet = inspection.feet
    owner = feet.owners.get(inspection.wrenches.bodies[number])
    distances = np.nan_to_num(feet.distances(samples.centers(feet.up)[:, [number]])[:, 0])
    chosen = distances.min(axis=1) if owner is None else distances[:, owner]
    return float(np.average(chosen, weights=inspection.weights(number)))


def check_mass(inspection: Inspection) -> Iterator[Finding]:
    """The weight that the plates carry against that of the model, where all standing feet are on plates."""
    result = balance(inspection)
    if result is None:
        return
    up, model, time = inspection.feet.up, inspection.feet.model, inspection.feet.time
    carried, wanted = result[0] @ up, result[1] @ up
    steady = supported(inspection) & (wanted > 0.5 * model.weight) & (carried > 0.0)
    margin = max(2, len(time) // 25)
    steady[:margin] = steady[-margin:] = False
    if steady.sum() < 15 or steady.sum() * np.median(np.diff(time)) < 0.3:
        return
    ratios = carried[steady] / wanted[steady]
    low, middle, high = np.percentile(ratios, [10, 50, 90])
    ratio = float(carried[steady].sum() / wanted[steady].sum())
    # A part of the weight that another contact carries changes; a wrong mass is the same in all frames.
    if (
        high - low > SPREAD * middle
        or abs(ratio - middle) > 0.05
        or not LIGHTEST < ratio < HEAVIEST
        or abs(ratio - 1.0) < MASS
    ):
        return
    text = (
        f"the plates carry {ratio * model.mass:.1f} kg where all standing feet are on them, the model weighs "
        f"{model.mass:.1f} kg ({100.0 * (1.0 / ratio - 1.0):+.0f} %): scale the model to the subject's mass, or check "
        "the calibration of the plates"
    )
    yield Finding("mass", model.name, text)
