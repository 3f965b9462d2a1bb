"""Contacts detected by microphones: impacts as contact intervals and as short forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.core.contact.clocks import sound_clock
from myomorph.core.contact.impacts import (
    Impact,
    calibration_pairs,
    effective_mass,
    impact_wrenches,
    impacts_from_sound,
    velocity_change,
)
from myomorph.core.contact.sound import HeardImpacts, Instrument, contacts_heard, hear_impacts
from myomorph.core.contact.strikers import Striker, find_strikers
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import SOUND
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Sound, Wrenches

Impulse = Literal["known", "motion"]
SURE = 0.8
"""Probability of a site below which it is reported that others may have struck."""


@read_only
class SoundPlan:
    """A recording of impacts.

    Attributes
    ----------
    speed : of sound [m/s]
    find_clock : whether the sound's beginning is found from the motion of what strikes
    known : instrument to (time [s], impulse [N s]) of impacts of known impulse
    directions : of the force on what strikes, by instrument, in ground; up where it is not named
    impulse : "known": from loudness, calibrated with the known impacts; "motion": effective mass of
        the site times its change of velocity
    pulse : length of a impact's force [s]
    """

    sound: Sound
    instruments: tuple[Instrument, ...]
    speed: float
    find_clock: bool
    known: Mapping[str, Sequence[tuple[float, float]]]
    directions: Mapping[str, Array]
    impulse: Impulse
    pulse: float


@dataclass(frozen=True, eq=False)
class Heard:
    """Impacts as contacts and forces.

    Attributes
    ----------
    forces : of impacts, on bodies at the motion's times
    sites : names of the sites that strike
    impacts : each with its instrument and interval, in the order of time
    """

    contacts: Contacts
    forces: Wrenches
    sites: tuple[str, ...]
    impacts: tuple[Impact, ...]


def heard_contacts(  # page: a recording of sound and of motion, with its filter
    plan: SoundPlan,
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    recorded: Motion,
    cutoff: float | None,
) -> Heard:
    """Find impacts during a motion, each at the site that struck.

    Parameters
    ----------
    plan : the recording of impacts
    model : of the body that strikes
    motion : filtered, whose times forces have
    sites : that may strike
    recorded : the motion before it was filtered: a filter takes most of an impact's change of
        velocity away
    cutoff : of that filter, which the forces go through too [Hz]
    """
    sound = plan.sound
    notes: list[Message] = []
    if plan.find_clock:
        impacts_heard = hear_impacts(sound, plan.instruments, plan.speed)
        clock = sound_clock(impacts_heard, model, recorded, sites)
        sound = replace(sound, start=sound.start + clock.shift)
        notes.append(
            SOUND.message(
                f"the sound begins at {sound.start:.3f} s of the motion, as {clock.impacts} impacts"
                f" show ({clock.ratio:.1f} times better than the next best time)",
                severity="good to know",
            )
        )
    heard = hear_impacts(sound, plan.instruments, plan.speed, np.asarray(recorded.time))
    strikers = find_strikers(heard, model, recorded, sites)
    inside = HeardImpacts(
        heard.instruments, tuple(heard.impacts[number] for number in strikers), heard.warnings
    )
    names = tuple(striker.site for striker in strikers.values())
    contacts = contacts_heard(inside, names, plan.pulse)
    notes += [*contacts.warnings, *_uncertain(heard, strikers)]
    if plan.impulse == "motion":
        impacts = _impacts_by_motion(plan, heard, strikers, model, recorded, sites)
    else:
        laws = calibration_pairs(heard, plan.known)
        impacts, warnings = impacts_from_sound(heard, laws, strikers, plan.directions)
        notes += warnings
    able = [name for instrument in plan.instruments for name in instrument.sites]
    return Heard(
        contacts=Contacts(contacts.sites, contacts.intervals, tuple(notes)),
        forces=impact_wrenches(impacts, model, motion, sites, plan.pulse, cutoff),
        sites=tuple(dict.fromkeys(able)),
        impacts=impacts,
    )


def _uncertain(heard: HeardImpacts, strikers: Mapping[int, Striker]) -> list[Message]:
    """Name impacts that more than one site may have made; one line at most."""
    unclear = [number for number, striker in strikers.items() if striker.confidence < SURE]
    if not unclear:
        return []
    first = heard.impacts[unclear[0]]
    return [
        SOUND.message(
            f"which site struck is not shown for {len(unclear)} of {len(strikers)} impacts, first"
            f" on '{first.instrument}' at {first.time:.3f} s: others are as likely where two"
            " instruments are struck at once"
        )
    ]


def _impacts_by_motion(
    plan: SoundPlan,
    heard: HeardImpacts,
    strikers: Mapping[int, Striker],
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
) -> tuple[Impact, ...]:
    """Impulses as effective mass times change of velocity, along each instrument's direction.

    Parameters
    ----------
    strikers : by place in `heard.impacts`
    motion : before it was filtered
    """
    by_name = {site.name: site for site in sites}
    results = []
    for number, striker in strikers.items():
        impact = heard.impacts[number]
        site = by_name[striker.site]
        direction = plan.directions[impact.instrument]
        frame = int(np.argmin(np.abs(motion.time - impact.time)))
        instant = Motion(motion.time[[frame]], motion.names, motion.values[[frame]])
        mass = effective_mass(model, instant, site.body, site.points.mean(axis=0), direction)[0]
        change = max(float(velocity_change(model, motion, site, impact.time) @ direction), 0.0)
        results.append(
            Impact(
                site=striker.site,
                time=impact.time,
                impulse=mass * change if np.isfinite(mass) else 0.0,
                direction=direction,
                instrument=impact.instrument,
                confidence=striker.confidence,
            )
        )
    return tuple(results)
