"""What the signals of force plates show by themselves, before any mechanics.

A channel that never changes while its plate is stepped on is dead; one that stays at its largest
value again and again was clipped; one that leaps by its whole range from sample to sample
overflowed; two plates with one signal are one plate; a leap of all forces under load is where
samples are lost. Hum and spikes are said too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.plate_disturbances import disturbances
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.causes import CLOCKS, PLATES
from myomorph.core.model.findings import Finding
from myomorph.core.model.series import Wrenches

DEAD = "dead channel"
CLIPPED = "clipped"
WRAPPED = "wrapped"
SAME = "same signal"
LOST = "lost samples"
"""Kinds of findings."""
BROKEN = (DEAD, CLIPPED, WRAPPED, SAME)
"""Kinds whose plate shows nothing more."""
STILL = 1e-9
"""Part of a plate's largest force within which a channel does not change."""
HELD = 1e-6
"""The same of samples at the top of a clipped channel."""
SLOPE = 1e-4
"""Part of the largest force by which a clipped channel comes to its top: a foot comes to rest
there."""
TOP = 0.2
"""Part of the plate's largest force that a clipped channel reaches, and newtons."""
TOP_NEWTONS = 30.0
TOP_SAMPLES = 4
TOP_TIME = 0.012
"""Samples of one stay at the top, and time of all together [s]."""
LEAP = 0.6
"""Part of the range of a channel that it leaps by where it overflowed."""
BOTH_SIDES = 0.2
"""Part of the largest force that a channel which overflowed reaches on both sides of zero."""
ALIKE = 1e-3
"""Part of the largest force by which two signals differ that are one."""
DENSE = 400.0
"""Rate from which on a leap from sample to sample is no motion [Hz]."""
LOST_LEAP = 0.08
"""Leap of the force of all plates where samples are lost, as a part of the weight."""
SHARPER = 10.0
"""A leap is so much larger than the steps beside it."""
LOADED = 0.3
"""Part of the weight that plates carry on both sides of a leap."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class PlateSignals:
    """Plates as their signals show them.

    Attributes
    ----------
    findings : of signals that no foot makes
    usable : (plates,) that are stepped on, and whose channels all work
    stepped_on : (plates,)
    """

    findings: tuple[Finding, ...]
    usable: NDArray[np.bool_]
    stepped_on: NDArray[np.bool_]


def plate_signals(wrenches: Wrenches, weight: float, up: Array) -> PlateSignals:
    """Look at the signals of all plates.

    Parameters
    ----------
    wrenches : as recorded, forces (samples, plates, 3) [N]
    weight : of the body [N]
    up : (3,)

    Returns
    -------
    findings, and which plates show forces
    """
    forces = np.nan_to_num(wrenches.forces)
    vertical = int(np.argmax(np.abs(up)))
    largest = np.abs(forces).max(axis=(0, 2), initial=0.0)
    stepped_on = np.abs(forces[..., vertical]).max(axis=0, initial=0.0) > 0.02 * weight
    stepped_on |= largest > 0.02 * weight
    rate = 1.0 / float(np.median(np.diff(wrenches.time))) if len(wrenches) > 1 else 1.0
    findings: list[Finding] = []
    for number in np.flatnonzero(stepped_on):
        plate = _Plate(wrenches.names[number], forces[:, number], float(largest[number]), rate)
        findings += _dead(plate, wrenches.points[:, number])
        findings += _clipped(plate)
        findings += _wrapped(plate, vertical)
    findings += _same(wrenches, forces, np.flatnonzero(stepped_on))
    broken = {finding.place for finding in findings}
    usable = stepped_on & np.array([name not in broken for name in wrenches.names], bool)
    if not findings:
        findings += _lost(wrenches, forces, weight, vertical)
    for number in np.flatnonzero(usable):
        findings += disturbances(
            wrenches.names[number],
            forces[:, number],
            wrenches.time,
            weight=weight,
            vertical=vertical,
        )
    return PlateSignals(findings=tuple(findings), usable=usable, stepped_on=stepped_on)


@read_only
@dataclass(frozen=True)
class _Plate:
    """One plate: its name, force (samples, 3) [N], largest component [N] and rate [Hz]."""

    name: str
    force: Array
    largest: float
    rate: float


def _dead(plate: _Plate, points: Array) -> Iterator[Finding]:
    """Find the one component of a force that never changes while its points (samples, 3) do.

    Plates that measure the vertical alone have two such components.
    """
    moves = np.nanmax(np.ptp(np.nan_to_num(points), axis=0)) > 0.0
    still = np.ptp(plate.force, axis=0) < STILL * max(plate.largest, 1.0)
    for axis, word in enumerate("xyz"):
        if moves and still[axis] and still.sum() == 1:
            text = PLATES.message(
                f"force '{plate.name}' never changes along {word}, though its plate is stepped on:"
                " is this channel dead? Torques are wrong there; leave the plate out"
                " (--plates, --bodies), or record it again",
                severity="changes results",
            )
            yield Finding(DEAD, plate.name, text)


def _clipped(plate: _Plate) -> Iterator[Finding]:
    """Find components that stay at their largest value, and come there with a slope."""
    for axis, word in enumerate("xyz"):
        for sign, side in ((1.0, "largest"), (-1.0, "least")):
            values = sign * plate.force[:, axis]
            if values.max() <= max(TOP * plate.largest, TOP_NEWTONS):
                continue
            stays = [span for span in _stays(values, plate.largest) if _sloped(values, span, plate)]
            samples = sum(stop - start for start, stop in stays)
            if samples > max(6, TOP_TIME * plate.rate):
                text = PLATES.message(
                    f"force '{plate.name}' stays at its {side} value along {word},"
                    f" {sign * values.max():.0f} N, {len(stays)} times: the plate's range was too"
                    " small, and torques are too small there; record it again with a larger one",
                    severity="changes results",
                )
                yield Finding(CLIPPED, plate.name, text)


def _stays(values: Array, largest: float) -> list[tuple[int, int]]:
    """Find stretches of samples at the top of a component (samples,), its ends left out."""
    top = runs(values > values.max() - HELD * largest)
    return [
        (start, stop)
        for start, stop in top
        if stop - start >= TOP_SAMPLES and start > 2 and stop < len(values) - 2
    ]


def _sloped(values: Array, span: tuple[int, int], plate: _Plate) -> bool:
    """Return whether a component comes to or leaves its top with a slope."""
    start, stop = span
    steps = (values[start] - values[start - 1], values[stop - 1] - values[stop])
    return max(steps) > SLOPE * plate.largest


def _wrapped(plate: _Plate, vertical: int) -> Iterator[Finding]:
    """Find a vertical force that leaps from one end of its range to the other."""
    force = plate.force[:, vertical]
    steps = np.abs(np.diff(force))
    leaping = steps > LEAP * np.ptp(force)
    leaps = steps[leaping]
    both = force.min() < -BOTH_SIDES * plate.largest and force.max() > BOTH_SIDES * plate.largest
    if not len(leaps) or not both:
        return
    size = float(leaps.mean())
    if float(leaps.std()) < 0.1 * size and float(np.quantile(steps[~leaping], 0.97)) < 0.1 * size:
        text = PLATES.message(
            f"force '{plate.name}' leaps {len(leaps)} times by {size:.0f} N from one sample to the"
            " next: its numbers overflowed (a range of 16 bits?); export it again",
            severity="changes results",
        )
        yield Finding(WRAPPED, plate.name, text)


def _same(wrenches: Wrenches, forces: Array, numbers: NDArray[np.int64]) -> Iterator[Finding]:
    """Find plates that have one signal."""
    for later, number in enumerate(numbers):
        for other in numbers[:later]:
            size = np.abs(forces[:, number]).max()
            if np.abs(forces[:, number] - forces[:, other]).max() < ALIKE * size:
                pair = (wrenches.names[other], wrenches.names[number])
                text = PLATES.message(
                    f"forces '{pair[0]}' and '{pair[1]}' are the same signal: one plate's channels"
                    " stand for both; export the recording again",
                    severity="changes results",
                )
                for name in pair:
                    yield Finding(SAME, name, text)


def _lost(wrenches: Wrenches, forces: Array, weight: float, vertical: int) -> Iterator[Finding]:
    """Find a sample at which all forces leap together under load."""
    if len(wrenches) < 5 or 1.0 / float(np.median(np.diff(wrenches.time))) < DENSE:
        return
    total = forces.sum(axis=1)
    steps = np.diff(total, axis=0)
    beside = np.abs(steps).max(axis=1)
    carried = np.minimum(np.abs(total[1:-2, vertical]), np.abs(total[2:-1, vertical]))
    leaps = np.linalg.norm(steps, axis=1)[1:-1] * (carried > LOADED * weight)
    at = int(leaps.argmax())
    if leaps[at] > max(LOST_LEAP * weight, SHARPER * (beside[at] + beside[at + 2])):
        time = float(wrenches.time[at + 1])
        text = CLOCKS.message(
            f"all forces leap by {leaps[at]:.0f} N at {time:.3f} s, under load: samples are lost"
            " there, and what follows is early against the motion; export the forces again",
            severity="changes results",
        )
        yield Finding(LOST, ", ".join(wrenches.names), text, times=((time, time),))
