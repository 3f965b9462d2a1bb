"""What is known of the contacts of a recording before anything is computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from myomorph.contact.feet_on_steps import Stairs
from myomorph.contact.impacts import (
    Impact,
    calibration_pairs,
    effective_mass,
    impact_wrenches,
    impacts_from_sound,
    site_places,
    striking_sites,
    velocity_change,
)
from myomorph.contact.sound import HeardImpacts, Instrument, contacts_heard, hear_impacts
from myomorph.model.arrays import Array, read_only
from myomorph.model.contacts import Contacts, Site
from myomorph.model.errors import BadData, check_name
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.series import Motion, Sound, Wrenches

EITHER_SIDE = 0.015  # Time before and after a moment over which a tip's change of velocity is taken [s]
STEP, APART = 0.001, 0.06
"""Step of the shifts that are tried, and how far another shift is that could have been meant [s]."""
MIN_COUNT = 3


@dataclass(frozen=True)
class SoundClock:
    """How much later on the motion's clock a sound starts than it was said to."""

    shift: float  # to be added to `Sound.start` [s]
    ratio: float  # mean change of velocity at the impacts over that at the next best shift; 1 shows nothing
    impacts: int  # how many lie within the motion then


def sound_clock(
    heard: HeardImpacts, model: Model, motion: Motion, sites: Sequence[Site], reach: float = 5.0
) -> SoundClock:
    """The shift at which impacts fall on the largest changes of velocity of the sites that make them.
    `sites`: at least those that the instruments name; `reach`: largest shift either way [s].
    """
    by_name = {site.name: site for site in sites}
    changes: dict[str, Array] = {}
    for instrument in heard.instruments:
        for name in instrument.sites:
            check_name("contact site", name, by_name, "the model's sites")
        if instrument.sites:
            each = [_changes(motion.time, site_places(model, motion, by_name[name])) for name in instrument.sites]
            changes[instrument.name] = np.max(each, axis=0)
    used = [impact for impact in heard.impacts if impact.instrument in changes]
    if len(used) < MIN_COUNT:
        raise BadData(f"{len(used)} impacts by sites of the model: a clock needs {MIN_COUNT} or more")
    shifts = np.arange(-reach, reach + 0.5 * STEP, STEP)
    summed, count = np.zeros(len(shifts)), np.zeros(len(shifts))
    for impact in used:
        at = impact.time + shifts
        inside = (at >= motion.time[0]) & (at <= motion.time[-1])
        summed += np.where(inside, np.interp(at, motion.time, changes[impact.instrument]), 0.0)
        count += inside
    # Few impacts that fit well by chance must not win over all of them.
    mean = np.where(count >= max(MIN_COUNT, 0.5 * count.max()), summed / np.maximum(count, 1.0), 0.0)
    best = int(np.argmax(mean))
    others = mean[np.abs(shifts - shifts[best]) > APART]
    ratio = float(mean[best] / max(others.max(initial=0.0), 1e-300))
    return SoundClock(float(shifts[best]), ratio, int(count[best]))


def _changes(time: Array, places: Array) -> Array:
    """Change of velocity (frames,) over `EITHER_SIDE` about each moment [m/s]."""
    velocities = np.gradient(places, time, axis=0)
    sides = (EITHER_SIDE, -EITHER_SIDE)
    after, before = ([np.interp(time + side, time, column) for column in velocities.T] for side in sides)
    return np.linalg.norm(np.array(after) - before, axis=0)


@dataclass(frozen=True)
class CameraClock:
    """What a camera's time is on the motion's clock: t_motion = start + pace t_camera."""

    start: float = 0.0  # time of the camera's zero on the motion's clock [s]
    pace: float = 1.0  # seconds of the motion per second of the camera
    error: float = 0.0  # largest distance of the events seen by both from this line [s]


def camera_clock(seen: Sequence[float], known: Sequence[float], drift: float = 1e-3) -> CameraClock:
    """The clock of a camera from events that both saw, as a flash, a clap or a heel drop.
    One event gives the start; two or more give the pace too, by least squares, so they should lie far apart.
    `seen`, `known`: times of the events on the camera's and on the motion's clock, in the same order [s]; `drift`:
    greatest difference of the pace from 1 that is believed.
    """
    a, b = np.asarray(seen, dtype=np.float64), np.asarray(known, dtype=np.float64)
    if not len(a) or len(a) != len(b):
        raise BadData(f"{len(a)} events on the camera's clock, {len(b)} on the motion's: expected as many, one or more")
    if len(a) == 1 or np.ptp(a) == 0.0:
        return CameraClock(float(np.mean(b - a)), 1.0, float(np.ptp(b - a)))
    pace, start = np.polyfit(a, b, 1)
    error = float(np.abs(start + pace * a - b).max())
    if abs(pace - 1.0) > drift:
        raise BadData(
            f"the camera's clock runs {pace:.4f} times as fast as the motion's: is its rate right, or were events of "
            "different moments paired?"
        )
    return CameraClock(float(start), float(pace), error)


def on_clock(contacts: Contacts, clock: CameraClock) -> Contacts:
    """The same contacts on the motion's clock."""
    start, pace = clock.start, clock.pace
    intervals = (
        replace(touch, start=start + pace * touch.start, stop=start + pace * touch.stop) for touch in contacts.intervals
    )
    return replace(contacts, intervals=tuple(intervals))


Impulse = Literal["known", "motion"]


@read_only
class SoundPlan:
    """A recording of impacts.

    Attributes
    ----------
    speed : of sound [m/s]
    find_clock : whether the sound's beginning is found from the motion of what strikes
    known : instrument to (time [s], impulse [N s]) of impacts of known impulse
    directions : of the force on what strikes, by instrument, in ground; up where it is not named
    impulse : "known": from loudness, calibrated with the known impacts; "motion": effective mass of the site times its
        change of velocity
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
    """Impacts as contacts and forces."""

    contacts: Contacts
    impacts: Wrenches  # forces on bodies at the motion's times
    sites: tuple[str, ...]  # names of the sites that strike


def heard_contacts(
    plan: SoundPlan, model: Model, motion: Motion, sites: Sequence[Site], recorded: Motion, cutoff: float | None
) -> Heard:
    """Impacts during a motion, each at the site that struck.
    `recorded`: the motion before it was filtered: a filter takes most of a impact's change of velocity away; `cutoff`:
    of that filter, which the forces go through too [Hz].
    """
    sound = plan.sound
    result: tuple[str, ...] = ()
    if plan.find_clock:
        clock = sound_clock(hear_impacts(sound, plan.instruments, plan.speed), model, recorded, sites)
        sound = replace(sound, start=sound.start + clock.shift)
        result = (
            f"the sound begins at {sound.start:.3f} s of the motion, as {clock.impacts} impacts show "
            f"({clock.ratio:.1f} times better than the next best time)",
        )
    heard = hear_impacts(sound, plan.instruments, plan.speed, np.asarray(recorded.time))
    struck = striking_sites(heard, model, recorded, sites)
    own = tuple(dict.fromkeys(name for instrument in plan.instruments for name in instrument.sites))
    inside = HeardImpacts(heard.instruments, tuple(heard.impacts[number] for number in struck), heard.warnings)
    contacts = contacts_heard(inside, tuple(struck.values()), plan.pulse)
    warned: tuple[str, ...] = ()
    if plan.impulse == "motion":
        impacts = _impacts_by_motion(plan, heard, struck, model, recorded, sites)
    else:
        laws = calibration_pairs(heard, plan.known)
        impacts, warned = impacts_from_sound(heard, laws, struck, plan.directions)
    forces = impact_wrenches(impacts, model, motion, sites, plan.pulse, cutoff)
    return Heard(Contacts(contacts.sites, contacts.intervals, (*result, *contacts.warnings, *warned)), forces, own)


def _impacts_by_motion(
    plan: SoundPlan, heard: HeardImpacts, struck: Mapping[int, str], model: Model, motion: Motion, sites: Sequence[Site]
) -> tuple[Impact, ...]:
    """Impulses as effective mass times change of velocity, along each instrument's direction."""
    by_name = {site.name: site for site in sites}
    results = []
    for index, name in struck.items():
        impact, site = heard.impacts[index], by_name[name]
        direction = plan.directions[impact.instrument]
        frame = int(np.argmin(np.abs(motion.time - impact.time)))
        instant = Motion(motion.time[[frame]], motion.names, motion.values[[frame]])
        mass = effective_mass(model, instant, site.body, site.points.mean(axis=0), direction)[0]
        change = max(float(velocity_change(model, motion, site, impact.time) @ direction), 0.0)
        results.append(Impact(name, impact.time, mass * change if np.isfinite(mass) else 0.0, direction))
    return tuple(results)


When: TypeAlias = Literal["always", "motion", "file"]

FOREVER = 1e9  # End of a contact interval that always lasts [s]


@dataclass(frozen=True, eq=False)
class ContactPlan:
    """What is known of the contacts of a recording before anything is computed."""

    feet: bool = True  # whether the soles of the model's feet are sites
    sites: tuple[Site, ...] = ()  # beside the soles
    # of each of `sites` what determines when it touches: "always", the "motion", or the "file" of its intervals
    when: Mapping[str, When] = field(default_factory=lambda: FrozenMap({}))
    # height of what a site rests on where that is not the floor [m], None for the lowest that it gets
    surfaces: Mapping[str, float | None] = field(default_factory=lambda: FrozenMap({}))
    reported: Contacts | None = None  # contact intervals of a file; of the soles too where it names them
    # impacts that microphones recorded, whose forces are known by their loudness or motion
    sound: SoundPlan | None = None
    # what measured loads are used for: "exact": they act as measured, and contacts are estimated where none was
    # measured; "shared": each is known for the sites on it together; "hidden": not at all
    measured: Literal["exact", "shared", "hidden"] = "exact"
    # load cells of steps that show who stands on them and, together, what force they carry
    stairs: Stairs | None = None

    @property
    def situation(self) -> Literal["unknown", "shared", "sound"]:
        """Which of the situations of [D] chapter 4 it is."""
        if self.sound is not None:
            return "sound"
        return "shared" if self.measured == "shared" else "unknown"
