"""Unmeasured contacts for muscle tensions: sites, intervals, activations, measured forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.alone import AloneOnPlates, alone_on_plates, still_shared
from myomorph.core.contact.feet_on_steps import Stairs, shared_stairs, stairs_contacts
from myomorph.core.contact.found_supports import find_supports
from myomorph.core.contact.heard import Heard, heard_contacts
from myomorph.core.contact.held_objects import RaisedContact, find_holds, raised_contacts
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
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
from myomorph.core.contact.supports import Supports
from myomorph.core.contact.whole_feet import contacts_of_sites
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import CONTACT_TIMES, FEET_BESIDE
from myomorph.core.model.contacts import FOREVER, ContactForces, Contacts, SharedWrench, Site
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask

NAME_SITES = "name sites in a contact file (--contacts FILE.toml)"


@dataclass(frozen=True, eq=False)
class ContactSetting:
    """Contacts of a recording, ready for the tension problem.

    Attributes
    ----------
    exact : measured forces that act as they were measured, None where there are none
    plates : what plates measured of the sites on them, together; where forces are shared, `task`
        has to keep to those of several contacts
    heard : impacts whose forces act as their sound tells, None for none
    alone : forces of contacts that had a plate for themselves, where forces are shared
    supports : steps, rails and seats that carry
    """

    task: ContactTask
    contacts: Contacts
    exact: Wrenches | None
    notes: tuple[Message, ...] = ()
    plates: tuple[SharedWrench, ...] = ()
    heard: Heard | None = None
    alone: AloneOnPlates | None = None
    supports: Supports = field(default_factory=Supports)

    def with_known(self, forces: ContactForces) -> ContactForces:
        """Add forces of impacts, and of contacts alone on plates, where nothing was estimated.

        Parameters
        ----------
        forces : at contact sites, as estimated
        """
        if self.alone is not None:
            forces = self.alone.added_to(forces)
        if self.heard is None:
            return forces
        known = self.heard.forces
        values = np.array(forces.contact_force)
        for column, name in enumerate(known.names):
            values[:, forces.names.index(name)] += known.forces[:, column]
        return replace(forces, contact_force=values)


@read_only
class Measurements:
    """What a recording shows of contacts beside the motion.

    Attributes
    ----------
    recorded : the motion before it was filtered
    wrenches : forces of plates on bodies, at the motion's times
    plates : what plates measured before it was given to bodies, at the motion's times; as
        `wrenches` where that is not known
    cutoff : of the motion's filter [Hz]
    standing : the motion with feet that stay on the floor, for finding contacts; None where the
        motion itself shows them
    """

    recorded: Motion
    wrenches: Wrenches | None = None
    plates: PlateForces | None = None
    cutoff: float | None = None
    standing: Motion | None = None


def set_contacts(
    plan: ContactPlan, model: Model, motion: Motion, known: Measurements, options: ContactOptions
) -> ContactSetting:
    """Find sites, contact intervals and activations of a motion, and what measured forces show.

    Raises
    ------
    BadData : the model has no site, or contacts are reported for a site that it does not have
    """
    if plan.stairs is not None:
        return _on_stairs(plan.stairs, plan, model, motion, known.wrenches, options)
    standing = known.standing or motion
    visible = None if plan.measured == "hidden" else known.wrenches
    plan = _with_supports(plan, model, standing, visible)
    feet, floor = _feet_and_floor(plan, model, standing, known.wrenches)
    sites = (*feet, *plan.sites)
    if not sites:
        raise BadData(
            f"no contact site: '{model.name}' has no feet, and no site is named; {NAME_SITES}"
        )
    heard = None
    if plan.sound is not None:
        heard = heard_contacts(plan.sound, model, motion, sites, known.recorded, known.cutoff)

    if plan.reported is not None:
        plan = replace(plan, reported=contacts_of_sites(plan.reported, model, standing, sites))
    reported = [] if plan.reported is None else [plan.reported]
    reported += [] if heard is None else [heard.contacts]
    raised = _raised(plan, reported, model, motion, feet)
    reported += [site.contacts for site in raised.values()]
    contacts = _all_contacts(
        plan, reported, model, standing, sites, visible, ContactStateOptions(floor=floor)
    )

    supports = plan.found_supports
    ready = contact_activations(
        model,
        standing,
        sites,
        contacts,
        ActivationOptions(floor=floor, steps=supports.raised(sites, standing.time)),
    )
    ready = _replaced(ready, {name: site.activation for name, site in raised.items()})
    ready = supports.activated(ready, sites)
    plates = _on_plates(plan, model, motion, sites, contacts, known)
    acting = _acting(plan, model, ready, sites, plates, known.wrenches, heard, floor or 0.0)
    task = ContactTask(
        sites=sites,
        activations=acting.ready,
        measured=still_shared(sites, plates) if plan.measured == "shared" else (),
        options=_formulated(options, supports, acting.ready, sites),
        preferred=preferred_directions(model, motion, sites),
    )
    return ContactSetting(
        task=task,
        contacts=contacts,
        exact=acting.exact,
        notes=(*contacts.warnings, *_notes(plan, model, motion, known, feet)),
        supports=supports,
        plates=plates,
        heard=heard,
        alone=acting.alone,
    )


def _with_supports(
    plan: ContactPlan, model: Model, motion: Motion, measured: Wrenches | None
) -> ContactPlan:
    """Find steps, rails and seats where nobody has, and make sites of hands and seat on them.

    Nobody looks for them where contacts are named.
    """
    supports = plan.supports
    if supports is None:
        supports = Supports()
        if plan.feet and not plan.sites and plan.reported is None and plan.sound is None:
            supports = find_supports(model, motion, measured)
    sites = supports.sites(model, plan.sites)
    seats = {site.name: None for site in sites if site.name == "seat"}
    return replace(
        plan,
        supports=supports,
        sites=(*plan.sites, *sites),
        surfaces=FrozenMap({**plan.surfaces, **seats}),
    )


def _formulated(
    options: ContactOptions, supports: Supports, ready: Series, sites: Sequence[Site]
) -> ContactOptions:
    """Find contact forces first where plates and motion determine them.

    That is where only steps, rails and seats are unknown, one at a time: muscles that are too weak
    change nothing of them.

    Parameters
    ----------
    ready : activations (frames, sites) of contacts whose forces are not known
    """
    groups = [site.group for site in sites]
    active = [
        ready.values[:, [group == name for group in groups]].any(axis=1)
        for name in dict.fromkeys(groups)
    ]
    alone = bool(np.sum(active, axis=0).max(initial=0) <= 1)
    return replace(options, formulation="sequential") if supports.alone and alone else options


class _Acting(NamedTuple):
    """Activations of sites whose forces are to be found, and forces that are known.

    Attributes
    ----------
    ready : activations (frames, sites)
    exact : all known forces, None for none
    alone : those of contacts alone on plates
    """

    ready: Series
    exact: Wrenches | None
    alone: AloneOnPlates | None


def _acting(  # page: all that makes forces known
    plan: ContactPlan,
    model: Model,
    ready: Series,
    sites: tuple[Site, ...],
    plates: tuple[SharedWrench, ...],
    measured: Wrenches | None,
    heard: Heard | None,
    floor: float,
) -> _Acting:
    """Silence the sites whose forces are known, and collect these forces.

    Parameters
    ----------
    ready : activations (frames, sites)
    plates : what plates measured of the sites on them
    measured : forces of plates on bodies
    heard : impacts
    floor : height of the plates [m]
    """
    known: list[Wrenches] = []
    alone = None
    if plan.measured == "exact" and measured is not None:
        measured = plan.found_supports.used(measured)
        ready = without_measured(model, ready, sites, measured)
        known.append(measured)
    if heard is not None:
        ready = _replaced(ready, dict.fromkeys(heard.sites, 0.0))
        known.append(heard.forces)
    if plan.measured == "shared":
        alone = alone_on_plates(model, ready.time, sites, plates, floor)
    if alone is not None:
        ready = alone.silenced(ready, sites)
        known.append(alone.forces)
    exact = known[0] if known else None
    for more in known[1:]:
        exact = more if exact is None else exact.and_others(more)
    return _Acting(ready=ready, exact=exact, alone=alone)


class _Soles(NamedTuple):
    """Sites under the feet, and the floor's height [m], None where there are no feet."""

    sites: tuple[Site, ...]
    floor: float | None


def _feet_and_floor(
    plan: ContactPlan, model: Model, motion: Motion, measured: Wrenches | None
) -> _Soles:
    """Put the sites under the feet on the floor, as far as feet take part."""
    feet = _soles(plan, model)
    if not feet:
        return _Soles((), None)
    visible = None if plan.measured == "hidden" else measured
    steps = plan.found_supports.raised(feet, motion.time)
    resting, floor = rest_on_floor(model, motion, feet, plate_height(model, visible), steps)
    return _Soles(resting, floor.height)


def _on_plates(
    plan: ContactPlan,
    model: Model,
    motion: Motion,
    sites: tuple[Site, ...],
    contacts: Contacts,
    known: Measurements,
) -> tuple[SharedWrench, ...]:
    """Find what plates measured of the sites on them; nothing where it acts as it was measured."""
    if plan.measured == "exact" or known.wrenches is None:
        return ()
    plates = known.plates or PlateForces(known.wrenches)
    return shared_wrenches(model, motion, sites, contacts, plates)


def _notes(
    plan: ContactPlan, model: Model, motion: Motion, known: Measurements, feet: tuple[Site, ...]
) -> tuple[Message, ...]:
    """Say which reported contacts lie elsewhere, and which measured forces are misplaced."""
    notes: tuple[Message, ...] = ()
    supports = plan.found_supports
    if supports:
        notes += (
            FEET_BESIDE.message(
                f"{supports.sentence} (--contacts none: what is missing stays at the root)",
                times=tuple(support.rests for support in supports.all),
            ),
        )
    if plan.reported is not None:
        notes += never_during(plan.reported, known.recorded.time)
        notes += unreported_feet(plan.reported, feet)
    if feet and known.wrenches is not None:
        notes += misplaced_forces(model, motion, feet, known.wrenches)
    return notes


def _on_stairs(
    stairs: Stairs,
    plan: ContactPlan,
    model: Model,
    motion: Motion,
    measured: Wrenches | None,
    options: ContactOptions,
) -> ContactSetting:
    """Set paws on steps: their cells tell contacts, and forces for the sites on each step together.

    Loads of a file act as they are; then only steps that these leave out are shared.
    """
    paws = stairs.paws_in(model, motion)
    contacts = stairs_contacts(paws)
    exact = measured if plan.measured == "exact" else None
    ready = contacts.states(motion.time)
    known: set[str] = set()
    if exact is not None:
        ready = without_measured(model, ready, paws.sites, exact)
        known = {
            step.name
            for step in paws.steps
            for site in paws.sites
            if f"{step.name}_{site.body}" in exact.names
        }
    steps = shared_stairs(paws, known)
    task = ContactTask(
        sites=paws.sites,
        activations=ready,
        measured=steps,
        options=options,
        preferred=preferred_directions(model, motion, paws.sites),
    )
    return ContactSetting(task=task, contacts=contacts, exact=exact, notes=paws.notes, plates=steps)


def during(contacts: Contacts, start: float, stop: float) -> Contacts:
    """Cut contacts that always last to a motion's start and stop [s]."""
    intervals = [
        replace(
            interval,
            start=max(interval.start, start) if interval.start <= -FOREVER else interval.start,
            stop=min(interval.stop, stop) if interval.stop >= FOREVER else interval.stop,
        )
        for interval in contacts.intervals
    ]
    return replace(contacts, intervals=tuple(intervals))


def unreported_feet(reported: Contacts, feet: Sequence[Site]) -> tuple[Message, ...]:
    """Note the soles that a file leaves out while it has others.

    Who took their lines away meant that they never touch.
    """
    names = [item.name for item in feet]
    missing = [name for name in names if name not in reported.sites]
    if not missing or len(missing) == len(names):
        return ()
    return (
        CONTACT_TIMES.message(
            f"no contact interval is specified for {', '.join(missing)}: found from the motion",
            severity="good to know",
        ),
    )


def never_during(reported: Contacts, time: Array) -> tuple[Message, ...]:
    """Note the sites whose contacts all lie before or after a motion.

    Parameters
    ----------
    reported : contacts of a file, or of sound
    time : (frames,) of the motion [s]

    Returns
    -------
    one note per site
    """
    start = float(time[0])
    stop = float(time[-1])
    notes = []
    for name in reported.sites:
        contacts = reported.of(name)
        elsewhere = all(contact.stop < start or contact.start > stop for contact in contacts)
        if not contacts or not elsewhere:
            continue
        first = min(contact.start for contact in contacts)
        last = max(contact.stop for contact in contacts)
        until = "on" if last >= FOREVER else f"to {last:g} s"
        notes.append(
            CONTACT_TIMES.message(
                f"'{name}' is specified to touch from {first:g} s {until}, the motion is"
                f" {start:g} to {stop:g} s: it never touches"
            )
        )
    return tuple(notes)


def _soles(plan: ContactPlan, model: Model) -> tuple[Site, ...]:
    """Sites under the feet, where they are asked for.

    There are none of a model without feet whose sites are named.
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
    """Join contacts that files and sound report with those of plates and motion."""
    supports = plan.found_supports
    reported = [*reported, supports.rail_contacts()]
    known = {name for contacts in reported for name in contacts.sites}
    _refuse_unknown_sites(known, sites)
    by_motion = [
        site
        for site in sites
        if plan.when.get(site.name, "motion") == "motion" and site.name not in known
    ]
    standing = tuple(site for site in by_motion if site.against == GROUND)
    holding = tuple(site for site in by_motion if site.against != GROUND)
    parts = [*reported]
    if standing:
        options = replace(options, steps=supports.raised(standing, motion.time))
        parts.append(find_contacts(model, motion, standing, options, measured))
    if holding:
        parts.append(find_holds(model, motion, holding))
    return supports.cut(_joined(parts, sites), sites)


def _refuse_unknown_sites(names: set[str], sites: Sequence[Site]) -> None:
    """Raise where contacts are reported for sites that do not exist."""
    existing = [site.name for site in sites]
    groups = dict.fromkeys(site.group for site in sites)
    for name in sorted(names):
        if name not in existing:
            raise BadData(
                f"contact intervals are specified for '{name}', but the contact sites are"
                f" {', '.join(existing)}; all of one together: {', '.join(groups)}"
            )


def _joined(parts: Sequence[Contacts], sites: Sequence[Site]) -> Contacts:
    """Contacts of all sites.

    Tables seldom name the surface: that of a site against a body is this body.
    """
    against = {site.name: site.against for site in sites}
    intervals = []
    warnings: list[Message] = []
    for part in parts:
        warnings += part.warnings
        for contact in part.intervals:
            surface = against[contact.site] if contact.surface == GROUND else contact.surface
            intervals.append(replace(contact, surface=surface))
    return Contacts(tuple(site.name for site in sites), tuple(intervals), tuple(warnings))


def _raised(
    plan: ContactPlan,
    reported: Sequence[Contacts],
    model: Model,
    motion: Motion,
    soles: Sequence[Site],
) -> dict[str, RaisedContact]:
    """Contacts of sites that rest on something else than the floor, by the motion.

    Sites that a file or sound reports are left out.
    """
    known = {name for contacts in reported for name in contacts.sites}
    raised = {}
    for site in plan.sites:
        if site.name in plan.surfaces and site.against == GROUND and site.name not in known:
            surface = plan.surfaces[site.name]
            raised[site.name] = raised_contacts(model, motion, site, soles, surface)
    return raised


def _replaced(ready: Series, columns: Mapping[str, Array | float]) -> Series:
    """Replace the activations of some sites: by name, (frames,) or one for all frames."""
    values = np.array(ready.values)
    for name, column in columns.items():
        values[:, ready.names.index(name)] = column
    return replace(ready, values=values)


def all_loads(exact: Wrenches | None, estimated: ContactForces) -> Wrenches:
    """Every force that acted on the bodies, one load per body: measured ones and of contacts.

    Parameters
    ----------
    exact : measured forces, None where there are none
    estimated : forces at contact sites
    """
    result = estimated.wrenches("body")
    if exact is None:
        return result
    bodies = tuple(dict.fromkeys((*exact.bodies, *result.bodies)))
    forces = np.zeros((len(result), len(bodies), 3))
    points = np.zeros_like(forces)
    torques = np.zeros_like(forces)
    for j, body in enumerate(bodies):
        load = _load_on(body, (exact, result))
        forces[:, j] = load.force
        points[:, j] = load.point
        torques[:, j] = load.torque
    return Wrenches(
        time=result.time,
        names=bodies,
        bodies=bodies,
        forces=forces,
        points=points,
        torques=torques,
    )


class _BodyLoad(NamedTuple):
    """Force [N], its point [m] and torque about it [N m], (frames, 3) each."""

    force: Array
    point: Array
    torque: Array


def _load_on(body: str, loads: Sequence[Wrenches]) -> _BodyLoad:
    """Sum of all loads on a body, at the mean of their points weighted by their sizes."""
    parts = [(part, i) for part in loads for i, other in enumerate(part.bodies) if other == body]
    # (loads, frames, 3)
    force = np.stack([part.forces[:, i] for part, i in parts])
    point = np.nan_to_num(np.stack([part.points[:, i] for part, i in parts]))
    torque = np.stack([part.torques[:, i] for part, i in parts])
    size = np.linalg.norm(force, axis=2, keepdims=True)
    share = size / np.where(size.sum(axis=0) > 0.0, size.sum(axis=0), 1.0)
    middle = (share * point).sum(axis=0)
    return _BodyLoad(
        force=force.sum(axis=0),
        point=middle,
        torque=(torque + np.cross(point - middle, force)).sum(axis=0),
    )
