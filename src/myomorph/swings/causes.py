"""Causes of the messages that swings of a limb make."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

SWINGS = Cause(
    key="swings",
    title="Swings with too little information",
    severity="changes results",
    effect="Viscosity, or that of an axis, has a wide interval.",
    remedy="Release the limb from farther out, about every axis, and more often.",
)
PLATE = Cause(
    key="swing_plate",
    title="The plate below the joint",
    severity="changes results",
    effect="Mass, mass center and viscosity of the limb follow the plate's zero and loads.",
    remedy="Set zero with the fixture alone, and let nothing else touch the plate.",
)
LIMB = Cause(
    key="limb",
    title="Identified limb that does not explain the wrench",
    severity="changes results",
    effect="Neither inertia nor viscosity can be trusted.",
    remedy="Swing it about every axis, and check the joint's center.",
)
TRACKING = Cause(
    key="tracking",
    title="Markers and clusters that slip or are hidden",
    severity="may change results",
    effect="The motion of the limb is known less well.",
    remedy="Look at clusters, wires and base, and label lost markers.",
)
