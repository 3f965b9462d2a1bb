"""Jumps: heights, impulse, power, rate of force, and landing of each.

With the vertical force F of both feet, the weight W = m g of quiet standing before the jump, and
its onset (five standard deviations of quiet standing, less 30 ms: Owen et al. 2014):

    v(t) = g integral (F / W - 1) dt      net impulse J = m v(take-off)
    x(t) = integral v dt                  depth = -min x
    power = F v                           height by impulse = v(take-off)^2 / 2 g
    height by flight time t_f = g t_f^2 / 8

Phases are those of McMahon et al. 2018: unweighting (until v is lowest), braking (until v is 0),
propulsion (until take-off), flight, landing (until the body has stopped). The rate of force
development is the slope from the smallest to the largest force before take-off (McLellan et al.
2011). Of a drop jump, a contact between a fall and a flight, nobody stands still before: velocity
is that which ends with the take-off velocity g t_f / 2. Its reactive strength index is height over
contact time (Young 1995). Landing begins with the velocity of the fall.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.quantity import Quantity
from myomorph.lab.analysis.phases import SHORTEST_FLIGHT, Phase, quiet_standing
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.part import UNKNOWN, Part, known_numbers, phases_between
from myomorph.lab.movements.support_force import (
    GRAVITY,
    Contact,
    SupportForce,
    accumulated,
)

MAX_FLIGHT = 1.1
"""Who is off the plates for longer has left them; it is the flight of a jump of 1.5 m [s]."""
MAX_REBOUND = 1.0
"""A contact between a fall and a flight is a rebound where it is at most so long [s]."""
LANDED = 1.0
"""A landing is looked for within so long [s]."""
PUSH = ("unweighting", "braking", "propulsion")
MAX_LEVEL = 0.2
"""The center of mass is about as high at take-off as where a drop jump meets the ground: where it
is not, weight and force contradict each other [m]."""
MIN_DIP = 0.05
"""Unweighting lowers the velocity by this share of that of take-off; else there is none."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class PushOff:
    """The contact before a flight.

    Attributes
    ----------
    time, force : (samples,) until take-off [s], [N]
    velocity, height : (samples,) of the center of mass [m/s], [m], the height from where it began
    weight : of the body [N]
    rebound : whether it follows a fall
    """

    time: Array
    force: Array
    velocity: Array
    height: Array
    weight: float
    rebound: bool

    @property
    def holds(self) -> bool:
        """Whether velocity and height are known."""
        return not self.rebound or abs(float(self.height[-1])) < MAX_LEVEL

    @property
    def slowest(self) -> int:
        """Sample of the lowest velocity."""
        return int(np.argmin(self.velocity))

    @property
    def dips(self) -> bool:
        """Whether the body goes down before it goes up."""
        return float(self.velocity.min()) < -MIN_DIP * max(float(self.velocity[-1]), 1e-9)

    @property
    def turn(self) -> int:
        """Sample from which on it goes up."""
        down = np.flatnonzero(self.velocity < 0.0)
        return min(int(down[-1]) + 1, len(self.time) - 1) if self.dips and len(down) else 0


def jumps(force: SupportForce) -> tuple[Part, ...]:
    """Find all jumps in a recording of the force under the feet, see the module.

    Parameters
    ----------
    force : under the feet, as measured

    Returns
    -------
    one part a flight, from onset (or from the contact of a drop jump) to the end of the landing
    """
    found = []
    for before, after in itertools.pairwise(force.contacts(force.total)):
        flight = after.start - before.stop
        if SHORTEST_FLIGHT <= flight <= MAX_FLIGHT:
            found.append(_jump(force, before, after))
    return tuple(found)


def _jump(force: SupportForce, before: Contact, after: Contact) -> Part:
    """Numbers of the jump between two contacts."""
    flight = after.start - before.stop
    push = _push_off(force, before, flight)
    numbers = {
        of.FLIGHT_TIME: flight,
        of.HEIGHT_BY_FLIGHT: GRAVITY * flight**2 / 8.0,
    }
    take_off = GRAVITY * flight / 2.0
    weight = force.weight
    start = before.stop
    phases: tuple[Phase, ...] = ()
    if push is not None:
        weight = push.weight
        start = float(push.time[0])
        phases = _push_phases(push, before.stop)
        numbers |= _push_numbers(force, push, numbers[of.HEIGHT_BY_FLIGHT], before)
        if not push.rebound:
            take_off = float(push.velocity[-1])
    stopped = _stopped(force, after, GRAVITY * flight - take_off, weight)
    numbers |= _landing_numbers(force, after, stopped, weight)
    return Part(
        start=start,
        stop=stopped if np.isfinite(stopped) else after.start,
        numbers=known_numbers(numbers),
        phases=(
            *phases,
            *phases_between(("flight", "landing"), (before.stop, after.start, stopped)),
        ),
    )


def _push_off(force: SupportForce, before: Contact, flight: float) -> PushOff | None:
    """Return velocity and height before a flight; None where nothing tells the velocity."""
    part = force.inside(before.start, before.stop)
    if part.stop - part.start < 3:
        return None
    contact = (part.start, part.stop - 1)
    quiet = quiet_standing(force.time, force.total, contact, force.weight)
    rebound = quiet is None
    if quiet is None:
        if not before.begins or before.duration > MAX_REBOUND:
            return None
        weight = force.weight
    else:
        weight = quiet.weight
        part = slice(quiet.onset, part.stop)
    time = force.time[part]
    total = force.total[part]
    velocity = accumulated(time, (total / weight - 1.0) * GRAVITY)
    if rebound:
        velocity += GRAVITY * flight / 2.0 - velocity[-1]
    return PushOff(
        time=time,
        force=total,
        velocity=velocity,
        height=accumulated(time, velocity),
        weight=weight,
        rebound=rebound,
    )


def _push_numbers(
    force: SupportForce, push: PushOff, by_flight: float, before: Contact
) -> dict[Quantity, float]:
    """Numbers of the contact before a flight."""
    mass = push.weight / GRAVITY
    up = push.time[push.turn]
    numbers = {}
    if push.holds:
        numbers[of.PEAK_POWER] = float((push.force * push.velocity).max()) / mass
        numbers[of.PUSH_SHARE] = force.right_share(float(up), before.stop)
    if push.holds and push.dips:
        numbers[of.COUNTERMOVEMENT_DEPTH] = -float(push.height.min())
    if push.rebound:
        return numbers | {
            of.CONTACT_TIME: before.duration,
            of.REACTIVE_STRENGTH: by_flight / before.duration,
        }
    velocity = float(push.velocity[-1])
    by_impulse = max(velocity, 0.0) ** 2 / (2.0 * GRAVITY)
    return numbers | {
        of.NET_IMPULSE: mass * velocity,
        of.HEIGHT_BY_IMPULSE: by_impulse,
        of.HEIGHT_DIFFERENCE: by_flight - by_impulse,
        of.FORCE_RATE: _force_rate(push),
    }


def _force_rate(push: PushOff) -> float:
    """Mean slope of the force from its smallest to its largest value before take-off [N/s]."""
    first = int(np.argmin(push.force[: push.turn + 1])) if push.dips else 0
    top = first + int(np.argmax(push.force[first:]))
    duration = float(push.time[top] - push.time[first])
    return float(push.force[top] - push.force[first]) / duration if duration > 0.0 else UNKNOWN


def _push_phases(push: PushOff, off: float) -> tuple[Phase, ...]:
    """Phases before take-off at a time [s]; of a drop jump there is no unweighting."""
    start = float(push.time[0])
    up = float(push.time[push.turn])
    if not push.holds:
        return phases_between(("contact",), (start, off))
    if push.rebound or not push.dips:
        return phases_between(("braking", "propulsion"), (start, up, off))
    return phases_between(PUSH, (start, float(push.time[push.slowest]), up, off))


def _stopped(force: SupportForce, after: Contact, falls: float, weight: float) -> float:
    """Return when a fall has stopped after it met the ground [s], NaN where it did not."""
    part = force.inside(after.start, min(after.start + LANDED, after.stop))
    time = force.time[part]
    if len(time) < 3:
        return UNKNOWN
    velocity = accumulated(time, (force.total[part] / weight - 1.0) * GRAVITY, -falls)
    up = np.flatnonzero(velocity >= 0.0)
    return float(time[up[0]]) if len(up) else UNKNOWN


def _landing_numbers(
    force: SupportForce, after: Contact, stopped: float, weight: float
) -> dict[Quantity, float]:
    """Largest force and its share of the right leg, until the body has stopped."""
    if not np.isfinite(stopped):
        return {}
    part = force.inside(after.start, stopped)
    return {
        of.LANDING_FORCE: float(force.total[part].max()) / weight,
        of.LANDING_SHARE: force.right_share(after.start, stopped),
    }
