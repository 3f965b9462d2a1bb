"""Rates in heads of files that are not those of the recording, as gravity shows them.

By Newton's law the forces F of all plates move the center of mass of a body of mass m,

    F = m (a - g).

Where the head of a recording states f times its rate, the motion runs f times as fast and its
acceleration a is f^2 times the true one, while the mean of F stays the weight. So over time

    F - mean F = (mean F / mean m (a - g)) / f^2 * m (a - mean a),

and 1 / f^2 lies between the slope of F on m a, which errors of a make smaller, and the inverse of
the slope of m a on F, which errors of F make larger. Where only the table of forces has another
rate, no slope fits, and the forces agree with the motion when their times are stretched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.force_balance import (
    SLACK,
    BalancedForces,
    balance,
    between_steps,
    core_frames,
    cutoff_of,
)
from myomorph.core.contact.force_inspection import Inspection, supported
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import RATES
from myomorph.core.model.findings import Finding
from myomorph.core.motion.filters import lowpass

RATE = "rate"
PACE = "rate of one clock"
"""Kinds of findings: a rate that is not the recording's, and times of forces that are stretched."""
SLOWER = (2 / 5, 5 / 12, 1 / 2, 3 / 5, 2 / 3, 3 / 4, 4 / 5, 5 / 6)
PACES = (*SLOWER, *(1.0 / pace for pace in SLOWER))
"""Ratios of usual rates, of 50, 60, 100, 120, 200, 240, 250 and 300 Hz, by which times of forces
are stretched.
"""
SHORTEST = 0.3
"""Time over which forces and motion are compared [s], and twice as much where times stretch."""
SWINGS = 0.08
"""Standard deviation of the vertical force over the weight from which gravity shows a rate."""
EXPLAINED = 0.75
"""Share of the variance of the vertical force that the motion has to explain."""
SLOWEST = 0.82
FASTEST = 1.3
"""Ratios of force to motion that are no error of a model: in 23 clean recordings they lie between
0.86 and 1.2.
"""
LIGHTEST = 0.7
HEAVIEST = 1.4
"""Share of the weight on the plates beyond which they do not carry the body alone."""
AGREES = 0.9
"""Share that the motion has to explain of vertical forces after their times were stretched."""
AGREES_IN_ALL = 0.8
"""The same of all three components."""
DISAGREES = 0.6
"""Share of all three that it explains before, at most; 0.51 where times were stretched."""


class Slope(NamedTuple):
    """Change of forces over that of what the motion needs.

    Attributes
    ----------
    low, high : bounds of the ratio, by errors of either
    explained : share of the variance, negative where they are opposite
    size : standard deviation of the force [N]
    """

    low: float
    high: float
    explained: float
    size: float

    @property
    def middle(self) -> float:
        """Geometric mean of both bounds."""
        return float(np.sqrt(max(self.low * self.high, 0.0)))


def check_rates(inspection: Inspection) -> Iterator[Finding]:
    """Find a recording whose rate gravity contradicts: motion and forces are too fast or slow."""
    both = _filtered_alike(inspection)
    if both is None:
        return
    up = inspection.feet.up
    weight = inspection.feet.model.weight
    core = core_frames(inspection)
    for frames in (supported(inspection) & core, between_steps(inspection, both.measured)):
        if not _lasts(inspection, frames, SHORTEST):
            continue
        carried = float((both.measured[frames] @ up).sum() / (both.needed[frames] @ up).sum())
        upwards = _slope(both, frames, up[:, None])
        known = upwards.explained >= EXPLAINED and upwards.size >= SWINGS * weight
        if not known or not LIGHTEST < carried < HEAVIEST:
            continue
        low = upwards.low / carried
        high = upwards.high / carried
        level = _slope(both, frames, np.eye(3) - np.outer(up, up)).middle / carried
        # Horizontal forces have no weight in them: they need not agree, but on the side.
        if (low > FASTEST and level > 1.0) or (high < SLOWEST and level < 1.0):
            yield _of_the_recording(inspection, float(np.sqrt(low * high)))
        return


def _of_the_recording(inspection: Inspection, ratio: float) -> Finding:
    """Name the rate of motion and forces, by the ratio of force to motion."""
    factor = ratio**-0.5
    text = RATES.message(
        f"plates and motion agree in the weight, but forces change {ratio:.2f} times as much as the"
        f" motion's acceleration: the head of the recording seems to state about {factor:.2g} times"
        " its rate: check its rates in Hz",
        size=factor,
    )
    return Finding(RATE, ", ".join(map(inspection.name, inspection.numbers)), text)


def check_paces(inspection: Inspection) -> Iterator[Finding]:
    """Find forces whose times run faster or slower than the motion's."""
    both = _filtered_alike(inspection)
    if both is None:
        return
    now = _agreement(inspection, 1.0)
    if now is not None and now > DISAGREES:
        return
    found = {pace: _agreement(inspection, pace) for pace in PACES}
    known = {pace: value for pace, value in found.items() if value is not None}
    if not known:
        return
    best = max(known, key=lambda pace: known[pace])
    if known[best] < AGREES_IN_ALL:
        return
    text = RATES.message(
        f"the forces agree with the motion when their times are multiplied by {best:.3g}: the rate"
        f" of one of both seems wrong in its head, by {best:.3g} times: check both in Hz",
        size=best,
    )
    yield Finding(PACE, ", ".join(map(inspection.name, inspection.numbers)), text)


def _agreement(inspection: Inspection, pace: float) -> float | None:
    """Share of the forces' variance that the motion explains when their times are stretched.

    Parameters
    ----------
    pace : by which the forces' times are multiplied, from their first on

    Returns
    -------
    None where the vertical forces do not agree, or too little is left
    """
    wrenches = inspection.wrenches
    start = wrenches.time[0]
    stretched = replace(wrenches, time=start + pace * (wrenches.time - start))
    paced = replace(inspection, wrenches=stretched)
    both = _filtered_alike(paced)
    if both is None:
        return None
    time = inspection.feet.time
    covered = time < stretched.time[-1] - SLACK
    up = inspection.feet.up
    best: float | None = None
    # Runners are in the air between their steps, which shows the rate as well.
    for frames in (between_steps(paced, both.measured), core_frames(paced)):
        used = frames & covered
        if not _lasts(inspection, used, 2.0 * SHORTEST):
            continue
        carried = float((both.measured[used] @ up).sum() / (both.needed[used] @ up).sum())
        upwards = _slope(both, used, up[:, None])
        if LIGHTEST < carried < HEAVIEST and upwards.explained >= AGREES:
            explained = _slope(both, used, np.eye(3)).explained
            best = explained if best is None else max(best, explained)
    return best


def _filtered_alike(inspection: Inspection) -> BalancedForces | None:
    """Filter measured forces as often as the motion was: when it was read, and when compared."""
    result = balance(inspection)
    if result is None:
        return None
    rate = 1.0 / float(np.mean(np.diff(inspection.feet.time)))
    measured = lowpass(result.measured, rate, cutoff_of(inspection))
    return BalancedForces(measured=np.asarray(measured), needed=result.needed)


def _lasts(inspection: Inspection, frames: NDArray[np.bool_], seconds: float) -> bool:
    """Return whether frames (frames,) are enough to compare."""
    step = float(np.median(np.diff(inspection.feet.time)))
    return bool(frames.sum() >= 10 and frames.sum() * step >= seconds)


def _slope(both: BalancedForces, frames: NDArray[np.bool_], axes: Array) -> Slope:
    """Compare changes of measured and needed forces.

    Parameters
    ----------
    both : (frames, 3) each [N]
    frames : (frames,) that are compared
    axes : (3, axes) along which they are
    """
    force = both.measured[frames] @ axes
    motion = both.needed[frames] @ axes
    force = force - force.mean(axis=0)
    motion = motion - motion.mean(axis=0)
    common = float((force * motion).sum())
    of_force = max(float((force**2).sum()), 1e-300)
    of_motion = max(float((motion**2).sum()), 1e-300)
    return Slope(
        low=common / of_motion,
        high=of_force / common if common > 0.0 else np.inf,
        explained=common * abs(common) / of_force / of_motion,
        size=float(np.sqrt(of_force / len(force))),
    )
