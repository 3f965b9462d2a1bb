"""Unmeasured contacts, in the step of muscle tensions: where, when, how ready, and what is known of
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.contact.feet_on_steps import Stairs, shared_stairs, stairs_contacts
from myomorph.core.contact.heard import heard_contacts
from myomorph.core.contact.held_objects import find_holds, raised_contacts
from myomorph.core.contact.plan import FOREVER, ContactPlan
from myomorph.core.contact.shared import misplaced_forces, shared_wrenches, without_measured
from myomorph.core.contact.site_motion import plate_height, rest_on_floor
from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.states import (
    ActivationOptions,
    ContactStateOptions,
    contact_activations,
    find_contacts,
    preferred_directions,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces, Contacts, SharedWrench, Site
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import ForcePlate, Motion, Series, Wrenches
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask

NAME_SITES = "name sites in a contact file (--contacts FILE.toml)"


@dataclass(frozen=True, eq=False)
class ContactSetting:
    """Contacts of a recording, ready for the tension problem."""

    task: ContactTask
    contacts: Contacts
    # measured forces that act as they were measured, None where there are none
    exact: Wrenches | None
    notes: tuple[str, ...] = ()


@read_only
class Measurements:
    """What a recording shows of contacts beside the motion."""

    recorded: Motion  # the motion before it was filtered
    wrenches: Wrenches | None = None  # forces of plates on bodies, at the motion's times
    # plates, plate_time: the plates themselves, where their outlines are known, and the clock of
    # their forces [s]
    plates: Sequence[ForcePlate] = ()
    plate_time: Array | None = None
    cutoff: float | None = None  # of that filter [Hz]
    # the motion with feet that stay on the floor, for finding contacts; None where the motion
    # itself shows them
    standing: Motion | None = None


def set_contacts(
    plan: ContactPlan, model: Model, motion: Motion, known: Measurements, options: ContactOptions
) -> ContactSetting:
    """Sites, touches and activations of a motion, and what measured forces show of them."""
    measured = known.wrenches
    if plan.stairs is not None:
        return _on_stairs(plan.stairs, plan, model, motion, measured, options)
    standing = known.standing or motion
    feet = _soles(plan, model)
    seen = None if plan.measured == "hidden" else measured
    feet, floor = (
        rest_on_floor(model, standing, feet, plate_height(model, seen)) if feet else (feet, None)
    )
    sites = (*feet, *plan.sites)
    if not sites:
        raise BadData(
            f"no contact site: '{model.name}' has no feet, and no site is named; {NAME_SITES}"
        )
    heard = None
    if plan.sound is not None:
        heard = heard_contacts(plan.sound, model, motion, sites, known.recorded, known.cutoff)
    height = None if floor is None else floor.height
    reported = [
        values
        for values in (plan.reported, None if heard is None else heard.contacts)
        if values is not None
    ]
    raised = _raised(plan, reported, model, motion, feet)
    reported += [contacts for contacts, _ in raised.values()]
    contacts = _all_contacts(
        plan, reported, model, standing, sites, seen, ContactStateOptions(floor=height)
    )
    elsewhere: tuple[str, ...] = ()
    if plan.reported is not None:
        elsewhere = (
            *never_during(plan.reported, known.recorded.time),
            *unreported_feet(plan.reported, feet),
        )
    ready = contact_activations(model, standing, sites, contacts, ActivationOptions(floor=height))
    ready = _with(ready, {name: activation for name, (_, activation) in raised.items()})
    if plan.measured == "exact" and measured is not None:
        ready = without_measured(model, ready, sites, measured)
    shared: tuple[SharedWrench, ...] = ()
    plates = known.plates if any(len(plate.forces) for plate in known.plates) else measured
    if plan.measured == "shared" and plates is not None:
        shared = shared_wrenches(model, motion, sites, contacts, plates, known.plate_time)
    exact = measured if plan.measured == "exact" else None
    if heard is not None:
        # Their forces are known already.
        ready = _with(ready, dict.fromkeys(heard.sites, 0.0))
        exact = heard.impacts if exact is None else exact.and_others(heard.impacts)
    warnings = (
        misplaced_forces(model, motion, feet, measured) if feet and measured is not None else ()
    )
    task = ContactTask(
        sites=sites,
        activations=ready,
        measured=shared,
        options=options,
        preferred=preferred_directions(model, motion, sites),
    )
    return ContactSetting(
        task=task, contacts=contacts, exact=exact, notes=(*contacts.warnings, *elsewhere, *warnings)
    )


def _on_stairs(
    stairs: Stairs,
    plan: ContactPlan,
    model: Model,
    motion: Motion,
    measured: Wrenches | None,
    options: ContactOptions,
) -> ContactSetting:
    """Paws on steps: the cells tell touches, and forces for the sites on each step together.
    Loads that are given beside act as they are; then only steps that these leave out are shared.
    """
    paws = stairs.paws_in(model, motion)
    contacts = stairs_contacts(paws)
    exact = measured if plan.measured == "exact" else None
    ready = contacts.states(motion.time)
    known: set[str] = set()
    if exact is not None:
        ready = without_measured(model, ready, paws.sites, exact)
        pairs = ((step.name, site.body) for step in paws.steps for site in paws.sites)
        known = {step for step, body in pairs if f"{step}_{body}" in exact.names}
    task = ContactTask(
        sites=paws.sites,
        activations=ready,
        measured=shared_stairs(paws, known),
        options=options,
        preferred=preferred_directions(model, motion, paws.sites),
    )
    return ContactSetting(task=task, contacts=contacts, exact=exact, notes=paws.notes)


def during(contacts: Contacts, start: float, stop: float) -> Contacts:
    """Touches that always last, cut to a motion's start and stop [s]."""
    touches = (
        replace(
            interval,
            start=max(interval.start, start) if interval.start <= -FOREVER else interval.start,
            stop=min(interval.stop, stop) if interval.stop >= FOREVER else interval.stop,
        )
        for interval in contacts.intervals
    )
    return replace(contacts, intervals=tuple(touches))


def unreported_feet(reported: Contacts, feet: Sequence[Site]) -> tuple[str, ...]:
    """Soles that a file leaves out while it tells of others: who took their lines away meant that
    they never touch.
    """
    names = [item.name for item in feet]
    lacking = [name for name in names if name not in reported.sites]
    if not lacking or len(lacking) == len(names):
        return ()
    return (f"no contact interval is specified for {', '.join(lacking)}: found from the motion",)


def never_during(reported: Contacts, time: Array) -> tuple[str, ...]:
    """What to say of sites whose touches all lie before or after a motion (frames,)."""
    start = float(time[0])
    stop = float(time[-1])
    texts = []
    for name in reported.sites:
        touches = reported.of(name)
        if touches and all(touch.stop < start or touch.start > stop for touch in touches):
            spans = (
                f"{min(touch.start for touch in touches):g} to"
                f" {max(touch.stop for touch in touches):g} s"
            )
            texts.append(
                f"'{name}' is specified to touch at {spans}, the motion is {start:g} to {stop:g} s:"
                " it never touches"
            )
    return tuple(texts)


def _soles(plan: ContactPlan, model: Model) -> tuple[Site, ...]:
    """Sites under the feet, where they are asked for; none for a model without feet whose sites are
    named.
    """
    if not plan.feet:
        return ()
    try:
        return foot_sites(model)
    except MyomorphError as error:
        if plan.sites:
            return ()
        raise BadData(f"no contact site: {error}; {NAME_SITES}") from None


def _all_contacts(
    plan: ContactPlan,
    reported: Sequence[Contacts],
    model: Model,
    motion: Motion,
    sites: tuple[Site, ...],
    measured: Wrenches | None,
    options: ContactStateOptions,
) -> Contacts:
    """Touches that files and sound tell; those of every other site from plates and motion."""
    names = tuple(site.name for site in sites)
    known = {name for contacts in reported for name in contacts.sites}
    for name in sorted(known):
        if name not in names:
            raise BadData(
                f"contact intervals are specified for '{name}', but the contact sites are"
                f" {', '.join(names)}"
            )
    by_motion = tuple(
        site
        for site in sites
        if plan.when.get(site.name, "motion") == "motion" and site.name not in known
    )
    standing = tuple(site for site in by_motion if site.against == GROUND)
    holding = tuple(site for site in by_motion if site.against != GROUND)
    result = [find_contacts(model, motion, standing, options, measured)] if standing else []
    result += [find_holds(model, motion, holding)] if holding else []
    parts = (*reported, *result)
    against = {site.name: site.against for site in sites}
    # Tables seldom tell the surface; of a site against a body it is that body.
    touches = tuple(
        replace(touch, surface=against[touch.site]) if touch.surface == GROUND else touch
        for part in parts
        for touch in part.intervals
    )
    return Contacts(names, touches, tuple(text for part in parts for text in part.warnings))


def _raised(
    plan: ContactPlan,
    reported: Sequence[Contacts],
    model: Model,
    motion: Motion,
    soles: Sequence[Site],
) -> dict[str, tuple[Contacts, Array]]:
    """Touches and activations (frames,) of sites that rest on something else than the floor, as the
    motion tells.
    """
    known = {name for contacts in reported for name in contacts.sites}
    return {
        site.name: raised_contacts(model, motion, site, soles, plan.surfaces[site.name])
        for site in plan.sites
        if site.name in plan.surfaces and site.against == GROUND and site.name not in known
    }


def _with(ready: Series, columns: Mapping[str, Array | float]) -> Series:
    """The activations with other columns of some sites."""
    values = np.array(ready.values)
    for name, column in columns.items():
        values[:, ready.names.index(name)] = column
    return replace(ready, values=values)


def all_loads(exact: Wrenches | None, estimated: ContactForces) -> Wrenches:
    """Every force that acted on the bodies, one load a body: measured ones and those of contacts."""
    result = estimated.wrenches("body")
    if exact is None:
        return result
    bodies = tuple(dict.fromkeys((*exact.bodies, *result.bodies)))
    summed = np.zeros((3, len(result), len(bodies), 3))
    for j, body in enumerate(bodies):
        parts = [
            (values, i)
            for values in (exact, result)
            for i, other in enumerate(values.bodies)
            if other == body
        ]
        force = np.stack([part.forces[:, i] for part, i in parts])
        point = np.nan_to_num(np.stack([part.points[:, i] for part, i in parts]))
        torque = np.stack([part.torques[:, i] for part, i in parts])
        size = np.linalg.norm(force, axis=2, keepdims=True)
        share = size / np.where(size.sum(axis=0) > 0.0, size.sum(axis=0), 1.0)
        middle = (share * point).sum(axis=0)
        summed[:, :, j] = (
            force.sum(axis=0),
            middle,
            (torque + np.cross(point - middle, force)).sum(axis=0),
        )
    return Wrenches(result.time, bodies, bodies, *summed)
