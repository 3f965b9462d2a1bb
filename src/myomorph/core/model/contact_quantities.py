"""Quantities of contacts: forces at sites, and intervals in which they touch."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

BY_SITE = ("time", "contact_site", "axis")
INTERVAL = ("contact_interval",)

FORCES = (
    Quantity(
        name="contact_activation",
        dims=("time", "contact_site"),
        unit="1",
        meaning="activation of a contact, 0 to 1",
    ),
    Quantity(
        name="contact_force",
        dims=BY_SITE,
        unit="N",
        meaning="estimated force on the body at a contact site, in ground",
    ),
    Quantity(
        name="contact_point",
        dims=BY_SITE,
        unit="m",
        meaning="center of pressure of a contact site, in ground",
    ),
    Quantity(
        name="contact_torque",
        dims=BY_SITE,
        unit="N m",
        meaning="free torque about that point, in ground",
    ),
)

TOUCHES = (
    Quantity(
        name="contact_interval_site",
        dims=INTERVAL,
        unit="",
        meaning="site that touches",
        attribute="site",
        kind="text",
    ),
    Quantity(
        name="contact_interval_start",
        dims=INTERVAL,
        unit="s",
        meaning="when a site begins to touch",
        attribute="start",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_stop",
        dims=INTERVAL,
        unit="s",
        meaning="when it ends",
        attribute="stop",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_confidence",
        dims=INTERVAL,
        unit="1",
        meaning="how sure that is",
        attribute="confidence",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_surface",
        dims=INTERVAL,
        unit="",
        meaning="what it touches",
        attribute="surface",
        kind="text",
    ),
    Quantity(
        name="contact_interval_source",
        dims=INTERVAL,
        unit="",
        meaning="what shows that it touches",
        attribute="source",
        kind="text",
    ),
)

QUANTITIES = (*FORCES, *TOUCHES)
