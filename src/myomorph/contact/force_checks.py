"""Whether external forces belong to the motion: signs, units, axes, feet, mass and clock; what is wrong is named.

What the motion knows of its forces: a center of pressure lies under a foot that stands, the point of the foot at the
center of pressure does not glide over the ground, and the forces accelerate the center of mass. Where they disagree,
the faults that recordings usually have are tried one by one, and one that makes them agree is put right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.foot_poses import foot_poses
from myomorph.contact.force_balance import CUTOFF, check_directions, check_mass
from myomorph.contact.force_clock import check_clock
from myomorph.contact.force_inspection import LOAD, Inspection, change_repair
from myomorph.contact.force_mirrors import check_mirrors, check_progress
from myomorph.contact.force_placement import FAR, check_feet, check_origins, check_shared_plates
from myomorph.model.findings import Finding, repaired
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.motion.filters import lowpass

PULLED = 0.3  # Share of the weight that all plates together pull down where their sign is wrong
LONGEST = 0.1  # Longest step between frames that are not taken for a gap [s]


@dataclass(frozen=True, eq=False)
class CheckedForces:
    """External forces, put right where that was safe, and what was found."""

    wrenches: Wrenches
    findings: tuple[Finding, ...]  # with `mended` where `wrenches` have it put right


def checked_forces(wrenches: Wrenches, model: Model, motion: Motion, mend: bool = True) -> CheckedForces:
    """Hold external forces against the motion, put right what is safe and name the rest.
    Looked for are forces that pull instead of push, turned axes or a mirrored one, a plate mirrored about
    its own middle, other units, moments about another
    point than the center of pressure, a wrong foot, two feet on one plate, forces under no foot, a mass that is not the
    model's, and a clock that is not the motion's. Models without feet are not looked at.
    `wrenches`: in ground, at their own times; a body that is not known is ""; `motion` (frames, coordinates) [rad or
    m]; `mend`: put right what is safe to put right. Returns the wrenches, as they were where nothing was mended, and
    the findings.
    """
    inside = np.zeros(len(motion), bool)
    if len(wrenches):
        inside = (motion.time >= wrenches.time[0] - 1e-6) & (motion.time <= wrenches.time[-1] + 1e-6)
        inside &= _between_gaps(motion)
    if not np.any(inside) or not model.mass > 0.0 or not wrenches.names:
        return CheckedForces(wrenches, ())
    feet = foot_poses(model, _smooth(motion, inside))
    if feet is None:
        return CheckedForces(wrenches, ())
    inspection = Inspection(wrenches, feet)
    if not inspection.numbers:
        return CheckedForces(wrenches, ())
    for check in CHECKS:
        # Each looks at forces in which what was found before is put right, whether the result has it so or not.
        findings = tuple(check(inspection))
        right, _ = repaired(inspection.wrenches, findings)
        inspection = Inspection(right, feet, (*inspection.findings, *findings)) if findings else inspection
    return CheckedForces(*repaired(wrenches, inspection.findings, mend))


def _between_gaps(motion: Motion) -> NDArray[np.bool_]:
    """Frames (frames,) from the first with a pose to the last: before and after, a body is out of the cameras' view."""
    seen = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    frames = np.arange(len(motion))
    return (frames >= seen[0]) & (frames <= seen[-1]) if len(seen) else np.zeros(len(motion), bool)


def _smooth(motion: Motion, inside: NDArray[np.bool_]) -> Motion:
    """The frames of a motion that are looked at, evenly spaced and low-pass filtered where it has no gaps."""
    time, values = motion.time[inside], motion.values[inside]
    steps = np.diff(time)
    if len(time) <= 20 or steps.max() > LONGEST or not np.isfinite(values).all():
        return Motion(time, motion.names, values)
    if steps.max() > 1.2 * steps.min():
        even = np.linspace(time[0], time[-1], len(time))
        values = np.column_stack([np.interp(even, time, column) for column in values.T])
        time = even
    rate = 1.0 / float(np.mean(np.diff(time)))
    return Motion(time, motion.names, lowpass(values, rate, CUTOFF) if rate > 2.5 * CUTOFF else values)


def check_units(inspection: Inspection) -> Iterator[Finding]:
    """Forces far too small for the model's weight: kilonewtons or body weights."""
    weight = inspection.feet.model.weight
    size = np.nan_to_num(np.linalg.norm(inspection.wrenches.forces[:, inspection.numbers], axis=2))
    largest = float(size.max(initial=0.0))
    if 0.0 < largest < 0.02 * weight and size.sum(axis=1).max() < 0.02 * weight:
        yield Finding(
            "unit of force",
            inspection.name(inspection.numbers[0]),
            f"the largest external force is {largest:.3g} N, the model weighs {weight:.0f} N: are the forces in "
            "kilonewtons or body weights? Give them in newtons",
        )


def check_signs(inspection: Inspection) -> Iterator[Finding]:
    """Forces that pull to the ground: of a foot with the wrong sign, or, under no foot, a load in the hands."""
    up, weight = inspection.feet.up, inspection.feet.model.weight
    lifts = inspection.samples.forces @ up
    used = [number for number in inspection.numbers if inspection.weights(number).any()]
    pulling = [number for number in used if _lift(inspection, number) <= -0.5]
    if not pulling:
        return
    loaded = inspection.samples.loaded[:, used].any(axis=1)
    # Where all plates together pull a body down, its own weight has the wrong sign, wherever they lie.
    all_of_it = float(lifts[loaded][:, used].sum(axis=1).mean()) < -PULLED * weight
    for number in pulling:
        name, away = inspection.name(number), inspection.misfit(number)
        mean = f"mean {float(lifts[inspection.weights(number) > 0.0, number].mean()):.0f} N upwards while loaded"
        if not all_of_it and away > FAR * inspection.feet.unit:
            text = (
                f"force '{name}' pulls down ({mean}) and lies {away:.2f} m from the nearest foot: it seems a load in "
                "the hands: no foot gets it; name the body that carries it (--bodies, --plates)"
            )
            yield Finding(LOAD, name, text)
            continue
        done, advice = "force and moment were reversed", "reverse force and moment"
        repair = change_repair(number, lambda force, point, torque: (-force, point, -torque), done, advice)
        yield Finding("swapped sign", name, f"force '{name}' pulls the foot down ({mean})", repair=repair)


def _lift(inspection: Inspection, number: int) -> float:
    """Share of a force that points up while it is loaded; 0 where it never is."""
    weights = inspection.weights(number)
    upwards = (inspection.samples.forces[:, number] @ inspection.feet.up)[weights > 0.0].sum()
    return float(upwards / weights.sum()) if weights.any() else 0.0


CHECKS: tuple[Callable[[Inspection], Iterator[Finding]], ...] = (
    check_units,
    check_origins,
    check_signs,
    check_directions,
    check_mirrors,
    check_progress,
    check_feet,
    check_shared_plates,
    check_mass,
    check_clock,
)
