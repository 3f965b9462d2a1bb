"""Contacts and their forces in result files: of sites, and at contact points of joints."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from myomorph.core.model.contacts import ContactForces, Contacts, Site, Touch, contact_law
from myomorph.core.model.series import Series
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.lab.report.trial.report_input import ForceIntervals, InfeasibleContact, Situation
from myomorph.lab.store.results import ResultWriter, Stored

if TYPE_CHECKING:
    from myomorph.core.tension.certificates import ContactIntervals
    from myomorph.core.tension.relaxation import Relaxation

SITES = "contact_sites"
CHECKED = "contact_sites_checked"
WARNINGS = "contact_warnings"
SITUATION = "contact_situation"

JOINT_MEANINGS = {
    "joint_contact_force": "force at a contact point of a joint, along its normal",
    "joint_contact_total": "size of the joint's whole force",
    "joint_contact_shear": "force across the mean normal, which the contact points do not carry",
    "joint_contact_unbalanced_force": "force along the mean normal that would pull",
    "joint_contact_unbalanced_moment": "moment that is left where contact points have lifted off",
}
JOINT_WEIGHT = "joint_contact_body_weight"

INTERVAL_NUMBERS = (
    ("start", "s", "when a site begins to touch"),
    ("stop", "s", "when it ends"),
    ("confidence", "1", "how sure that is"),
)
INTERVAL_TEXTS = ("site", "surface", "source")


def put_contact_forces(writer: ResultWriter, contact_forces: ContactForces) -> None:
    """Forces at contact sites, and what the sites are."""
    writer.time(contact_forces.time)
    writer.names("contact_site", contact_forces.names)
    writer.names("axis", ("x", "y", "z"))
    writer.fact(SITES, json.dumps([_plain_site(site) for site in contact_forces.sites]))
    three = ("time", "contact_site", "axis")
    ready = contact_forces.activations
    writer.put(
        "contact_activation",
        ("time", "contact_site"),
        ready,
        "1",
        "activation of a contact, 0 to 1",
    )
    writer.put(
        "contact_force",
        three,
        contact_forces.forces,
        "N",
        "estimated force on the body at a contact site, in ground",
    )
    writer.put(
        "contact_point",
        three,
        contact_forces.points,
        "m",
        "center of pressure of a contact site, in ground",
    )
    writer.put(
        "contact_torque",
        three,
        contact_forces.torques,
        "N m",
        "free torque about that point, in ground",
    )


def get_contact_forces(stored: Stored) -> ContactForces | None:
    """What `put_contact_forces` wrote, or None."""
    values = stored.values
    if "contact_force" not in values:
        return None
    sites = tuple(_site(load) for load in json.loads(stored.facts[SITES]))
    parts = (values[f"contact_{name}"] for name in ("activation", "force", "point", "torque"))
    return ContactForces(stored.time, sites, *parts)


def put_contacts(
    writer: ResultWriter, contacts: Contacts, situation: Situation = "unknown"
) -> None:
    """Which site touches what, and when, and how the forces came to be known."""
    writer.fact(SITUATION, situation)
    writer.fact(CHECKED, json.dumps(contacts.sites))
    writer.fact(WARNINGS, json.dumps(contacts.warnings))
    writer.sizes("contact_interval", len(contacts.intervals))
    for name, unit, meaning in INTERVAL_NUMBERS:
        values = np.array(
            [getattr(interval, name) for interval in contacts.intervals], dtype=np.float64
        )
        writer.put(f"contact_interval_{name}", ("contact_interval",), values, unit, meaning)
    for name in INTERVAL_TEXTS:
        writer.texts(
            f"contact_interval_{name}",
            "contact_interval",
            [getattr(interval, name) for interval in contacts.intervals],
        )


def get_contacts(stored: Stored) -> Contacts | None:
    """What `put_contacts` wrote, or None."""
    if CHECKED not in stored.facts:
        return None
    numbers = [
        stored.values[f"contact_interval_{name}"].tolist() for name, _, _ in INTERVAL_NUMBERS
    ]
    texts = [stored.names.get(f"contact_interval_{name}", ()) for name in INTERVAL_TEXTS]
    names = (*(name for name, _, _ in INTERVAL_NUMBERS), *INTERVAL_TEXTS)
    intervals = tuple(
        Touch(**dict(zip(names, row, strict=True))) for row in zip(*numbers, *texts, strict=True)
    )
    return Contacts(
        tuple(json.loads(stored.facts[CHECKED])),
        intervals,
        tuple(json.loads(stored.facts[WARNINGS])),
    )


def put_forces_with_contacts(writer: ResultWriter, torques: Series) -> None:
    """Generalized forces under all external forces, those of estimated contacts included."""
    writer.names("coordinate", torques.names)
    meaning = "generalized force of inverse dynamics with estimated contacts"
    writer.put(
        "generalized_force_with_contacts",
        ("time", "coordinate"),
        torques.values,
        "N m or N",
        meaning,
    )


def get_forces_with_contacts(stored: Stored) -> Series | None:
    """What `put_forces_with_contacts` wrote, or None."""
    forces = stored.values.get("generalized_force_with_contacts")
    return None if forces is None else Series(stored.time, stored.names["coordinate"], forces)


def get_situation(stored: Stored) -> Situation:
    """How the forces of contacts came to be known; "" where none were estimated."""
    situation: Situation = stored.facts.get(SITUATION, "")  # type: ignore[assignment]
    return situation


def put_warnings(
    writer: ResultWriter, intervals: ContactIntervals | None, infeasible: Sequence[Relaxation]
) -> None:
    """Intervals and frames that could not be carried, in a result file."""
    writer.sizes("infeasible_contact", len(infeasible))
    times = np.array([relaxation.time for relaxation in infeasible], dtype=np.float64)
    writer.put(
        "infeasible_contact_time",
        ("infeasible_contact",),
        times,
        "s",
        "frame whose contacts are infeasible",
    )
    writer.texts(
        "infeasible_contact_relaxation",
        "infeasible_contact",
        [relaxation.sentence for relaxation in infeasible],
    )
    if intervals is None:
        return
    writer.names("contact_group", intervals.groups)
    writer.names("axis", ("x", "y", "z"))
    writer.sizes("interval_time", len(intervals))
    asked = "instants at which it was asked what is left open"
    writer.put("interval_time", ("interval_time",), intervals.time, "s", asked)
    writer.texts("max_interval_direction", "interval_time", intervals.sentences)
    three = ("interval_time", "contact_group", "axis")
    for name, meaning in (
        ("low", "least force that the data allow"),
        ("high", "greatest force that the data allow"),
        ("near_low", "least force among solutions near the optimum"),
        ("near_high", "greatest force among solutions near the optimum"),
    ):
        writer.put(f"interval_{name}", three, getattr(intervals, name), "N", meaning)


def get_intervals(stored: Stored) -> ForceIntervals | None:
    """Intervals of contact forces of a result, or None."""
    values = stored.values
    if "interval_low" not in values:
        return None
    names = stored.names["contact_group"]
    return ForceIntervals(
        time=values["interval_time"],
        names=names,
        lower=values["interval_low"],
        upper=values["interval_high"],
    )


def get_infeasible_contacts(stored: Stored) -> tuple[InfeasibleContact, ...]:
    """Frames of a result that its contacts cannot carry."""
    times = stored.values.get("infeasible_contact_time", ())
    texts = stored.names.get("infeasible_contact_relaxation", ())
    return tuple(
        InfeasibleContact(float(time), text) for time, text in zip(times, texts, strict=True)
    )


def put_joint_contacts(writer: ResultWriter, contacts: JointContactForces) -> None:
    """Forces at contact points, those of their joints, and what the points do not carry."""
    writer.time(contacts.time)
    writer.names("joint_contact", contacts.point_columns)
    writer.names("contact_joint", contacts.joints)
    writer.texts("joint_contact_point", "joint_contact", contacts.points)
    writer.texts("joint_contact_joint", "joint_contact", contacts.joint_of)
    writer.fact(JOINT_WEIGHT, repr(contacts.weight))
    for name, variable in contacts.variables().items():
        writer.put(name, variable.dimensions, variable.values, variable.unit, JOINT_MEANINGS[name])


def get_joint_contacts(stored: Stored) -> JointContactForces | None:
    """What `put_joint_contacts` wrote, or None."""
    values = stored.values
    names = stored.names
    if "joint_contact_force" not in values:
        return None
    return JointContactForces(
        time=stored.time,
        joints=names["contact_joint"],
        points=names["joint_contact_point"],
        joint_of=names["joint_contact_joint"],
        forces=values["joint_contact_force"],
        totals=values["joint_contact_total"],
        shear=values["joint_contact_shear"],
        unbalanced_forces=values["joint_contact_unbalanced_force"],
        unbalanced_moments=values["joint_contact_unbalanced_moment"],
        weight=float(stored.facts[JOINT_WEIGHT]),
    )


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
    return Site(**{**plain, "points": np.array(plain["points"]), "cone": cone})
