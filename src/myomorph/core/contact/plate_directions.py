"""One plate whose forces are turned or mirrored against those of the others.

Horizontal forces of all plates together accelerate the center of mass. A plate that is turned about
its own vertical keeps its centers of pressure near the feet, but not that balance: feet that push
against each other, as those of somebody who rises, then push to one side.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.force_balance import (
    BalancedForces,
    Turn,
    balance,
    covered,
    cutoff_of,
    turns,
)
from myomorph.core.contact.force_inspection import TURNED_PLATE, Inspection
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES
from myomorph.core.model.findings import Finding
from myomorph.core.motion.filters import lowpass

MIN_FRAMES = 15
MIN_TIME = 0.25
"""Time in which plates carry the body that is compared [s]."""
SMALLEST = 0.03
"""Error of horizontal forces that is looked at, as a share of the weight."""
LEFT = 0.4
"""Part of the mean square error that may be left by a turn: 0.9 in clean recordings at least, and
0.24 where a plate is turned at most, but for a slow runner.
"""
OF_MOTION = 0.5
"""The same over the mean square of what the motion needs."""
CLEARER = 1.4
"""So much more any turn of another plate has to leave, and of all plates together."""


class TurnedPlate(NamedTuple):
    """A plate, the rotation that corrects it, and the mean square error that it leaves [N^2]."""

    number: int
    turn: Turn
    error: float


def check_plate_directions(inspection: Inspection) -> Iterator[Finding]:
    """Find one plate whose horizontal forces fit the center of mass only when they are turned."""
    used = [number for number in inspection.numbers if inspection.weights(number).any()]
    result = balance(inspection)
    # One plate alone is turned as all plates are: `check_directions` finds it.
    if result is None or len(used) < 2:
        return
    here = covered(inspection, result.measured, result.needed)
    step = float(np.median(np.diff(inspection.feet.time)))
    if here.sum() < MIN_FRAMES or here.sum() * step < MIN_TIME:
        return
    up = inspection.feet.up
    level = np.eye(3) - np.outer(up, up)
    both = BalancedForces(
        measured=result.measured[here] @ level, needed=result.needed[here] @ level
    )
    before = _mean_square(both.measured - both.needed)
    needed = _mean_square(both.needed)
    if np.sqrt(before) < SMALLEST * inspection.feet.model.weight:
        return
    best, *others = sorted(
        (_best_turn(inspection, both, number, here, level) for number in used),
        key=lambda plate: plate.error,
    )
    together = (_mean_square(both.measured @ turn.matrix.T - both.needed) for turn in turns(up)[1:])
    rivals = [*(plate.error for plate in others), *together]
    clear = min(rivals) > CLEARER * best.error
    if clear and best.turn.text and best.error < min(LEFT * before, OF_MOTION * needed):
        yield _finding(inspection, best, before)


def _best_turn(
    inspection: Inspection, both: BalancedForces, number: int, here: np.ndarray, level: Array
) -> TurnedPlate:
    """Find the turn of one plate that leaves least.

    Parameters
    ----------
    both : (frames, 3) horizontal [N]
    here : (all frames,) those that are compared
    level : (3, 3) projection on the ground
    """
    rate = 1.0 / float(np.mean(np.diff(inspection.feet.time)))
    whole = lowpass(inspection.samples.forces[:, number], rate, cutoff_of(inspection))
    own = np.asarray(whole)[here] @ level
    others = both.measured - own - both.needed
    tried = [
        TurnedPlate(number, turn, _mean_square(others + own @ turn.matrix.T))
        for turn in turns(inspection.feet.up)
    ]
    return min(tried, key=lambda plate: plate.error)


def _mean_square(forces: Array) -> float:
    """Mean of the squares of forces (frames, 3) [N^2]."""
    return float((forces**2).sum(axis=1).mean())


def _finding(inspection: Inspection, plate: TurnedPlate, before: float) -> Finding:
    """Name a plate with the error of horizontal forces that it leaves as it is."""
    name = inspection.name(plate.number)
    text = PLATES.message(
        f"the forces of '{name}' are {plate.turn.text} against the motion: as recorded, horizontal"
        f" forces miss the center of mass's acceleration by {np.sqrt(before):.0f} N (root mean"
        f" square), so {np.sqrt(plate.error):.0f} N: check the corners of its plate, or its axes",
        place=name,
        severity="changes results",
    )
    return Finding(TURNED_PLATE, name, text)
