"""Contacts of both feet with the ground, by recorded events or by plates that carry the body."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.known import Origin
from myomorph.core.model.series import Event
from myomorph.core.model.stride_curves import STRIKES
from myomorph.lab.analysis.foot_events import LIFTS

SHORT_EVENT = re.compile(r"(?P<side>[RL])\.?\s?(?P<what>HS|IC|FS|FC|TO|FO)", re.IGNORECASE)
"""Events in short, as RHS for a strike of the right heel."""
SHORT_STRIKES = ("HS", "IC", "FS", "FC")
STEADY = 0.1  # Halves of a recording in which plates carry the body agree within this share.
UNLOADED = 0.05  # Of the mean force, below which nobody stands on the plates.
MIN_FLIGHT = 0.06  # A flight lasts so long at least, and so long at most [s].
MAX_FLIGHT = 0.9


@dataclass(frozen=True, kw_only=True)
class SeenContacts:
    """How feet touch the ground.

    Attributes
    ----------
    origin : "events" or "plates"
    flights : how often both feet are in the air, between contacts
    supports : how often a foot leaves the ground while the other one is on it
    steps : how often the feet take turns in striking the ground, 0 where plates do not show feet
    """

    origin: Origin
    flights: int = 0
    supports: int = 0
    steps: int = 0

    @property
    def tells_flight(self) -> bool:
        """Whether they show if the body flies."""
        return self.flights + self.supports > 0

    @property
    def flies(self) -> bool:
        """Whether more feet lift into a flight than onto the other foot."""
        return self.flights > self.supports


@dataclass(frozen=True, kw_only=True)
class FootEvent:
    """A strike or a lift of a foot at a time [s]."""

    time: float
    side: str
    is_strike: bool


def contacts_of_events(events: Sequence[Event]) -> SeenContacts | None:
    """Contacts by recorded strikes and lifts.

    A foot that lifts while the other one is on the ground is the end of a double support, of a
    walk; one that lifts while the other is in the air begins a flight. Whether the other is on the
    ground follows from its last event before, else from its next one.

    Parameters
    ----------
    events : of a recording, "Foot Strike" with a side, or RHS

    Returns
    -------
    the contacts; None where no event is one of a foot
    """
    feet = sorted(filter(None, map(_foot_event, events)), key=lambda event: event.time)
    if not feet:
        return None
    flights = 0
    supports = 0
    for event in feet:
        if event.is_strike:
            continue
        other = _is_on_ground([foot for foot in feet if foot.side != event.side], event.time)
        flights += other is False
        supports += other is True
    strikes = [event.side for event in feet if event.is_strike]
    steps = sum(one != other for one, other in itertools.pairwise(strikes))
    return SeenContacts(origin="events", flights=flights, supports=supports, steps=steps)


def _foot_event(event: Event) -> FootEvent | None:
    """Strike or lift that an event is of, None for another one."""
    label = event.label.lower().replace("_", " ").strip()
    side = event.side.lower()
    if side and label in (*STRIKES, *LIFTS):
        return FootEvent(time=event.time, side=side, is_strike=label in STRIKES)
    short = SHORT_EVENT.fullmatch(event.label.strip())
    if short is None:
        return None
    side = {"R": "right", "L": "left"}[short["side"].upper()]
    is_strike = short["what"].upper() in SHORT_STRIKES
    return FootEvent(time=event.time, side=side, is_strike=is_strike)


def _is_on_ground(foot: Sequence[FootEvent], time: float) -> bool | None:
    """Whether a foot is on the ground at a time [s], None where it has no event."""
    before = [event for event in foot if event.time <= time]
    if before:
        return before[-1].is_strike
    after = [event for event in foot if event.time > time]
    return not after[0].is_strike if after else None


def contacts_of_force(time: Array, force: Array) -> SeenContacts | None:
    """Contacts by the force of plates that carry the body all the time.

    In the mean over a recording the ground carries the weight, so the means over both halves agree
    where plates miss no step.

    Parameters
    ----------
    time : (samples,) [s]
    force : (samples,) vertical force of all plates [N]

    Returns
    -------
    the contacts, with each stretch between flights as a support; None where plates do not carry
    the body throughout
    """
    if len(time) < 2:
        return None
    mean = float(np.mean(force))
    first, second = np.array_split(force, 2)
    difference = abs(float(np.mean(first)) - float(np.mean(second)))
    if not mean > 0.0 or difference > STEADY * mean:
        return None
    last = len(time) - 1
    gaps = runs(force < UNLOADED * mean)
    lasting = [float(time[min(stop, last)] - time[start]) for start, stop in gaps]
    if any(duration > MAX_FLIGHT for duration in lasting):
        return None  # Somebody steps onto the plates, or off them.
    # A recording that begins or ends in the air does not show a whole flight.
    flights = sum(
        duration > MIN_FLIGHT and start > 0 and stop <= last
        for (start, stop), duration in zip(gaps, lasting, strict=True)
    )
    return SeenContacts(origin="plates", flights=flights, supports=0 if flights else 1)
