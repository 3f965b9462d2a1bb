"""Steps of a run: times, forces and stiffness of each.

With the contact time t_c, from where the vertical force F passes 3 % of body weight m g:

- flight time t_f: until the other foot meets the ground;
- duty factor: t_c over the time from strike to strike of the same foot (McMahon 1985);
- cadence: 60 over the time from strike to strike of one foot and the other;
- peak vertical force: the largest F, as measured;
- loading rate: mean slope of F from 20 to 80 % of its way to the impact peak (Milner et al. 2006),
  or to its value at 13 % of the contact where there is no impact peak (Blackmore et al. 2016);
- vertical stiffness (McMahon and Cheng 1990): k_vert = max F / dy, where y'' = F / m - g, twice
  integrated over the contact so that y is the same where it begins and ends (Cavagna 1975), and
  dy how far y goes down;
- leg stiffness (McMahon and Cheng 1990; Morin et al. 2005): k_leg = max F / dL with

      dL = L - sqrt(L^2 - (v t_c / 2)^2) + dy

  for a leg of length L and the speed v of travel.

A step whose force does not carry the body was not measured as a whole, as where half a foot is on
a plate: the mean force from strike to strike is the weight in a steady run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.quantity import Quantity
from myomorph.core.motion.peaks import prominent_peaks
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.part import UNKNOWN, Part, known_numbers, phases_between
from myomorph.lab.movements.support_force import (
    GRAVITY,
    SupportForce,
    accumulated,
    impulse,
)

MAX_STEP = 0.8
"""From strike to strike of both feet it is at most so long: else a step was not seen [s]."""
EARLY = 0.35
"""An impact peak is within this share of the contact."""
IMPACT = 0.05
"""It stands out by this share of body weight."""
NO_IMPACT = 0.13
"""Share of the contact at which loading ends where there is no impact peak."""
LOADING = (0.2, 0.8)
MIN_LOADING = 6
"""Samples between these from which on the slope is known."""
CARRIES = 0.25
"""By which share the mean force over a step may differ from the weight."""


@dataclass(frozen=True, kw_only=True)
class Stance:
    """When a foot is on the ground.

    Attributes
    ----------
    side : "right" or "left"
    start, stop : strike and lift [s], NaN where they were not seen
    measured : whether a plate carried the foot alone, from strike to lift
    length : of the step that begins with it, along the travel [m], NaN where it is not known
    """

    side: str
    start: float
    stop: float
    measured: bool = False
    length: float = UNKNOWN


@dataclass(frozen=True, kw_only=True)
class Runner:
    """Who runs how fast.

    Attributes
    ----------
    leg_length : of the straight leg, from the hip's center to the ground [m], NaN where not known
    speed : of travel [m/s], NaN where it is not known
    """

    leg_length: float = UNKNOWN
    speed: float = UNKNOWN


def running_steps(
    stances: Sequence[Stance], force: SupportForce | None, runner: Runner
) -> tuple[Part, ...]:
    """Find the numbers of each step, see the module.

    Parameters
    ----------
    stances : of both feet; those whose lift was not seen have no numbers
    force : under the feet, None without plates
    runner : leg length and speed

    Returns
    -------
    a part for each stance that was seen from strike to lift
    """
    ordered = sorted(
        (stance for stance in stances if np.isfinite(stance.start)), key=lambda each: each.start
    )
    steps = []
    for index, stance in enumerate(ordered):
        if not stance.stop > stance.start:
            continue
        steps.append(_step(stance, _following(stance, ordered[index + 1 :]), force, runner))
    return tuple(steps)


@dataclass(frozen=True, kw_only=True)
class _Following:
    """Strikes after a stance [s], NaN where they were not seen: of the other foot, of the same."""

    other: float = UNKNOWN
    same: float = UNKNOWN


def _following(stance: Stance, later: Sequence[Stance]) -> _Following:
    """Return the next strikes of the other foot and, after it, of the same."""
    if not later or later[0].side == stance.side or later[0].start - stance.start > MAX_STEP:
        return _Following()
    other = later[0].start
    if len(later) < 2 or later[1].side != stance.side or later[1].start - other > MAX_STEP:
        return _Following(other=other)
    return _Following(other=other, same=later[1].start)


def _step(
    stance: Stance, following: _Following, force: SupportForce | None, runner: Runner
) -> Part:
    """Numbers of one step."""
    contact = stance.stop - stance.start
    step_time = following.other - stance.start
    numbers = {
        of.CONTACT_TIME: contact,
        of.FLIGHT_TIME: max(following.other - stance.stop, 0.0)
        if np.isfinite(following.other)
        else UNKNOWN,
        of.DUTY_FACTOR: contact / (following.same - stance.start),
        of.CADENCE: 60.0 / step_time,
        of.STEP_LENGTH: stance.length,
    }
    own = None if force is None or not stance.measured else force.of_side(stance.side)
    if force is not None and own is not None:
        part = force.inside(stance.start, stance.stop)
        time = force.time[part]
        carried = own[part]
        if _carries(time, carried, force.weight, step_time):
            numbers |= _force_numbers(time, carried, force.weight, runner)
    return Part(
        start=stance.start,
        stop=stance.stop,
        side=stance.side,
        numbers=known_numbers(numbers),
        phases=phases_between(
            (stance.side, "flight"), (stance.start, stance.stop, following.other)
        ),
    )


def _carries(time: Array, force: Array, weight: float, step_time: float) -> bool:
    """Tell whether a force carries the body over a step, or may where its time is not known.

    Parameters
    ----------
    time, force : (samples,) within the contact [s], [N]
    weight : of the body [N]
    step_time : from strike to strike [s], NaN where it is not known
    """
    if len(time) < 3:
        return False
    if not np.isfinite(step_time):
        return float(force.max()) > weight
    mean = impulse(time, force) / step_time
    return abs(mean - weight) < CARRIES * weight


def _force_numbers(
    time: Array, force: Array, weight: float, runner: Runner
) -> dict[Quantity, float]:
    """Peak, loading rate and stiffness of a contact.

    Parameters
    ----------
    time, force : (samples,) within the contact [s], [N]
    weight : of the body [N]
    """
    peak = float(force.max())
    down = center_drop(time, force, weight)
    half_way = 0.5 * runner.speed * float(time[-1] - time[0])
    length = runner.leg_length
    shorter = length - np.sqrt(length**2 - half_way**2) if length > half_way else UNKNOWN
    return {
        of.PEAK_VERTICAL_FORCE: peak / weight,
        of.LOADING_RATE: loading_rate(time, force, weight) / weight,
        of.VERTICAL_STIFFNESS: 1e-3 * peak / down if down > 0.0 else UNKNOWN,
        of.LEG_STIFFNESS: 1e-3 * peak / (down + shorter) if down > 0.0 else UNKNOWN,
    }


def center_drop(time: Array, force: Array, weight: float) -> float:
    """Return how far the center of mass goes down in a contact.

    y'' = F / m - g, with the vertical velocity at the strike by which y ends where it began.

    Parameters
    ----------
    time, force : (samples,) within the contact [s], [N]
    weight : of the body [N]

    Returns
    -------
    [m]
    """
    acceleration = (force / weight - 1.0) * GRAVITY
    moved = accumulated(time, accumulated(time, acceleration))
    duration = float(time[-1] - time[0])
    height = moved - moved[-1] * (time - time[0]) / duration
    return -float(height.min())


def loading_rate(time: Array, force: Array, weight: float) -> float:
    """Mean slope of a force from 20 to 80 % of its way to the impact peak.

    Source: Milner et al. 2006; Blackmore et al. 2016 where there is no impact peak.

    Parameters
    ----------
    time, force : (samples,) within the contact [s], [N]
    weight : of the body [N]

    Returns
    -------
    [N/s], NaN where the plate took too few samples between them
    """
    early = time - time[0] <= EARLY * (time[-1] - time[0])
    peaks = prominent_peaks(force, IMPACT * weight)
    impacts = [peak for peak in peaks if early[peak] and peak < int(np.argmax(force))]
    at = float(time[0] + NO_IMPACT * (time[-1] - time[0]))
    end = impacts[0] if impacts else int(np.searchsorted(time, at))
    level = float(force[min(end, len(force) - 1)])
    rising = force[: end + 1]
    begin, end_share = LOADING
    over_high = np.flatnonzero(rising >= end_share * level)
    if not len(over_high):
        return UNKNOWN
    last = int(over_high[0])
    under_low = np.flatnonzero(rising[: last + 1] <= begin * level)
    first = int(under_low[-1]) if len(under_low) else 0
    if last - first < MIN_LOADING:
        return UNKNOWN
    slope, _ = np.polyfit(time[first : last + 1], force[first : last + 1], 1)
    return float(slope)
