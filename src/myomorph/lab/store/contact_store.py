"""Contacts and their forces in result files: of sites, and at contact points of joints."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.contact.impacts import Impact
from myomorph.core.model.contact_quantities import FORCES, IMPACTS, PLATE_FORCE, TOUCHES
from myomorph.core.model.contacts import (
    ContactForces,
    Contacts,
    SharedWrench,
    Site,
    Touch,
    contact_law,
)
from myomorph.core.model.labelled import AXES
from myomorph.core.model.messages import messages_of, messages_text
from myomorph.core.model.series import Series
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.load_quantities import (
    CONTACT_INTERVALS,
    INFEASIBLE_CONTACTS,
    INTERVAL_HIGH,
    INTERVAL_LOW,
    INTERVAL_TIME,
    JOINT_CONTACT_JOINT,
    JOINT_CONTACT_POINT,
    JOINT_CONTACTS,
)
from myomorph.core.tension.quantities import GENERALIZED_FORCE_WITH_CONTACTS
from myomorph.lab.report.trial.report_input import (
    ForceIntervals,
    HeardImpact,
    InfeasibleContact,
    PlateForce,
    Situation,
)
from myomorph.lab.store.quantities import (
    get_fields,
    get_quantity,
    get_rows,
    put_quantity,
    put_rows,
    put_value,
    value_of,
)
from myomorph.lab.store.results import ResultWriter, Stored
from myomorph.lab.store.stored import get_series

if TYPE_CHECKING:
    from myomorph.core.tension.certificates import ContactIntervals
    from myomorph.core.tension.relaxation import Relaxation

SITES = "contact_sites"
CHECKED = "contact_sites_checked"
WARNINGS = "contact_warnings"
SITUATION = "contact_situation"
ON_PLATES = "loaded_plate_sites"

JOINT_WEIGHT = "joint_contact_body_weight"


def put_contact_forces(writer: ResultWriter, contact_forces: ContactForces) -> None:
    """Write forces at contact sites, and what the sites are."""
    writer.fact(SITES, json.dumps([_plain_site(site) for site in contact_forces.sites]))
    put_value(writer, contact_forces)


def get_contact_forces(stored: Stored) -> ContactForces | None:
    """Read what `put_contact_forces` wrote, or None."""
    fields = get_fields(stored, FORCES)
    if "contact_force" not in fields:
        return None
    sites = tuple(_site(load) for load in json.loads(stored.facts[SITES]))
    return value_of(ContactForces, fields, {"time": stored.time, "sites": sites})


def put_contacts(
    writer: ResultWriter, contacts: Contacts, situation: Situation = "unknown"
) -> None:
    """Which site touches what, and when, and how the forces came to be known."""
    writer.fact(SITUATION, situation)
    writer.fact(CHECKED, json.dumps(contacts.sites))
    writer.fact(WARNINGS, messages_text(contacts.warnings))
    put_rows(writer, TOUCHES, contacts.intervals)


def get_contacts(stored: Stored) -> Contacts | None:
    """Read what `put_contacts` wrote, or None."""
    if CHECKED not in stored.facts:
        return None
    return Contacts(
        sites=tuple(json.loads(stored.facts[CHECKED])),
        intervals=get_rows(stored, TOUCHES, Touch) or (),
        warnings=messages_of(stored.facts[WARNINGS]),
    )


def put_plate_forces(writer: ResultWriter, plates: Sequence[SharedWrench]) -> None:
    """Write what plates measured of the contacts on them, and which these are."""
    if not plates:
        return
    writer.fact(ON_PLATES, json.dumps([list(plate.sites) for plate in plates]))
    labels = {"loaded_plate": [plate.name for plate in plates], "axis": AXES}
    forces = np.stack([plate.forces for plate in plates], axis=1)
    put_quantity(writer, PLATE_FORCE, forces, labels)


def get_plate_forces(stored: Stored) -> tuple[PlateForce, ...]:
    """Read what `put_plate_forces` wrote; none where plates measured nothing of contacts."""
    forces = get_quantity(stored, PLATE_FORCE)
    if forces is None:
        return ()
    sites = json.loads(stored.facts[ON_PLATES])
    return tuple(
        PlateForce(name=name, sites=tuple(sites[index]), forces=forces[:, index])
        for index, name in enumerate(stored.names["loaded_plate"])
    )


def put_impacts(writer: ResultWriter, impacts: Sequence[Impact]) -> None:
    """Write impacts that were heard; none too, so that it is known to be empty."""
    put_rows(writer, IMPACTS, impacts)


def get_impacts(stored: Stored) -> tuple[HeardImpact, ...]:
    """Read what `put_impacts` wrote."""
    return get_rows(stored, IMPACTS, HeardImpact) or ()


def put_forces_with_contacts(writer: ResultWriter, torques: Series) -> None:
    """Generalized forces under all external forces, those of estimated contacts included."""
    put_value(writer, replace(torques, quantity=GENERALIZED_FORCE_WITH_CONTACTS))


def get_forces_with_contacts(stored: Stored) -> Series | None:
    """Read what `put_forces_with_contacts` wrote, or None."""
    return get_series(stored, GENERALIZED_FORCE_WITH_CONTACTS)


def get_situation(stored: Stored) -> Situation:
    """How the forces of contacts came to be known; "" where none were estimated."""
    situation: Situation = stored.facts.get(SITUATION, "")  # type: ignore[assignment]
    return situation


def put_warnings(
    writer: ResultWriter, intervals: ContactIntervals | None, infeasible: Sequence[Relaxation]
) -> None:
    """Intervals and frames that could not be carried, in a result file."""
    put_rows(writer, INFEASIBLE_CONTACTS, infeasible)
    if intervals is None:
        return
    labels = {"contact_group": intervals.groups, "axis": AXES}
    for quantity in CONTACT_INTERVALS:
        put_quantity(writer, quantity, quantity.of(intervals), labels)


def get_intervals(stored: Stored) -> ForceIntervals | None:
    """Intervals of contact forces of a result, or None."""
    fields = get_fields(stored, (INTERVAL_TIME, INTERVAL_LOW, INTERVAL_HIGH))
    if INTERVAL_LOW.field not in fields:
        return None
    return ForceIntervals(
        time=fields["time"],
        names=stored.names["contact_group"],
        lower=fields["low"],
        upper=fields["high"],
    )


def get_infeasible_contacts(stored: Stored) -> tuple[InfeasibleContact, ...]:
    """Frames of a result that its contacts cannot carry."""
    times = stored.values.get("infeasible_contact_time", ())
    texts = stored.names.get("infeasible_contact_relaxation", ())
    return tuple(
        InfeasibleContact(float(time), text) for time, text in zip(times, texts, strict=True)
    )


def put_joint_contacts(writer: ResultWriter, contacts: JointContactForces) -> None:
    """Write forces at contact points, those of their joints, and what the points do not carry."""
    put_value(writer, contacts)
    for quantity in (JOINT_CONTACT_POINT, JOINT_CONTACT_JOINT):
        put_quantity(writer, quantity, quantity.of(contacts))
    writer.fact(JOINT_WEIGHT, repr(contacts.weight))


def get_joint_contacts(stored: Stored) -> JointContactForces | None:
    """Read what `put_joint_contacts` wrote, or None."""
    fields = get_fields(stored, (*JOINT_CONTACTS, JOINT_CONTACT_POINT, JOINT_CONTACT_JOINT))
    if "joint_contact_force" not in fields:
        return None
    others = {
        "time": stored.time,
        "joints": stored.names["contact_joint"],
        "weight": float(stored.facts[JOINT_WEIGHT]),
    }
    return value_of(JointContactForces, fields, others)


def _plain_site(site: Site) -> dict[str, Any]:
    return {
        "name": site.name,
        "body": site.body,
        "points": site.points.tolist(),
        "against": site.against,
        "group": site.group,
        "cone": site.cone.plain(),
    }


def _site(plain: dict[str, Any]) -> Site:
    # Results of 34e3048 and before know one law.
    numbers = {"law": "pyramid"} | plain["cone"]
    cone = contact_law(numbers.pop("law"))(**numbers)
    return Site(
        name=plain["name"],
        body=plain["body"],
        points=np.array(plain["points"]),
        cone=cone,
        against=plain["against"],
        group=plain["group"],
    )
