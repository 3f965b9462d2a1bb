"""Contacts and their forces in result files."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from myomorph.model.contacts import Cone, ContactForces, Contacts, Site, Touch
from myomorph.model.series import Series
from myomorph.report.trial.given import Situation
from myomorph.store.results import ResultWriter, Stored

SITES, CHECKED, WARNINGS = "contact_sites", "contact_sites_checked", "contact_warnings"
SITUATION = "contact_situation"

INTERVAL_NUMBERS = (
    ("start", "s", "when a site begins to touch"),
    ("stop", "s", "when it ends"),
    ("confidence", "1", "how sure that is"),
)
INTERVAL_TEXTS = ("site", "surface", "source")


def put_contact_forces(writer: ResultWriter, found: ContactForces) -> None:
    """Forces at contact sites, and what the sites are."""
    writer.time(found.time)
    writer.names("contact_site", found.names)
    writer.names("axis", ("x", "y", "z"))
    writer.fact(SITES, json.dumps([_plain_site(one) for one in found.sites]))
    three = ("time", "contact_site", "axis")
    writer.put("contact_activation", ("time", "contact_site"), found.strengths, "1", "activation of a contact, 0 to 1")
    writer.put("contact_force", three, found.forces, "N", "estimated force on the body at a contact site, in ground")
    writer.put("contact_point", three, found.points, "m", "center of pressure of a contact site, in ground")
    writer.put("contact_torque", three, found.torques, "N m", "free torque about that point, in ground")


def get_contact_forces(stored: Stored) -> ContactForces | None:
    """What `put_contact_forces` wrote, or None."""
    values = stored.values
    if "contact_force" not in values:
        return None
    sites = tuple(_site(one) for one in json.loads(stored.facts[SITES]))
    parts = (values[f"contact_{name}"] for name in ("activation", "force", "point", "torque"))
    return ContactForces(stored.time, sites, *parts)


def put_contacts(writer: ResultWriter, contacts: Contacts, situation: Situation = "unknown") -> None:
    """Which site touches what, and when, and how the forces came to be known."""
    writer.fact(SITUATION, situation)
    writer.fact(CHECKED, json.dumps(contacts.sites))
    writer.fact(WARNINGS, json.dumps(contacts.warnings))
    writer.sizes("contact_interval", len(contacts.intervals))
    for name, unit, meaning in INTERVAL_NUMBERS:
        values = np.array([getattr(one, name) for one in contacts.intervals], dtype=np.float64)
        writer.put(f"contact_interval_{name}", ("contact_interval",), values, unit, meaning)
    for name in INTERVAL_TEXTS:
        writer.texts(f"contact_interval_{name}", "contact_interval", [getattr(one, name) for one in contacts.intervals])


def get_contacts(stored: Stored) -> Contacts | None:
    """What `put_contacts` wrote, or None."""
    if CHECKED not in stored.facts:
        return None
    numbers = [stored.values[f"contact_interval_{name}"].tolist() for name, _, _ in INTERVAL_NUMBERS]
    texts = [stored.names.get(f"contact_interval_{name}", ()) for name in INTERVAL_TEXTS]
    names = (*(name for name, _, _ in INTERVAL_NUMBERS), *INTERVAL_TEXTS)
    intervals = tuple(Touch(**dict(zip(names, row, strict=True))) for row in zip(*numbers, *texts, strict=True))
    return Contacts(tuple(json.loads(stored.facts[CHECKED])), intervals, tuple(json.loads(stored.facts[WARNINGS])))


def put_forces_with_contacts(writer: ResultWriter, torques: Series) -> None:
    """Generalized forces under all external forces, those of estimated contacts included."""
    writer.names("coordinate", torques.names)
    meaning = "generalized force of inverse dynamics with estimated contacts"
    writer.put("generalized_force_with_contacts", ("time", "coordinate"), torques.values, "N m or N", meaning)


def get_forces_with_contacts(stored: Stored) -> Series | None:
    """What `put_forces_with_contacts` wrote, or None."""
    found = stored.values.get("generalized_force_with_contacts")
    return None if found is None else Series(stored.time, stored.names["coordinate"], found)


def get_situation(stored: Stored) -> Situation:
    """How the forces of contacts came to be known; "" where none were estimated."""
    told: Situation = stored.facts.get(SITUATION, "")  # type: ignore[assignment]
    return told


def _plain_site(site: Site) -> dict[str, Any]:
    cone = {name: getattr(site.cone, name) for name in ("frame", "friction", "torsion", "grip", "edges", "most")}
    direction = None if site.cone.direction is None else site.cone.direction.tolist()
    return {
        "name": site.name,
        "body": site.body,
        "points": site.points.tolist(),
        "against": site.against,
        "group": site.group,
        "cone": {"direction": direction, **cone},
    }


def _site(plain: dict[str, Any]) -> Site:
    return Site(**{**plain, "points": np.array(plain["points"]), "cone": Cone(**plain["cone"])})
