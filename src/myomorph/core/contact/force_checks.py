"""Checks whether external forces belong to the motion: signs, units, axes, feet, mass and clock.

What the motion knows of its forces: a center of pressure lies under a foot that stands, the point
of the foot at the center of pressure does not glide over the ground, and the forces accelerate the
center of mass. Where they disagree, the faults that recordings usually have are tried one by one,
and one that makes them agree is put right.

A foot that a body passes over is left at the end to which the body goes; a plate mirrored about its
own middle shows the opposite. On a treadmill a mirrored center of pressure goes forwards while the
belt carries the foot backwards, and so it passes near the other foot, which swings forwards
meanwhile. What sets it apart from a force on the wrong foot is that a foot under load moves as the
belt does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.balance_test import (
    BESIDE,
    NOT_ONE,
    MeasuredPlates,
    Verdict,
    verdict_of,
)
from myomorph.core.contact.consistency.plate_disturbances import HUM, SPIKES
from myomorph.core.contact.consistency.plate_signals import PlateSignals, plate_signals
from myomorph.core.contact.force_balance import CUTOFF, check_clock, check_directions, check_mass
from myomorph.core.contact.force_inspection import (
    GAIN,
    LOAD,
    MIRRORED_PLATE,
    TURNED_PLATE,
    UNSURE,
    Inspection,
    belt_velocity,
    change_repair,
    foot_poses,
    standing,
)
from myomorph.core.contact.force_placement import (
    FAR,
    FITS,
    MARKED,
    NEAR,
    NO_FOOT,
    TWO_FEET,
    WRONG_FOOT,
    check_feet,
    check_origins,
    check_shared_plates,
)
from myomorph.core.contact.plate_directions import check_plate_directions
from myomorph.core.contact.plate_gains import check_gains
from myomorph.core.contact.rates import PACE, RATE, check_paces, check_rates
from myomorph.core.contact.unloaded import without_zeros, zeros_of
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES, UNITS
from myomorph.core.model.findings import Finding, repaired
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import lowpass

STANDS = 0.6
"""Share of its load during which a foot that carries it stands."""
STEPS = 3
"""Number of steps on a belt from which on both ways are judged."""
CLEARER = 0.6
"""Of two explanations the one that leaves so much less of the distance is the right one."""
LASTS = 0.25
"""A step that is shorter is not judged [s]."""
PASSES = 0.25
"""Way of the center of mass along a human foot from which on it steps over the foot [m]."""
AGAINST = 0.06
"""Way of the center of pressure against that of the center of mass, from the first to the last
third of a step [m].
"""


OVERRULED = (GAIN, "mass", "clock", TWO_FEET, NO_FOOT)
"""Kinds of findings that ask a part of the balance, so that the whole of it overrules them."""
BEYOND = frozenset((LOAD, PACE, TURNED_PLATE))
"""Kinds with which the balance would only say the same in other words, or cannot be drawn up."""
HARMLESS = frozenset((HUM, SPIKES))
"""Kinds that change no balance of filtered forces."""
LATE = ("clock", "lost samples")
"""Kinds that change how forces follow the motion, as a rate does."""
MISPLACES = frozenset(
    {
        "clock",
        "lost samples",
        "clock rate",
        "points off",
        "plates exchanged",
        "cameras tilted",
        TWO_FEET,
        NO_FOOT,
    }
)
"""Kinds with which points may lie under other feet than those that made the forces."""
FEWEST = 3
"""Frames with forces in which a motion has velocities."""
PULLED = 0.3
"""Share of the weight that all plates together pull down where their sign is wrong."""
LONGEST = 0.1
"""Longest step between frames that are not taken for a gap [s]."""


class Mirror(NamedTuple):
    """A reflection of the points of a plate.

    Attributes
    ----------
    axes : (axes, 3) horizontal directions that are reversed
    middle : (axes,) that stays where it is, along each of the axes [m]
    distance : of the centers of pressure to the feet that carry them afterwards, mean [m]
    """

    axes: Array
    middle: Array
    distance: float


def check_mirrors(inspection: Inspection) -> Iterator[Finding]:
    """Find forces of belts that are under their foot only when they are mirrored."""
    if not np.any(belt_velocity(inspection)):
        return
    stands = standing(inspection)
    for number in inspection.numbers:
        weights = inspection.weights(number)
        if len(inspection.episodes(number)) < STEPS:
            continue
        feet = inspection.feet
        owner = feet.owners.get(inspection.wrenches.bodies[number])
        # Feet that may carry the force: the one that it is put on, else those that stand.
        carriers = stands
        if owner is not None:
            carriers = np.tile(np.arange(stands.shape[1]) == owner, (len(stands), 1))
        centers = inspection.samples.centers(feet.up)[:, number]
        before = _distance(inspection, centers, carriers, weights)
        if before < NEAR * feet.unit:
            continue
        exchanged = np.inf
        if owner is not None:
            others = stands.copy()
            others[:, owner] = False
            if _share(np.asarray(others.any(axis=1)), weights) > STANDS:
                exchanged = _distance(inspection, centers, others, weights)
        result = _mirror(inspection, centers, carriers, weights)
        carried = stands.any(axis=1) if owner is None else stands[:, owner]
        fits = _share(np.asarray(carried), weights) > STANDS
        if not fits or result.distance > min(FITS * feet.unit, MARKED * before):
            continue
        yield from _mirrored(inspection.name(number), before, exchanged, result)


def _mirrored(name: str, before: float, exchanged: float, mirror: Mirror) -> Iterator[Finding]:
    """Name a force that a mirror explains better than the other foot does, or as well.

    Parameters
    ----------
    name : of the force
    before, exchanged : mean distance of its center of pressure to its foot, and to the other [m]
    mirror : the best one
    """
    near = f"{100.0 * mirror.distance:.0f} cm"
    axes = " and ".join("xyz"[int(np.argmax(np.abs(axis)))] for axis in mirror.axes)
    if mirror.distance < CLEARER * exchanged:
        middle = ", ".join(f"{item:.2f}" for item in mirror.middle)
        text = PLATES.message(
            f"the center of pressure of force '{name}' lies {100.0 * before:.0f} cm from the"
            f" foot that the belt carries, {near} when mirrored along {axes} (about {middle}"
            " m): its plate seems mirrored about its own middle, and torques there are wrong:"
            " check the plate's corners or the sign of its moments",
            severity="changes results",
        )
        yield Finding(MIRRORED_PLATE, name, text)
    elif exchanged > CLEARER * mirror.distance:
        text = PLATES.message(
            f"force '{name}' is put on the wrong foot ({100.0 * exchanged:.0f} cm from the"
            f" other one), or its plate is mirrored along {axes} ({near} from its own then):"
            " the recording does not say which: nothing was changed; check the plate's"
            " corners, or name its body (--bodies, --plates)",
            severity="changes results",
        )
        yield Finding(UNSURE, name, text)


def _share(frames: NDArray[np.bool_], weights: Array) -> float:
    """Share of a load (frames,) that acts in some frames (frames,)."""
    return float(weights[frames].sum() / weights.sum())


def _distance(
    inspection: Inspection, centers: Array, carriers: NDArray[np.bool_], weights: Array
) -> float:
    """Mean distance of centers of pressure to the nearest foot that may carry them [m].

    Parameters
    ----------
    centers : (frames, 3) [m]
    carriers : (frames, feet) which feet may carry the force
    weights : (frames,) size of the force [N]
    """
    distances = np.nan_to_num(inspection.feet.distances(centers[:, None])[:, 0], nan=9.0)
    nearest = np.where(carriers, distances, np.inf).min(axis=1)
    known = np.isfinite(nearest) & (weights > 0.0)
    return float(np.average(nearest[known], weights=weights[known])) if known.any() else np.inf


def _mirror(
    inspection: Inspection, centers: Array, carriers: NDArray[np.bool_], weights: Array
) -> Mirror:
    """Find the reflection of horizontal axes that brings forces nearest to feet.

    Its middle is looked for too.

    Parameters
    ----------
    centers : (frames, 3) [m]
    carriers : (frames, feet) which feet may carry the force
    weights : (frames,) size of the force [N]
    """
    up = inspection.feet.up
    level = np.eye(3)[np.sort(np.argsort(np.abs(up))[:2])]
    heels, tips = inspection.feet.soles
    middles = 0.5 * (heels + tips)
    feet = np.where(carriers[..., None], middles, np.nan)
    with np.errstate(invalid="ignore"):
        target = np.nansum(feet, axis=1) / np.maximum(carriers.sum(axis=1), 1)[:, None]
    known = carriers.any(axis=1) & (weights > 0.0)
    best = Mirror(level[:0], np.zeros(0), np.inf)
    for axes in (level[:1], level[1:], level):
        middle = np.array(
            [np.median(0.5 * (centers[known] + target[known]) @ axis) for axis in axes]
        )
        for step in (0.04, 0.01):
            around = step * np.arange(-4, 5)
            for i in range(len(axes)):
                tried = np.tile(middle, (len(around), 1))
                tried[:, i] += around
                left = [
                    _distance(inspection, _reflected(centers, axes, candidate), carriers, weights)
                    for candidate in tried
                ]
                middle = tried[int(np.argmin(left))]
        left_at = _distance(inspection, _reflected(centers, axes, middle), carriers, weights)
        # One axis more has to explain more.
        if left_at < (1.0 if len(axes) == 1 else CLEARER) * best.distance:
            best = Mirror(axes, middle, left_at)
    return best


def _reflected(centers: Array, axes: Array, middle: Array) -> Array:
    """Mirror points (frames, 3) along axes (axes, 3) about a middle (axes,)."""
    return np.asarray(centers + 2.0 * (middle - centers @ axes.T) @ axes)


def check_progress(inspection: Inspection) -> Iterator[Finding]:
    """Find plates whose center of pressure moves along the foot against the body.

    An axis across the foot does not show it: the center of pressure hardly moves along it.
    """
    feet = inspection.feet
    heels, tips = feet.soles
    along = tips - heels
    along = along - (along @ feet.up)[..., None] * feet.up
    along = along / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
    for number in inspection.numbers:
        steps = list(_steps(inspection, number, along))
        against = [step for step in steps if step.moved < -AGAINST * feet.unit]
        if against and 2 * len(against) > len(steps):
            name = inspection.name(number)
            times = inspection.times(step.span for step in against)
            mean = -float(np.mean([step.moved for step in against]))
            text = PLATES.message(
                f"the center of pressure of force '{name}' moves {100.0 * mean:.0f} cm along the"
                f" foot against the body in {len(against)} of {len(steps)} steps, first at"
                f" {times[0][0]:.2f} s: its plate seems mirrored about its own middle along the"
                " foot, and torques there are wrong: check the plate's corners or the sign of its"
                " moments",
                severity="changes results",
            )
            yield Finding(kind=MIRRORED_PLATE, place=name, text=text, times=times)


class _Step(NamedTuple):
    """A foot on a plate while the body passes over it.

    Attributes
    ----------
    span : its frames
    moved : way of the center of pressure along the foot, positive with the body [m]
    """

    span: slice
    moved: float


def _steps(inspection: Inspection, number: int, along: Array) -> Iterator[_Step]:
    """Measure the steps on one plate that last, and in which the body passes over the foot.

    Parameters
    ----------
    inspection : forces and feet
    number : of the force
    along : (frames, feet, 3) level unit vectors from heels to tips
    """
    feet = inspection.feet
    heels, _ = feet.soles
    centers = inspection.samples.centers(feet.up)[:, number]
    weights = inspection.weights(number)
    distances = feet.distances(centers[:, None])[:, 0]
    body = inspection.wrenches.bodies[number]
    for span in inspection.episodes(number):
        if feet.time[span.stop - 1] - feet.time[span.start] < LASTS:
            continue
        nearest = int(np.argmin(np.average(distances[span], axis=0, weights=weights[span])))
        foot = feet.owners.get(body, nearest)
        way = along[span, foot]
        place = ((centers[span] - heels[span, foot]) * way).sum(axis=1)
        center = ((feet.center[span] - heels[span, foot]) * way).sum(axis=1)
        passed = float(center[-1] - center[0])
        if abs(passed) >= PASSES * feet.unit:
            yield _Step(span, float(np.sign(passed)) * _moved(place, weights[span]))


def _moved(place: Array, weights: Array) -> float:
    """Way from the first to the last third of a step, weighted by force [m].

    Parameters
    ----------
    place, weights : (frames,) along the foot [m], and size of the force [N]
    """
    third = max(1, len(place) // 3)
    first = float(np.average(place[:third], weights=weights[:third]))
    last = float(np.average(place[-third:], weights=weights[-third:]))
    return last - first


@dataclass(frozen=True, eq=False)
class CheckedForces:
    """External forces, corrected where that was safe, and what was found.

    Attributes
    ----------
    findings : with `repaired` where `wrenches` have it corrected
    """

    wrenches: Wrenches
    findings: tuple[Finding, ...]


def checked_forces(
    wrenches: Wrenches,
    model: Model,
    motion: Motion,
    repair: bool = True,
    checks: Sequence[Check] = (),
) -> CheckedForces:
    """Hold external forces against the motion, correct what is safe and name the rest.

    Looked for are rates that gravity contradicts, forces that pull instead of push, turned axes or
    a mirrored one, a plate turned or mirrored about its own middle, other units, moments about
    another point than the center of pressure, a wrong foot, two feet on one plate, forces under no
    foot, a mass that is not the model's, and a clock that is not the motion's. What plates read
    with nobody on them is taken off before. Models without feet are not looked at.

    Parameters
    ----------
    wrenches : in ground, at their own times; a body that is not known is ""
    model : of the body
    motion : (frames, coordinates) [rad or m]
    repair : whether to correct what is safe to correct
    checks : those that are made, all by default

    Returns
    -------
    the wrenches, as they were where nothing was corrected, and the findings
    """
    inside = _common_frames(wrenches, motion)
    if np.count_nonzero(inside) < FEWEST or not model.mass > 0.0 or not wrenches.names:
        return CheckedForces(wrenches, ())
    feet = foot_poses(model, _smooth(motion, inside))
    if feet is None:
        return CheckedForces(wrenches, ())
    up = np.asarray(model.up)
    signals = plate_signals(wrenches, model.weight, up)
    if any(not finding.times for finding in motion.findings):
        return CheckedForces(wrenches, (*signals.findings, _not_judged(wrenches, motion)))
    inspection = Inspection(without_zeros(wrenches, up), feet, signals.findings)
    known = Motion(
        motion.time[inside], motion.names, motion.values[inside], findings=motion.findings
    )
    found = _judged(inspection, known, signals, checks or CHECKS)
    # Frames that are repeated or missing make the motion another one than the forces'.
    corrected, findings = repaired(wrenches, found, repair and not motion.findings)
    return CheckedForces(corrected, findings)


def _judged(
    inspection: Inspection, motion: Motion, signals: PlateSignals, checks: Sequence[Check]
) -> tuple[Finding, ...]:
    """Find how forces are to be read, and hold what is read then against the whole body.

    Parameters
    ----------
    inspection : forces as recorded, their zeros taken off
    motion : the frames that are looked at (frames, coordinates) [rad or m]
    signals : of the plates
    checks : those that are made
    """
    recorded = inspection.wrenches
    parts = [check for check in checks if check in PARTS_OF_THE_BALANCE]
    inspection = _inspected(inspection, (check for check in checks if check not in parts))
    on_no_foot = (item for item in inspection.findings if item.kind != WRONG_FOOT)
    measured, _ = repaired(recorded, on_no_foot)
    shared = check_feet not in checks or any(item.kind == TWO_FEET for item in inspection.findings)
    balance = _balance(inspection, motion, measured, signals, one_foot_each=not shared)
    if not balance.fits:
        inspection = _inspected(inspection, parts)
    return _together(inspection.findings, balance)


def _inspected(inspection: Inspection, checks: Iterable[Check]) -> Inspection:
    """Make some checks, each of forces in which what was found before is put right.

    They are put right here, whether the result has them so or not.
    """
    for check in checks if inspection.numbers else ():
        findings = tuple(check(inspection))
        right, _ = repaired(inspection.wrenches, findings)
        if findings:
            known = (*inspection.findings, *findings)
            inspection = Inspection(right, inspection.feet, known)
    return inspection


def _not_judged(wrenches: Wrenches, motion: Motion) -> Finding:
    """Say that a motion which may be that of another body judges no forces."""
    kinds = ", ".join(
        dict.fromkeys(finding.kind for finding in motion.findings if not finding.times)
    )
    text = PLATES.message(
        f"the forces were neither judged nor corrected by the motion, since the markers contradict"
        f" a standing body ({kinds}): correct the markers first",
        severity="changes results",
    )
    return Finding("forces not judged", ", ".join(wrenches.names), text)


def _balance(
    inspection: Inspection,
    motion: Motion,
    measured: Wrenches,
    signals: PlateSignals,
    *,
    one_foot_each: bool,
) -> Verdict:
    """Ask the balance of forces and moments of the whole body.

    Parameters
    ----------
    inspection : forces with what was found of units, axes and places
    motion : the frames that are looked at (frames, coordinates) [rad or m]
    measured : forces of whole plates, with what was found put right but for their feet
    signals : of the plates
    one_foot_each : whether no plate carries two feet at once
    """
    model = inspection.feet.model
    up = np.asarray(model.up)
    said = {finding.kind for finding in inspection.findings}
    signals = replace(plate_signals(measured, model.weight, up), findings=signals.findings)
    if len(inspection.feet.feet) != 2 or said & BEYOND:
        return Verdict()
    zeros = frozenset(
        number for number, zero in enumerate(zeros_of(measured, up)) if zero is not None
    )
    plates = MeasuredPlates(measured, signals, zeros=zeros, one_foot_each=one_foot_each)
    return verdict_of(model, motion, plates)


def _together(findings: Sequence[Finding], balance: Verdict) -> tuple[Finding, ...]:
    """Bring the verdict of the balance and what other checks found together.

    Parameters
    ----------
    findings : of other checks
    balance : of the whole body

    Returns
    -------
    the findings, those that the balance contradicts left out, and what it shows besides
    """
    said = {finding.kind for finding in findings}
    new = [item for item in balance.findings if not _says_the_same(item, said)]
    overruled = _overruled(new)
    kept = [item for item in findings if item.kind not in overruled]
    kinds = {kind for item in (*kept, *new) for kind in item.kind.split(" or ")}
    if kinds & MISPLACES:
        kept = [_as_in_file(item) for item in kept]
    return (*kept, *new)


def _overruled(new: Sequence[Finding]) -> set[str]:
    """Return the kinds of other checks that findings of the balance explain."""
    sure = [item.kind for item in new if not item.kind.startswith((NOT_ONE, BESIDE))]
    overruled = set(OVERRULED) if sure else set()
    return overruled | {RATE} if any(kind in LATE for kind in sure) else overruled


def _says_the_same(finding: Finding, said: set[str]) -> bool:
    """Return whether what was said is as much as a finding of the balance says."""
    if finding.kind == NOT_ONE:
        return bool(said - HARMLESS)
    return bool(said & set(finding.kind.split(" or ")))


def _as_in_file(finding: Finding) -> Finding:
    """Leave a force on the foot of its file, where the foot was judged by a wrong time or place."""
    return replace(finding, repair=None) if finding.kind == WRONG_FOOT else finding


def _common_frames(wrenches: Wrenches, motion: Motion) -> NDArray[np.bool_]:
    """Frames (frames,) in which the body is in view and forces are recorded."""
    inside = np.zeros(len(motion), bool)
    seen = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if len(wrenches) and len(seen):
        # Before the first frame with a pose and after the last, a body is out of the cameras' view.
        inside[seen[0] : seen[-1] + 1] = True
        first = wrenches.time[0] - 1e-6
        last = wrenches.time[-1] + 1e-6
        inside &= (motion.time >= first) & (motion.time <= last)
    return inside


def _smooth(motion: Motion, inside: NDArray[np.bool_]) -> Motion:
    """Choose the frames of a motion that are looked at, evenly spaced.

    They are low-pass filtered where the motion has no gaps; `inside` (frames,).
    """
    time = motion.time[inside]
    values = motion.values[inside]
    steps = np.diff(time)
    if len(time) <= 20 or steps.max() > LONGEST or not np.isfinite(values).all():
        return Motion(time, motion.names, values)
    if steps.max() > 1.2 * steps.min():
        even = np.linspace(time[0], time[-1], len(time))
        values = np.column_stack([np.interp(even, time, column) for column in values.T])
        time = even
    rate = 1.0 / float(np.mean(np.diff(time)))
    return Motion(
        time, motion.names, lowpass(values, rate, CUTOFF) if rate > 2.5 * CUTOFF else values
    )


def check_units(inspection: Inspection) -> Iterator[Finding]:
    """Find forces far too small for the model's weight: kilonewtons or body weights."""
    weight = inspection.feet.model.weight
    size = np.nan_to_num(np.linalg.norm(inspection.wrenches.forces[:, inspection.numbers], axis=2))
    largest = float(size.max(initial=0.0))
    if 0.0 < largest < 0.02 * weight and size.sum(axis=1).max() < 0.02 * weight:
        yield Finding(
            "unit of force",
            inspection.name(inspection.numbers[0]),
            UNITS.message(
                f"the largest external force is {largest:.3g} N, the model weighs {weight:.0f} N:"
                " are the forces in kilonewtons or body weights? Give them in newtons",
                severity="changes results",
            ),
        )


def check_signs(inspection: Inspection) -> Iterator[Finding]:
    """Find forces that pull down: of a foot with the wrong sign, or a load in the hands."""
    up = inspection.feet.up
    weight = inspection.feet.model.weight
    lifts = inspection.samples.forces @ up
    used = [number for number in inspection.numbers if inspection.weights(number).any()]
    pulling = [number for number in used if _lift(inspection, number) <= -0.5]
    if not pulling:
        return
    loaded = inspection.samples.loaded[:, used].any(axis=1)
    # Where all plates together pull a body down, its own weight has the wrong sign, wherever they
    # lie.
    all_of_it = float(lifts[loaded][:, used].sum(axis=1).mean()) < -PULLED * weight
    for number in pulling:
        name = inspection.name(number)
        away = inspection.misfit(number)
        mean = (
            f"mean {float(lifts[inspection.weights(number) > 0.0, number].mean()):.0f} N upwards"
            " while loaded"
        )
        if not all_of_it and away > FAR * inspection.feet.unit:
            text = PLATES.message(
                f"force '{name}' pulls down ({mean}) and lies {away:.2f} m from the nearest foot:"
                " it seems a load in the hands: no foot gets it; name the body that carries it"
                " (--bodies, --plates)"
            )
            yield Finding(LOAD, name, text)
            continue
        done = "force and moment were reversed"
        advice = "reverse force and moment"
        repair = change_repair(
            number, lambda force, point, torque: (-force, point, -torque), done, advice
        )
        yield Finding(
            "swapped sign",
            name,
            PLATES.message(f"force '{name}' pulls the foot down ({mean})"),
            repair=repair,
        )


def _lift(inspection: Inspection, number: int) -> float:
    """Share of a force that points up while it is loaded; 0 where it never is."""
    weights = inspection.weights(number)
    upwards = (inspection.samples.forces[:, number] @ inspection.feet.up)[weights > 0.0].sum()
    return float(upwards / weights.sum()) if weights.any() else 0.0


Check = Callable[[Inspection], Iterator[Finding]]

CHECKS: tuple[Check, ...] = (
    check_units,
    check_paces,
    check_rates,
    check_origins,
    check_signs,
    check_plate_directions,
    check_directions,
    check_mirrors,
    check_progress,
    check_feet,
    check_shared_plates,
    check_gains,
    check_mass,
    check_clock,
)

PARTS_OF_THE_BALANCE: tuple[Check, ...] = (check_gains, check_mass, check_clock)
"""Those that ask a part of the balance of forces, and are made where the whole does not fit."""
BODY_CHECKS: tuple[Check, ...] = (
    check_units,
    check_paces,
    check_rates,
    check_origins,
    check_plate_directions,
    check_directions,
    check_mass,
)
"""Those that ask for no foot of a force: of plates that feet share."""
