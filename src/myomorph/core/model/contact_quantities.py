"""Quantities of contacts: forces at sites, and intervals in which they touch."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

BY_SITE = ("time", "contact_site", "axis")
INTERVAL = ("contact_interval",)
IMPACT = ("impact",)
IMPACT_TABLE = "impacts.csv"

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
        meaning="site in contact",
        attribute="site",
        kind="text",
    ),
    Quantity(
        name="contact_interval_start",
        dims=INTERVAL,
        unit="s",
        meaning="start of the contact",
        attribute="start",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_stop",
        dims=INTERVAL,
        unit="s",
        meaning="end of the contact",
        attribute="stop",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_confidence",
        dims=INTERVAL,
        unit="1",
        meaning="confidence of the contact, 0 to 1",
        attribute="confidence",
        file="contacts.csv",
    ),
    Quantity(
        name="contact_interval_surface",
        dims=INTERVAL,
        unit="",
        meaning="surface in contact with the site",
        attribute="surface",
        kind="text",
    ),
    Quantity(
        name="contact_interval_source",
        dims=INTERVAL,
        unit="",
        meaning="evidence of the contact",
        attribute="source",
        kind="text",
    ),
)

PLATE_FORCE = Quantity(
    name="plate_force",
    dims=("time", "loaded_plate", "axis"),
    unit="N",
    meaning="force that a plate measured of the contacts on it; NaN while others are on it",
)

IMPACTS = (
    Quantity(
        name="impact_time",
        dims=IMPACT,
        unit="s",
        meaning="start of an impact that was heard",
        attribute="time",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_site",
        dims=IMPACT,
        unit="",
        meaning="contact that made the impact",
        attribute="site",
        kind="text",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_instrument",
        dims=IMPACT,
        unit="",
        meaning="object that was struck",
        attribute="instrument",
        kind="text",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_impulse",
        dims=IMPACT,
        unit="N s",
        meaning="impulse of an impact",
        attribute="impulse",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_impulse_low",
        dims=IMPACT,
        unit="N s",
        meaning="lower bound of the 90 % interval of an impulse, NaN where it is not identifiable",
        attribute="low",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_impulse_high",
        dims=IMPACT,
        unit="N s",
        meaning="upper bound of the 90 % interval of an impulse",
        attribute="high",
        file=IMPACT_TABLE,
    ),
    Quantity(
        name="impact_site_confidence",
        dims=IMPACT,
        unit="1",
        meaning="probability that this contact made the impact",
        attribute="confidence",
        file=IMPACT_TABLE,
    ),
)

QUANTITIES = (*FORCES, *TOUCHES, PLATE_FORCE, *IMPACTS)
